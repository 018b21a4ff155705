"""From the user's observations to the one adjustment: what is free, where it starts, how well each spot is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust import CameraBlock, JointPrior, Loss, PoseBlock, Prior, Problem, VectorBlock
from windmark.deformation.sighting import (
    LAW,
    MOTION,
    Sight,
    Sighting,
    by_place,
    camera_block,
    in_tunnel,
    pose_block,
    whiteners,
)
from windmark.deformation.turned import rotated, turns
from windmark.deformation.volumes import Placed, Volumes
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.scene import MarkerSet, Observations, View

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Task:
    """One instant as it was given, checked.

    Parameters
    ----------
    observations, markers, volumes, cameras, views : see `identify`
    wall : (N,) markers that stand still in the tunnel
    placed : all markers, bound to their laws
    place_cov : (N, 3, 3) covariance of their own places; None where they are exact
    free_motion, free_poses, free_focal : what is free: the rigid motion; views; cameras
    motion_cov, pose_cov : what is known of free motion and poses beforehand
    disc_ratio : radii of the discs over those of the table
    """

    observations: Observations
    markers: MarkerSet
    volumes: Volumes
    cameras: Mapping[str, Camera]
    views: tuple[View, ...]
    wall: Mask
    placed: Placed
    place_cov: Array | None
    free_motion: bool
    free_poses: tuple[str, ...]
    free_focal: tuple[str, ...]
    motion_cov: Array | None
    pose_cov: Mapping[str, Array]
    disc_ratio: float = 1.0

    @property
    def slots(self) -> tuple[Ints, Ints]:
        """Marker and view of each observation."""
        return self.observations.point, self.observations.view

    @cached_property
    def seen(self) -> Mask:
        """(N,) markers that are observed."""
        out = np.zeros(len(self.markers), bool)
        out[self.observations.point] = True
        return out

    def sights(self, shift: Array, used: Mask) -> tuple[Sight, ...]:
        """What each view sees, the discs' eccentricity (O, 2) taken off, of the observations that take part."""
        out = []
        for v, view in enumerate(self.views):
            own = np.flatnonzero((self.observations.view == v) & used)
            free = view.name in self.free_poses
            out.append(
                Sight(view.name, view.camera, self.observations.point[own], self.observations.xy[own] - shift[own],
                      free, view.camera in self.free_focal)
            )  # fmt: skip
        return tuple(out)

    def problem(self, values: Mapping[str, Any], shift: Array, used: Mask, loss: Loss) -> Problem:
        """The adjustment, with the whiteners at these values."""
        sights = self.sights(shift, used)
        term = self.term(values, sights, used, loss)
        blocks: dict[str, Any] = {}
        priors: list[Any] = []
        if self.volumes.names:
            blocks[LAW] = self._law_block()
            known = {n: p.sigma for n, p in zip(self.volumes.names, self.volumes.parameters, strict=True)
                     if np.isfinite(p.sigma)}  # fmt: skip
            if known:
                priors.append(Prior(LAW, blocks[LAW], self.volumes.start, known))
        if self.free_motion:
            blocks[MOTION] = PoseBlock(self.placed.xyz[self.seen & ~self.wall].mean(axis=0))
            if self.motion_cov is not None:
                priors.append(_held(MOTION, blocks[MOTION], Pose.identity(), self.motion_cov))
        for view in self.views:
            if view.name in self.free_poses:
                block = blocks[pose_block(view.name)] = PoseBlock(self.placed.xyz[self.seen].mean(axis=0))
                if view.name in self.pose_cov:
                    assert view.cam_from_model is not None
                    priors.append(_held(pose_block(view.name), block, view.cam_from_model, self.pose_cov[view.name]))
        for camera in self.free_focal:
            block_f = blocks[camera_block(camera)] = CameraBlock(("focal_px",))
            cov = self.cameras[camera].cov
            if cov is not None and cov[0, 0] > 0:
                sigma = {"focal_px": float(np.sqrt(cov[0, 0]))}
                priors.append(Prior(camera_block(camera), block_f, self.cameras[camera], sigma))
        return Problem(blocks, [term, *priors])

    def term(self, values: Mapping[str, Any], sights: tuple[Sight, ...], used: Mask, loss: Loss) -> Sighting:
        """The observation block with whiteners at these values."""
        count, views = len(self.markers), len(self.views)
        seen, cov = np.zeros((count, views), bool), np.zeros((count, views, 2, 2))
        row, view = (a[used] for a in self.slots)
        seen[row, view], cov[row, view] = True, self.observations.cov[used]
        place_cov = self.own_cov(values)
        jacobian = cov[..., :0]
        if place_cov is not None:
            jacobian = by_place(sights, values, self.tunnel_place(values))
        whitener = whiteners(cov, seen, jacobian, place_cov)
        return Sighting(self.placed, self.wall, sights, whitener, bool(self.volumes.names), self.free_motion, loss)

    def own_cov(self, values: Mapping[str, Any]) -> Array | None:
        """(N, 3, 3) covariance of the markers' own places, in the tunnel."""
        if self.place_cov is None:
            return None
        turn = values[MOTION].rotation
        return np.where(self.wall[:, None, None], self.place_cov, turn @ self.place_cov @ turn.T)

    def tunnel_place(self, values: Mapping[str, Any]) -> Array:
        """(P, 3) where the markers are now."""
        return in_tunnel(self.placed.place(values[LAW]), self.wall, values[MOTION])

    def without_image(self, values: Mapping[str, Any]) -> list[str]:
        """Which marks ("marker in view") have markers behind their camera, or beyond its lens."""
        place, out = self.tunnel_place(values), []
        for v, view in enumerate(self.views):
            rows = self.observations.point[self.observations.view == v]
            seen = values[camera_block(view.camera)].project(values[pose_block(view.name)].apply(place[rows]))[1]
            out += [f"{name} in {view.name}" for name in self.markers.name[rows[~seen]]]
        return out

    def eccentricity(self, values: Mapping[str, Any]) -> Array:
        """(O, 2) centre of the imaged ellipse less the image of the disc's centre; 0 where a disc is not known."""
        out = np.zeros((len(self.observations), 2))
        radius, normal = self.markers.radius * self.disc_ratio, self.markers.normal
        disc = self.markers.is_disc
        if not disc.any():
            return out
        motion: Pose = values[MOTION]
        place = self.tunnel_place(values)
        form, turned = self.markers.curvature, turns(self.placed, values[LAW], normal)
        now = np.where(self.wall[:, None], normal, motion.rotate(rotated(turned, normal)))
        bent = np.where(self.wall[:, None, None], form, motion.rotate_form(rotated(turned, form)))
        for v, view in enumerate(self.views):
            own = np.flatnonzero((self.observations.view == v) & disc[self.observations.point])
            rows, pose = self.observations.point[own], values[pose_block(view.name)]
            camera = values[camera_block(view.camera)]
            seen = imaged_ellipse(
                camera, pose.apply(place[rows]), pose.rotate(now[rows]), radius[rows], pose.rotate_form(bent[rows])
            )
            out[own] = np.where(np.isfinite(seen.eccentricity_px), seen.eccentricity_px, 0.0)
        return out

    def _law_block(self) -> VectorBlock:
        """Natural units: the change that moves some marker by the extent of the model, at most ten prior sigma."""
        model = self.placed.xyz[~self.wall]
        extent = float(np.linalg.norm(np.ptp(model, axis=0))) if len(model) else 1.0
        column = {key: np.array([getattr(p, key) for p in self.volumes.parameters]) for key in
                  ("sigma", "lower", "upper")}  # fmt: skip
        with np.errstate(divide="ignore"):
            scale = np.minimum(extent / self.placed.rates, 10 * column["sigma"])
        scale = np.where(np.isfinite(scale), scale, 1.0)
        return VectorBlock(self.volumes.names, scale, column["lower"], column["upper"])


def _held(name: str, block: PoseBlock, reference: Pose, cov: Array) -> JointPrior:
    """What is known of a pose beforehand."""
    try:
        if not (np.isfinite(cov).all() and (np.diag(cov) > 0).all()):
            raise np.linalg.LinAlgError
        sigma = np.sqrt(np.diag(cov))
        half = np.linalg.cholesky(cov / np.outer(sigma, sigma))
    except np.linalg.LinAlgError:
        raise UsageError(f"covariance of {name}: must be finite, (6, 6) and positive definite") from None
    return JointPrior(name, block, reference, range(6), np.linalg.inv(half) / sigma)


def prepare(
    observations: Observations,
    markers: MarkerSet,
    volumes: Volumes,
    cameras: Mapping[str, Camera] | Camera,
    views: Sequence[View],
    free_motion: bool,
    motion_cov: ArrayLike | None,
    free_poses: bool | Sequence[str],
    pose_cov: Mapping[str, ArrayLike] | None,
    free_focal: bool | Sequence[str],
    marker_cov: ArrayLike | None,
    before: Placed | None,
) -> Task:
    """Check what was given. See `identify` for the meaning.

    ``before``: markers bound at an earlier instant, used again where they are the same.

    Raises
    ------
    ValueError
        Naming the argument, what was expected and what came.
    """
    views = tuple(views)
    names = [v.name for v in views]
    if len(set(names)) != len(names) or not views:
        raise UsageError(f"views: expected at least one, with distinct names, got {names}")
    known = {v.camera: cameras for v in views} if isinstance(cameras, Camera) else dict(cameras)
    for view in views:
        if view.camera not in known:
            raise UsageError(f"views: camera {view.camera!r} of {view.name} is not one of {', '.join(known)}")
        if view.cam_from_model is None:
            raise UsageError(f"views: {view.name} has no pose; expected cam_from_tunnel, at least as a start")
    if len(observations):
        for key, end in (("view", len(views)), ("point", len(markers))):
            index = getattr(observations, key)
            if index.min() < 0 or index.max() >= end:
                raise ValueError(f"observations: {key} must be 0 to {end - 1}, got {index.min()} to {index.max()}")
    pairs = observations.view * len(markers) + observations.point
    times = np.bincount(pairs)
    if times.max(initial=0) > 1:
        k = int(np.argmax(times))
        raise UsageError(
            f"observations: view {names[k // len(markers)]} has marker {markers.name[k % len(markers)]} more than once"
        )
    c = observations.cov
    good = (c[:, 0, 0] > 0) & (c[:, 0, 0] * c[:, 1, 1] > c[:, 0, 1] * c[:, 1, 0])
    if not good.all():
        k = int(np.argmin(good))
        raise UsageError(f"observations: cov must be positive definite, got {c[k].tolist()} of observation {k}")
    wall = np.asarray(markers.role == "wall")
    volume = np.where(wall, "", markers.volume)
    same = before is not None and before.volumes is volumes and before.xyz is markers.xyz
    if before is None or not same or not np.array_equal(before.names, volume):
        before = volumes.bind(markers.xyz, volume)
    known_poses = dict(pose_cov or {})
    moves = free_motion and not wall[observations.point].all()
    return Task(
        observations, markers, volumes, known, views, wall, before, _marker_cov(markers, marker_cov), moves,
        _chosen("free_poses", free_poses, names),
        _chosen("free_focal", free_focal, list(dict.fromkeys(v.camera for v in views))),
        None if motion_cov is None else _square("motion_cov", motion_cov),
        {n: _square(f"pose_cov of {n}", known_poses[n]) for n in _chosen("pose_cov", tuple(known_poses), names)},
    )  # fmt: skip


def _marker_cov(markers: MarkerSet, given: ArrayLike | None) -> Array | None:
    """(N, 3, 3), or None where all places are exact."""
    if given is not None:
        cov = np.asarray(given, dtype=float)
        if cov.shape != (len(markers), 3, 3) or not np.isfinite(cov).all():
            raise ValueError(f"marker_cov: expected ({len(markers)}, 3, 3), finite, got {cov.shape}")
        return cov
    sigma = np.where(np.isfinite(markers.sigma), markers.sigma, 0.0)
    return sigma[:, :, None] ** 2 * np.eye(3) if sigma.any() else None


def _square(name: str, values: ArrayLike) -> Array:
    out = np.asarray(values, dtype=float)
    if out.shape != (6, 6):
        raise UsageError(f"{name}: expected (6, 6), got {out.shape}")
    return out


def _chosen(name: str, what: bool | Sequence[str], all_names: list[str]) -> tuple[str, ...]:
    if isinstance(what, bool):
        return tuple(all_names) if what else ()
    unknown = sorted(set(what) - set(all_names))
    if unknown:
        raise UsageError(f"{name}: {unknown[0]!r} is not one of {', '.join(all_names)}")
    return tuple(n for n in all_names if n in what)


def start_values(task: Task, start: Any) -> dict[str, Any]:
    """Where the search begins: a state met before, or the undeformed model at rest."""
    values: dict[str, Any] = {LAW: task.volumes.start.copy(), MOTION: Pose.identity()}
    for view in task.views:
        values[pose_block(view.name)] = view.cam_from_model
        values[camera_block(view.camera)] = task.cameras[view.camera]
    if start is not None:
        values[LAW], values[MOTION] = np.array(start.q), start.tunnel_from_model
        for view in task.views:
            if view.name in task.free_poses and view.name in start.cam_from_tunnel:
                values[pose_block(view.name)] = start.cam_from_tunnel[view.name]
            if view.camera in task.free_focal and view.camera in start.cameras:
                known = task.cameras[view.camera]
                values[camera_block(view.camera)] = replace(known, focal_px=start.cameras[view.camera].focal_px)
    return values
