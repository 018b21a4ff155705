"""The eccentricity of imaged discs in a calibration: adjusted, corrected with what is known then, adjusted again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import NetworkState
from windmark.calibration.disc_shapes import Discs, discs_of_ellipses, with_common_radius
from windmark.calibration.finish import datum_points
from windmark.calibration.normals import all_normals
from windmark.calibration.setup import Job, views_of
from windmark.calibration.solve import Solved, solve
from windmark.geometry import imaged_ellipse
from windmark.geometry.similarity import align
from windmark.scene import MarkerSet
from windmark.scene.units import RADII_OFF, off_by

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 3
NOTICED_PX = 1e-3
"""Change of the discs' eccentricity that asks for another adjustment."""
LEAST = 4
"""Fewer radii say nothing about the table."""
SURE = float(np.radians(3.0))
"""1 sigma up to which a normal told by ellipses is taken: what is left of r^2 / d then is less than what a surface
through the neighbours or a rough table leave."""


def with_eccentricity(
    job: Job, state: NetworkState, good: Mask, options: dict[str, Any], fits: Mask | None = None
) -> Solved:
    """Adjust; then with the eccentricity of the imaged discs, until that changes no more. ``fits`` as of `solve`."""
    how, reject = options["eccentricity"], options["reject"]
    shift = np.zeros((len(job.observations), 2))
    solved = solve(job, state, good, shift, reject, fits)
    told = how == "auto" and job.ellipses is not None and bool(np.isfinite(job.ellipses).all(axis=1).any())
    if how == "off" or not (told or np.isfinite(job.markers.radius).any()):
        return solved
    for _ in range(ROUNDS):
        discs = _discs(job, solved) if told else None
        turn = _table_turned(job, solved)
        normal, radius, form = job.markers.normal @ turn, job.markers.radius, turn.T @ job.markers.curvature @ turn
        if max(ratio := radii_off(job.markers, discs), 1 / ratio) > RADII_OFF:
            return replace(solved, discs=discs)  # no correction by such radii
        if discs is not None:
            normal = np.where(np.isfinite(discs.normal), discs.normal, normal)
            radius = np.where(np.isfinite(radius), radius, discs.radius)
        if how == "auto":
            radius = with_common_radius(radius)
            normal = all_normals(solved.state.points, normal, _towards_cameras(job, solved))
        new = eccentricities(job, solved.state, normal, radius, form)
        solved = replace(solved, discs=discs)
        if np.abs(new - shift).max(initial=0.0) < NOTICED_PX:
            break
        shift = new
        solved = replace(solve(job, solved.state, good, shift, reject, fitting(solved)), discs=discs)
    return solved


def fitting(solved: Solved) -> Mask:
    """(O,) marks that an adjustment used."""
    out = solved.taken.copy()
    out[solved.taken] = solved.used
    return out


def radii_off(markers: MarkerSet, discs: Discs | None) -> float:
    """The factor by which nearly all radii that the ellipses tell are larger than the table's; 1 where they fit."""
    return 1.0 if discs is None else off_by(discs.radius / markers.radius, LEAST)


def eccentricities(job: Job, state: NetworkState, normal: Array, radius: Array, form: Array) -> Array:
    """(O, 2) centre of each imaged disc less the image of its centre; zero where normal or radius is unknown."""
    obs, out = job.observations, np.zeros((len(job.observations), 2))
    for v, (camera, pose) in enumerate(views_of(job, state)):
        mine = np.flatnonzero(obs.view == v)
        p = obs.point[mine]
        known = np.isfinite(normal[p]).all(axis=1) & np.isfinite(radius[p])
        mine, p = mine[known], p[known]
        bent = pose.rotate_form(form[p])
        seen = imaged_ellipse(camera, pose.apply(state.points[p]), pose.rotate(normal[p]), radius[p], bent)
        out[mine] = np.where(np.isfinite(seen.eccentricity_px), seen.eccentricity_px, 0.0)
    return out


def _discs(job: Job, solved: Solved) -> Discs:
    """Normals and radii that the ellipses of the used marks tell, in the frame of the network; sure ones only."""
    obs, state = job.observations, solved.state
    assert job.ellipses is not None
    ellipses, jacobian = np.full((len(obs), 3), np.nan), np.full((len(obs), 2, 3), np.nan)
    mine = np.flatnonzero(solved.taken)[solved.used]
    ellipses[mine] = job.ellipses[mine]
    for v, (camera, pose) in enumerate(views_of(job, state)):
        own = mine[obs.view[mine] == v]
        by_point = camera.project_jacobian(pose.apply(state.points[obs.point[own]]))[2]
        jacobian[own] = by_point @ pose.rotation
    found = discs_of_ellipses(ellipses, obs.point, jacobian, _towards_cameras(job, solved))
    sure = found.sigma < SURE
    return Discs(np.where(sure[:, None], found.normal, np.nan), found.radius, found.sigma)


def _table_turned(job: Job, solved: Solved) -> Array:
    """(3, 3) ``v @ turn`` is a direction of the table in the frame of the network, which a free one may have turned."""
    chosen = datum_points(job)
    if chosen is None:
        return np.eye(3)
    seen = np.zeros(len(job.markers), dtype=np.bool_)
    seen[job.observations.point[solved.taken]] = True
    fit = align(solved.state.points[chosen & seen], job.markers.xyz[chosen & seen])
    return np.asarray(fit.rotation)


def _towards_cameras(job: Job, solved: Solved) -> Array:
    """(N, 3) mean direction from each marker to the cameras that saw it; NaN where none did."""
    obs = job.observations
    center = np.stack([pose.center for _, pose in views_of(job, solved.state)])
    mine = solved.taken
    arm = center[obs.view[mine]] - solved.state.points[obs.point[mine]]
    out = np.zeros((len(job.markers), 3))
    np.add.at(out, obs.point[mine], arm / np.linalg.norm(arm, axis=1, keepdims=True))
    count = np.bincount(obs.point[mine], minlength=len(out))[:, None]
    return np.where(count > 0, out / np.maximum(count, 1), np.nan)
