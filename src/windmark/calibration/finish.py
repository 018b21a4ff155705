"""From an adjusted network to a `Calibration`: datum, covariances, names."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import NetworkState
from windmark.adjust.network.datum import DatumCovariance, in_datum
from windmark.adjust.network.problem import camera_columns
from windmark.calibration.advice import helpful_pictures
from windmark.calibration.bar_reliability import hardly_checked_bars
from windmark.calibration.datum import Free
from windmark.calibration.disc_shapes import Discs
from windmark.calibration.lens_known import RADIAL, radial_spread
from windmark.calibration.reliability import hardly_checked
from windmark.calibration.result import Calibration
from windmark.calibration.rough_places import held_by_table
from windmark.calibration.setup import Job, frames_of, taking_part, views_of
from windmark.calibration.sides import mirror_doubts
from windmark.calibration.solve import Solved
from windmark.calibration.swaps import swapped
from windmark.geometry import PARAMETERS, DegenerateGeometry, Pose
from windmark.geometry.rotations import hat
from windmark.geometry.similarity import Similarity, align
from windmark.scene import Doubt, MarkerSet, Observations

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

WEAK = 0.1
"""1 sigma in natural units (the focal length itself, the size of the model, the corner's distance from the image's
centre) above which something counts as not determined."""


OUT = "its marks contradict the others"
"""Why a marker or a view took no part that had enough marks."""


def calibration(
    job: Job, solved: Solved, good: Mask, dropped: dict[str, str], options: dict[str, Any],
    doubts: tuple[Doubt, ...] = (),
) -> Calibration:  # fmt: skip
    """Put an adjusted network into its datum and name everything, with the ``doubts`` known before.

    ``good`` (O,) are the marks that were given to it. What is not determined must have been refused before
    (`refuse_weak`).
    """
    chosen = datum_points(job)
    obs = job.observations
    seen = np.zeros(len(job.markers), dtype=np.bool_)
    seen[obs.point[solved.taken]] = True
    gone = _lost(job, solved, good)
    doubts = (*doubts, *gone)
    dropped = dropped | {name: OUT for d in gone for name in d.names if name in dropped}
    if chosen is not None:
        solved, chosen, beside = _by_table(job, solved, chosen, chosen & seen)
        doubts = (*doubts, *beside)
    state, discs = solved.state, solved.discs
    covariance = in_datum(solved.covariance, chosen)
    scale = solved.scale
    marker_cov = covariance.points()[seen] * scale
    sigma = np.sqrt(np.maximum(np.diagonal(marker_cov, axis1=1, axis2=2), 0.0))
    markers = replace(_with_discs(job.markers, discs).take(seen), xyz=state.points[seen], sigma=sigma)
    view_seen = np.zeros(len(job.views), dtype=np.bool_)
    view_seen[obs.view[solved.taken]] = True
    residuals = _pixels(solved, obs.cov[solved.taken])
    change = np.zeros((len(job.views), 3)) if state.change is None else state.change
    at, o, frames = views_of(job, state), state.offsets, frames_of(job)[1]
    used = np.zeros(len(obs), dtype=np.bool_)
    used[np.flatnonzero(solved.taken)[solved.used]] = True
    doubts = (*doubts, *mirror_doubts(job.markers, state.points, seen, obs, used, [pose for _, pose in at]))
    views = tuple(replace(job.views[v], cam_from_model=at[v][1]) for v in np.flatnonzero(view_seen))
    return Calibration(
        cameras=_cameras(job, solved, covariance, scale),
        views=views,
        markers=markers,
        marker_cov=marker_cov,
        pose_cov=pose_covs(job, solved, covariance, np.flatnonzero(view_seen), frames) * scale,
        observations=Observations(
            (np.cumsum(view_seen) - 1)[obs.view[solved.taken]], (np.cumsum(seen) - 1)[obs.point[solved.taken]],
            obs.xy[solved.taken], obs.cov[solved.taken],
        ),
        residuals=residuals,
        test=solved.test,
        used=solved.used,
        sigma0=solved.sigma0,
        redundancy=solved.redundancy,
        rms_px=float(np.sqrt((residuals[solved.used] ** 2).sum(axis=1).mean())),
        focal_change=change[view_seen, 0],
        principal_shift=change[view_seen, 1:],
        dropped=dropped,
        suspect=tuple(dict.fromkeys(name for doubt in doubts for name in doubt.names)),
        doubts=doubts,
        swapped=swapped(job, solved, at),
        report=solved.report,
        options=options,
        cam_from_rig={n: Pose(o.rotation[c], o.translation[c]) for c, n in enumerate(job.cameras)} if o else {},
        rig_cov=_rig_cov(job, solved, covariance, scale) if o else {},
        hardly_checked=hardly_checked(job, solved, seen, sigma),
        hardly_checked_bars=hardly_checked_bars(job, solved, seen, sigma),
    )  # fmt: skip


def datum_points(job: Job) -> Mask | None:
    """(N,) markers that hold a free network; None where the datum is in the network itself."""
    return job.chosen(job.datum.markers, "datum") if isinstance(job.datum, Free) else None


def refuse_weak(job: Job, solved: Solved, rough: NetworkState | None = None) -> None:
    """Nothing undetermined is returned as if it were known.

    ``rough`` is what the adjustment began with; with it the refusal names pictures that would help.

    Raises
    ------
    DegenerateGeometry
        Naming what the pictures, or the datum, do not determine.
    """
    motions = solved.covariance.motions.shape[1]
    if motions and not isinstance(job.datum, Free):
        raise DegenerateGeometry(
            f"the datum leaves {motions} of seven motions free; it needs three markers that are not on a line",
            ("datum",),
        )
    covariance = in_datum(solved.covariance, datum_points(job))
    lay = solved.problem.layout
    names, inner = list(job.cameras), camera_columns(lay)
    variance = np.diagonal(covariance.some(np.array([column for _, _, column in inner], dtype=np.int64)))
    sigma = np.sqrt(np.maximum(variance, 0.0) * solved.scale)
    poor = [each for each, s in zip(inner, sigma, strict=True) if not s < WEAK]
    if any(parameter in RADIAL for _, parameter, _ in poor):
        cameras = list(_cameras(job, solved, covariance, solved.scale).values())
        known = [c.lens == "rational" and radial_spread(c, c.cov) < WEAK for c in cameras]
        poor = [each for each in poor if not (known[each[0]] and each[1] in RADIAL)]
    weak = [parameter if len(names) == 1 else f"{names[c]} {parameter}" for c, parameter, _ in poor]
    spread = np.sqrt(np.nanmax(np.diagonal(covariance.points(), axis1=1, axis2=2), axis=1, initial=0.0))
    loose = np.flatnonzero(spread * np.sqrt(solved.scale) > WEAK * lay.unit)
    weak += [f"marker {name}" for name in job.markers.name[loose][:10]]
    if weak:
        best = () if rough is None else helpful_pictures(solved, rough, [(c, name) for c, name, _ in poor], WEAK)
        advice = f"; what would help most: a further picture {', and one '.join(best)}" if best else ""
        raise DegenerateGeometry(f"the pictures do not determine everything that is free{advice}", tuple(weak))


def _lost(job: Job, solved: Solved, good: Mask) -> list[Doubt]:
    """Markers and views that lost a quarter of their marks and more than one by chance; or all, and took no part."""
    obs, out, given = job.observations, [], taking_part(job, good)[0]
    given[solved.taken] = True
    bad = given.copy()
    bad[np.flatnonzero(solved.taken)[solved.used]] = False
    for index, names, words, cause in (
        (obs.point, job.markers.name.tolist(), "it moved, is not where its table says, or has wrong labels", "marker"),
        (
            obs.view,
            [v.name for v in job.views],
            "out of focus, taken by another camera, wrong labels, or the markers had moved",
            "picture",
        ),
    ):
        lost, every = (np.bincount(index[marks], minlength=len(names)) for marks in (bad, given))
        out += [
            Doubt((str(names[n]),), f"{{}} lost {lost[n]} of its {every[n]} marks: {words}", cause)
            for n in np.flatnonzero((lost > 1) & (4 * lost >= every))
        ]
    return out


def _with_discs(markers: MarkerSet, discs: Discs | None) -> MarkerSet:
    """The table with the normals and radii that the ellipses tell; radii that it has stay."""
    if discs is None:
        return markers
    told = np.isfinite(discs.normal)
    radius = np.where(np.isfinite(markers.radius), markers.radius, discs.radius)
    return replace(markers, normal=np.where(told, discs.normal, markers.normal), radius=radius)


def transformed(state: NetworkState, fit: Similarity) -> NetworkState:
    """A network seen in another frame: the same pictures."""
    offsets = state.offsets
    if offsets is not None:
        offsets = Pose(offsets.rotation, fit.scale * offsets.translation)
    return replace(state, frames=fit.moved(state.frames), points=fit.apply(state.points), offsets=offsets)


def _by_table(job: Job, solved: Solved, chosen: Mask, known: Mask) -> tuple[Solved, Mask, tuple[Doubt, ...]]:
    """A free network in its table's frame, by those of the ``known`` markers that hold it: which (N,), and doubts."""
    scale = solved.covariance.motions.shape[1] == 7

    def fitted(by: Mask) -> Solved:
        return _in_frame(solved, align(solved.state.points[by], job.markers.xyz[by], scale=scale))

    def held(of: Solved, spread: Array) -> tuple[Mask, tuple[Doubt, ...]]:
        names, unit = [str(n) for n in job.markers.name[known]], job.markers.length_unit or ""
        return held_by_table(of.state.points[known], job.markers.xyz[known], spread, names, unit, scale=scale)

    whole = fitted(known)
    if held(whole, np.zeros(int(known.sum())))[0].all():
        return whole, chosen, ()
    # Some are far from the table: what the pictures leave open of them is asked only then.
    cov = in_datum(whole.covariance, chosen).points()[known] * whole.scale
    on, doubts = held(whole, np.sqrt(np.maximum(np.trace(cov, axis1=1, axis2=2) / 3, 0.0)))
    if on.all():
        return whole, chosen, ()
    by = known.copy()
    by[known] = on
    return fitted(by), by, doubts


def _in_frame(solved: Solved, fit: Similarity) -> Solved:
    """An adjusted network in another frame, nothing adjusted or inverted again."""
    problem = solved.problem.moved(fit)
    return replace(
        solved, problem=problem, state=transformed(solved.state, fit),
        covariance=solved.covariance.moved(fit.rotation, problem.layout),
        discs=None if solved.discs is None else solved.discs.moved(fit),
    )  # fmt: skip


def _cameras(job: Job, solved: Solved, covariance: DatumCovariance, scale: float) -> dict[str, Any]:
    """The cameras with the covariance of their free parameters."""
    units = solved.problem.units(solved.state)
    out, columns = {}, solved.problem.layout.columns.camera
    for c, name in enumerate(job.cameras):
        own = np.flatnonzero(columns[c] >= 0)
        index, step = columns[c][own], units.camera[c][own]
        cov = np.zeros((len(PARAMETERS),) * 2)
        cov[np.ix_(own, own)] = covariance.some(index) * np.outer(step, step) * scale
        out[name] = replace(solved.state.cameras[c], cov=cov if len(own) else None)
    return out


def pose_covs(job: Job, solved: Solved, covariance: DatumCovariance, views: Ints, frames: Ints) -> Array:
    """(V, 6, 6) of ``exp(delta) @ cam_from_model`` of some views in units of the marks' covariances."""
    columns = solved.problem.layout.columns
    if solved.state.offsets is not None or (columns.frame[frames[views]] < 0).any():
        return np.stack([_pose_cov(job, solved, covariance, v, int(frames[v])) for v in views.tolist()])
    units = solved.problem.units(solved.state)
    index = columns.frame[frames[views]][:, None] + np.arange(6)
    change = tangent(units.frame_pivot[frames[views]], units.frame_scale[frames[views]])
    cov = covariance.between(index, index, solved.covariance.dense[index[:, :, None], index[:, None, :]])
    return np.asarray(change @ cov @ change.transpose(0, 2, 1))


def _pose_cov(job: Job, solved: Solved, covariance: DatumCovariance, view: int, frame: int) -> Array:
    """(6, 6) of one view: in a rig, or where frames are eliminated."""
    lay, units = solved.problem.layout, solved.problem.units(solved.state)
    columns, network = lay.columns, solved.covariance
    member = list(job.cameras).index(job.views[view].camera)
    eliminated = columns.frame[frame] < 0
    start = lay.dense + 6 * columns.frame_block[frame] if eliminated else columns.frame[frame]
    index = start + np.arange(6)
    change = tangent(units.frame_pivot[frame], units.frame_scale[frame])
    if solved.state.offsets is not None:
        pose = Pose(solved.state.offsets.rotation[member], solved.state.offsets.translation[member])
        change = adjoint(pose) @ change
        if columns.offset[member] >= 0:
            index = np.concatenate([columns.offset[member] + np.arange(6), index])
            change = np.concatenate([tangent(units.offset_pivot[member], units.offset_scale[member]), change], axis=1)
    cov = covariance.between(index, index, network.marginal(index))
    return np.asarray(change @ cov @ change.T)


def _rig_cov(job: Job, solved: Solved, covariance: DatumCovariance, scale: float) -> dict[str, Array]:
    """(6, 6) of ``exp(delta) @ cam_from_rig`` of each camera; zero of the first, which is the rig's frame."""
    columns, units = solved.problem.layout.columns.offset, solved.problem.units(solved.state)
    out = {}
    for c, name in enumerate(job.cameras):
        out[name] = np.zeros((6, 6))
        if columns[c] >= 0:
            index, change = columns[c] + np.arange(6), tangent(units.offset_pivot[c], units.offset_scale[c])
            cov = covariance.between(index, index, solved.covariance.dense[np.ix_(index, index)])
            out[name] = change @ cov @ change.T * scale
    return out


def tangent(pivot: Array, scale: Array) -> Array:
    """(..., 6, 6): natural steps (a turn about the pivot (..., 3), a shift in parts of the scale) as [rotation,
    translation].
    """
    out = np.zeros((*pivot.shape[:-1], 6, 6))
    out[..., :3, :3], out[..., 3:, :3], out[..., 3:, 3:] = np.eye(3), hat(pivot), scale[..., None, None] * np.eye(3)
    return out


def adjoint(pose: Pose) -> Array:
    """(6, 6): ``pose @ exp(delta) = exp(adjoint delta) @ pose``."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = pose.rotation
    out[3:, :3] = hat(pose.translation) @ pose.rotation
    return out


def _pixels(solved: Solved, cov: Array) -> Array:
    """Residuals in pixels from the whitened ones."""
    x, y = solved.residual.T
    root = np.sqrt(cov[:, 0, 0])  # the factor (Cholesky) of a 2 x 2 matrix
    along = cov[:, 1, 0] / root
    return np.stack([root * x, along * x + np.sqrt(cov[:, 1, 1] - along**2) * y], axis=1)
