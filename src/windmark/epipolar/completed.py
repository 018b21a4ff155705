"""A matching of two pictures made complete: epipolar geometry and the spots along its lines in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar import band
from windmark.epipolar.constellation.evidence import Evidence, weigh
from windmark.epipolar.constellation.patches import NOISE_PX, Neighbours
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
ALONG = 0.35
"""How far a spot may lie from its prediction along its epipolar line, as part of its neighbours' distance."""


@dataclass(frozen=True)
class Job:
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
    def of(cls, a: Detections, b: Detections, camera_a: Camera, camera_b: Camera, seed: int) -> Job:
        """The job of two pictures; spots that the lens model does not know are left out."""
        ideal_a, ideal_b = ideal_pixels(camera_a, a.xy), ideal_pixels(camera_b, b.xy)
        in_a, in_b = (np.flatnonzero(np.isfinite(p).all(axis=1)) for p in (ideal_a, ideal_b))
        near = Neighbours.of(ideal_a[in_a], ideal_b[in_b])
        return cls(a.take(in_a), b.take(in_b), in_a, in_b, camera_a, camera_b, near, near.swapped(), seed)


@dataclass(frozen=True)
class Matching:
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
        """Number of pairs."""
        return int((self.match >= 0).sum())

    def shared(self, other: Matching) -> float:
        """Part of the pairs of the smaller matching that both have."""
        both = ((self.match >= 0) & (self.match == other.match)).sum()
        return float(both / max(min(self.count, other.count), 1))


def completed(job: Job, pairs: Ints, weight: Array, tried: int, trials: int) -> Matching | None:
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


def _weighed(job: Job, view: TwoView, match: Ints, tried: int) -> Matching | None:
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
    return Matching(match, view, distance, ahead, behind)


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
