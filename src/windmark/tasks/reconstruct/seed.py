"""Two pictures to begin with: matched from nothing, far enough apart, and confirmed by others."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Free
from windmark.epipolar import NotMatched, PairMatching
from windmark.geometry import Pose, triangulate
from windmark.tasks.reconstruct.matched import PairMatcher
from windmark.tasks.reconstruct.structure import Structure, adjusted, compact
from windmark.tasks.reconstruct.task import Refused, Task
from windmark.tasks.reconstruct.ties import TiedPair, tied_pairs

Array = NDArray[np.float64]

FEWEST_POINTS = 12
ENOUGH = 4
"""Good pairs that are compared before the best of them is tried."""
MOST_TRIED, MOST_AMBIGUOUS = 60, 10
"""Pairs of pictures that are tried; fewer where so many are ambiguous and none is accepted: a regular layout."""
LEAST_PARALLAX_DEG, GOOD_PARALLAX_DEG = 1.0, 10.0
"""Angle between the rays below which depths are guesses, and beyond which more is no better."""


@dataclass(frozen=True)
class Seed:
    """A pair of views and the structure that it gives (one per reading of a plane)."""

    a: int
    b: int
    worth: float
    structures: tuple[Structure, ...]


def seeds(task: Task, views: list[int], match: PairMatcher, covered: set[int]) -> Iterator[Seed]:
    """Pairs to begin with: those with matches by hand, the best of the first few good ones, those, the next few.

    ``covered`` are views that have been tried in vain, and may grow meanwhile: pairs of two of them are left out, and
    those with one come last.

    Raises
    ------
    Refused
        "too_few", "no_pair" or "baseline", where there are none.
    """
    if len(views) < 2:
        raise Refused("too_few", f"{len(views)} of {len(task.views)} pictures with spots enough, at least 2 are needed")
    for tied in tied_pairs(task, views):
        structure = _two_views(task, tied.first, tied.second, tied, tied.b_from_a)
        if structure is not None and tied.view.parallax_deg > LEAST_PARALLAX_DEG:
            yield Seed(tied.first, tied.second, float(len(tied.a)), (structure,))
    found: list[Seed] = []
    flat, good, ambiguous = 0, 0, 0
    best: NotMatched | None = None
    first, last = deque(islice(_order(views), MOST_TRIED)), deque[tuple[int, int]]()
    while first or last:
        early = bool(first)
        a, b = (first or last).popleft()
        known = len({a, b} & covered)
        if known == 1 and early:
            last.append((a, b))
        if known == 2 or (known == 1 and early):
            continue
        pair = match(a, b, task.camera(a), task.camera(b))
        if isinstance(pair, NotMatched):
            best = pair if best is None or pair.count > best.count else best
            ambiguous += pair.cause == "ambiguous"
            if ambiguous == MOST_AMBIGUOUS and not (flat or good or found):
                break
            continue
        seed = _seed(task, a, b, pair)
        if seed is None:
            flat += 1
            continue
        found.append(seed)
        if len(found) == ENOUGH:
            yield from sorted(found, key=lambda s: -s.worth)
            good, found = good + len(found), []
    yield from sorted(found, key=lambda s: -s.worth)
    if good or found:
        return
    if flat:
        raise Refused(
            "baseline", f"{flat} pairs of pictures were matched, but taken from one place: turning the camera shows no "
            "depth; move it by a tenth of the distance or more",
        )  # fmt: skip
    why = "" if best is None else f"; the best: {best.reason}"
    help_ = "; four labels in each of three pictures, or given poses, decide" if ambiguous else ""
    raise Refused("no_pair", f"no two of {len(views)} pictures could be matched{why}{help_}")


def _order(views: list[int]) -> Iterator[tuple[int, int]]:
    """Pairs of views, those taken one after the other first, spread over all."""
    n = len(views)
    for step in range(1, n):
        first = np.arange(n - step)
        for k in np.lexsort((first, first % max(ENOUGH, step))):
            yield views[int(k)], views[int(k) + step]


def _seed(task: Task, a: int, b: int, pair: PairMatching) -> Seed | None:
    """None where the pair has no baseline that shows."""
    view = pair.view
    if view.b_from_a is None or not view.parallax_deg > LEAST_PARALLAX_DEG:
        return None
    structures = [_two_views(task, a, b, pair, pose) for pose in (view.b_from_a, *view.alternatives)]
    good = tuple(s for s in structures if s is not None)
    worth = len(pair) * min(view.parallax_deg / GOOD_PARALLAX_DEG, 1.0)
    return Seed(a, b, worth, good) if good else None


def _two_views(task: Task, a: int, b: int, pair: PairMatching | TiedPair, b_from_a: Pose) -> Structure | None:
    poses = (Pose(np.eye(3), np.zeros(3)), b_from_a)
    xy = np.stack([task.detections[a].xy[pair.a], task.detections[b].xy[pair.b]])
    cov = np.stack([task.detections[a].cov[pair.a], task.detections[b].cov[pair.b]])
    points = triangulate([task.camera(a), task.camera(b)], list(poses), xy, cov)
    good = np.flatnonzero(points.valid)
    if len(good) < FEWEST_POINTS:
        return None
    k, n = np.arange(len(good)), len(good)
    return Structure(
        points.xyz[good], np.tile(k, 2), np.repeat([a, b], n),
        np.concatenate([pair.a[good], pair.b[good]]), {a: poses[0], b: poses[1]}, {}, task.cameras,
    )  # fmt: skip


def settled(task: Task, structure: Structure) -> Structure | None:
    """The two views adjusted together; None where they do not fit."""
    result = adjusted(task, structure, Free())
    return compact(result[0]) if isinstance(result, tuple) else None
