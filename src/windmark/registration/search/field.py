"""What is known of a deformation before the picture: it is smooth, small, and mostly across the model's flat side.

The displacement of the markers is a Gaussian process over the model (Rasmussen and Williams 2006, chapter 2):
squared exponential correlation, one amplitude for each principal axis of the markers. Its strongest eigenvectors are
the *modes*; with them it is a few parameters whose prior is the unit normal distribution, to be solved for beside the
pose. Wings bend and twist out of their plane, so the thinnest axis has the full amplitude and the others less. The
modes hold rigid motions, too; these cost nothing as a pose and something as a deformation, so they go to the pose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Array = NDArray[np.float64]

REACH = 1.2
"""Correlation length, in root mean square distances of the markers from their centre."""
STIFF = 0.1
"""Least amplitude along a wide axis, as part of that along the thinnest one."""
MOST_MODES = 24
LANDMARKS = 600
"""The modes of more markers are those of about so many of them: the process is far smoother than they are apart."""
FAINT = 0.01
"""Modes with an amplitude below this part of the strongest one's are left out."""


def extents(xyz: Array) -> tuple[Array, Array]:
    """Principal axes (3, 3) of markers (N, 3) as rows, widest first, and the extent (3,) along each."""
    from_centre = xyz - xyz.mean(axis=0)
    axes = np.linalg.svd(from_centre, full_matrices=False)[2]
    return axes, np.ptp(from_centre @ axes.T, axis=0)


def modes_of(xyz: Array, rigid: NDArray[np.bool_]) -> Array:
    """(K, N, 3) displacements of markers (N, 3) of the unit model by 1 sigma of a prior of unit amplitude.

    Markers that are ``rigid`` (N,) do not move.
    """
    soft = np.flatnonzero(~rigid)
    count = min(len(soft), MOST_MODES)
    shape = np.zeros((count, len(xyz)))
    if count:
        some = soft[:: -(-len(soft) // LANDMARKS)]
        last = (max(len(some) - count, 0), len(some) - 1)
        value, vector = eigh(_correlation(xyz[some], xyz[some]), subset_by_index=last)
        value = np.maximum(value, FAINT**2 * value[-1])
        # The process at the landmarks, carried to all (Nystroem's method); exact where these are all.
        shape = np.zeros((len(value), len(xyz)))
        shape[:, soft] = (_correlation(xyz[soft], xyz[some]) @ (vector / np.sqrt(value))).T[::-1]
    strength = np.sqrt((shape**2).mean(axis=1))
    modes = []
    for axis, stiff in zip(*amplitudes(xyz), strict=True):
        kept = shape[strength * stiff > FAINT * strength.max(initial=0.0)]
        modes.append(stiff * kept[:, :, None] * axis)
    return np.concatenate(modes)


def _correlation(a: Array, b: Array) -> Array:
    """(A, B) of the process at places (A, 3) and (B, 3)."""
    distance2 = sum((a[:, None, axis] - b[None, :, axis]) ** 2 for axis in range(3))
    return np.asarray(np.exp(-0.5 * distance2 / REACH**2))


def amplitudes(xyz: Array) -> tuple[Array, Array]:
    """Principal axes (3, 3) as rows, and the amplitude (3,) along each: one for the thinnest, less for wider ones."""
    axes, extent = extents(xyz)
    return axes, np.array([max(STIFF, extent[2] / extent[0]), max(STIFF, extent[2] / extent[1]), 1.0])
