"""The verb `match_pair`: which spots of two pictures are the same markers, from the spots alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar import band
from windmark.epipolar.constellation.evidence import Evidence, lead, weigh
from windmark.epipolar.constellation.patches import NOISE_PX, Neighbours, Patches, find_patches
from windmark.epipolar.result import Cause, NotMatched, PairMatching
from windmark.geometry import Camera
from windmark.geometry.two_view import TwoView, estimate_two_view, ideal_pixels
from windmark.scene import Detections

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

FEWEST = 12
"""Pairs below which two pictures are not matched, whatever they say."""
ROUNDS = 4
"""Of completing the matching along the epipolar lines, and estimating these again."""
TRIALS = (1000, 250)
"""Sets of five pairs that are drawn at most: from all patches together, and from one, which is mostly right."""
ALONG = 0.35
"""How far a spot may lie from its prediction along its epipolar line, as part of its neighbours' distance."""
OTHER = 0.2
"""Matchings that share at most this part of their pairs are different."""


def match_pair(
    detections_a: Detections,
    detections_b: Detections,
    camera_a: Camera,
    camera_b: Camera | None = None,
    *,
    max_log10_nfa: float = -6.0,
    min_margin: float = 10.0,
    seed: int = 0,
) -> PairMatching | NotMatched:
    """Match the spots of two pictures taken close to each other, without descriptors, labels or poses.

    Patches that an affine map explains (`constellation.patches`) give pairs; from these comes the two-view geometry
    (`geometry.two_view`), robustly; along its epipolar lines the matching is completed, the neighbours deciding where
    several spots lie on one line (AIAA 2005-5007, section VI.D). A spot with two candidates stays open.

    Parameters
    ----------
    detections_a, detections_b : spots; false and missing ones are expected
    camera_a, camera_b : interior parameters, None for the same camera; a focal length within some per cent will do
    max_log10_nfa : accepted only if chance gives such a matching less often (decimal logarithm)
    min_margin : and if no other matching, with other pairs, comes this near (nats). On a regular grid its border tells
        them apart
    seed : of the random search for the two-view geometry

    Returns
    -------
    A `PairMatching`, or a falsy `NotMatched` with its reason. How far apart the views may be depends on the relief:
    some 40 degrees on smooth surfaces, some 10 degrees where neighbours in the picture are at random depths.
    """
    options: dict[str, Any] = {"max_log10_nfa": max_log10_nfa, "min_margin": min_margin, "seed": seed}
    job = _Job.of(detections_a, detections_b, camera_a, camera_b or camera_a, seed)
    if min(len(job.near.a), len(job.near.b)) < FEWEST:
        few = f"{len(job.near.a)} and {len(job.near.b)} spots, at least {FEWEST} in each picture are needed"
        return NotMatched(few, "too_few", options=options)
    patches = find_patches(job.near)
    found = _matchings(job, patches)
    if not found:
        return NotMatched(
            f"no piece of one picture is found in the other one ({len(job.near.a)} and {len(job.near.b)} spots): views "
            "too far apart, or of different things", "nothing", options=options,
        )  # fmt: skip
    best, others = found[0], [m for m in found[1:] if m.shared(found[0]) <= OTHER]
    refusal = _refusal(best, others, max_log10_nfa, min_margin)
    if refusal is not None:
        return NotMatched(refusal[1], refusal[0], best.count, best.evidence.log10_nfa, options)
    a = np.flatnonzero(best.match >= 0)
    b = best.match[a]
    open_a = np.flatnonzero(best.evidence.expected & (best.match < 0))
    open_b = np.setdiff1d(np.flatnonzero(best.behind.expected), b)
    return PairMatching(
        job.index_a[a], job.index_b[b], best.distance_px[a], best.view, job.index_a[open_a], job.index_b[open_b],
        best.evidence.log10_nfa, best.score, (others[0].score, others[0].count) if others else None, options,
    )  # fmt: skip


@dataclass(frozen=True)
class _Job:
    """Spots that the lens model knows, in ideal pixels, with what is needed to go back."""

    a: Detections
    b: Detections
    index_a: Ints
    index_b: Ints
    camera_a: Camera
    camera_b: Camera
    near: Neighbours
    back: Neighbours
    seed: int

    @classmethod
    def of(cls, a: Detections, b: Detections, camera_a: Camera, camera_b: Camera, seed: int) -> _Job:
        ideal_a, ideal_b = ideal_pixels(camera_a, a.xy), ideal_pixels(camera_b, b.xy)
        in_a, in_b = (np.flatnonzero(np.isfinite(p).all(axis=1)) for p in (ideal_a, ideal_b))
        near = Neighbours.of(ideal_a[in_a], ideal_b[in_b])
        return cls(a.take(in_a), b.take(in_b), in_a, in_b, camera_a, camera_b, near, near.swapped(), seed)


@dataclass(frozen=True)
class _Matching:
    """A matching in the job's indices, its geometry and its worth."""

    match: Ints
    view: TwoView
    distance_px: Array
    evidence: Evidence
    behind: Evidence

    @property
    def score(self) -> float:
        """Log-likelihood ratio in nats, the mean of both sides."""
        return 0.5 * (self.evidence.score + self.behind.score)

    @property
    def count(self) -> int:
        return int((self.match >= 0).sum())

    def shared(self, other: _Matching) -> float:
        """Part of the pairs of the smaller matching that both have."""
        both = ((self.match >= 0) & (self.match == other.match)).sum()
        return float(both / max(min(self.count, other.count), 1))


def _matchings(job: _Job, patches: Patches) -> list[_Matching]:
    """Complete matchings, best first: from all patches together, and from every large one by itself."""
    pairs, size = patches.pairs()
    starts = [pairs] if len(pairs) >= FEWEST else []
    starts += [np.stack([np.flatnonzero(m >= 0), m[m >= 0]], axis=1) for m in patches.match]
    found: list[_Matching] = []
    for start in starts:
        if len(start) < FEWEST or any(_known(start, m) for m in found):
            continue
        alone = start is not pairs
        matching = _completed(job, start, np.ones(len(start)) if alone else size, patches.tried, TRIALS[alone])
        if matching is not None:
            found.append(matching)
    return sorted(found, key=lambda m: -m.score)


def _known(pairs: Ints, matching: _Matching) -> bool:
    """Whether most of these pairs are those of a matching."""
    return bool((matching.match[pairs[:, 0]] == pairs[:, 1]).mean() > 1 - OTHER)


def _completed(job: _Job, pairs: Ints, weight: Array, tried: int, trials: int) -> _Matching | None:
    """A matching from some pairs: epipolar geometry and completion in turn, until nothing changes."""
    from windmark.epipolar.constellation import _kernels as kernels

    near, view, match = job.near, None, np.full(len(job.near.a), -1, np.int64)
    for _ in range(ROUNDS):
        estimate = estimate_two_view(
            job.a.xy[pairs[:, 0]], job.b.xy[pairs[:, 1]], job.camera_a, job.camera_b,
            cov_a=job.a.cov[pairs[:, 0]], cov_b=job.b.cov[pairs[:, 1]], seed=job.seed, max_trials=trials,
        )  # fmt: skip
        if not estimate or estimate.inliers.sum() < FEWEST:
            break
        view = estimate
        start = _one_to_one(pairs[view.inliers], weight[view.inliers], len(near.a))
        allowed = band.in_band(job.a, job.b, job.camera_a, job.camera_b, view)
        grown = kernels.grow(near.a, near.na, near.b, near.nb, start, ALONG, NOISE_PX, allowed)
        if (grown == match).all():
            break
        match = grown
        a = np.flatnonzero(match >= 0)
        pairs, weight = np.stack([a, match[a]], axis=1), np.ones(len(a))
    if view is None or (match >= 0).sum() < FEWEST:
        return None
    return _weighed(job, view, match, tried)


def _weighed(job: _Job, view: TwoView, match: Ints, tried: int) -> _Matching | None:
    """The matching with its evidence; pairs off their epipolar lines are left out."""
    distance, a = np.full(len(match), np.nan), np.flatnonzero(match >= 0)
    px, sigmas = band.distance(job.a.take(a), job.b.take(match[a]), job.camera_a, job.camera_b, view)
    distance[a], width = px, band.width_px(px, sigmas)
    match = match.copy()
    match[a[~band.allowed(px, sigmas)]] = -1
    back = np.full(len(job.near.b), -1, np.int64)
    back[match[match >= 0]] = np.flatnonzero(match >= 0)
    ahead = weigh(job.near, match, width, _inside(job.camera_b), tried)
    behind = weigh(job.back, back, width, _inside(job.camera_a), tried)
    if (match >= 0).sum() < FEWEST:
        return None
    return _Matching(match, view, distance, ahead, behind)


def _one_to_one(pairs: Ints, weight: Array, count: int) -> Ints:
    """(A,) partner of each spot, the pairs of the largest patches first."""
    match, taken = np.full(count, -1, np.int64), set()
    for k in np.argsort(-weight, kind="stable"):
        a, b = (int(i) for i in pairs[k])
        if match[a] < 0 and b not in taken:
            match[a] = b
            taken.add(b)
    return match


def _inside(camera: Camera) -> Callable[[Array], Mask]:
    """Which ideal pixels of a camera are in its picture."""

    def inside(xy: Array) -> Mask:
        rays = np.column_stack([
            (xy[:, 0] - camera.cx) / camera.focal_px, (xy[:, 1] - camera.cy) / (camera.focal_px * camera.aspect),
            np.ones(len(xy)),
        ])  # fmt: skip
        seen, valid = camera.project(rays)
        return np.asarray(valid & camera.in_image(seen))

    return inside


def _refusal(
    best: _Matching, others: list[_Matching], max_log10_nfa: float, min_margin: float
) -> tuple[Cause, str] | None:
    """Why the best matching is refused; None if it is accepted."""
    nfa = best.evidence.log10_nfa
    if nfa > max_log10_nfa:
        return "weak", (
            f"the best matching has {best.count} pairs, which could be chance: false-alarm number 1e{nfa:+.1f} (limit "
            f"1e{max_log10_nfa:+.1f}); take the pictures closer to each other"
        )
    for other in others:
        ahead = lead((best.evidence, best.behind), (other.evidence, other.behind))
        if other.evidence.log10_nfa < max_log10_nfa and ahead < min_margin:
            return "ambiguous", (
                f"two matchings, of {best.count} and {other.count} pairs, are about equally good (apart by {ahead:.1f} "
                f"nats, at least {min_margin:g}): a regular layout of which neither picture shows the border"
            )
    return None
