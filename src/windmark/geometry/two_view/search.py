"""Seeded random search for essential matrices and homographies that many pairs agree with, locally optimised.

Sources: Fischler and Bolles 1981 (RANSAC); Torr and Zisserman 2000 (truncated squares, MSAC); Chum, Matas and Kittler,
Locally optimized RANSAC, 2003; Moisan and Stival 2004, Moulon, Monasse and Marlet 2012 (false-alarm number).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from windmark.geometry.pose import Pose
from windmark.geometry.two_view.decompose import cheirality, pose_from_essential
from windmark.geometry.two_view.five_point import essential_five_point
from windmark.geometry.two_view.homography_refine import homography_errors, refine_matrix
from windmark.geometry.two_view.matrices import essential_from_poses
from windmark.geometry.two_view.pairs import Pairs
from windmark.geometry.two_view.refine import refine_pose, sampson_errors

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Model = TypeVar("Model")

PARALLAX = 3.0  # sigmas from which an angle between two rays counts as seen
_BATCH = 24  # minimal sets at a time
_SCORED = 500  # pairs that hypotheses are scored on; candidates are judged on all
_WIDE = 9.0  # a minimal set spreads its own noise: squared gates are this much wider before the local optimisation
_WORTH = 0.9  # a hypothesis is optimised if what it explains is above this times what the best before did
_PATIENCE = 6  # after so many that led to no better optimum only if it explains more
_MISSED = 1e-4  # probability that no minimal set free of wrong pairs was drawn, at which the search ends


@dataclass(frozen=True)
class Candidate(Generic[Model]):
    """A model with the squared errors (N,) of all pairs in units of sigma and its truncated cost."""

    model: Model
    squares: Array
    cost: float


def essential_candidates(pairs: Pairs, gate: float, rng: np.random.Generator, trials: int) -> list[Candidate[Pose]]:
    """Best relative poses first: distinct local optima of the truncated Sampson cost (``gate``: sigma^2)."""

    def squares(models: Array, on: Pairs) -> Array:
        return sampson_errors(models, on) ** 2

    def optimise(matrix: Array) -> Candidate[Pose] | None:
        return optimised_pose(start_pose(matrix, pairs, _WIDE * gate), pairs, gate)

    return _search(
        pairs, 5, lambda a, b: essential_five_point(a, b).reshape(-1, 3, 3), squares, optimise, gate, rng, trials
    )


def homography_candidates(pairs: Pairs, gate: float, rng: np.random.Generator, trials: int) -> list[Candidate[Array]]:
    """Best homographies first: distinct local optima of the truncated Sampson cost (``gate``: sigma^2)."""

    def optimise(matrix: Array) -> Candidate[Array] | None:
        return optimised_homography(matrix, pairs, gate, (_WIDE, 1.0), 4)

    return _search(pairs, 4, _four_point, homography_errors, optimise, gate, rng, trials)


def optimised_homography(
    matrix: Array, pairs: Pairs, gate: float, widths: tuple[float, ...], steps: int
) -> Candidate[Array] | None:
    """Refined on the pairs near it, once for each (relative, squared) width of the gate; None if few or mirrored."""
    for width in widths:
        near = homography_errors(matrix, pairs) < width * gate
        if near.sum() < 4:
            return None
        try:
            matrix = refine_matrix(matrix, pairs[near], steps)[0]
        except np.linalg.LinAlgError:
            return None
    if np.linalg.det(matrix) <= 0:  # the plane would be seen from both sides
        return None
    e2 = homography_errors(matrix, pairs)
    return Candidate(matrix, e2, float(np.minimum(e2, gate).sum()))


def start_pose(matrix: Array, pairs: Pairs, gate: float) -> Pose:
    """The pose of an essential matrix with most of the pairs near it in front of both cameras."""
    near = pairs[sampson_errors(matrix, pairs) ** 2 < gate]
    return pose_from_essential(matrix, near.a, near.b)[0]


def optimised_pose(pose: Pose, pairs: Pairs, gate: float) -> Candidate[Pose] | None:
    """Refined on the pairs near it and in front, then on those still nearer, until they stay the same.

    Squared errors of pairs behind a camera are infinite.
    """
    previous: Mask | None = None
    for width in (_WIDE, 1.0, 1.0, 1.0):
        near = sampson_errors(essential_from_poses(pose), pairs) ** 2 < width * gate
        near &= ~behind(pose, pairs)
        if near.sum() < 5:
            return None
        if previous is not None and (near == previous).all():
            break
        previous = near
        pose = refine_pose(pose, pairs[near], steps=8)[0]
    e2 = sampson_errors(essential_from_poses(pose), pairs) ** 2
    e2[behind(pose, pairs)] = np.inf
    return Candidate(pose, e2, float(np.minimum(e2, gate).sum()))


def behind(pose: Pose, pairs: Pairs) -> Mask:
    """(N,) pairs that meet behind a camera and whose parallax shows it (far points may seem to diverge)."""
    angle, sigma = ray_angles(pose, pairs)
    return np.asarray(~cheirality(pose, pairs.a, pairs.b) & (angle > PARALLAX * sigma))


def ray_angles(pose: Pose, pairs: Pairs) -> tuple[Array, Array]:
    """Angle (N,) between the two rays of a pair and its sigma, radians, as if the noise were round."""
    y = pairs.a @ pose.rotation.T
    angle = np.arctan2(np.linalg.norm(np.cross(y, pairs.b), axis=1), np.sum(y * pairs.b, axis=1))
    variance = [
        np.trace(c, axis1=1, axis2=2) / 2 / np.sum(r * r, axis=1)
        for r, c in ((pairs.a, pairs.cov_a), (pairs.b, pairs.cov_b))
    ]
    return angle, np.sqrt(variance[0] + variance[1])


def _search(
    pairs: Pairs,
    size: int,
    solve: Callable[[Array, Array], Array],
    squares: Callable[[Array, Pairs], Array],
    optimise: Callable[[Array], Candidate[Model] | None],
    gate: float,
    rng: np.random.Generator,
    trials: int,
) -> list[Candidate[Model]]:
    n = len(pairs)
    sample = pairs if n <= _SCORED else pairs[rng.choice(n, _SCORED, replace=False)]
    found: list[Candidate[Model]] = []
    drawn, best, stale = 0, 0.0, 0
    while drawn < trials:
        pick = np.argpartition(rng.random((_BATCH, n)), size - 1, axis=1)[:, :size]
        drawn += _BATCH
        models = solve(pairs.a[pick], pairs.b[pick])
        models = models[np.isfinite(models).all(axis=(1, 2))]
        if len(models) == 0:
            continue
        # What is explained, not what is left: wrong pairs leave as much whatever the model.
        score = _WIDE * gate * len(sample) - np.minimum(squares(models, sample), _WIDE * gate).sum(axis=1)
        bar = best * (_WORTH if stale < _PATIENCE else 1.0)
        top = [k for k in np.argsort(-score)[:2] if score[k] > bar]
        best = max(best, float(score.max()))
        new = [c for c in map(optimise, models[top]) if c is not None]
        better = new and (not found or min(c.cost for c in new) < found[0].cost)
        stale = 0 if better else stale + len(top)
        found = best_few([*found, *new])
        if found:
            trials = min(trials, _trials(float(np.mean(found[0].squares < gate)), size))
    return found


def best_few(found: list[Candidate[Model]], keep: int = 3) -> list[Candidate[Model]]:
    """The best few that do not explain the pairs in the same way."""
    kept: list[Candidate[Model]] = []
    for one in sorted(found, key=lambda c: c.cost):
        if len(kept) < keep and not any(np.isclose(one.cost, k.cost, rtol=1e-4, atol=1e-4) for k in kept):
            kept.append(one)
    return kept


def _trials(share: float, size: int) -> int:
    """Minimal sets to be drawn until one of right pairs only is among them but for `_MISSED`."""
    return int(np.ceil(np.log(_MISSED) / np.log1p(-min(max(share**size, 1e-9), 1 - 1e-9))))


def _four_point(a: Array, b: Array) -> Array:
    """Homographies (B, 3, 3) of four pairs of rays each (z = 1), with positive depth at the first; NaN if mirrored."""
    zero = np.zeros_like(a)
    rows = [np.concatenate([a, zero, -b[..., :1] * a], axis=-1), np.concatenate([zero, a, -b[..., 1:2] * a], axis=-1)]
    h = np.linalg.svd(np.concatenate(rows, axis=1))[2][:, 8].reshape(-1, 3, 3)
    depth = np.einsum("bj,bnj->bn", h[:, 2], a)
    h = h * np.sign(depth[:, :1, None])
    return np.where((depth * depth[:, :1] > 0).all(axis=1)[:, None, None], h, np.nan)


def log10_false_alarms(n: int, inliers: int, size: int, solutions: int, chance: float) -> float:
    """Decimal logarithm of how many models with so many inliers unrelated pairs would give.

    ``solutions`` C(n, k) C(k, size) p^(k - size), p = ``chance``: that one wrong pair is within the gate.
    """
    k = inliers
    if k < size:
        return float("inf")
    ways = gammaln(n + 1) - gammaln(n - k + 1) - gammaln(size + 1) - gammaln(k - size + 1)
    return float((np.log(solutions) + ways + (k - size) * np.log(min(chance, 1.0))) / np.log(10))
