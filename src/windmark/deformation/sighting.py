"""What all cameras see of a model at one instant: the observation block of the one adjustment.

    pixel = project(camera, cam_from_tunnel @ tunnel_from_model, law(marker, q))        a marker on the model
    pixel = project(camera, cam_from_tunnel, marker)                                    a marker on the wall

A marker whose own place is known with a sigma is off by the same amount in all cameras. Its observations are therefore
whitened together, with cov = cov of the spots + J cov of the marker J^T.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import Linearised, Loss
from windmark.deformation.ends import tried
from windmark.deformation.volumes import Placed
from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LAW, MOTION = "law", "motion"
"""Names of the blocks of the laws' parameters and of the model's rigid motion."""


def pose_block(view: str) -> str:
    """Name of the block of a view's pose."""
    return f"{view}.pose"


def camera_block(camera: str) -> str:
    """Name of the block of a camera's focal length."""
    return f"{camera}.camera"


@dataclass(frozen=True)
class Sight:
    """What one view sees.

    Parameters
    ----------
    name, camera : of the view and its camera
    row : (n,) rows of the points
    xy : (n, 2) observed places of the discs' centres in pixels
    free_pose, free_focal : what of the view is free
    """

    name: str
    camera: str
    row: Ints
    xy: Array
    free_pose: bool = False
    free_focal: bool = False


@dataclass(frozen=True)
class Sighting:
    """Observations of P points in V views at one instant; a `Term` of the adjustment.

    Parameters
    ----------
    placed : the points, bound to their laws
    wall : (P,) points that stand still in the tunnel
    sights : of each view
    whitener : (P, 2 V, 2 V) of the stacked observations of each point, zero where a view does not see it
    free_law, free_motion : what is free besides
    loss : on the length of each point's whitened residual, all views together
    """

    placed: Placed
    wall: NDArray[np.bool_]
    sights: tuple[Sight, ...]
    whitener: Array
    free_law: bool = True
    free_motion: bool = True
    loss: Loss = field(default_factory=Loss)
    _last: list[Any] = field(default_factory=list, repr=False, compare=False)

    @cached_property
    def blocks(self) -> tuple[str, ...]:
        """See `Term`."""
        return tuple(self._columns)

    @cached_property
    def _columns(self) -> dict[str, slice]:
        """Where each free block stands in the derivatives: laws, motion, poses, focal lengths."""
        sizes = {LAW: len(self.placed.volumes.names)} if self.free_law else {}
        sizes |= {MOTION: 6} if self.free_motion else {}
        sizes |= {pose_block(s.name): 6 for s in self.sights if s.free_pose}
        sizes |= {camera_block(s.camera): 1 for s in self.sights if s.free_focal}
        ends = np.cumsum([0, *sizes.values()]).tolist()
        return {name: slice(*pair) for name, pair in zip(sizes, pairwise(ends), strict=True)}

    def residual(self, values: Any) -> Array | None:
        """See `Term`; (P, 2 V)."""
        raw = self.raw(values)
        return None if raw is None else (self.whitener @ raw[..., None])[..., 0]

    def raw(self, values: Any) -> Array | None:
        """(P, 2 V) projected - observed in pixels, 0 where a view does not see a point."""
        if self._last and self._last[0] is values:
            return np.asarray(self._last[1])
        motion: Pose = values[MOTION]
        place = tried(self.placed, values[LAW], self.placed.place)
        if place is None:
            return None
        place = in_tunnel(place, self.wall, motion)
        out = np.zeros((len(place), 2 * len(self.sights)))
        for v, s in enumerate(self.sights):
            xy, valid = values[camera_block(s.camera)].project(values[pose_block(s.name)].apply(place[s.row]))
            if not valid.all():
                return None
            out[s.row, 2 * v : 2 * v + 2] = xy - s.xy
        return out

    def linearise(self, values: Any) -> Linearised | None:
        """See `Term`."""
        raw = self.raw_jacobian(values)
        if raw is None:
            return None
        whitened = self.whitener @ raw[1]
        jacobian = {name: whitened[..., where] for name, where in self._columns.items()}
        return Linearised((self.whitener @ raw[0][..., None])[..., 0], jacobian)

    def raw_jacobian(self, values: Any) -> tuple[Array, Array] | None:
        """`raw` and its derivative (P, 2 V, F) by all that is free, in the order of `blocks`.

        The last one is kept: where the search ends the tests ask for it again.
        """
        if not (self._last and self._last[0] is values):
            found = self.evaluated(values)
            if found is None:
                return None
            self._last[:] = [values, *found]
        return self._last[1], self._last[2]

    def evaluated(self, values: Any) -> tuple[Array, Array] | None:
        """The same, and the one that is kept stays."""
        from windmark.deformation._kernels import see

        points = self._points(values)
        if points is None:
            return None
        place, by_model = points
        columns = self._columns
        residual = np.zeros((len(place), 2 * len(self.sights)))
        jacobian = np.zeros((*residual.shape, max((c.stop for c in columns.values()), default=0)))
        for v, s in enumerate(self.sights):
            camera: Camera = values[camera_block(s.camera)]
            pose: Pose = values[pose_block(s.name)]
            valid = see(
                camera.packed(), np.ascontiguousarray(pose.rotation), pose.translation, place, by_model, s.row, s.xy,
                2 * v, columns[pose_block(s.name)].start if s.free_pose else -1,
                columns[camera_block(s.camera)].start if s.free_focal else -1, residual, jacobian,
            )  # fmt: skip
            if not valid:
                return None
        return residual, jacobian

    def _points(self, values: Any) -> tuple[Array, Array] | None:
        """Places in the tunnel (P, 3) and their derivative (P, 3, K + 6) by laws and motion, as far as free.

        None where a law has none.
        """
        motion: Pose = values[MOTION]
        found = tried(self.placed, values[LAW], self.placed.linearise)
        if found is None:
            return None
        place, by_q = found
        place = in_tunnel(place, self.wall, motion)
        laws = by_q.shape[2] * self.free_law
        by_model = np.empty((len(place), 3, laws + 6 * self.free_motion))
        if laws:
            by_model[..., :laws] = motion.rotation @ by_q
        if self.free_motion:
            by_model[..., laws : laws + 3], by_model[..., laws + 3 :] = -hat(place), np.eye(3)
            by_model[self.wall, :, laws:] = 0.0
        return place, by_model


def in_tunnel(place: Array, wall: NDArray[np.bool_], motion: Pose) -> Array:
    """(P, 3) places of the model's frame in the tunnel; what is on a wall stands still."""
    return np.where(wall[:, None], place, motion.apply(place))


def by_place(sights: tuple[Sight, ...], values: Any, place: Array) -> Array:
    """(P, 2 V, 3) derivative of every view's pixels by the points' places (P, 3) in the tunnel."""
    from windmark.deformation._kernels import see

    out, off = np.zeros((len(place), 2 * len(sights), 3)), np.zeros((len(place), 2 * len(sights)))
    each = np.ascontiguousarray(np.broadcast_to(np.eye(3), (len(place), 3, 3)))
    for v, s in enumerate(sights):
        camera: Camera = values[camera_block(s.camera)]
        pose: Pose = values[pose_block(s.name)]
        rotation = np.ascontiguousarray(pose.rotation)
        if not see(camera.packed(), rotation, pose.translation, place, each, s.row, s.xy, 2 * v, -1, -1, off, out):
            out[s.row, 2 * v : 2 * v + 2] = np.nan
    return out


def whiteners(cov: Array, seen: NDArray[np.bool_], by_place: Array, place_cov: Array | None) -> Array:
    """(P, 2 V, 2 V) whiteners of stacked observations.

    Parameters
    ----------
    cov : (P, V, 2, 2) covariances of the spots, anything where not seen
    seen : (P, V) which views count
    by_place : (P, 2 V, 3) derivative of the pixels by the point's place; only needed with ``place_cov``
    place_cov : (P, 3, 3) covariance of the markers' own places in the same frame; None where they are exact
    """
    from windmark.deformation._kernels import whiten

    count, views = seen.shape
    if place_cov is None:  # the inverse of the Cholesky factor of each spot's own, written out
        cov = np.where(seen[..., None, None], cov, np.eye(2))
        total = np.zeros((count, views, 2, views, 2))
        a = np.sqrt(cov[..., 0, 0])
        b = cov[..., 0, 1] / a
        c = np.sqrt(cov[..., 1, 1] - b * b)
        for v in range(views):
            total[:, v, 0, v, 0], total[:, v, 1, v, 1] = seen[:, v] / a[:, v], seen[:, v] / c[:, v]
            total[:, v, 1, v, 0] = seen[:, v] * -b[:, v] / (a[:, v] * c[:, v])
        return total.reshape(count, 2 * views, 2 * views)
    out = np.empty((count, 2 * views, 2 * views))
    if not whiten(cov, seen, by_place, np.ascontiguousarray(place_cov), out):
        raise np.linalg.LinAlgError("a covariance of the spots with their markers' is not positive definite")
    return out
