"""What may be wrong besides single marks, tested in the adjusted network: a prior, a picture focused anew or cut.

A hypothesis adds an unknown to the network: a column b to its equations. Whether that unknown is there is told without
solving again (Baarda 1967; Teunissen, "Testing theory", 2000, ch. 4): with the residuals r, their cofactors
Q = 1 - J C J^T, the unknown is -b^T r / (b^T Q b), and the sum of squares would fall by T = (b^T r)^2 / (b^T Q b).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from windmark.adjust import chance
from windmark.adjust.network.datum import in_datum
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
class Otherwise:
    """A view whose focal length (K = 1, relative) or principal point (K = 2, px) is another one.

    Parameters
    ----------
    view : its name
    change, sigma : (K,) and 1 sigma
    test : by how much the sum of squares would fall, in units of its expectation
    """

    view: str
    change: Array
    sigma: Array
    test: float


@dataclass(frozen=True)
class Unnoticed:
    """What a change by `ANEW` (of the focal length) in one view, where it would mostly not be seen, does.

    Parameters
    ----------
    off : to the camera's focal length (px), or to the marker that it moves most
    sigmas : in units of its stated one
    """

    off: float
    sigmas: float


@dataclass(frozen=True)
class Asked:
    """What the marks say of the focal lengths, or of the principal points, of the views that share their camera's.

    Parameters
    ----------
    own : views that ask for one of their own
    together : root mean square change of all, where they together ask for it though perhaps none alone does; else 0
    lead : by how much the sum of squares would fall with all of them, less what as many idle unknowns are worth (BIC)
    worst : the most that a change in one view would do unnoticed, where it matters
    """

    own: tuple[Otherwise, ...] = ()
    together: float = 0.0
    lead: float = 0.0
    worst: Unnoticed | None = None


def refocused(job: Job, solved: Solved) -> Asked:
    """Views whose marks ask for a focal length of their own, and whether the marks would show it (Baarda 1968)."""
    problem, state = solved.problem, solved.state
    marks, order = problem.marks, problem.order
    center = np.array([(c.cx, c.cy) for c in state.cameras])[problem.scene(state).view_camera[marks.views]]
    if state.change is not None:
        center = center + state.change[marks.views, 1:]
    white = whitener(problem.network.cov, len(order))[order]
    # The residual is white (seen - xy + shift): what the view's focal length moves is white (seen - center).
    moved = solved.residual[order] + (white @ (marks.xy - marks.shift - center)[..., None])[..., 0]
    return _asked(job, solved, moved[..., None], slice(0, 1))


def shifted(job: Job, solved: Solved) -> Asked:
    """Views whose marks ask for a principal point of their own: a loose or stabilised lens, a cut picture."""
    order = solved.problem.order
    return _asked(job, solved, whitener(solved.problem.network.cov, len(order))[order], slice(1, 3))


def _asked(job: Job, solved: Solved, moved: Array, what: slice) -> Asked:
    """Whether the views' marks, which a change moves by ``moved`` (O, 2, K), ask for it; ``what``: of a view's changes.

    ``every`` is what the network's own unknowns leave over of all changes together, b^T Q b.
    """
    problem, kinds = solved.problem, moved.shape[2]
    marks, free = problem.marks, np.asarray((problem.layout.columns.change[:, what] >= 0).any(axis=1))
    used = solved.used[problem.order]
    views = np.array([v for v in np.unique(marks.views[used]) if not free[v]], dtype=np.int64)
    if not len(views):
        return Asked()
    at = np.full(len(job.views), -1)
    at[views] = np.arange(len(views))
    group = np.where(used, at[marks.views], -1)
    known = group >= 0
    b, r = np.where(known[:, None, None], moved, 0.0), solved.residual[problem.order]
    cross = np.stack([gathered(solved, b[:, :, k], group, len(views)) for k in range(kinds)], axis=2)
    power, score = np.zeros((len(views), kinds, kinds)), np.zeros((len(views), kinds))
    np.add.at(power, group[known], np.einsum("oik,oil->okl", b[known], b[known]))
    np.add.at(score, group[known], np.einsum("oik,oi->ok", b[known], r[known]))
    cross = cross.reshape(len(cross), -1)
    through = solved.covariance.product(cross)
    every = -cross.T @ through
    blocks = every.reshape(len(views), kinds, len(views), kinds)
    n = np.arange(len(views))
    blocks[n, :, n] += power
    size = np.sqrt(np.diagonal(power, axis1=1, axis2=2))
    own = _own(job, solved, views, (blocks[n, :, n], size, score))
    size = size.ravel()
    value, vector = np.linalg.eigh(every / np.outer(size, size))
    told = value > CHECKED
    change = (vector[:, told].T @ (score.ravel() / size)) / value[told]
    test, count = float((change**2 * value[told]).sum()), int(told.sum())
    together = _chance(test, count, solved) < FALSE
    rms = np.sqrt(kinds * (((vector[:, told] @ change) / size) ** 2).mean()) if together else 0.0
    lead = test / solved.scale - count * np.log(2 * used.sum())
    left = np.maximum(np.diagonal(blocks[n, :, n], axis1=1, axis2=2), np.finfo(float).tiny)
    smallest = (norm.isf(FALSE / (2 * len(views))) + norm.isf(1 - NOTICED)) * np.sqrt(solved.scale / left)
    worst = None
    if what.start == 0:
        worst = _worst(solved, views, smallest[:, 0], through)
    elif set(job.free_focal) >= {v.name for v in job.views}:
        worst = _worst_shifts(solved, every, count, cross)
    return Asked(own, float(rms), float(lead), worst)


def _own(
    job: Job, solved: Solved, views: NDArray[np.int64], equations: tuple[Array, Array, Array]
) -> tuple[Otherwise, ...]:
    """Views that alone ask for a change; ``equations``: their (V, K, K) and score (V, K), and the size of b (V, K)."""
    found = []
    for v, block, size, score in zip(views, *equations, strict=True):
        value, axes = np.linalg.eigh(block / np.outer(size, size))
        if not value[0] > CHECKED:
            continue
        inverse = (axes / value) @ axes.T / np.outer(size, size)
        change = -inverse @ score
        test = float(-change @ score)
        if _chance(test, len(change), solved) < FALSE / len(views):
            sigma = np.sqrt(solved.scale * np.diagonal(inverse))
            found.append(Otherwise(job.views[v].name, change, sigma, test / (solved.scale * len(change))))
    return tuple(found)


def _worst(solved: Solved, views: NDArray[np.int64], smallest: Array, moved: Array) -> Unnoticed | None:
    """What the view does that may be focused anew unnoticed and moves its camera's focal length most, if it matters.

    ``smallest`` (V,) and ``moved`` (D + E b, V) of the ``views``: the least change of each one's focal length that is
    mostly seen, and how the network's unknowns move with one (external reliability).
    """
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


def _worst_shifts(solved: Solved, every: Array, count: int, cross: Array) -> Unnoticed | None:
    """What principal points do that are by chance `ANEW` off in every view, to the marker that they move most.

    ``every`` (V K, V K), of rank ``count``, and ``cross`` (D + E b, V K): what the network's unknowns leave over of the
    shifts, and these in its equations. None where the test of all together would mostly find them. The markers hold the
    datum; "off" is what chance exceeds once in twenty.
    """
    size, lay = ANEW * max(c.focal_px for c in solved.state.cameras), solved.problem.layout
    beyond = size**2 * float(np.trace(every)) / solved.scale
    middle, spread = count + beyond, np.sqrt(2 * (count + 2 * beyond))
    if middle + norm.isf(NOTICED) * spread > chi2.isf(FALSE, count) or not lay.points_eliminated:
        return None
    datum, block = in_datum(solved.covariance), lay.columns.point_block
    sigma = np.sqrt(solved.scale * np.diagonal(datum.points(), axis1=1, axis2=2))[block >= 0]
    moved = datum.through(cross)[lay.dense :].reshape(lay.blocks, 3, -1)[block[block >= 0]]
    change = norm.isf(0.025) * size * lay.unit * np.sqrt((moved**2).sum(axis=2))
    ratio = change / np.where(sigma > 0, sigma, np.inf)
    at = np.unravel_index(int(ratio.argmax()), ratio.shape)
    return Unnoticed(float(change[at]), float(ratio[at])) if ratio[at] > MATTERS else None


def change_doubts(job: Job, solved: Solved) -> tuple[Doubt, ...]:
    """What is said of pictures whose focal length or principal point is not that of the others, or may not be.

    A change of one looks like some of the other: what explains more is named.
    """
    focal, principal = refocused(job, solved), shifted(job, solved)
    if (principal.own or principal.together) and not ((focal.own or focal.together) and focal.lead >= principal.lead):
        return (_said(principal, "principal point", "principal", _pixels),)
    if focal.own or focal.together:
        return (_said(focal, "focal length", "focal", _percent),)
    if focal.worst is not None:
        off = f"{g2(focal.worst.off)} px, {g2(focal.worst.sigmas)} of its sigmas"
        words = (
            f"nothing checks that the pictures have one focus: a focal length {100 * ANEW:g} % off in one of them "
            f"alone would mostly go unnoticed, and the camera's be off by {off}"
        )
        return (Doubt((), words, "focus"),)
    if principal.worst is not None:
        size = ANEW * max(c.focal_px for c in solved.state.cameras)
        length = f"{g2(principal.worst.off)} {job.markers.length_unit}".rstrip()
        off = f"{length}, {g2(principal.worst.sigmas)} of its sigmas"
        words = (
            "nothing checks that the pictures, which all have a focus of their own, have one principal point: "
            f"{size:.0f} px (1 sigma) would mostly go unnoticed, and a marker be off by up to {off}"
        )
        return (Doubt((), words, "focus"),)
    return ()


def _said(asked: Asked, thing: str, key: str, number: Callable[[Otherwise], str]) -> Doubt:
    """The surest first."""
    if not asked.own:
        size = f"{g2(100 * asked.together)} %" if key == "focal" else f"{g2(asked.together)} px"
        return Doubt((), f"{thing}s of the pictures differ by {size} (rms): free_{key}", key)
    worst = sorted(asked.own, key=lambda found: -found.test)[:NAMED]
    listed = ", ".join(f"{{}} ({number(found)})" for found in worst)
    more = f" and {len(asked.own) - NAMED} more" if len(asked.own) > NAMED else ""
    words = f"{thing} not that of the other pictures (free_{key}): {listed}{more}"
    return Doubt(tuple(found.view for found in worst), words, key)


def _percent(found: Otherwise) -> str:
    return f"{100 * found.change[0]:+.2g} +- {g1(100 * found.sigma[0])} %"


def _pixels(found: Otherwise) -> str:
    return ", ".join(f"{c:+.2g} +- {g1(s)}" for c, s in zip(found.change, found.sigma, strict=True)) + " px"


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
