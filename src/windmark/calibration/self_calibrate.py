"""The verb `self_calibrate`: interior parameters, poses and marker coordinates from pictures alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust.network import NetworkState
from windmark.adjust.network.linear import single_thread
from windmark.calibration.bar_scale import other_unit, scale_doubts
from windmark.calibration.changed_views import change_doubts
from windmark.calibration.consistent import with_control
from windmark.calibration.datum import Datum, Distance
from windmark.calibration.eccentric import radii_off
from windmark.calibration.finish import calibration, refuse_weak
from windmark.calibration.foreign import contradicting, most_foreign, of_its_own, without
from windmark.calibration.lens_known import with_coefficients_told
from windmark.calibration.mirrored_marks import mirrored_refusal
from windmark.calibration.mixed import likely_mixed, two_cameras, with_mixed
from windmark.calibration.result import Calibration, NotCalibrated
from windmark.calibration.setup import Job, first_state, taking_part
from windmark.calibration.solve import Solved
from windmark.calibration.start import start_poses
from windmark.errors import g3
from windmark.geometry import Camera, DegenerateGeometry, Pose
from windmark.options.calibration import ECCENTRICITY, MAX_SIGMA0, SOLVER
from windmark.scene import MarkerSet, Observations, View
from windmark.scene.repeated import ONCE_MORE, repeated_views
from windmark.scene.shown import by_name, check_kinds, list_of
from windmark.scene.units import RADII_OFF, radii_words

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FREE = ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2")
"""Free by default: the paper's set (AIAA 2005-5007, section IV.A)."""
FREE_OF = {
    "brown": FREE, "rational": (*FREE, "k3", "k4", "k5", "k6"), "fisheye": (*FREE[:6], "k3", "k4"),
}  # fmt: skip
"""The same of each lens."""
LEAST_USED = 0.6
"""Share of the marks that must fit: where more are gross errors, they are none."""
RETRY_FOCAL = (0.6, 0.8, 1.25, 1.6)
"""Focal lengths started from when the given one leads to no solution."""


def self_calibrate(
    observations: Observations,
    markers: MarkerSet,
    cameras: Mapping[str, Camera],
    views: Sequence[View],
    *,
    datum: Datum,
    free: Sequence[str] | None = None,
    distances: Sequence[Distance] = (),
    rig: bool = False,
    free_focal: Sequence[str] = (),
    free_principal: Sequence[str] = (),
    prior_sigma: Mapping[str, float] | None = None,
    eccentricity: str = ECCENTRICITY.default,
    ellipses: ArrayLike | None = None,
    reject: bool = True,
    max_sigma0: float = MAX_SIGMA0.default,
    solver: str = SOLVER.default,
    seed: int = 0,
) -> Calibration | NotCalibrated:
    """Calibrate cameras and markers together, in place (AIAA 2005-5007, section IV).

    Parameters
    ----------
    observations : matched marks; ``view`` and ``point`` are indices into ``views`` and ``markers``
    markers : rough coordinates (some per cent of the model), with radius and normal where known
    cameras : start values by name; a focal length within a factor of two, distortion zero, will do
    views : each with the name of its camera; a pose is found where ``cam_from_model`` is None
    datum : `Fixed`, `Weighted` or `Free`; no default
    free : interior parameters to find, of `geometry.PARAMETERS`; all cameras alike, but for what a camera's lens lacks.
        None: focal length, aspect, principal point and the coefficients of the lenses (`FREE_OF`); of a rational lens
        as many of these as the marks tell apart, the others stay as they are
    distances : known distances, which give a free network its scale
    rig : views with the same ``frame`` were taken at once by cameras that do not move against each other
    free_focal : views whose focal length may differ from that of their camera, as the focus distance did (Fig. 6)
    free_principal : views whose principal point may differ from that of their camera, as a loosely mounted or
        stabilised lens or a cut picture has it
    prior_sigma : 1 sigma of free parameters round the start values, by name; of "focus" that of the relative changes of
        the focal length in the views of ``free_focal``, which may be all then: a camera that focuses by itself; of
        "principal" that of the shifts of the principal point (px) in the views of ``free_principal``
    eccentricity : the image of a disc's centre is not the centre of its image. "auto" corrects with the normals (and,
        where the table has none, the radii) that the ellipses tell; of markers whose ellipses tell none with the
        table's normals, then that of the surface through the neighbouring markers, or, where there is none, of the
        side the markers are seen from; "table" only with the table's (markers without stay as they are, which does
        harm beside corrected ones)
    ellipses : (O, 3) half axes in pixels and direction of the first (radians, from x towards y) of each mark's ellipse,
        as `Detections` has them; NaN where not measured
    reject : leave gross errors out; without, all marks take part with full weight, and are only tested
    max_sigma0 : residuals larger than this, in units of the marks' covariances, are no solution
    solver : of the least squares, from start values that a robust Levenberg-Marquardt finds: "newton" goes on with
        it; "steps" takes the paper's growing and shrinking steps (section IV.B), to compare: the same minimum
        hundreds to thousands of times slower, `NotCalibrated` where 3000 passes do not reach it
    seed : of the choice of triplets for the first poses

    Returns
    -------
    A `Calibration`, or a falsy `NotCalibrated` with its reason.

    Raises
    ------
    ValueError
        For wrong indices, names, options, or a marker observed twice in one view.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(30)], rng.uniform(-1.0, 1.0, (30, 3)) * [2.0, 1.5, 0.5])
    >>> eyes, camera = [(-3, 0, 6), (3, 0, 6), (0, 3, 6), (0, -3, 6)], wm.Camera((640, 480), 800.0, k1=-0.1)
    >>> poses = [wm.Pose.look_at(eye, [0, 0, 0], [1, 0, 0]) for eye in eyes]
    >>> xy = np.concatenate([camera.project(pose.apply(markers.xyz))[0] for pose in poses])
    >>> seen = wm.Observations(*np.divmod(np.arange(120), 30), xy, np.tile(0.0004 * np.eye(2), (120, 1, 1)))
    >>> start, views = {"camera": wm.Camera((640, 480), 760.0)}, [wm.View(f"view{i}") for i in range(4)]
    >>> found = wm.self_calibrate(seen, markers, start, views, datum=wm.Free(), free=["focal_px", "k1"])
    >>> round(found.cameras["camera"].focal_px, 1), round(found.cameras["camera"].k1, 3)
    (800.0, -0.1)
    """
    check_kinds(
        "self_calibrate", observations=(observations, Observations), markers=(markers, MarkerSet),
        cameras=(cameras, by_name(Camera, single=False)), views=(views, list_of(View)),
    )  # fmt: skip
    ECCENTRICITY.check(eccentricity, "self_calibrate")
    usual = free is None
    if free is None:
        free = usual_free(_in_use(cameras, views).values())
    options: dict[str, Any] = {
        "datum": datum, "free": tuple(free), "distances": tuple(distances), "rig": rig,
        "free_focal": tuple(free_focal), "free_principal": tuple(free_principal),
        "prior_sigma": dict(prior_sigma or {}), "eccentricity": eccentricity, "reject": reject,
        "max_sigma0": max_sigma0, "solver": solver, "seed": seed,
    }  # fmt: skip
    job = Job(
        observations, markers, tuple(views), _in_use(cameras, views), tuple(free), datum, tuple(distances), rig,
        tuple(free_focal), dict(prior_sigma or {}), solver,
        None if ellipses is None else np.asarray(ellipses, dtype=float), tuple(free_principal),
    )  # fmt: skip
    if why := other_unit(job.markers, job.distances):
        return NotCalibrated(why, "units", options=options)
    every = np.ones(len(observations), dtype=np.bool_)
    if not taking_part(job, every)[0].any():
        dropped = taking_part(job, every)[1]
        reason = "no view has four marks of markers that are seen at least twice"
        return NotCalibrated(reason, "too_few", dropped=dropped, options=options)
    with single_thread(6 * len(job.views)):
        outcome = _best_of_starts(job, options)
        if not usual:
            return outcome

        def again(fewer: tuple[str, ...]) -> Calibration | NotCalibrated:
            return _best_of_starts(replace(job, free=fewer), {**options, "free": fewer})

        return with_coefficients_told(outcome, job.cameras, job.free, again, len(observations))


def usual_free(cameras: Iterable[Camera]) -> tuple[str, ...]:
    """The parameters that are free by default with the lenses of some cameras."""
    return tuple(dict.fromkeys(p for c in cameras for p in FREE_OF[c.lens])) or FREE


def _in_use(cameras: Mapping[str, Camera], views: Sequence[View]) -> dict[str, Camera]:
    """The cameras of the views, in their own order; unknown names are found by `Job`."""
    used = {v.camera for v in views}
    return {name: camera for name, camera in cameras.items() if name in used}


def _best_of_starts(job: Job, options: dict[str, Any]) -> Calibration | NotCalibrated:
    """From the given focal length, and from others where that leads to no solution."""
    refusal: NotCalibrated | None = None
    accepted: list[Calibration] = []
    factors = (1.0, *RETRY_FOCAL) if "focal_px" in job.free else (1.0,)
    for n, factor in enumerate(factors):
        cameras = {name: replace(c, focal_px=c.focal_px * factor) for name, c in job.cameras.items()}
        outcome = _attempt(job, cameras, options, options["seed"] + n)
        if isinstance(outcome, Calibration):
            accepted.append(outcome)
            if not _lost_markers(outcome):
                break
            continue  # a solution that leaves markers alone is perhaps none: another start may explain them, too
        if refusal is None or outcome.sigma0 < refusal.sigma0 or np.isnan(refusal.sigma0):
            refusal = outcome
        if outcome.cause == "degenerate" and outcome.sigma0 <= options["max_sigma0"]:
            break  # the marks fit: no other start can help
    if accepted:
        return max(accepted, key=lambda result: int(result.used.sum()))
    assert refusal is not None
    seed = options["seed"]
    return mirrored_refusal(job, refusal, lambda turned: _attempt(turned, turned.cameras, options, seed), seed)


def _lost_markers(result: Calibration) -> bool:
    """Whether markers took no part because all of their marks were left out."""
    return any(d.cause == "marker" and set(d.names) & set(result.dropped) for d in result.doubts)


def _attempt(
    job: Job, cameras: Mapping[str, Camera], options: dict[str, Any], seed: int
) -> Calibration | NotCalibrated:
    """From one start; once more without pictures that contradict all others, if the others agree then."""
    try:
        good, state, dropped = _start(job, cameras, seed)
    except DegenerateGeometry as error:
        return NotCalibrated(str(error), "degenerate", error.weak, {}, np.nan, options)
    if state is None:
        reason = "no view has a pose: fewer than four marks, or markers on one line"
        return NotCalibrated(reason, "too_few", (), dropped, np.nan, options)
    outcome, solved = _adjusted(job, state, good, dropped, options)
    whole, others, foreign = solved, outcome, dict[int, str]()
    # Where all differ a little (a lens that focuses by itself) the rest still asks for it, however many are left out.
    while (
        options["reject"] and solved is not None and isinstance(others, Calibration)
        and contradicting(others, least=0 if foreign else 2)
    ):  # fmt: skip
        if 4 * (len(foreign) + 1) > len(job.views):
            return _of_two_cameras(job, outcome, whole, options, seed)  # of so many none is told to be the wrong one
        view = most_foreign(solved)
        foreign[view] = of_its_own(job, solved, view)
        rest = good & ~np.isin(job.observations.view, list(foreign))
        others, solved = _adjusted(job, state, rest, dropped, options)
    if not isinstance(others, Calibration):
        return _of_two_cameras(job, outcome, whole, options, seed)
    found = without(others, {job.views[v].name: focal for v, focal in foreign.items()}) if foreign else others
    mixed = _of_two_cameras(job, outcome, whole, options, seed) if len(foreign) > 1 or likely_mixed(found) else outcome
    return mixed if mixed is not outcome else found


def _of_two_cameras(
    job: Job, outcome: Calibration | NotCalibrated, solved: Solved | None, options: dict[str, Any], seed: int
) -> Calibration | NotCalibrated:
    """The outcome, with what is to be said where its pictures are of two cameras."""
    if solved is None or not options["reject"]:
        return outcome

    def again(parted: Job) -> Calibration | NotCalibrated:
        good, state, dropped = _start(parted, parted.cameras, seed)
        if state is None:
            return NotCalibrated("no view has a pose", "too_few", (), dropped, np.nan, options)
        return _adjusted(parted, state, good, dropped, options)[0]

    doubt = two_cameras(job, solved, again)
    return outcome if doubt is None else with_mixed(outcome, doubt)


def _adjusted(
    job: Job, state: NetworkState, good: Mask, dropped: dict[str, str], options: dict[str, Any]
) -> tuple[Calibration | NotCalibrated, Solved | None]:
    """The ``good`` (O,) marks adjusted from a start and judged, and what was solved."""
    sigma0 = np.nan

    solved: Solved | None = None

    def refused(cause: str, reason: str) -> tuple[NotCalibrated, Solved | None]:
        # Of marks that do not fit it may still be asked why.
        return NotCalibrated(reason, cause, (), dropped, sigma0, options), solved if cause == "misfit" else None

    try:
        held = with_control(job, state, good, options)
        job, solved = held.job, held.solved
        dropped, sigma0 = solved.dropped | dropped, solved.sigma0
        if held.unclear is not None:
            why = str(held.unclear)
            return NotCalibrated(why, "control", held.unclear.names, dropped, sigma0, options), None
        if solved.redundancy <= 0:
            return refused("too_few", f"{2 * int(solved.used.sum())} observations for as many unknowns or more")
        ratio = radii_off(job.markers, solved.discs)
        if max(ratio, 1 / ratio) > RADII_OFF:
            return refused("discs", radii_words(ratio, job.markers.length_unit))
        if sigma0 > options["max_sigma0"]:
            return refused(
                "misfit",
                f"residuals are {g3(sigma0)} times what the marks' covariances say (limit "
                f"{options['max_sigma0']:g}): wrong labels, a start too far away, or a lens beyond the model",
            )
        # First: where something is not determined, the search has no end.
        refuse_weak(job, solved, state)
        if not solved.report.converged:
            return refused("not_converged", f"the adjustment ended without a minimum: {solved.report.reason}")
        if (share := float(solved.used.sum() / good.sum())) < LEAST_USED:
            return refused(
                "misfit",
                f"only {100 * share:.0f} % of the marks fit one solution: wrong labels, a start too far away, or a "
                "lens beyond the model (free more parameters)",
            )
        used = {"datum": job.datum, "distances": job.distances, "prior_sigma": dict(job.prior_sigma)}
        doubts = (*held.doubts, *scale_doubts(job, solved), *change_doubts(job, solved, held.alone, misfit=held.misfit))
        return calibration(job, solved, good, dropped, {**options, **used}, doubts), solved
    except DegenerateGeometry as error:
        return NotCalibrated(str(error), "degenerate", error.weak, dropped, sigma0, options), None


def _start(job: Job, cameras: Mapping[str, Camera], seed: int) -> tuple[Mask, NetworkState | None, dict[str, str]]:
    """Marks of views with a pose, first values, and the views without one."""
    obs, rng = job.observations, np.random.default_rng(seed)
    good = np.ones(len(obs), dtype=np.bool_)
    poses: list[Pose | None] = [v.cam_from_model for v in job.views]
    found = dict(cameras)
    dropped: dict[str, str] = {}
    for name, camera in cameras.items():
        mine = [v for v, view in enumerate(job.views) if view.camera == name and poses[v] is None]
        if not mine:
            continue
        marks = [(obs.xy[obs.view == v], job.markers.xyz[obs.point[obs.view == v]]) for v in mine]
        found[name], new, _ = start_poses(camera, marks, scan_focal="focal_px" in job.free, rng=rng)
        for v, pose in zip(mine, new, strict=True):
            poses[v] = pose
            if pose is None:
                good[obs.view == v] = False
                count = int((obs.view == v).sum())
                dropped[job.views[v].name] = f"view without a pose: {count} marks (four are needed, not on one line)"
    for v, first in repeated_views(obs.view, obs.point, obs.xy, obs.cov).items():
        if good[obs.view == v].any():
            good[obs.view == v] = False
            dropped[job.views[v].name] = f"{job.views[first].name} once more: {ONCE_MORE}"
    if not taking_part(job, good)[0].any():
        return good, None, dropped
    return good, first_state(job, found, poses), dropped
