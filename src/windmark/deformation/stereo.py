"""Displacement of single markers from two or more cameras, without any law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose, imaged_ellipse, triangulate
from windmark.scene import MarkerSet, Observations, View
from windmark.scene.shown import by_name, check_kinds, list_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class MarkerPlaces:
    """Where P markers are at one instant.

    Parameters
    ----------
    marker : (P,) index of the markers that were observed
    xyz : (P, 3) in the cameras' common frame, NaN where there is none
    cov : (P, 3, 3) from the spots' covariances; cameras count as known
    views : (P,) how many views saw it
    rms_px : (P,) root mean square length of its residuals
    reason : (P,) why there is no place, "" where there is one
    """

    marker: Ints
    xyz: Array
    cov: Array
    views: Ints
    rms_px: Array
    reason: NDArray[np.str_]


@dataclass(frozen=True)
class Displacements:
    """Displacement of K markers that both instants have.

    Parameters
    ----------
    marker : (K,) index of the markers
    vector : (K, 3) place after less place before
    cov : (K, 3, 3) sum of both covariances. Errors of the cameras are common to all markers and not in it
    """

    marker: Ints
    vector: Array
    cov: Array


def marker_places(
    observations: Observations,
    markers: MarkerSet,
    cameras: Mapping[str, Camera] | Camera,
    views: Sequence[View],
) -> MarkerPlaces:
    """Triangulate every marker for itself.

    Parameters
    ----------
    observations, markers, cameras, views : as for `identify`; a marker's normal and radius, where known, remove the
        disc's eccentricity

    Raises
    ------
    ValueError
        For fewer than two views, or views without a pose.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b"], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.2]])
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> poses = [wm.Pose.look_at([x, 0.0, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-2.0, 2.0)]
    >>> xy = np.concatenate([camera.project(pose.apply(markers.xyz))[0] for pose in poses])
    >>> seen = wm.Observations(np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]), xy, np.tile(0.01 * np.eye(2), (4, 1, 1)))
    >>> views = [wm.View(f"view{i}", cam_from_model=pose) for i, pose in enumerate(poses)]
    >>> places = wm.marker_places(seen, markers, camera, views)
    >>> np.allclose(places.xyz, markers.xyz), places.views.tolist()
    (True, [2, 2])
    >>> bool(places.cov[0, 2, 2] > places.cov[0, 0, 0])  # depth is known less well
    True
    """
    check_kinds(
        "marker_places", observations=(observations, Observations), markers=(markers, MarkerSet),
        cameras=(cameras, by_name(Camera)), views=(views, list_of(View)),
    )  # fmt: skip
    if len(views) < 2:
        raise UsageError(f"marker_places: at least two views are needed, got {len(views)}")
    known = {v.camera: cameras for v in views} if isinstance(cameras, Camera) else cameras
    poses: list[Pose] = []
    for view in views:
        if view.cam_from_model is None:
            raise UsageError(f"marker_places: view {view.name} has no pose")
        poses.append(view.cam_from_model)
    marker, row = np.unique(observations.point, return_inverse=True)
    xy = np.full((len(views), len(marker), 2), np.nan)
    cov = np.tile(np.eye(2), (len(views), len(marker), 1, 1))
    xy[observations.view, row.ravel()], cov[observations.view, row.ravel()] = observations.xy, observations.cov
    cams = [known[v.camera] for v in views]
    found = triangulate(cams, poses, xy, cov)
    radius, normal, curvature = markers.radius[marker], markers.normal[marker], markers.curvature[marker]
    disc = found.valid & markers.is_disc[marker]
    if disc.any():
        for v, (camera, pose) in enumerate(zip(cams, poses, strict=True)):
            seen = imaged_ellipse(
                camera, pose.apply(found.xyz[disc]), pose.rotate(normal[disc]), radius[disc],
                pose.rotate_form(curvature[disc]),
            )  # fmt: skip
            xy[v, disc] -= np.nan_to_num(seen.eccentricity_px)
        found = triangulate(cams, poses, xy, cov)
    return MarkerPlaces(marker, found.xyz, found.cov, found.views, found.rms_px, found.reason)


def displacements(before: MarkerPlaces, after: MarkerPlaces) -> Displacements:
    """Displacement of the markers that have a place at both instants.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b"], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.2]])
    >>> camera, index = wm.Camera((640, 480), 800.0), np.arange(2)
    >>> poses = [wm.Pose.look_at([x, 0.0, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-2.0, 2.0)]
    >>> views = [wm.View(f"view{i}", cam_from_model=pose) for i, pose in enumerate(poses)]
    >>> places = []
    >>> for height in (0.0, 0.1):  # wind off, wind on: b rises
    ...     xyz = markers.xyz + [[0.0, 0.0, 0.0], [0.0, 0.0, height]]
    ...     xy = np.concatenate([camera.project(pose.apply(xyz))[0] for pose in poses])
    ...     seen = wm.Observations(np.repeat(index, 2), np.tile(index, 2), xy, np.tile(0.01 * np.eye(2), (4, 1, 1)))
    ...     places.append(wm.marker_places(seen, markers, camera, views))
    >>> moved = wm.displacements(*places)
    >>> np.allclose(moved.vector, [[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]])
    True
    """
    good = [p.marker[p.reason == ""] for p in (before, after)]
    both = np.intersect1d(*good)
    a, b = (np.searchsorted(p.marker, both) for p in (before, after))
    return Displacements(both, after.xyz[b] - before.xyz[a], after.cov[b] + before.cov[a])
