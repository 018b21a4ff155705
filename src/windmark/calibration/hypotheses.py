"""What may be wrong besides single marks, tested in the adjusted network: a prior, a picture that was focused anew.

A hypothesis adds an unknown to the network: a column b to its equations. Whether that unknown is there is told without
solving again (Baarda 1967; Teunissen, "Testing theory", 2000, ch. 4): with the residuals r, their cofactors
Q = 1 - J C J^T, the unknown is -b^T r / (b^T Q b), and the sum of squares would fall by T = (b^T r)^2 / (b^T Q b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from windmark.adjust import chance
from windmark.adjust.network.problem import camera_columns
from windmark.adjust.terms import whitener
from windmark.calibration.agreement import FALSE
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.errors import g1, g2
from windmark.geometry import PARAMETERS
from windmark.scene import Doubt

Array = NDArray[np.float64]

CHUNK = 40_000
"""Marks worked on at a time, for memory."""
CHECKED = 1e-4
"""Share of a hypothesis that the network's own unknowns leave over, below which it cannot be told from them."""


def contradicted(job: Job, solved: Solved) -> dict[str, tuple[float, float]]:
    """Priors of interior parameters that the pictures contradict: by name, how far off, and in how many sigmas."""
    columns = [entry for entry in camera_columns(solved.problem.layout) if entry[1] in job.prior_sigma]
    units, given = solved.problem.units(solved.state).camera, list(job.cameras.values())
    found: dict[str, tuple[float, float]] = {}
    for c, name, column in columns:
        sigma, step = job.prior_sigma[name], float(units[c][PARAMETERS.index(name)])
        off = float(getattr(solved.state.cameras[c], name) - getattr(given[c], name))
        left = sigma**2 - float(solved.covariance.dense[column, column]) * step**2
        if left <= CHECKED * sigma**2:
            continue  # nothing but the prior tells it
        if _chance(off**2 / left, 1, solved) < FALSE / len(columns):
            found[name] = (off, float(np.sqrt(off**2 / left)))
    return found


ANEW, NOTICED, MATTERS = 0.003, 0.8, 3.0
"""A relative change of the focal length, as a consumer's camera makes it where it focuses anew; the probability with
which the test of a view finds it, or else it goes unnoticed; sigmas by which it must move the camera's to be said."""
NAMED = 5
"""Pictures that are named at most."""


@dataclass(frozen=True)
class Refocused:
    """A view whose focal length is another one: its relative change and 1 sigma of that."""

    view: str
    change: float
    sigma: float


@dataclass(frozen=True)
class Unnoticed:
    """What a focal length that is `ANEW` off in one view, where it would mostly not be seen, does to the camera's."""

    off_px: float
    sigmas: float


@dataclass(frozen=True)
class Focus:
    """What the marks say of the focal lengths of the views that share their camera's.

    Parameters
    ----------
    own : views that ask for one of their own
    together : root mean square change of all, where they together ask for it though perhaps none alone does; else 0
    worst : the most that a change in one view would do unnoticed, where it matters
    """

    own: tuple[Refocused, ...] = ()
    together: float = 0.0
    worst: Unnoticed | None = None


def refocused(job: Job, solved: Solved) -> Focus:
    """Views whose marks ask for a focal length of their own, and whether the marks would show it (Baarda 1968)."""
    problem, state, obs = solved.problem, solved.state, job.observations
    marks, lay, order = problem.marks, problem.layout, problem.order
    center = np.array([(c.cx, c.cy) for c in state.cameras])[problem.scene(state).view_camera[marks.views]]
    used = solved.used[order]
    r = solved.residual[order]
    white = whitener(problem.network.cov, len(order))[order]
    # The residual is white (seen - xy + shift): what the view's focal length moves is white (seen - center).
    b = np.where(used[:, None], r + (white @ (marks.xy - marks.shift - center)[..., None])[..., 0], 0.0)
    views = np.array([v for v in np.unique(obs.view[solved.taken][solved.used]) if lay.columns.focal[v] < 0])
    if not len(views):
        return Focus()
    at = np.full(len(job.views), -1)
    at[views] = np.arange(len(views))
    by_view = at[marks.views]
    known = by_view >= 0
    cross = gathered(solved, np.where(known[:, None], b, 0.0), by_view, len(views))
    power, score = np.zeros(len(views)), np.zeros(len(views))
    np.add.at(power, by_view[known], (b[known] ** 2).sum(axis=1))
    np.add.at(score, by_view[known], (b[known] * r[known]).sum(axis=1))
    moved = solved.covariance.product(cross)
    every = np.diag(power) - cross.T @ moved
    left = np.diagonal(every)
    out = []
    for n, v in enumerate(views):
        if left[n] > CHECKED * power[n] and _chance(score[n] ** 2 / left[n], 1, solved) < FALSE / len(views):
            spread = float(np.sqrt(solved.scale / left[n]))
            out.append(Refocused(job.views[v].name, float(-score[n] / left[n]), spread))
    size = np.sqrt(power)
    value, vector = np.linalg.eigh(every / np.outer(size, size))
    told = value > CHECKED
    change = (vector[:, told].T @ (score / size)) / value[told]
    test = float((change**2 * value[told]).sum())
    together = _chance(test, int(told.sum()), solved) < FALSE
    rms = float(np.sqrt((((vector[:, told] @ change) / size) ** 2).mean())) if together else 0.0
    return Focus(tuple(out), rms, _worst(solved, views, left, moved))


def _worst(solved: Solved, views: NDArray[np.int64], left: Array, moved: Array) -> Unnoticed | None:
    """What the view does that may be focused anew unnoticed and moves its camera's focal length most, if it matters.

    ``left`` (V,) and ``moved`` (D + E b, V) of the ``views``: what the network's unknowns leave over of a change of
    each one's focal length, and how they move with it (external reliability).
    """
    smallest = (norm.isf(FALSE / (2 * len(views))) + norm.isf(1 - NOTICED)) * np.sqrt(
        solved.scale / np.maximum(left, np.finfo(float).tiny)
    )
    problem = solved.problem
    camera = problem.scene(solved.state).view_camera[views]
    column = problem.layout.columns.camera[camera, PARAMETERS.index("focal_px")]
    sigma = np.sqrt(solved.scale * np.diagonal(solved.covariance.dense)[np.maximum(column, 0)])
    change = ANEW * np.abs(moved[np.maximum(column, 0), np.arange(len(views))])
    ratio = np.where((column >= 0) & (smallest > ANEW) & (sigma > 0), change / np.where(sigma > 0, sigma, 1.0), 0.0)
    n = int(np.argmax(ratio))
    if not ratio[n] > MATTERS:
        return None
    unit = float(problem.units(solved.state).camera[camera[n], PARAMETERS.index("focal_px")])
    return Unnoticed(float(change[n]) * unit, float(ratio[n]))


def focus_doubts(job: Job, solved: Solved) -> tuple[Doubt, ...]:
    """What is said of pictures whose focal length is not that of the others, the surest first, or may not be."""
    focus = refocused(job, solved)
    if focus.own:
        worst = sorted(focus.own, key=lambda r: -abs(r.change) / r.sigma)[:NAMED]
        listed = ", ".join(f"{{}} ({100 * r.change:+.2g} +- {g1(100 * r.sigma)} %)" for r in worst)
        more = f" and {len(focus.own) - NAMED} more" if len(focus.own) > NAMED else ""
        words = f"focal length not that of the other pictures (free_focal): {listed}{more}"
        return (Doubt(tuple(r.view for r in worst), words, "focal"),)
    if focus.together:
        words = f"focal lengths of the pictures differ by {g2(100 * focus.together)} % (rms): free_focal"
        return (Doubt((), words, "focal"),)
    if focus.worst is not None:
        off = f"{g2(focus.worst.off_px)} px, {g2(focus.worst.sigmas)} of its sigmas"
        words = (
            f"nothing checks that the pictures have one focus: a focal length {100 * ANEW:g} % off in one of them "
            f"alone would mostly go unnoticed, and the camera's be off by {off}"
        )
        return (Doubt((), words, "focus"),)
    return ()


def gathered(solved: Solved, b: Array, group: NDArray[np.int64], count: int) -> Array:
    """(D + E b, count) J^T b, summed over the marks of each group; ``b`` (O, 2) is zero for marks of none (-1)."""
    lay = solved.problem.layout
    jd, je, cols, block = solved.problem.jacobian(solved.state)
    free = (cols >= 0).any(axis=0)
    jd, cols = jd[:, :, free], cols[:, free]
    rows = lay.dense + lay.blocks * lay.size
    out = np.zeros((rows + 1) * count)  # the last row takes what belongs to no parameter
    for start in range(0, len(b), CHUNK):
        part = slice(start, start + CHUNK)
        own, which = block[part, None], np.maximum(group[part, None], 0)
        row = np.where(own >= 0, lay.dense + lay.size * own + np.arange(lay.size), rows)
        for j, to in ((jd[part], np.where(cols[part] >= 0, cols[part], rows)), (je[part], row)):
            value = j[:, 0] * b[part, :1] + j[:, 1] * b[part, 1:]
            out += np.bincount((to * count + which).ravel(), value.ravel(), len(out))
    return out.reshape(rows + 1, count)[:rows]


def _chance(test: float, dof: int, solved: Solved) -> float:
    """`chance` beside the residuals of the network."""
    return chance(test, dof, solved.sigma0**2 * solved.redundancy, solved.redundancy)
