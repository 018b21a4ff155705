"""A free network in another datum: the same pictures, other coordinates and covariances, nothing adjusted again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.network import NetworkProblem, NetworkState
from windmark.adjust.network.covariance import network_covariance
from windmark.calibration.datum import Free
from windmark.calibration.finish import calibration
from windmark.calibration.result import Calibration
from windmark.calibration.setup import Job, first_state, make_network, views_of
from windmark.calibration.solve import Solved
from windmark.errors import UsageError
from windmark.scene import MarkerSet

Array = NDArray[np.float64]


def in_datum(result: Calibration, datum: Free, reference: MarkerSet | None = None) -> Calibration:
    """Coordinates, poses and all their covariances with other markers as the datum, or fitted to other coordinates.

    The S-transformation of `adjust.network.datum`. Interior parameters, residuals and the shape stay what they are.

    Parameters
    ----------
    result : of a free network
    datum : the markers that hold it now; None takes all (of the reference)
    reference : coordinates to which the datum's markers are fitted, found by name; None: those of the result

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        For a network that is not free (held or weighted markers shape its residuals; calibrate anew), or a datum with
        markers that the result or the reference do not have.
    DegenerateGeometry
        When the datum's markers do not hold it: three are needed, not on a line.
    """
    given = result.options["datum"]
    if not (isinstance(given, Free) and isinstance(datum, Free)):
        other = type(datum if isinstance(given, Free) else given).__name__
        raise UsageError(f"in_datum: expected a free network and a datum Free, got {other}; calibrate anew for that")
    job = job_of(result, datum, reference)
    solved, every = linearised(result, job), np.ones(len(result.observations), dtype=np.bool_)
    found = calibration(job, solved, every, dict(result.dropped), {**result.options, "datum": datum})
    return replace(found, doubts=result.doubts, suspect=result.suspect)


def linearised(result: Calibration, job: Job) -> Solved:
    """What was solved, from its result: linearised there once more."""
    state = _state(job, result)
    every = np.ones(len(result.observations), dtype=np.bool_)
    problem = NetworkProblem(make_network(job, every, result.used.astype(float)), state, _shift(job, result, state))
    system, residual = problem.linearise(state), problem.residual(state)
    assert system is not None
    assert residual is not None
    white = np.empty_like(residual)
    white[problem.order] = residual
    return Solved(
        problem, state, network_covariance(system, problem.layout), result.report, every, result.used, white,
        result.test, result.sigma0, result.redundancy, dict(result.dropped),
    )  # fmt: skip


def job_of(result: Calibration, datum: Free, reference: MarkerSet | None) -> Job:
    """The calibration as it was asked for, with the new datum."""
    options, markers = result.options, result.markers
    if reference is not None:
        place = {str(name): n for n, name in enumerate(reference.name)}
        names = [str(n) for n in markers.name if str(n) in place] if datum.markers is None else list(datum.markers)
        missing = [n for n in names if n not in place]
        if missing:
            raise UsageError(f"in_datum: the reference has no marker {missing[0]!r}")
        datum, xyz = Free(names), markers.xyz.copy()
        known = np.isin(markers.name, names)
        xyz[known] = reference.xyz[[place[str(n)] for n in markers.name[known]]]
        markers = replace(markers, xyz=xyz)
    seen = {v.name for v in result.views}
    there = set(markers.name.tolist())
    return Job(
        result.observations, markers, result.views, {n: replace(c, cov=None) for n, c in result.cameras.items()},
        options["free"], datum, tuple(d for d in options["distances"] if {d.first, d.second} <= there),
        options["rig"], tuple(n for n in options["free_focal"] if n in seen), options["prior_sigma"],
        free_principal=tuple(n for n in options["free_principal"] if n in seen),
    )  # fmt: skip


def _state(job: Job, result: Calibration) -> NetworkState:
    """The values as they are."""
    state = first_state(job, job.cameras, [v.cam_from_model for v in job.views])
    change = None if state.change is None else np.column_stack([result.focal_change, result.principal_shift])
    return replace(state, points=result.markers.xyz.copy(), change=change)


def _shift(job: Job, result: Calibration, state: NetworkState) -> Array:
    """(O, 2) the eccentricity of the imaged discs, which is in the residuals."""
    obs, shift = result.observations, np.zeros((len(result.observations), 2))
    for v, (camera, pose) in enumerate(views_of(job, state)):
        mine = obs.view == v
        seen = camera.project(pose.apply(state.points[obs.point[mine]]))[0]
        shift[mine] = result.residuals[mine] + obs.xy[mine] - seen
    return shift
