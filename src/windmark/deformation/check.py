"""Tests of a law before it is trusted with a measurement: shape, finite, continuous, every parameter with an effect,
each point by itself.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.extent import ends_and_jumps, uneven
from windmark.deformation.law import BoundLaw, Law, LawError
from windmark.deformation.parameter import Parameter
from windmark.errors import g3

Array = NDArray[np.float64]

JUMP = 0.2
"""Two difference quotients of a smooth law, over a step and over its half, differ by no more than this part."""
STEPS = (1.0, 0.5, 0.25, 0.125)
"""Changes tried, as part of the largest one; a smooth law's quotients agree better and better."""
ALONE = 1e-7
"""Of the points' extent: what a point moves by rounding when it is asked for with others."""


def check_law(law: Law, xyz: ArrayLike, *, name: str = "", source: str = "") -> tuple[str, ...]:
    """Check a law on points of its volume.

    Parameters
    ----------
    law : the law
    xyz : (N, 3) undeformed points, at least one
    name, source : of the law, for messages

    Returns
    -------
    tuple of str
        Remarks that are no errors: the points move at the start values, a parameter without effect or with a kink, or
        one for which the law has no place before its bound, or as far from its start as it is tried.

    Raises
    ------
    LawError
        When it returns a wrong shape or numbers that are not finite, changes from call to call, or jumps, or where a
        point goes depends on the other points.
    """
    points = np.asarray(xyz, dtype=float)
    label = f"{source or getattr(law, 'source', '')}: law {name or getattr(law, 'name', type(law).__name__)}".lstrip(
        ": "
    )
    bound, q = law.bind(points), np.array([p.start for p in law.parameters])
    rest = _called(bound.place(q), points, label, "at its start values")
    if not np.array_equal(rest, bound.place(q)):
        raise LawError(f"{label}: gives other points when it is called again with the same parameters")
    extent = float(max(np.ptp(points, axis=0).max(), 1e-6 * np.abs(points).max(), 1e-9))
    remarks = []
    off = float(np.linalg.norm(rest - points, axis=1).max())
    if off > 1e-6 * extent:
        remarks.append(f"{label}: moves points by up to {g3(off)} at its start values")
    by_q = bound.linearise(q)[1]
    if by_q.shape != (*points.shape, len(q)):
        raise LawError(f"{label}: its derivative must be {(*points.shape, len(q))}, got {by_q.shape}")
    wild = ~np.isfinite(by_q).all(axis=1)
    if wild.any():
        bad, j = np.argwhere(wild)[0].tolist()
        raise LawError(
            f"{label}: does not move the point {points[bad].tolist()} by finite numbers when {law.parameters[j].name} "
            f"changes a little from {q[j]:g}{_with_options(law)}"
        )
    for j, parameter in enumerate(law.parameters):
        size = float(np.linalg.norm(by_q[..., j], axis=1).max())
        change = _change(parameter, size, extent)
        quotients = []
        for part in STEPS:
            there = q.copy()
            there[j] += part * change
            words = f"with {parameter.name} = {there[j]:.4g} {parameter.unit}".rstrip()
            place = _called(bound.place(there), points, label, words)
            quotients.append((place - rest) / (part * change))
            if part == STEPS[0]:
                _check_alone(law, points, place, there, extent, f"{label}: {words}")
        largest = max(float(np.abs(c).max()) for c in quotients)
        if largest * abs(change) < 1e-9 * extent:
            remarks.append(f"{label}: parameter {parameter.name} moves none of the {len(points)} points")
        elif size == 0:
            remarks.append(f"{label}: parameter {parameter.name} has no effect close to its start {parameter.start:g}")
        elif float(np.abs(quotients[-1] - quotients[-2]).max()) > JUMP * largest:
            worst = np.unravel_index(int(np.abs(quotients[-1] - quotients[-2]).argmax()), rest.shape)
            where, jumps = _uneven(bound, q, j, STEPS[-2] * change, worst)
            if jumps:
                raise LawError(f"{label}: is not continuous in {parameter.name} near {g3(where)}")
            remarks.append(f"{label}: its slope in {parameter.name} changes near {g3(where)}, close to its start "
                           f"{parameter.start:g}: sigmas hold for one side of that")  # fmt: skip
        if size > 0:
            ends, jump = ends_and_jumps(
                lambda value, j=j: bound.place(_with(q, j, value)), parameter, change, extent  # type: ignore[misc]
            )
            if jump is not None:
                raise LawError(f"{label}: is not continuous in {parameter.name} near {g3(jump)}")
            remarks += [f"{label}: {words}" for words in ends]
    return tuple(remarks)


def _check_alone(law: Law, points: Array, place: Array, q: Array, extent: float, label: str) -> None:
    """A law is fitted on markers and used on nodes, stations and taps: one that scales itself by the points it is given
    (their largest y, their middle) is another one there. Each half of the points, along each axis, tells.
    """
    for along in points.T:
        low = along <= np.median(along)
        for part in (low, ~low):
            if not part.any() or part.all():
                continue
            off = np.linalg.norm(law.bind(points[part]).place(q) - place[part], axis=1)
            if not off.max() <= ALONE * extent:  # of numbers that are none, too
                worst = points[part][off.argmax()].tolist()
                raise LawError(
                    f"{label}: gives the point {worst} another place, by {g3(off.max())}, when other points "
                    "are not given with it: it is fitted on markers and used on the grid. Take lengths from its "
                    "options (arguments after a *), not from the points"
                )


def _uneven(bound: BoundLaw, q: Array, j: int, change: float, at: tuple[np.intp, ...]) -> tuple[float, bool]:
    """Where a coordinate ``at`` moves least evenly with parameter ``j`` within a change from ``q``, and whether it
    jumps there.
    """
    part, jumps = uneven(lambda part: float(bound.place(_with(q, j, q[j] + part * change))[at]))
    return float(q[j] + part * change), jumps


def _with(q: Array, j: int, value: float) -> Array:
    out = q.copy()
    out[j] = value
    return out


def _with_options(law: Law) -> str:
    """The options of a user's law, which are a likely reason."""
    settings: Mapping[str, object] = getattr(law, "settings", {})
    return f" (options: {', '.join(f'{k} = {v}' for k, v in settings.items())})" if settings else ""


def _change(parameter: Parameter, size: float, extent: float) -> float:
    """A change that matters: it moves the points by a hundredth of their extent, within the bounds."""
    change = 0.01 * extent / size if size > 0 else (parameter.sigma if np.isfinite(parameter.sigma) else 1.0)
    room = parameter.upper - parameter.start, parameter.start - parameter.lower
    return min(change, room[0]) if room[0] > 0 else -min(change, room[1])


def _called(out: Array, points: Array, label: str, when: str) -> Array:
    if out.shape != points.shape:
        raise LawError(f"{label}: must return {points.shape}, like its points, got {out.shape} {when}")
    if not np.isfinite(out).all():
        bad = int(np.argmin(np.isfinite(out).all(axis=1)))
        raise LawError(f"{label}: returns {out[bad].tolist()} for the point {points[bad].tolist()} {when}")
    return out
