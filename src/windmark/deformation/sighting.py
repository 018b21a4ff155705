"""What all cameras see of a model at one instant: the observation block of the one adjustment.

    pixel = project(camera, cam_from_tunnel @ tunnel_from_model, law(marker, q))        a marker on the model
    pixel = project(camera, cam_from_tunnel, marker)                                    a marker on the wall

A marker whose own place is known with a sigma is off by the same amount in all cameras. Its observations are therefore
whitened together, with cov = cov of the spots + J cov of the marker J^T.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import Linearised, Loss
from windmark.deformation.volumes import Placed
from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LAW, MOTION = "law", "motion"
"""Names of the blocks of the laws' parameters and of the model's rigid motion."""
FOCAL = PARAMETERS.index("focal_px")


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

    @property
    def blocks(self) -> tuple[str, ...]:
        """See `Term`."""
        out = [LAW] * self.free_law + [MOTION] * self.free_motion
        for s in self.sights:
            out += [pose_block(s.name)] * s.free_pose
            if s.free_focal and camera_block(s.camera) not in out:
                out.append(camera_block(s.camera))
        return tuple(out)

    def residual(self, values: Any) -> Array | None:
        """See `Term`; (P, 2 V)."""
        raw = self.raw(values)
        return None if raw is None else (self.whitener @ raw[..., None])[..., 0]

    def raw(self, values: Any) -> Array | None:
        """(P, 2 V) projected - observed in pixels, 0 where a view does not see a point."""
        motion: Pose = values[MOTION]
        place = self.placed.place(values[LAW])
        place = np.where(self.wall[:, None], place, motion.apply(place))
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
        residual, jacobian = raw
        whitened = {name: self.whitener @ j for name, j in jacobian.items()}
        return Linearised((self.whitener @ residual[..., None])[..., 0], whitened)

    def raw_jacobian(self, values: Any) -> tuple[Array, dict[str, Array]] | None:
        """`raw` and its derivatives (P, 2 V, k) by each free block."""
        motion: Pose = values[MOTION]
        place, by_q, turned = self._points(values)
        count, width = len(place), 2 * len(self.sights)
        residual = np.zeros((count, width))
        sizes = {LAW: by_q.shape[2], MOTION: 6}
        jacobian = {n: np.zeros((count, width, sizes.get(n, 6 if n.endswith(".pose") else 1))) for n in self.blocks}
        for v, s in enumerate(self.sights):
            camera: Camera = values[camera_block(s.camera)]
            pose: Pose = values[pose_block(s.name)]
            seen = pose.apply(place[s.row])
            xy, valid, by_seen, by_camera = camera.project_jacobian(seen)
            if not valid.all():
                return None
            rows = slice(2 * v, 2 * v + 2)
            residual[s.row, rows] = xy - s.xy
            by_place = by_seen @ pose.rotation
            if self.free_law:
                jacobian[LAW][s.row, rows] = (by_place @ motion.rotation) @ by_q[s.row]
            if self.free_motion:
                jacobian[MOTION][s.row, rows] = by_place @ turned[s.row]
            if s.free_pose:
                jacobian[pose_block(s.name)][s.row, rows] = np.concatenate([-(by_seen @ hat(seen)), by_seen], axis=-1)
            if s.free_focal:
                jacobian[camera_block(s.camera)][s.row, rows] = by_camera[..., FOCAL : FOCAL + 1]
        return residual, jacobian

    def _points(self, values: Any) -> tuple[Array, Array, Array]:
        """Places in the tunnel (P, 3), their derivative by the laws in the model's frame and by the rigid motion."""
        motion: Pose = values[MOTION]
        place, by_q = self.placed.linearise(values[LAW])
        place = np.where(self.wall[:, None], place, motion.apply(place))
        turned = np.concatenate([-hat(place), np.broadcast_to(np.eye(3), (len(place), 3, 3))], axis=-1)
        turned[self.wall] = 0.0
        return place, by_q, turned


def by_place(sights: tuple[Sight, ...], values: Any, place: Array) -> Array:
    """(P, 2 V, 3) derivative of every view's pixels by the points' places (P, 3) in the tunnel."""
    out = np.zeros((len(place), 2 * len(sights), 3))
    for v, s in enumerate(sights):
        pose: Pose = values[pose_block(s.name)]
        by_seen = values[camera_block(s.camera)].project_jacobian(pose.apply(place[s.row]))[2]
        out[s.row, 2 * v : 2 * v + 2] = by_seen @ pose.rotation
    return out


def whiteners(cov: Array, seen: NDArray[np.bool_], by_place: Array, place_cov: Array | None) -> Array:
    """(P, 2 V, 2 V) whiteners of stacked observations.

    Parameters
    ----------
    cov : (P, V, 2, 2) covariances of the spots, anything where not seen
    seen : (P, V) which views count
    by_place : (P, 2 V, 3) derivative of the pixels by the point's place
    place_cov : (P, 3, 3) covariance of the markers' own places in the same frame; None where they are exact
    """
    count, views = seen.shape
    blocks = np.zeros((count, views, 2, views, 2))
    for v in range(views):
        blocks[:, v, :, v] = np.where(seen[:, v, None, None], cov[:, v], np.eye(2))
    total = blocks.reshape(count, 2 * views, 2 * views)
    twice = np.repeat(seen, 2, axis=1)
    if place_cov is not None:
        j = by_place * twice[..., None]
        total = total + j @ place_cov @ np.swapaxes(j, 1, 2)
    out = np.linalg.inv(np.linalg.cholesky(total))
    return np.asarray(out * twice[:, None, :] * twice[:, :, None])
