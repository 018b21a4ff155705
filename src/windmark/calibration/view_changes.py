"""Changes of single views that their marks ask for, one at a time or all together: the hypotheses of `hypotheses`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.special import chdtri, gammaln, ndtri

from windmark.adjust.network.datum import in_datum
from windmark.calibration.agreement import FALSE
from windmark.calibration.hypotheses import CHECKED, chance_beside, gathered
from windmark.calibration.setup import Job
from windmark.calibration.solve import Solved
from windmark.geometry import PARAMETERS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ANEW, NOTICED, MATTERS = 0.003, 0.8, 3.0
"""A relative change of the focal length, as a consumer's camera makes it where it focuses anew; the probability with
which the test of a view finds it, or else it goes unnoticed; sigmas by which it must move the camera's to be said."""
LITTLE = 1e-2 * CHECKED
"""Beside what an unknown has to have left to be told, far above rounding."""
UNLIKELY = FALSE / 4
"""Probability of a change of one view where there is none, of any kind."""


@dataclass(frozen=True)
class Otherwise:
    """A view whose focal length (K = 1, relative), principal point (K = 2, px), shear (K = 2) or distortion (K = 1, as
    k1) is another one.

    Parameters
    ----------
    view : its name
    change, sigma : (K,) and 1 sigma
    """

    view: str
    change: Array
    sigma: Array


@dataclass(frozen=True)
class Unnoticed:
    """What a change by `ANEW` of the focal length, where it would mostly not be seen, does.

    Parameters
    ----------
    off : to the camera's focal length (px), or to the marker that it moves most
    sigmas : in units of its stated one
    """

    off: float
    sigmas: float


@dataclass(frozen=True)
class Asked:
    """What the marks say of one kind of change of the views that share their camera's interior.

    Parameters
    ----------
    own : views that ask for one of their own, the surest first
    together : root mean square change of all, where they together ask for it though perhaps none alone does; else 0
    lead : by how much the sum of squares would fall with all of them, or with those of the views that ask alone, less
        what as many idle unknowns are worth (BIC); 0 where none is asked for
    worst : the most that a change would do unnoticed, where it matters: in one view, of the principal point in all
    """

    own: tuple[Otherwise, ...] = ()
    together: float = 0.0
    lead: float = 0.0
    worst: Unnoticed | None = None


FOCAL_PX = PARAMETERS.index("focal_px")
FOCAL, PRINCIPAL_POINT, SHEAR, DISTORTION = slice(0, 1), slice(1, 3), slice(3, 5), slice(5, 6)
"""Where they are among the changes of a view."""


@dataclass(frozen=True)
class Equations:
    """Of the changes of V views, each in focal length (relative), principal point (px, 2), shear and stretch (2), and
    distortion (as k1: a mark at r focal lengths from the centre goes out by r^2 of its distance).

    Sheared and stretched, a picture has its marks at x + a (y - cy), y + b (y - cy): a camera that moves while its rows
    are read one after the other (a rolling shutter) sees so, and a program that straightens or scales makes such.

    Parameters
    ----------
    views : (V,) their numbers
    free : (V, 6) which of the changes are unknowns of the network already
    power, score : (V, 6, 6), (V, 6) b^T b and b^T r, with b by what a change moves the view's marks
    cross : (D + E b, V, 6) J^T b
    focal : (C, V, 6) how the focal length of each of the C cameras goes along, in natural units, where it is free
    every : (V, 6, V, 6) b^T Q b: what these leave over of all changes together
    """

    views: Ints
    free: NDArray[np.bool_]
    power: Array
    score: Array
    cross: Array
    focal: Array
    every: Array


def equations_of(solved: Solved) -> Equations:
    """What the used marks of every view say of a change of its own."""
    problem, state, order = solved.problem, solved.state, solved.problem.order
    marks, used, r = problem.marks, solved.used[order], solved.residual[order]
    interior = np.array([(c.cx, c.cy, c.focal_px) for c in state.cameras])[problem.network.view_camera[marks.views]]
    center = interior[:, :2]
    if state.change is not None:
        center = center + state.change[marks.views, 1:]
    white = np.zeros((len(order), 2, 2))
    white[:, 0, 0], white[:, 1, 0], white[:, 1, 1] = marks.white.T
    off = marks.xy - marks.shift - center
    # The residual is white (seen - xy + shift): what the view's focal length moves is white (seen - center).
    by_focal = r + (white @ off[..., None])[..., 0]
    by_lens = by_focal * ((off / interior[:, 2:]) ** 2).sum(axis=1, keepdims=True)
    b = np.concatenate([by_focal[..., None], white, white * off[:, 1, None, None], by_lens[..., None]], axis=2)
    b[~used] = 0.0
    views, kinds = np.unique(marks.views[used]), b.shape[2]
    n, at = np.arange(len(views)), np.full(len(marks.starts) - 1, -1)
    at[views] = n
    cross = gathered(solved, b, at[marks.views], len(views))
    column = np.maximum(problem.layout.columns.camera[:, FOCAL_PX], 0)
    focal, inner = solved.covariance.quadratic(cross.reshape(len(cross), -1), column)
    every = -inner.reshape(len(views), kinds, len(views), kinds)
    first = marks.starts[views]
    rows = [part.reshape(-1, kinds) for part in np.split(b, first[1:])]
    power = np.array([part.T @ part for part in rows])
    score = np.array([part.T @ of.ravel() for part, of in zip(rows, np.split(r, first[1:]), strict=True)])
    every[n, :, n] += power
    free = np.zeros((len(views), kinds), dtype=bool)
    free[:, :3] = problem.layout.columns.change[views] >= 0
    return Equations(views, free, power, score, cross, focal.reshape(-1, *cross.shape[1:]), every)


def asked(
    job: Job, solved: Solved, equations: Equations, kind: slice, worst_of: Callable[..., Unnoticed | None] | None
) -> Asked:
    """Whether views ask for a change of one kind of their own; ``worst_of`` tells what would go unnoticed."""
    what = np.arange(equations.free.shape[1])[kind]
    of = np.flatnonzero(~equations.free[:, what].any(axis=1))
    views, kinds = equations.views[of], len(what)
    if not len(views):
        return Asked()
    n, each = np.arange(len(views)), np.ix_(of, what, of, what)
    blocks, score = equations.every[each], equations.score[np.ix_(of, what)]
    size = np.sqrt(np.diagonal(equations.power, axis1=1, axis2=2)[np.ix_(of, what)])
    own, alone = _own([job.views[v].name for v in views], solved, blocks[n, :, n], size, score)
    size, every = size.ravel(), blocks.reshape(len(views) * kinds, -1)
    power, pull = every / np.outer(size, size), score.ravel() / size
    rms, lead, worst, count = 0.0, 0.0, None, told(power)
    if own or chance_beside(most_explained(power, pull), count, solved) < FALSE:
        change, test, count = explained(power, pull)
        if chance_beside(test, count, solved) < FALSE:
            rms = float(np.sqrt(kinds * ((change / size) ** 2).mean()))
        some = [_lead_of(solved, power, pull, alone[:m], kinds) for m in (1, len(own))]
        lead = max(_lead(solved, test, count), *some)
    if worst_of is worst_focal:
        worst = worst_focal(solved, views, blocks[n, 0, n, 0], equations.focal[:, of, 0])
    elif worst_of is worst_shifts:
        cross = equations.cross[:, of][:, :, what].reshape(len(equations.cross), -1)
        worst = worst_shifts(solved, every, count, cross)
    return Asked(own, rms, float(lead), worst)


def _lead(solved: Solved, test: float, count: int) -> float:
    """What unknowns explain, in units of the marks' covariances, less what as many idle ones are worth (BIC)."""
    return float(test / solved.scale - count * np.log(2 * solved.used.sum()))


def _lead_of(solved: Solved, power: Array, score: Array, some: Ints, kinds: int) -> float:
    """The same of the changes of some of the views alone; of the many such sets this is but one (extended BIC, Chen &
    Chen 2008). One odd picture is not worth the unknowns of all.
    """
    if not len(some):
        return -np.inf
    views, m = len(score) // kinds, len(some)
    at = (some[:, None] * kinds + np.arange(kinds)).ravel()
    _, test, count = explained(power[np.ix_(at, at)], score[at])
    sets = gammaln(views + 1) - gammaln(m + 1) - gammaln(views - m + 1)
    return _lead(solved, test, count) - 2 * float(sets)


def told(power: Array) -> int:
    """How many of unknowns can be told, see `explained`: by the signs of a factor (Sylvester's law of inertia)."""
    factor, pivot, _ = lapack.dsytrf(power - CHECKED * np.eye(len(power)), lower=1)
    alone = pivot > 0  # of two that are one pivot the one is positive and the other negative
    return int((np.diagonal(factor)[alone] > 0).sum() + (~alone).sum() // 2)


def most_explained(power: Array, score: Array) -> float:
    """What (n, n) and (n,) explain, see `explained`, is no more than that; inf where rounding leaves no bound.

    A direction of the eigenvalue v explains s^2 / v. With e = `LITTLE` more on the diagonal, v^2 / (v + e)^3 is no less
    where v is told but for (1 + e / CHECKED)^3, never negative, and little where v is far below e. A factor of the
    matrix is enough, no eigenvectors are needed.
    """
    factor, failed = lapack.dpotrf(power + LITTLE * np.eye(len(power)), lower=1)
    if failed:
        return float("inf")
    along = power @ lapack.dpotrs(factor, score, lower=1)[0]
    return float((1 + LITTLE / CHECKED) ** 3 * (along @ lapack.dpotrs(factor, along, lower=1)[0]))


def explained(power: Array, score: Array) -> tuple[Array, float, int]:
    """Unknowns (n,), what they explain, and how many of them can be told; all of it in units of the sizes of b."""
    factor, failed = lapack.dpotrf(power, lower=1)
    if not failed:
        norm1 = float(np.abs(power).sum(axis=0).max())
        # The inverse's 1-norm is a bound of its largest eigenvalue.
        if lapack.dpocon(factor, norm1, uplo="L")[0] * norm1 > CHECKED:
            change = lapack.dpotrs(factor, score, lower=1)[0]
            return change, float(score @ change), len(score)
    value, vector = np.linalg.eigh(power)
    told = value > CHECKED
    along = vector[:, told].T @ score
    return vector[:, told] @ (along / value[told]), float((along**2 / value[told]).sum()), int(told.sum())


def _own(
    names: list[str], solved: Solved, blocks: Array, size: Array, score: Array
) -> tuple[tuple[Otherwise, ...], Ints]:
    """Views that alone ask for a change, and which these are of the V, from their (V, K, K), the size of b (V, K), and
    their score (V, K).
    """
    scale = size[:, :, None] * size[:, None, :]
    value, axes = np.linalg.eigh(blocks / scale)
    told = value[:, 0] > CHECKED
    inverse = (axes / np.where(told[:, None], value, 1.0)[:, None, :]) @ axes.transpose(0, 2, 1) / scale
    change = -(inverse @ score[..., None])[..., 0]
    test = np.where(told, -(change * score).sum(axis=1), 0.0)
    found, order = list[Otherwise](), np.argsort(-test, kind="stable")
    for n in order.tolist():
        if not chance_beside(float(test[n]), size.shape[1], solved) < UNLIKELY / len(names):
            break
        sigma = np.sqrt(solved.scale * np.diagonal(inverse[n]))
        found.append(Otherwise(names[n], change[n], sigma))
    return tuple(found), order[: len(found)]


def worst_focal(solved: Solved, views: Ints, left: Array, moved: Array) -> Unnoticed | None:
    """What the view does that may be focused anew unnoticed and moves its camera's focal length most, if it matters.

    ``left`` (V,) and ``moved`` (C, V) of the ``views``: what the network's unknowns leave over of a change of
    each one's focal length, and how those of the cameras move with it (external reliability).
    """
    smallest = -(ndtri(UNLIKELY / (2 * len(views))) + ndtri(1 - NOTICED)) * np.sqrt(
        solved.scale / np.maximum(left, np.finfo(float).tiny)
    )
    problem = solved.problem
    camera = problem.network.view_camera[views]
    column = problem.layout.columns.camera[camera, FOCAL_PX]
    sigma = np.sqrt(solved.scale * np.diagonal(solved.covariance.dense)[np.maximum(column, 0)])
    change = ANEW * np.abs(moved[camera, np.arange(len(views))])
    ratio = np.where((column >= 0) & (smallest > ANEW) & (sigma > 0), change / np.where(sigma > 0, sigma, 1.0), 0.0)
    n = int(np.argmax(ratio))
    if not ratio[n] > MATTERS:
        return None
    unit = float(problem.units(solved.state).camera[camera[n], FOCAL_PX])
    return Unnoticed(float(change[n]) * unit, float(ratio[n]))


def worst_shifts(solved: Solved, every: Array, count: int, cross: Array) -> Unnoticed | None:
    """What principal points do that are by chance `ANEW` off in every view, to the marker that they move most.

    ``every`` (V K, V K), of rank ``count``, and ``cross`` (D + E b, V K): what the network's unknowns leave over of the
    shifts, and these in its equations. None where the test of all together would mostly find them. The markers hold the
    datum; "off" is what chance exceeds once in twenty.
    """
    size, lay = ANEW * max(c.focal_px for c in solved.state.cameras), solved.problem.layout
    beyond = size**2 * float(np.trace(every)) / solved.scale
    middle, spread = count + beyond, np.sqrt(2 * (count + 2 * beyond))
    noticed = middle - ndtri(NOTICED) * spread > chdtri(count, FALSE)
    if noticed or not (lay.points_eliminated and lay.blocks):
        return None
    datum, block = in_datum(solved.covariance), lay.columns.point_block
    sigma = np.sqrt(solved.scale * np.diagonal(datum.points(), axis1=1, axis2=2))[block >= 0]
    moved = datum.through(cross)[lay.dense :].reshape(lay.blocks, 3, -1)[block[block >= 0]]
    change = -ndtri(0.025) * size * lay.unit * np.sqrt((moved**2).sum(axis=2))
    ratio = change / np.where(sigma > 0, sigma, np.inf)
    at = np.unravel_index(int(ratio.argmax()), ratio.shape)
    return Unnoticed(float(change[at]), float(ratio[at])) if ratio[at] > MATTERS else None
