"""The verb `match_known_pair`: which spot is which in two pictures whose relative pose is known."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.epipolar.continuity import Family, Pairs, grow_family, neighbours, predict
from windmark.epipolar.given import LEAD_MATCH, candidates_of, disagrees, family_of, left_over
from windmark.epipolar.search import all_pairs, candidates, grown
from windmark.epipolar.views import ideal_spots, raster, stations
from windmark.errors import DataError, UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

GATE = 3.7
STARTS = 4
"""Spots from which families are grown before the best is believed."""
LARGE = 0.5
"""A family with so large a part of the spots needs no other starts: those that compete with it have its first spot."""
MOST_CANDIDATES = 16
"""Candidates of a start, those nearest to its line, from which families are grown."""
IN_VAIN = 4
"""After so many times without a family that stands out the rest stays open: the layout does not decide."""
RIVAL, MORE, BESIDE = 0.5, 4, 3
"""A family with more than this part of the best one's evidence is a rival unless it leaves so many more spots without a
partner; spots that have so many neighbours in the family count."""
LEAD_FAMILY = float(np.log(1000.0))
"""A family must be so many times likelier than any other that has its first spot."""


@dataclass(frozen=True)
class KnownPair:
    """K matches of two views, one to one.

    Parameters
    ----------
    spot_a, spot_b : (K,) indices into the detections
    distance_px : (K,) distance of spot b from the epipolar line of spot a
    xyz, cov : (K, 3), (K, 3, 3) points in the frame of camera a
    log_odds : (K,) natural logarithm of how many times likelier the match is than the next possibility
    ambiguous_a, ambiguous_b : spots that have possible partners, none of which stands out
    contradicted : (G,) given matches that their neighbours contradict
    """

    spot_a: Ints
    spot_b: Ints
    distance_px: Array
    xyz: Array
    cov: Array
    log_odds: Array
    ambiguous_a: Ints
    ambiguous_b: Ints
    contradicted: Mask = field(default_factory=lambda: np.zeros(0, bool))

    def __len__(self) -> int:
        return len(self.spot_a)


def match_known_pair(
    det_a: Detections,
    det_b: Detections,
    camera_a: Camera,
    camera_b: Camera,
    b_from_a: Pose,
    *,
    pose_cov: ArrayLike | None = None,
    depth_range: tuple[float, float] | None = None,
    model_px: float = 0.05,
    given: ArrayLike | None = None,
) -> KnownPair:
    """Match two pictures by epipolar distance and by their neighbours' depths (AIAA 2005-5007, section VI.C-D).

    Parameters
    ----------
    det_a, det_b : spots of the two views
    camera_a, camera_b : their cameras
    b_from_a : pose of camera b: ``X_b = R X_a + t``
    pose_cov : (6, 6) covariance of ``exp(delta) @ b_from_a``; None where it is exact
    depth_range : nearest and farthest depth before either camera; None: from a fifth to five times that at which the
        lines of sight meet. The narrower, the fewer candidates on a line
    model_px : 1 sigma of what the detections' covariances do not hold: lens, eccentricity
    given : (G, 2) spots of matches that are known but for single wrong ones, such as clicks. What grows from them is
        taken whatever else matches more spots. Where most of them do not stand together they decide nothing, and
        what contradicts one of them is left open

    Returns
    -------
    KnownPair
        What is not decided, such as a pattern that fits itself after a shift along the lines, is left out and listed.

    Raises
    ------
    ValueError
        Unusable options, or no baseline: then there are no epipolar lines.
    """
    noise = np.zeros((2, 6, 6))
    if pose_cov is not None:
        if np.shape(pose_cov) != (6, 6) or not np.isfinite(pose_cov).all():
            raise ValueError(f"match_known_pair: pose_cov must be finite and (6, 6), got {np.shape(pose_cov)}")
        noise[1] = pose_cov
    if depth_range is not None and not 0 < depth_range[0] < depth_range[1]:
        raise UsageError(f"match_known_pair: depth_range must be 0 < nearest < farthest, got {depth_range}")
    if not np.linalg.norm(b_from_a.translation) > 0:
        raise DataError("match_known_pair: b_from_a has no baseline: the pictures are from one place")
    pose = Pose(np.stack([np.eye(3), b_from_a.rotation]), np.stack([np.zeros(3), b_from_a.translation]))
    wider = [Detections.make(d.xy, cov=d.cov + model_px**2 * np.eye(2)) for d in (det_a, det_b)]
    xy, cov = ideal_spots(wider, (camera_a, camera_b))
    count = np.array([len(det_a), len(det_b)])
    free = np.asarray(np.isfinite(xy).all(axis=1))
    stand, depth = stations((camera_a, camera_b), pose, noise, depth_range, None)
    spots = raster(xy, cov, count, free)
    found, gain = candidates(stand, spots, free, all_pairs(2), GATE, depth)
    _, xyz, cov_xyz, kept = grown(stand, spots, free, found, GATE, 2)
    good = np.isfinite(kept) & (xyz[:, 2] > 0)
    found, gain, xyz, cov_xyz = found[good], gain[good], xyz[good], cov_xyz[good]
    z = xyz[:, 2]
    pairs = Pairs(
        found[:, 0], found[:, 1] - count[0], 1 / z, np.sqrt(cov_xyz[:, 2, 2]) / z**2, gain, xy[: count[0]],
        1 / stand.near[0] - 1 / stand.far[0],
    )  # fmt: skip
    other = _Other(
        1 / b_from_a.apply(xyz)[:, 2], xy[count[0] :], neighbours(xy[count[0] :]), b_from_a, stand.low, stand.high
    )
    seeds = candidates_of(pairs, np.asarray(() if given is None else given, np.int64).reshape(-1, 2))
    chosen, lead, contradicted = _decide(pairs, count, other, seeds)
    order = np.argsort(pairs.first[chosen], kind="stable")
    chosen, lead = chosen[order], lead[order]
    open_a, open_b = np.zeros(count[0], bool), np.zeros(count[1], bool)
    open_a[pairs.first], open_b[pairs.second] = True, True
    open_a[pairs.first[chosen]], open_b[pairs.second[chosen]] = False, False
    distance = _line_distance(camera_b, b_from_a, xy[: count[0]][pairs.first[chosen]], det_b.xy[pairs.second[chosen]])
    return KnownPair(
        pairs.first[chosen], pairs.second[chosen], distance, xyz[chosen], cov_xyz[chosen], lead,
        np.flatnonzero(open_a), np.flatnonzero(open_b), contradicted,
    )  # fmt: skip


@dataclass(frozen=True)
class _Other:
    """The second view: inverse depths there (C,) of the candidates, its spots (M, 2), and both pictures' borders."""

    inverse: Array
    xy: Array
    near: Ints
    pose: Pose
    low: Array
    high: Array

    def take(self, kept: Mask) -> _Other:
        return _Other(self.inverse[kept], self.xy, self.near, self.pose, self.low, self.high)


def _decide(pairs: Pairs, count: Ints, other: _Other, seeds: Ints) -> tuple[Ints, Array, Mask]:
    """Candidates that stand out, and by how much: the best family, then the best of what is left, and so on.

    First comes what grows from the ``seeds`` (G,); which of these are contradicted is said, too.
    """
    near = neighbours(pairs.xy)
    alive, tried = np.ones(len(pairs.first), dtype=np.bool_), np.zeros(count[0], dtype=np.bool_)
    chosen: list[Ints] = []
    leads: list[Array] = []
    vain, wrong = 0, np.zeros(len(seeds), bool)
    if (seeds >= 0).any() and (grown_up := family_of(pairs, near, seeds[seeds >= 0])) is not None:
        family, wrong[seeds >= 0] = grown_up
        members = family.chosen[family.chosen >= 0]
        clear = (family.lead[pairs.first[members]] > LEAD_MATCH) | np.isin(members, seeds)
        chosen.append(members[clear])
        leads.append(family.lead[pairs.first[members[clear]]])
        alive = left_over(pairs, near, family)
    while vain < IN_VAIN and len(starts := _starts(pairs.take(alive), count[0], tried)):
        tried[starts] = True
        vain += 1
        number = np.flatnonzero(alive)
        left = pairs.take(alive)
        family, ahead, rivals = _best_family(left, near, starts, other.take(alive))
        members = family.chosen[family.chosen >= 0]
        if rivals:  # None of their spots can be decided by its neighbours.
            doubtful = np.concatenate([members, *(f.chosen[f.chosen >= 0] for f in rivals)])
            alive &= ~pairs.sharing(number[doubtful])
            continue
        clear = family.lead[left.first[members]] > LEAD_MATCH
        if ahead < LEAD_FAMILY or not clear.any() or disagrees(pairs, number[members], seeds[(seeds >= 0) & ~wrong]):
            continue
        vain = 0
        chosen.append(number[members[clear]])
        leads.append(np.minimum(family.lead[left.first[members[clear]]], ahead))
        alive &= ~pairs.sharing(number[members])
    if not chosen:
        return np.zeros(0, dtype=np.int64), np.zeros(0), wrong
    return np.concatenate(chosen), np.concatenate(leads), wrong


def _starts(pairs: Pairs, spots: int, tried: Mask) -> Ints:
    """Some spots in the middle, which every family has, and some with few candidates, which are quickly decided."""
    number = np.bincount(pairs.first, minlength=spots)
    left = np.flatnonzero((number > 0) & ~tried)
    if not len(left):
        return left
    few = left[np.argsort(number[left], kind="stable")[: STARTS // 2]]
    away = np.linalg.norm(pairs.xy[left] - np.median(pairs.xy[left], axis=0), axis=1)
    return np.concatenate([left[np.argsort(away, kind="stable")[: STARTS - STARTS // 2]], few])


def _best_family(pairs: Pairs, near: Ints, starts: Ints, other: _Other) -> tuple[Family, float, list[Family]]:
    """The family with the largest evidence, how far it is ahead of those that disagree with it, and unbeaten rivals.

    Where a regular pattern is cut by the borders of the pictures, a shifted family can explain as much as the right
    one, or more. A rival is only beaten if it also leaves more spots without a partner that should have one.
    """
    families: list[Family] = []
    for spot in starts:
        mine = np.flatnonzero(pairs.first == spot)
        mine = mine[np.argsort(-pairs.gain[mine], kind="stable")[:MOST_CANDIDATES]]
        families += [grow_family(pairs, near, np.array([c])) for c in mine]
        if max((f.chosen >= 0).sum() for f in families) > LARGE * len(np.unique(pairs.first)):
            break
    families.sort(key=lambda f: -f.total)
    best = families[0]
    ahead, rivals = best.total, []
    unexplained = _unexplained(pairs, near, best, other)
    for rival in families[1:]:
        if not _different(best, rival):
            continue
        ahead = min(ahead, best.total - rival.total)
        if rival.total > RIVAL * best.total and _unexplained(pairs, near, rival, other) < unexplained + MORE:
            rivals.append(rival)
    return best, ahead, rivals


def _unexplained(pairs: Pairs, near: Ints, family: Family, other: _Other) -> int:
    """Spots of either view beside the family that have no partner, though the other view should show them."""
    members = family.chosen[family.chosen >= 0]
    back = np.full(len(other.xy), -1)
    back[pairs.second[members]] = members
    mirror = Pairs(
        pairs.second, pairs.first, other.inverse, pairs.sigma * (other.inverse / pairs.inverse) ** 2, pairs.gain,
        other.xy, pairs.span,
    )  # fmt: skip
    total = 0
    sides = ((pairs, near, family.chosen, other.pose, 1), (mirror, other.near, back, other.pose.inverse(), 0))
    for here, around, chosen, pose, there in sides:
        alone = np.flatnonzero((chosen < 0) & ((np.where(around >= 0, chosen[around], -1) >= 0).sum(axis=1) >= BESIDE))
        inverse, _ = predict(here, around, chosen, alone)
        point = pose.apply(np.concatenate([here.xy[alone], np.ones((len(alone), 1))], axis=1) / inverse[:, None])
        place = point[:, :2] / point[:, 2:]
        total += int(((place > other.low[there]) & (place < other.high[there])).all(axis=1).sum())
    return total


def _different(one: Family, other: Family) -> bool:
    """Whether two families disagree on most of what both match."""
    both = (one.chosen >= 0) & (other.chosen >= 0)
    return bool((one.chosen[both] != other.chosen[both]).mean() > 0.5) if both.any() else False


def _line_distance(camera: Camera, b_from_a: Pose, ideal_a: Array, xy_b: Array) -> Array:
    """Distance in pixels of spots of b from the epipolar lines of ideal coordinates of a, at the spots."""
    rays = np.concatenate([ideal_a, np.ones((len(ideal_a), 1))], axis=1)
    line = np.cross(b_from_a.translation, b_from_a.rotate(rays))
    spot = camera.unproject(xy_b)
    off = (line * spot).sum(axis=1) / np.linalg.norm(line[:, :2], axis=1)
    # One pixel across the line is so many ideal units there: the lens and the aspect are in the derivative.
    normal = line[:, :2] / np.linalg.norm(line[:, :2], axis=1, keepdims=True)
    to_pixels = camera.project_jacobian(spot)[2][:, :, :2]
    return np.asarray(
        np.abs(off) / np.linalg.norm(np.linalg.solve(to_pixels.transpose(0, 2, 1), normal[..., None])[..., 0], axis=1)
    )
