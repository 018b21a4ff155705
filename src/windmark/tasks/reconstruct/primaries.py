"""Which reconstructed points are the primary markers: by labels, or by their constellation in space."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.errors import g3
from windmark.geometry import DegenerateGeometry, align
from windmark.geometry.similarity import Similarity
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct.structure import Structure
from windmark.tasks.reconstruct.task import Refused, Task

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

THIN = 0.02
"""Width over length of the primaries below which they are on a line."""
TOLERANCE = 0.005
"""How far a primary may be from its place in the search, as part of the primaries' extent; the verdict follows the
residuals."""
TRIANGLES = 10
"""Triangles of primaries that are looked for, the widest first: some primaries may not have been reconstructed."""
MOST_POINTS = 400
"""Points among which a constellation is looked for; the work grows with the third power."""
MAX_LOG10_NFA = -3.0
MIRROR = np.array([1.0, 1.0, -1.0])
"""Of a table of places; which axis it is makes no difference to what is similar to it."""
RIVAL = 3.0
"""Another solution counts as a rival if its residuals are at most so many times those of the best."""
AGREED = 0.6
"""So large a part of the labels of a primary must be on one point."""
HELD = 0.02
"""Given poses hold the frame where the adjusted ones are so near to them, as part of the distance to the primaries."""
CLEAR = 3.0
"""A primary's place names the nearest point if the next one is so many times farther off, and than poses moved."""
OWN = 6.0
"""And if it is not so many times farther off than the primaries' places usually are: one without a point of its own
would take its neighbour's."""
FINEST = 1e-4
"""Residuals count as at least so large, as part of the extent: two pictures may agree by chance."""


PRIMARY_SIGMA = 1e-4
"""1 sigma of primaries without one in their table, as part of their extent."""


@dataclass(frozen=True)
class Located:
    """Points (K,) of the primaries (K,), and the similarity to their frame."""

    point: Ints
    primary: Ints
    frame: Similarity
    log10_nfa: float

    def same_as(self, other: Located) -> bool:
        """Whether no primary is another point."""
        mine = dict(zip(self.primary.tolist(), self.point.tolist(), strict=True))
        return all(mine.get(p, q) == q for p, q in zip(other.primary.tolist(), other.point.tolist(), strict=True))


def check_primaries(primary: MarkerSet) -> None:
    """Refuse primaries that give no frame."""
    if len(primary) < 3:
        raise Refused("few_primaries", f"{len(primary)} primary markers; position, direction and scale need three")
    spread = np.linalg.svd(primary.xyz - primary.xyz.mean(axis=0), compute_uv=False)
    if spread[1] <= THIN * spread[0]:
        raise Refused("line", f"the {len(primary)} primary markers are on a line: turns about it are not determined")


def default_sigma(primary: MarkerSet) -> float:
    """1 sigma of primaries without one in their table: `PRIMARY_SIGMA` of their extent."""
    return PRIMARY_SIGMA * float(np.linalg.norm(np.ptp(primary.xyz, axis=0))) if len(primary) else 0.0


def with_sigma(primary: MarkerSet) -> MarkerSet:
    """The primaries, each with a sigma: `default_sigma` where the table has none."""
    sigma = default_sigma(primary)
    return replace(primary, sigma=np.where(np.isfinite(primary.sigma), primary.sigma, sigma))


def locate(task: Task, structure: Structure) -> Located:
    """The primaries among the points of a structure: by labels, given poses or their mutual distances.

    Raises
    ------
    Refused
        "few_primaries", "line", "not_found" or "ambiguous".
    """
    named = _named(task, structure)
    if len(named) >= 3:
        return _by_labels(task, structure, named)
    return _by_place(task, structure) or _by_constellation(task, structure, named)


def _named(task: Task, structure: Structure) -> dict[int, int]:
    """{primary: point} of labelled spots; where a few labels disagree, most votes."""
    votes: dict[int, Counter[int]] = {}
    for v, s, p in zip(structure.view.tolist(), structure.spot.tolist(), structure.point.tolist(), strict=True):
        if s in task.labels[v]:
            votes.setdefault(task.labels[v][s], Counter())[p] += 1
    split = [p for p, count in votes.items() if count.most_common(1)[0][1] < AGREED * count.total()]
    if split:
        raise Refused(
            "not_found", f"the labels of {task.primary.name[split[0]]} are on {len(votes[split[0]])} reconstructed "
            "points: labels are wrong, or the pictures of a regular layout were linked with a shift",
        )  # fmt: skip
    return {primary: count.most_common(1)[0][0] for primary, count in votes.items()}


def _by_labels(task: Task, structure: Structure, named: dict[int, int]) -> Located:
    primary, point = np.array(list(named)), np.array(list(named.values()))
    if len(np.unique(point)) < len(point):
        raise Refused("not_found", "two primary markers are labels of one reconstructed point")
    try:
        frame = align(structure.xyz[point], task.primary.xyz[primary])
    except DegenerateGeometry as error:
        raise Refused("line", f"the {len(primary)} labelled primary markers give no frame: {error}") from None
    return Located(point, primary, frame, -np.inf)


def _by_place(task: Task, structure: Structure) -> Located | None:
    """The points at the primaries' places, where given poses hold the frame; None where fewer than three are clear."""
    known = task.primary.xyz
    moved = [
        np.linalg.norm(structure.poses[v].apply(known) - pose.apply(known), axis=1)
        for v, pose in task.given.items() if v in structure.poses
    ]  # fmt: skip
    far = [np.linalg.norm(pose.apply(known), axis=1) for v, pose in task.given.items() if v in structure.poses]
    if len(moved) < 2 or np.median(np.array(moved) / np.array(far)) > HELD or len(structure.xyz) < 4:
        return None
    error = float(np.median(moved))
    gap, near = cKDTree(structure.xyz).query(known, 2)
    clear = gap[:, 1] > CLEAR * np.maximum(gap[:, 0], error)
    usual = float(np.median(gap[clear, 0])) if clear.any() else 0.0
    primary = np.flatnonzero(clear & (gap[:, 0] <= OWN * max(usual, error)))
    point = near[primary, 0].astype(np.int64)
    if len(primary) < 3 or len(np.unique(point)) < len(point):
        return None
    try:
        return Located(point, primary, align(structure.xyz[point], known[primary]), -np.inf)
    except DegenerateGeometry:
        return None


def _by_constellation(task: Task, structure: Structure, named: dict[int, int]) -> Located:
    known, n = task.primary.xyz, len(structure.xyz)
    if len(known) < 4:
        raise Refused(
            "not_found", f"{len(known)} primary markers cannot be told from others by their distances alone; label "
            "three of them in one picture, or give four or more",
        )  # fmt: skip
    if n > MOST_POINTS:
        raise Refused("not_found", f"among {n} points the primary markers must be labelled in one picture")
    extent = float(np.linalg.norm(np.ptp(known, axis=0)))
    sigma = np.nanmax(np.where(np.isfinite(task.primary.sigma), task.primary.sigma, 0.0))
    tolerance = TOLERANCE * extent + 3 * float(sigma)
    found = _constellations(structure.xyz, known, named, tolerance, extent)
    most = max((len(f.point) for f in found), default=0)
    if most < len(known):
        _refuse_mirrored(_constellations(structure.xyz, known * MIRROR, named, tolerance, extent), most, len(known))
    if not found:
        views = len(structure.poses)
        raise Refused(
            "not_found", f"no four of {len(known)} primary markers were recognised among the {n} points that were "
            f"reconstructed from {views} pictures: fewer than four of them are in {min(views, 3)} of these, they "
            "are not where their table says, or the camera file is another camera's; take more pictures that "
            "show them, or label three in one picture",
        )  # fmt: skip
    return _best(found, len(known), FINEST * extent)


def _constellations(
    xyz: Array, known: Array, named: dict[int, int], tolerance: float, extent: float
) -> list[Located]:
    """Sets of points that are placed as the primaries, or four of them or more, are."""
    tree, found = cKDTree(xyz), list[Located]()
    for triangle in _triangles(known):
        for corners in _alike(xyz, known[list(triangle)], tolerance):
            located = _extended(xyz, tree, known, triangle, corners, tolerance, extent)
            if located is not None and all(
                p not in named or named[p] == q for p, q in zip(located.primary, located.point, strict=True)
            ):
                found.append(located)
        if found and min(f.log10_nfa for f in found) < 2 * MAX_LOG10_NFA:
            break
    return found


def _refuse_mirrored(found: list[Located], most: int, primaries: int) -> None:
    """Refuse primaries of which more are recognised in the mirror image of their table than in it."""
    best = min(found, key=lambda f: f.log10_nfa, default=None)
    if best is not None and best.log10_nfa <= MAX_LOG10_NFA and len(best.point) > most:
        raise Refused(
            "mirrored", f"the mirror image of the table of primaries has {len(best.point)} of {primaries} where "
            f"points were reconstructed, the table has {most}: one of its axes has the wrong sign",
        )  # fmt: skip


def _best(found: list[Located], primaries: int, floor: float) -> Located:
    found.sort(key=lambda f: f.log10_nfa)
    best = found[0]
    if best.log10_nfa > MAX_LOG10_NFA:
        raise Refused(
            "not_found", f"the best fit has {len(best.point)} of {primaries} primaries (RMS {g3(best.frame.rms)}), "
            f"which could be chance: false-alarm number 1e{best.log10_nfa:+.1f}; label three of them in one picture",
            nearly=best,
        )  # fmt: skip
    for other in found[1:]:
        near = other.frame.rms <= RIVAL * max(best.frame.rms, floor) and len(other.point) >= len(best.point)
        if near and not other.same_as(best):
            raise Refused(
                "ambiguous", f"two sets of points fit the {len(best.point)} primary markers about equally well (RMS "
                f"{g3(best.frame.rms)} and {g3(other.frame.rms)}): a symmetric placement; label three in one picture",
            )  # fmt: skip
    return best


def _triangles(xyz: Array) -> list[tuple[int, int, int]]:
    """Triangles of markers, the largest areas first."""
    every = list(combinations(range(len(xyz)), 3)) if len(xyz) <= 12 else _some(len(xyz))
    area = [np.linalg.norm(np.cross(xyz[j] - xyz[i], xyz[k] - xyz[i])) for i, j, k in every]
    return [every[t] for t in np.argsort(area)[::-1][:TRIANGLES]]


def _some(n: int) -> list[tuple[int, int, int]]:
    rng = np.random.default_rng(0)
    drawn = {tuple(sorted(rng.choice(n, 3, replace=False).tolist())) for _ in range(300)}
    return [(i, j, k) for i, j, k in sorted(drawn)]


def _alike(xyz: Array, corners: Array, tolerance: float) -> list[tuple[int, int, int]]:
    """Triangles of points that are similar to that of ``corners``, the sides within ``tolerance`` after scaling."""
    far = np.linalg.norm(xyz[:, None] - xyz[None], axis=2)
    side = [float(np.linalg.norm(corners[i] - corners[j])) for i, j in ((0, 1), (0, 2), (1, 2))]
    with np.errstate(divide="ignore"):
        scale = side[0] / far
    found: list[tuple[int, int, int]] = []
    for i in range(len(xyz)):
        with np.errstate(invalid="ignore"):
            first = np.abs(scale[i][:, None] * far[i][None] - side[1]) < tolerance
            second = np.abs(scale[i][:, None] * far - side[2]) < tolerance
        found += [(i, int(j), int(k)) for j, k in zip(*np.nonzero(first & second), strict=True) if len({i, j, k}) == 3]
    return found


def _extended(
    xyz: Array, tree: cKDTree, known: Array, triangle: tuple[int, int, int], corners: tuple[int, int, int],
    tolerance: float, extent: float,
) -> Located | None:  # fmt: skip
    """All primaries that are near points once three are; None if there are none besides."""
    try:
        frame = align(xyz[list(corners)], known[list(triangle)])
        for _ in range(2):
            gap, nearest = tree.query(frame.inverse().apply(known))
            primary = np.flatnonzero(gap * frame.scale < tolerance)
            point = np.asarray(nearest)[primary]
            if len(primary) < 4 or len(np.unique(point)) < len(point):
                return None
            frame = align(xyz[point], known[primary])
    except DegenerateGeometry:
        return None
    residual = np.linalg.norm(frame.apply(xyz[point]) - known[primary], axis=1)
    reach = max(float(residual.max()), FINEST * extent)
    return Located(point.astype(np.int64), primary, frame, _log10_nfa(xyz, frame, len(known), len(primary), reach))


def _log10_nfa(xyz: Array, frame: Similarity, primaries: int, count: int, reach: float) -> float:
    """How many placements as good chance would give, points spread over a plane (the conservative case).

    Three points fix the similarity and have two shape constraints; every other primary needs a point within ``reach``.
    """
    spread = frame.scale * np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)[:2] / np.sqrt(len(xyz))
    length, area = 3.5 * spread[0], 12 * spread[0] * spread[1]
    n = len(xyz)
    triples = 3 * np.log10(n) + np.log10(primaries * (primaries - 1) * (primaries - 2) / 6)
    shape = 2 * np.log10(min(2 * reach / length, 1.0))
    chance = np.log10(min(n * np.pi * reach**2 / area, 1.0))
    return float(triples + shape + (count - 3) * chance)
