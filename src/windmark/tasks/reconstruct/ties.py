"""Two pictures with some matches given by hand: their geometry, and all other matches along the epipolar lines."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar import match_known_pair
from windmark.geometry import Pose
from windmark.geometry.two_view import TwoView, estimate_two_view
from windmark.tasks.reconstruct.task import Task

Ints = NDArray[np.int64]

LEAST_TIES = 7
"""Spots with the same name in two pictures that give their geometry; five fix it."""


class TiedPair(NamedTuple):
    """Matches (K,) of views ``first`` and ``second``, and where ``second`` is seen from ``first`` (baseline 1)."""

    first: int
    second: int
    a: Ints
    b: Ints
    view: TwoView
    b_from_a: Pose


def tied_pairs(task: Task, views: list[int]) -> Iterator[TiedPair]:
    """Pairs with enough spots of the same name, those with the most first."""
    common = {(a, b): task.ties[a].keys() & task.ties[b].keys() for a, b in combinations(views, 2)}
    for (a, b), names in sorted(common.items(), key=lambda item: -len(item[1])):
        if len(names) < LEAST_TIES:
            return
        in_a, in_b = (np.array([task.ties[v][n] for n in sorted(names)]) for v in (a, b))
        spots = task.detections[a], task.detections[b]
        view = estimate_two_view(
            spots[0].xy[in_a], spots[1].xy[in_b], task.camera(a), task.camera(b), cov_a=spots[0].cov[in_a],
            cov_b=spots[1].cov[in_b], seed=task.seed,
        )  # fmt: skip
        given = in_a[view.inliers], in_b[view.inliers]
        for pose in () if view.b_from_a is None else (view.b_from_a, *view.alternatives):
            pair = match_known_pair(
                *spots, task.camera(a), task.camera(b), pose, pose_cov=view.cov, given=np.column_stack(given)
            )
            spot_a, spot_b = with_ties(pair.spot_a, pair.spot_b, *given)
            yield TiedPair(a, b, spot_a, spot_b, view, pose)


def with_ties(spot_a: Ints, spot_b: Ints, tie_a: Ints, tie_b: Ints) -> tuple[Ints, Ints]:
    """Matches (K,) of two pictures with those given by hand, which go before all that share a spot with them."""
    kept = ~(np.isin(spot_a, tie_a) | np.isin(spot_b, tie_b))
    return np.concatenate([spot_a[kept], tie_a]), np.concatenate([spot_b[kept], tie_b])
