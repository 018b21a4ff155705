"""The wind-off zero: where the markers really are, from images of the undeformed model.

A table of markers is off by some tenths of a millimetre, far more than the images. What the wind-off images say of each
marker's place is put to its prior: with A = S^-1 + sum J^T C^-1 J, the correction is -A^-1 sum J^T C^-1 r and its
covariance A^-1. Afterwards only the change from wind-off to wind-on matters, and the table's errors have left it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.result import Deformation
from windmark.deformation.sighting import in_tunnel
from windmark.scene import MarkerSet, Observations, View

Array = NDArray[np.float64]

LEAST_SIGMA_PX = 0.1
"""A table of unknown sigma is taken to be as far off as the residuals say, at least by so much in the image."""


@dataclass(frozen=True)
class ZeroMarkers:
    """Markers with their places by the wind-off images.

    Parameters
    ----------
    markers : the table, places corrected; sigma is that of the corrected places
    cov : (N, 3, 3) covariance of the places
    shift : (N, 3) correction
    seen : (N,) markers that the wind-off images showed
    """

    markers: MarkerSet
    cov: Array
    shift: Array
    seen: NDArray[np.bool_]


def zero_markers(
    states: Sequence[Deformation], observations: Sequence[Observations], views: Sequence[Sequence[View]],
    markers: MarkerSet,
) -> ZeroMarkers:  # fmt: skip
    """Correct a table of markers by wind-off frames.

    Parameters
    ----------
    states, observations, views : of each frame: what `identify` gave, and the observations and views it was given
    markers : the table that it was given

    Raises
    ------
    ValueError
        Without a frame, or for lists of different lengths.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> @wm.law(tip={"unit": "mm", "sigma": 20.0})
    ... def bend(xyz, tip):
    ...     return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])
    >>> x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], sigma=0.5, volume="wing")
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])
    >>> off = np.random.default_rng(0).normal(0.0, 0.5, (24, 3))  # errors of the table
    >>> xy, _ = camera.project(pose.apply(markers.xyz + off))  # wind off
    >>> seen = wm.Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    >>> views = [wm.View("cam1", cam_from_model=pose)]
    >>> state = wm.identify(seen, markers, [wm.Volume("wing", bend)], camera, views, free_motion=False)
    >>> zero = wm.zero_markers([state], [seen], [views], markers)
    >>> error = np.abs(off - zero.shift).mean() / np.abs(off).mean()
    >>> bool(error < 0.5), bool((zero.markers.sigma < markers.sigma).all())  # less error, and it is known
    (True, True)
    """
    if not states or not len(states) == len(observations) == len(views):
        raise ValueError(f"zero_markers: expected as many states, observations and views, at least one, got "
                         f"{len(states)}, {len(observations)}, {len(views)}")  # fmt: skip
    count = len(markers)
    precision, pull, seen = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count, bool)
    scale = []
    for state, seen_by, seen_from in zip(states, observations, views, strict=True):
        for v, view in enumerate(seen_from):
            own = np.flatnonzero((seen_by.view == v) & state.used)
            point = seen_by.point[own]
            j = _by_place(state, view, markers, point)
            scale.append(np.linalg.norm(j, axis=(1, 2)) / np.sqrt(2.0))
            weighted = np.linalg.solve(seen_by.cov[own], j)
            np.add.at(precision, point, np.swapaxes(j, 1, 2) @ weighted)
            np.add.at(pull, point, -np.einsum("nia,ni->na", weighted, state.residuals_px[own]))
            seen[point] = True
    rms = float(np.sqrt(np.mean([max(s.rms_px, LEAST_SIGMA_PX) ** 2 for s in states])))
    unknown = rms / float(np.median(np.concatenate(scale)))
    sigma = np.where(np.isfinite(markers.sigma) & (markers.sigma > 0), markers.sigma, unknown)
    prior = (sigma**-2)[:, :, None] * np.eye(3)
    cov: Array = np.asarray(np.linalg.inv(prior + precision), dtype=float)
    shift = np.einsum("nij,nj->ni", cov, pull)
    corrected = replace(
        markers, xyz=markers.xyz + shift, sigma=np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    )  # fmt: skip
    return ZeroMarkers(corrected, cov, shift, seen)


def _by_place(state: Deformation, view: View, markers: MarkerSet, point: NDArray[np.int64]) -> Array:
    """(n, 2, 3) derivative of the pixels by the markers' own places in the model's frame."""
    wall = markers.role[point] == "wall"
    volume = np.where(wall, "", markers.volume[point])
    place = state.volumes.bind(markers.xyz[point], volume).place(state.q)
    motion, pose = state.tunnel_from_model, state.cam_from_tunnel[view.name]
    place = in_tunnel(place, wall, motion)
    by_cam = state.cameras[view.camera].project_jacobian(pose.apply(place))[2]
    turned = np.where(wall[:, None, None], np.eye(3), motion.rotation)
    return np.asarray(by_cam @ pose.rotation @ turned)
