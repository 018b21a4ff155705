"""Which model two views ask for: likelihood-ratio tests with the number of parameters, from the simplest model up.

With N pairs of points (4 N coordinates) a rotation explains them with 2 N + 3 parameters, a plane with 2 N + 8, points
in space with 3 N + 5: the sum of squares rises by chi-square with 5 or N + 2 degrees of freedom where a rotation is
true, by N - 3 where a plane is. Torr's GRIC asks the same question with fixed penalties; the tests need none, as sigma
is known or estimated. Source: Torr, Geometric motion segmentation and model selection, Phil. Trans. R. Soc. A 1998.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri

from windmark.geometry.pose import Pose
from windmark.geometry.two_view.candidates import GATE_LINE, GATE_POINT, Candidates
from windmark.geometry.two_view.homography_refine import homography_errors
from windmark.geometry.two_view.matrices import essential_from_poses
from windmark.geometry.two_view.pairs import Pairs
from windmark.geometry.two_view.refine import sampson_errors
from windmark.geometry.two_view.search import log10_false_alarms

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_OF_PLANE, _OF_SPACE = 4, 5  # pairs that fix a homography, and an essential matrix
_LEVEL = 1e-4  # probability that a true simple model is rejected
_COUNTED = 100  # points whose wrong partners are counted
_LOG10_CHANCE = -3.0  # of pairs beyond the simple model that chance alone would bring


def choose(found: Candidates, pairs: Pairs, known: bool, right: bool) -> str:
    """The simplest model that the richer ones do not refute: "rotation", "homography-plane", "essential" or "none".

    ``known``: the covariances of the points are known, not only their ratios; ``right``: no pair is wrong.
    """
    rotation, plane, space = found.rotation, found.plane, found.space[0] if found.space else None
    if plane is None:
        return "none" if space is None else "essential"
    in_plane, on_line = plane.squares < GATE_POINT, np.zeros(len(pairs), dtype=bool)
    points = 0.0 if right else chance_at_point(plane.model, pairs)
    if space is not None:
        on_line = space.squares < GATE_LINE
        lines = 0.0 if right else chance_on_line(space.model, pairs)
    if rotation is not None:
        turned = rotation.squares < GATE_POINT
        refuted = _more_agree(turned, in_plane, 3, points) or _fits_better(
            rotation.squares, plane.squares, turned & in_plane, 5, -8, 2, known
        )
        if not refuted and space is not None:
            refuted = _more_agree(turned, on_line, 2, lines) or _fits_better(
                rotation.squares, space.squares, turned & on_line, 2, -5, 1, known, per_point=1
            )
        if not refuted:
            return "rotation"
    # Any four pairs are of a plane: where no fifth one is on it, it explains nothing, and lines that a sixth is on do.
    if space is not None and in_plane.sum() <= _OF_PLANE and on_line.sum() > _OF_SPACE:
        return "essential"
    if space is not None and (
        _more_agree(in_plane, on_line, 1, lines)
        or _fits_better(plane.squares, space.squares, in_plane & on_line, -3, -5, 1, known, per_point=1)
    ):
        return "essential"
    return "homography-plane"


def _more_agree(simple: Mask, rich: Mask, free: int, chance: float) -> bool:
    """Whether more pairs agree with the rich model than chance and its ``free`` parameters (in pairs) can bring.

    Without chance (``chance`` 0) every pair counts.
    """
    extra = int((rich & ~simple).sum())
    if chance == 0.0:
        return extra > 0
    return extra > free and log10_false_alarms(int((~simple).sum()), extra, free, 2, chance) < _LOG10_CHANCE


def _fits_better(
    simple: Array, rich: Array, on: Mask, more: int, less: int, rows: int, known: bool, per_point: int = 0
) -> bool:
    """Likelihood-ratio test on the pairs that agree with both models.

    ``per_point`` N + ``more`` parameters distinguish the models, and ``rows`` N + ``less`` degrees of freedom are left
    by the rich one. A known sigma is taken as it is unless the rich model shows that it is larger; an unknown one is
    the rich model's.
    """
    n = int(on.sum())
    extra, dof = per_point * n + more, rows * n + less
    if extra <= 0:
        return False
    base = float(rich[on].sum())
    excess = float(simple[on].sum()) - base
    if known and (dof <= 0 or base <= chdtri(dof, 0.01)):
        return bool(excess > chdtri(extra, _LEVEL))
    return bool(dof > 0 and excess / extra > fdtri(extra, dof, 1 - _LEVEL) * base / dof)


# --- what chance can do --------------------------------------------------------------------------
def chance_on_line(pose: Pose, pairs: Pairs) -> float:
    """Probability that an unrelated pair is within the gate of the epipolar geometry.

    The share of the given points that agree with a wrong partner, but no less than a gate's width across the extent
    of picture b: counting alone would say zero where the points are few.
    """
    some = _some(pairs)
    essential = essential_from_poses(pose)
    line_b, line_a = some.a @ essential.T, some.b @ essential
    part_a = np.einsum("ni,nij,nj->n", line_a[:, :2], some.cov_a, line_a[:, :2])
    part_b = np.einsum("ni,nij,nj->n", line_b[:, :2], some.cov_b, line_b[:, :2])
    with np.errstate(divide="ignore"):  # a point at the epipole has no line: any partner agrees
        sigma = np.sqrt((part_a + part_b) / np.sum(line_b[:, :2] ** 2, axis=1))
    width, height = _extent(pairs.b)
    geometric = 2 * np.sqrt(GATE_LINE) * float(np.median(sigma)) * float(np.hypot(width, height)) / (width * height)
    return _with_counted(geometric, sampson_errors(essential, _every_couple(some)) ** 2 < GATE_LINE, len(some))


def chance_at_point(matrix: Array, pairs: Pairs) -> float:
    """Probability that an unrelated pair is within the gate of a homography: as `chance_on_line`."""
    some = _some(pairs)
    width, height = _extent(pairs.b)
    spread = float(np.median(np.sqrt(np.linalg.det(some.cov_a + some.cov_b))))
    geometric = np.pi * GATE_POINT * spread / (width * height)
    return _with_counted(geometric, homography_errors(matrix, _every_couple(some)) < GATE_POINT, len(some))


def _some(pairs: Pairs) -> Pairs:
    """At most `_COUNTED` pairs, evenly taken."""
    return pairs if len(pairs) <= _COUNTED else pairs[np.linspace(0, len(pairs) - 1, _COUNTED).astype(np.int64)]


def _every_couple(pairs: Pairs) -> Pairs:
    """Every point of a with every point of b, row by row of a."""
    n = len(pairs)
    i, j = np.repeat(np.arange(n), n), np.tile(np.arange(n), n)
    return Pairs(pairs.a[i], pairs.b[j], pairs.cov_a[i], pairs.cov_b[j])


def _with_counted(geometric: float, agree: Mask, n: int) -> float:
    wrong = agree.reshape(n, n) & ~np.eye(n, dtype=bool)
    return min(max(geometric, float(wrong.sum()) / (n * (n - 1))), 1.0)


def _extent(points: Array) -> tuple[float, float]:
    """Width and height of the box round the points."""
    w, h = np.maximum(np.ptp(points[:, :2], axis=0), 1e-12)
    return float(w), float(h)


def on_a_line(pairs: Pairs) -> bool:
    """Whether the points of both pictures are on a line within their noise."""
    return _line(pairs.a, pairs.cov_a) and _line(pairs.b, pairs.cov_b)


def _line(points: Array, cov: Array) -> bool:
    d = points[:, :2] - points[:, :2].mean(axis=0)
    normal = np.linalg.svd(d, full_matrices=False)[2][1]
    squares = (d @ normal) ** 2 / np.einsum("i,nij,j->n", normal, cov, normal)
    return bool(squares.sum() <= chdtri(max(len(d) - 2, 1), 1e-3))
