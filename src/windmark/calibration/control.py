"""Does what is known beforehand (control points, held markers, distances) agree with itself and with the pictures?

The test is that of `agreement`; here what of it is left out, one block (a point, a distance) at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.agreement import FALSE, Blocks, Control, Seen, Test, chance
from windmark.calibration.datum import Fixed, Weighted
from windmark.calibration.setup import Job, bars_of
from windmark.calibration.solve import Solved
from windmark.geometry.similarity import Similarity

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

MOST = 150
"""Points that are tested together, for memory and time; more are tested in groups."""
TRIED = 12
"""Blocks, the worst ones, that are tried as the wrong one at a time."""

@dataclass(frozen=True)
class Verdict:
    """What the test of the control says.

    Parameters
    ----------
    wrong : blocks (markers first, then distances) that contradict all others, with the T that each had
    unclear : blocks of which one is wrong, and which cannot be told; empty where none is or it can
    factor : how many times larger than their sigmas all misfits are where no single block explains it; 1 if they fit
    fit : takes the network onto the right control
    off : how far known points are off besides their sigmas then (1 sigma per coordinate, length units); 0: not asked
    exchanged : the two points in each other's place, as far as that is what is `wrong` or `unclear`
    ratio : of the distances to what the points make them, where each of the two kinds agrees in itself; 0: not so
    """

    fit: Similarity
    wrong: dict[int, float] = field(default_factory=dict)
    unclear: tuple[int, ...] = ()
    factor: float = 1.0
    off: float = 0.0
    exchanged: tuple[int, ...] = ()
    ratio: float = 0.0


def control_of(job: Job, seen: Mask) -> Control:
    """The control of a job among the markers that the network has, (N,)."""
    n = len(job.markers)
    sigma = np.full((n, 3), np.inf)
    if isinstance(job.datum, Fixed):
        sigma[job.chosen(job.datum.markers, "datum")] = 0.0
    elif isinstance(job.datum, Weighted):
        sigma = job.known_sigma()
    point = np.flatnonzero(np.isfinite(sigma).any(axis=1) & seen)
    bars = bars_of(job)
    use = np.flatnonzero(seen[bars.first] & seen[bars.second])
    ends = np.stack([bars.first, bars.second], axis=1)[use]
    cov = np.diag(np.where(np.isfinite(sigma[point]), sigma[point], 0.0).ravel() ** 2)
    together = job.known_together(seen)
    if together is not None:
        own = (3 * np.searchsorted(point, together[0])[:, None] + np.arange(3)).ravel()
        cov[np.ix_(own, own)] = together[1].cov
    return Control(point, job.markers.xyz[point], sigma[point], cov, ends, bars.length[use], bars.sigma[use], use)


def judge(control: Control, solved: Solved, rough: Similarity) -> Verdict:
    """Test the control against a free network, leave out what contradicts the rest.

    ``rough`` takes the network near the control, where that itself cannot say.
    """
    groups = max(-(-len(control.point) // MOST), 1)
    out = Verdict(rough)
    for g in range(groups):
        part = _group(control, g, groups)
        found = _judged(part, solved, rough)
        at = np.concatenate([np.arange(g, len(control.point), groups), len(control.point) + np.arange(len(part.bar))])
        out = Verdict(
            found.fit if g == 0 else out.fit, out.wrong | {int(at[b]): t for b, t in found.wrong.items()},
            (*out.unclear, *(int(at[b]) for b in found.unclear)), max(out.factor, found.factor),
            max(out.off, found.off), ratio=max(out.ratio, found.ratio),
        )  # fmt: skip
    # Of two in each other's place none is the only one that is wrong.
    several = len(out.wrong) > 1 or out.unclear or out.factor > 1
    return _with_exchanged(control, solved, out) if several else out


def _with_exchanged(control: Control, solved: Solved, verdict: Verdict) -> Verdict:
    """The verdict that two points are in each other's place, where they are the only ones of which that explains all.

    Both are wrong then, if the others hold the frame without them; else it is not used. The worst points are tried,
    of more than `MOST` among a part of the others.
    """
    if len(control.point) < 3:
        return verdict
    groups = -(-len(control.point) // MOST)
    value = np.zeros(len(control.point))
    for g in range(groups):
        part = _group(control, g, groups)
        seen = Test(part, solved, verdict.fit).of(np.ones(len(part), dtype=np.bool_))
        value[g::groups] = seen.blocks().value[: len(part.point)]
    worst = np.sort(np.argsort(-value, kind="stable")[:TRIED])
    some = np.union1d(worst, np.arange(0, len(control.point), groups))
    part, places = _part(control, some, slice(None)), np.searchsorted(some, worst)
    every = np.ones(len(part), dtype=np.bool_)
    test = Test(part, solved, verdict.fit)
    as_named = test.fit(every).rms
    pairs = []
    for a, b in combinations(places.tolist(), 2):
        other = test.exchanged(a, b)
        if other.fit(every).rms > as_named:
            continue  # they are farther from their places then
        swapped = other.of(every)
        if _fits(swapped, swapped.blocks(), every):
            pairs.append((int(some[a]), int(some[b]), swapped.fit))
    if len(pairs) != 1:
        return verdict
    a, b, fit = pairs[0]
    both = {k: float(value[k]) for k in (a, b)}
    if hold_frame(np.delete(control.xyz, (a, b), axis=0)):
        return Verdict(fit, both, exchanged=(a, b))
    return Verdict(fit, unclear=(a, b), exchanged=(a, b))


def hold_frame(xyz: Array) -> bool:
    """Whether points hold a frame: three at least, not on a line."""
    if len(xyz) < 3:
        return False
    spread = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-3 * spread[0])


def _group(control: Control, g: int, groups: int) -> Control:
    """Every so-many-th point from the g-th on; the distances are with the first."""
    return _part(control, np.arange(g, len(control.point), groups), slice(None) if g == 0 else slice(0, 0))


def _part(control: Control, part: Ints, bars: slice) -> Control:
    """Some of the points, and of the distances."""
    own = np.arange(control.xyz.size).reshape(-1, 3)[part].ravel()
    return Control(
        control.point[part], control.xyz[part], control.sigma[part], control.cov[np.ix_(own, own)],
        control.bar[bars], control.length[bars], control.bar_sigma[bars], control.distance[bars],
    )  # fmt: skip


def _judged(control: Control, solved: Solved, rough: Similarity) -> Verdict:
    """One block at a time: the one without which all others fit. Where several would do, none can be told."""
    used = np.ones(len(control), dtype=np.bool_)
    wrong: dict[int, float] = {}
    test = Test(control, solved, rough)
    seen = test.of(used)
    while True:
        blocks = seen.blocks()
        if _fits(seen, blocks, used):
            return Verdict(test.fit(used), wrong)
        order = np.argsort(np.where(used & (blocks.dof > 0), blocks.p, 2.0), kind="stable")[:TRIED]
        tried = [int(b) for b in order if used[b] and blocks.dof[b]]
        heals = [b for b in tried if _heals(test, seen, blocks, used, b)]
        if len(heals) > 1 and not wrong:
            return Verdict(test.fit(used), {}, tuple(sorted(heals)))
        # Several that could be wrong beside one that is: bad sigmas are the simpler explanation.
        if len(heals) > 1 or (not heals and (not tried or 3 * (len(wrong) + 1) > len(control))):
            every = np.ones(len(control), dtype=np.bool_)
            whole = test.of(every)
            factor = float(np.sqrt(max(whole.value, 1.0)))
            return Verdict(whole.fit, factor=factor, off=test.off(whole), ratio=_ratio(control, solved, rough))
        worst = heals[0] if heals else tried[0]
        used[worst] = False
        wrong[worst] = float(blocks.value[worst])
        seen = test.without(seen, used, worst)


def _ratio(control: Control, solved: Solved, rough: Similarity) -> float:
    """Of the distances to what the points make them, where each kind agrees in itself; else 0."""
    points, bars = _part(control, np.arange(len(control.point)), slice(0, 0)), _part(control, np.arange(0), slice(None))
    if len(bars) < 2 or not hold_frame(points.xyz):
        return 0.0
    scale = []
    for part in (points, bars):
        used = np.ones(len(part), dtype=np.bool_)
        seen = Test(part, solved, rough).of(used)
        if seen.free <= 0 or not _fits(seen, seen.blocks(), used):
            return 0.0
        scale.append(seen.fit.scale)
    return scale[1] / scale[0]


def _heals(test: Test, seen: Seen, blocks: Blocks, used: Mask, block: int) -> bool:
    """Whether all others fit each other without one block, which may have turned the similarity away from them."""
    others = used.copy()
    others[block] = False
    if test.turned(seen, others):
        rest = test.of(others)
    elif not chance(seen.total - float(blocks.value[block]), seen.free - int(blocks.dof[block])):
        return False
    else:
        rest = seen.without(block)
    return _fits(rest, rest.blocks(), others)


def _fits(seen: Seen, blocks: Blocks, used: Mask) -> bool:
    """Whether what is used fits each other, as a whole and one by one."""
    return chance(seen.total, seen.free) and bool((blocks.p[used] > FALSE / max(used.sum(), 1)).all())


