"""What is known of a deformation before the picture: it is smooth, small, and mostly across the model's flat side.

The displacement of the markers is a Gaussian process over the model (Rasmussen and Williams 2006, chapter 2):
squared exponential correlation, one amplitude for each principal axis of the markers. Its strongest eigenvectors are
the *modes*; with them it is a few parameters whose prior is the unit normal distribution, to be solved for beside the
pose. Wings bend and twist out of their plane, so the thinnest axis has the full amplitude and the others less. The
modes hold rigid motions, too; these cost nothing as a pose and something as a deformation, so they go to the pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from windmark.geometry.rotations import hat

Array = NDArray[np.float64]

REACH, FAR = 1.2, 3.0
"""Correlation lengths, in root mean square distances of the markers from their centre: of a deformation that labels are
found with, and of one that is hardly more than a bow."""
STIFF, SUPPLE = 0.1, 0.3
"""Least amplitude along a wide axis, as part of that along the thinnest one: of a model whose labels are not known yet,
and of one that may be sheared, too."""
MOST_MODES = 24
LANDMARKS = 600
"""The modes of more markers are those of about so many of them: the process is far smoother than they are apart."""
FAINT, FAINTEST = 0.01, 1e-4
"""Modes with an amplitude below this part of the strongest one's are left out: where labels are found, whose gates are
open by more than that, and where the pose is told, which takes up whatever is left out and larger than the noise."""


def extents(xyz: Array) -> tuple[Array, Array]:
    """Principal axes (3, 3) of markers (N, 3) as rows, widest first, and the extent (3,) along each."""
    from_centre = xyz - xyz.mean(axis=0)
    # Of fewer than three markers the axes that they do not span, too.
    axes = np.linalg.svd(from_centre, full_matrices=len(xyz) < 3)[2]
    return axes, np.ptp(from_centre @ axes.T, axis=0)


@dataclass(frozen=True, eq=False)
class Field:
    """A deformation of one reach, of unit amplitude along all axes.

    Parameters
    ----------
    modes : (K, N, 3) displacement of the markers of the unit model by 1 sigma of each mode
    motions : (N, 6, K) the rigid motion [rotation, translation of the centre] in which the whole model would go on from
        each marker as the mode does there
    axis : (K,) the principal axis along which each mode is, widest first
    extent : (3,) of the markers along these axes
    """

    modes: Array
    motions: Array
    axis: NDArray[np.int64]
    extent: Array

    def amplitude(self, stiff: float) -> Array:
        """(K,) of the modes: one along the thinnest axis, less along wider ones, ``stiff`` at least."""
        return _amplitudes(self.extent, stiff)[self.axis]


def field_of(xyz: Array, rigid: NDArray[np.bool_], reach: float, faint: float = FAINT) -> Field:
    """The deformation of markers (N, 3) of the unit model; those that are ``rigid`` (N,) do not move.

    Modes with an amplitude below ``faint`` times the strongest one's are left out.
    """
    shape, slope = _shapes(xyz, rigid, reach, faint)
    axes, extent = extents(xyz)
    products = xyz.T @ xyz
    inertia = np.linalg.pinv(np.trace(products) * np.eye(3) - products)
    modes, motions = [], []
    for axis in axes:
        modes.append(shape[:, :, None] * axis)
        turn = slope @ products @ hat(axis) @ inertia  # of the rigid motion nearest to this slope
        motions.append(np.concatenate([turn, modes[-1] - np.einsum("knj,nji->kni", turn, hat(xyz))], axis=2))
    return Field(
        np.concatenate(modes), np.concatenate(motions).transpose(1, 2, 0), np.repeat(np.arange(3), len(shape)), extent
    )


def modes_of(field: Field) -> Array:
    """(K, N, 3) displacements of a stiff unit model's markers by 1 sigma of a prior of unit amplitude, no faint one."""
    modes = field.amplitude(STIFF)[:, None, None] * field.modes
    strength = np.sqrt((modes**2).sum(axis=2).mean(axis=1))
    return modes[strength > FAINT * strength.max(initial=0.0)]


def _shapes(xyz: Array, rigid: NDArray[np.bool_], reach: float, faint: float) -> tuple[Array, Array]:
    """(K, N) of the strongest modes at the markers, and (K, N, 3) their slopes."""
    soft = np.flatnonzero(~rigid)
    count = min(len(soft), MOST_MODES)
    if not count:
        return np.zeros((0, len(xyz))), np.zeros((0, len(xyz), 3))
    landmarks = soft[:: -(-len(soft) // LANDMARKS)]
    some = xyz[landmarks]
    correlation = _correlation(xyz, some, reach)
    value, vector = eigh(correlation[landmarks], subset_by_index=(max(len(some) - count, 0), len(some) - 1))
    kept = np.flatnonzero(value > faint**2 * value[-1])[::-1]
    weight = vector[:, kept] / np.sqrt(value[kept])
    # The process at the landmarks, carried to all (Nystroem's method); exact where these are all.
    correlation *= ~rigid[:, None]
    shape = (correlation @ weight).T
    towards = np.stack([(correlation @ (some[:, axis, None] * weight)).T for axis in range(3)], axis=2)
    return shape, (towards - shape[:, :, None] * xyz) / reach**2


def _correlation(a: Array, b: Array, reach: float) -> Array:
    """(A, B) of the process at places (A, 3) and (B, 3)."""
    distance2 = sum((a[:, None, axis] - b[None, :, axis]) ** 2 for axis in range(3))
    return np.asarray(np.exp(-0.5 * distance2 / reach**2))


def _amplitudes(extent: Array, stiff: float) -> Array:
    """(3,) along each axis: one for the thinnest, less for wider ones, but ``stiff`` at least."""
    wide = [max(stiff, extent[2] / size) if size > 0.0 else 1.0 for size in extent[:2]]  # 0: on a line
    return np.array([*wide, 1.0])
