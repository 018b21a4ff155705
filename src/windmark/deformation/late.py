"""A camera whose pictures are of another time than those of the others, by all instants of a series together.

Paired by number where one camera began a picture earlier than the others, or one of these dropped a picture, its
pictures show the model where it was a frame before. Slow motion hides that in every instant: most of it looks like a
motion of the model. What is left grows with the motion, which nothing else does. Where a camera's clock, or its rate,
runs fast, it grows with the time as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.adjust import chance
from windmark.deformation.attached import LIKELIER
from windmark.deformation.evidence import Evidence, Instant
from windmark.errors import g1, g2
from windmark.scene import Doubt

Array = NDArray[np.float64]

FALSE = 2.5e-4
"""Probability that a camera in step with the others is called late."""
MOVED = 2
"""Instants in which the model moves that are needed: in one a camera that was pushed looks the same."""
BESIDE = 8.0
"""Least sum of squares that lateness explains beside poses that are off by the same in all instants: of chance, in one
of 200 series. A pose that is a little off is common, and looks much the same where the model moves steadily."""
STRAIGHT = 0.5
"""Part of a change of velocity by which the mean velocity of a step is off that at its end."""


@dataclass(frozen=True)
class Late:
    """How long before the moment of the others the pictures of a camera show the model.

    Parameters
    ----------
    views : all cameras; ``which`` of them
    value, sigma : in the unit of the instants; negative where they show it after that
    unit : of the instants, "frames" or "s"
    rate : how much that grows in one unit of time and the sigma of that, ``value`` that of the last instant; None where
        it is the same in all of them
    since : from when on it is that, by the instants; None where it was always so
    """

    views: tuple[str, ...]
    which: int
    value: float
    sigma: float
    unit: str = "frames"
    rate: tuple[float, float] | None = None
    since: float | None = None

    @property
    def doubt(self) -> Doubt:
        """As a sentence."""
        name = self.views[self.which]
        others = [n for n in self.views if n != name]
        of = others[0] if len(others) == 1 else "the others"
        if self.rate is not None:
            rate, sigma = 100 * abs(self.rate[0]), 100 * self.rate[1]
            way = "fast" if self.rate[0] > 0 else "slow"
            return Doubt((name,), f"{{}} runs {g2(rate)} ± {g1(sigma)} % {way} beside {_escaped(of)}, by all frames "
                         f"together: its pictures show the model {g2(abs(self.value))} {self.unit} "
                         f"{'earlier' if self.value > 0 else 'later'} by now", "late")  # fmt: skip
        side = "earlier" if self.value > 0 else "later"
        begin = "" if self.since is None else f"{self.since:g} s" if self.unit == "s" else f"frame {self.since:g}"
        since = f" from {begin} on" if begin else ""
        return Doubt((name,), f"pictures of {{}} show the model {g2(abs(self.value))} ± {g1(self.sigma)} {self.unit} "
                     f"{side} than those of {_escaped(of)}{since}, by all frames together", "late")  # fmt: skip

    def shifts(self, instant: Instant) -> Array:
        """(F, k) by how much what is free in an instant is off, 1 sigma, whichever camera is the one in time."""
        size = float(np.hypot(self.value, self.sigma))
        # Of two cameras either may be late, and the instant is that of the other.
        views = [0, 1] if len(self.views) == 2 else [self.which]
        return size * instant.follow[:, views]


def _escaped(name: str) -> str:
    return name.replace("{", "{{").replace("}", "}}")


def lateness(
    evidence: Evidence, place_cov: Array | None, uneven: float = 0.0, unit: str = "frames"
) -> Late | None:
    """The camera that the series shows at another time than the others; None where none is.

    ``uneven``: by which part of itself, root mean square, the model's motion changes from instant to instant. A camera
    shows where the model was, and not where its last step, straight on, would have it. Where it turns round within a
    few instants, and the states are of both times at once, the value is as uncertain as that. ``unit`` of the instants.
    """
    if len(evidence.views) < 2 or evidence.moved < MOVED:
        return None
    one, none, best = np.array([0]), evidence.poses[:0], (0.0, 0, 0.0, 0.0)
    for v in evidence.late:
        test, rank, value, cov = evidence.added(evidence.late[[v]], none, place_cov).fitted(one)
        if rank and test > best[0]:
            best = (test, int(v), float(value[0]), float(np.sqrt(cov[0, 0])))
    if (drift := _drifting(evidence, place_cov, uneven, unit)) is not None:
        return drift
    test, which, value_, sigma = best
    if chance(test, 1, *evidence.beside(test)) >= FALSE / len(evidence.views):
        return None
    # Weighted as each by itself is: what is wrong alike in all of them has no part in how they differ.
    pooled = evidence.score[which] ** 2 / max(evidence.power[which, which], 1e-300)
    if evidence.alone[which] > 2 * pooled:  # not the same in all of them: it moved once
        return None
    if len(evidence.views) == 2 and value_ < 0:
        which, value_ = 1 - which, -value_  # the other way round it is the same
    sigma = float(np.hypot(sigma, STRAIGHT * uneven * value_))
    own = evidence.late[[which]]
    beside = evidence.added(own, evidence.poses, place_cov).fitted(one)[0]
    off = max(
        evidence.added(pose, own, place_cov).fitted(np.arange(6))[0]
        for pose in evidence.poses.reshape(-1, 6)
    )  # fmt: skip
    return Late(evidence.views, which, value_, sigma, unit) if beside > max(BESIDE, off) else None


def _drifting(evidence: Evidence, place_cov: Array | None, uneven: float, unit: str) -> Late | None:
    """The camera whose lateness grows with the time; None where none's does.

    It must be told beside a lateness that stays, poses that are off, with the time as well, and what the laws lack,
    with the load or without: a steady motion goes with the time as well, and before a camera that turns slowly it looks
    the same. A picture that was dropped is no rate: it is a step, which then explains more.
    """
    limit, one, best = FALSE / len(evidence.views), np.array([0]), (0.0, 0)
    every = evidence.by_factors(evidence.course.factors)
    for v in evidence.late:
        alone = evidence.added(evidence.drift[[v]], evidence.late[[v]], place_cov).fitted(one)[0]
        if chance(alone, 1, *evidence.beside(alone)) < limit:
            rest = np.concatenate([every.late[[v]], every.with_loads(every.poses), every.with_loads(every.lacking),
                                   every.drifting_poses])  # fmt: skip
            test, rank = every.added(every.drift[[v]], rest, place_cov).fitted(one)[:2]
            best = max(best, (test if rank else 0.0, int(v)))
    test, which = best
    if chance(test, 1, *evidence.beside(test)) >= limit:
        return None
    own = np.array([evidence.late[which], evidence.drift[which]])
    # Weighted as each instant by itself is, see `lateness`.
    score, power = evidence.score[own], evidence.power[np.ix_(own, own)]
    scale = max(evidence.chi2 / max(evidence.redundancy, 1), 1.0)
    explains, late, sigma, since = _step(evidence.blocks[:, :, which])
    if explains > score @ np.linalg.pinv(power, hermitian=True) @ score + LIKELIER * scale:
        if len(evidence.views) == 2 and late < 0:
            which, late = 1 - which, -late
        sigma = float(np.hypot(sigma * np.sqrt(scale), STRAIGHT * uneven * late))
        return Late(evidence.views, which, late, sigma, unit, since=since)
    value, cov = evidence.added(own, evidence.poses[:0], place_cov).fitted(np.arange(2))[2:]
    at = np.array([1.0, evidence.time])
    late, rate = float(at @ value), float(value[1])
    if len(evidence.views) == 2 and rate < 0:
        which, late, rate = 1 - which, -late, -rate  # the other way round it is the same
    sigma = float(np.hypot(np.sqrt(at @ cov @ at), STRAIGHT * uneven * late))
    return Late(evidence.views, which, late, sigma, unit, (rate, float(np.sqrt(cov[1, 1]))))


def _step(blocks: Array) -> tuple[float, float, float, float]:
    """What a lateness explains that changes once, by whatever it is before and after it; blocks (B, 3).

    And what it is after it, the sigma of that, and when the change is, that explains most.
    """
    score, power = np.cumsum(blocks[:, :2], axis=0).T
    after, power_after = score[-1] - score[:-1], power[-1] - power[:-1]
    told = (power[:-1] > 0) & (power_after > 0)
    if not told.any():
        return 0.0, 0.0, 0.0, 0.0
    by = np.where(told, power_after, 1.0)
    explains = np.where(told, score[:-1] ** 2 / np.where(told, power[:-1], 1.0) + after**2 / by, 0.0)
    k = int(explains.argmax())
    return float(explains[k]), float(-after[k] / by[k]), float(1 / np.sqrt(by[k])), float(blocks[k + 1, 2])
