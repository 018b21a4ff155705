"""Which marker to move, or where to add one: guessed by a cheap objective, measured by the campaign.

The objective is the evidence that the rivals met so far would lack. A marker whose spot the rival's pose explains
about as well as the true one adds next to nothing; one that it misses adds its full evidence. `register` wants a lead
over the rival, and each marker is hidden with its chance: the objective is how often the lead is too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Pose
from windmark.tasks.marker_check.campaign import Campaign, Progress, Trial, run_campaign
from windmark.tasks.marker_check.candidates import Change, candidates
from windmark.tasks.marker_check.stage import Stage, in_sight

Array = NDArray[np.float64]

MOST_CHANGES = 5
RIVALS = 24
"""Views whose rivals the objective knows at most."""
DRAWN = 192
"""Draws of hidden markers in the objective."""
LEAD, ENOUGH = 14.0, 75.0
"""Evidence (nats) wanted ahead of a rival, and of a solution at all; `register` wants 10 and 60, and spots scatter."""
GATE = 0.2
"""A spot is explained by a marker that is nearer than this part of the spots' spacing."""
TRIED = 40
"""Directions in which a change is tried, two views each."""
VERIFIED = 160
"""Views, at least, with which a proposal is measured."""
SATISFIED = 0.99
"""Share of the identified views at which no further change is tried: with some room above `campaign.GOAL`."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """Changes that were measured to help, in the order of their effect.

    Parameters
    ----------
    changes : what to do, all together
    before, after : share of the views that are identified without and with them
    steps : (C,) that share after one, two, ... of the changes, from a smaller campaign
    campaign : of the changed layout
    stage : the changed layout
    """

    changes: tuple[Change, ...]
    before: float
    after: float
    steps: tuple[float, ...]
    campaign: Campaign
    stage: Stage

    def words(self, unit: str) -> list[str]:
        """One line per change, with the share that is identified then."""
        lines = []
        for k, (change, share) in enumerate(zip(self.changes, (*self.steps[:-1], self.after), strict=True)):
            lines.append(f"{'and ' if k else ''}{change.words(unit)} -> identification {100 * share:.0f} %")
        return lines

    def record(self, unit: str) -> dict[str, Any]:
        """For machines."""
        rows = [
            {"kind": c.kind, "marker": c.name, "from": c.old, "to": c.place, "normal": c.normal, "near": list(c.near),
             "identified_then": share, "words": c.words(unit)}
            for c, share in zip(self.changes, (*self.steps[:-1], self.after), strict=True)
        ]  # fmt: skip
        return {
            "changes": rows, "identified_before": self.before, "identified_after": self.after,
            "wrong_after": self.campaign.wrong,
        }  # fmt: skip


def advise(stage: Stage, campaign: Campaign, seed: int, progress: Progress | None = None) -> list[Proposal]:
    """Proposals that measurably help, the better one first: markers moved, and markers added.

    A proposal that does not raise the share of identified views by more than two sigma is not made.
    """
    if len(stage.markers) < 4 or not campaign.trials:
        return []
    moved = _greedy(stage, campaign, "move", MOST_CHANGES, seed, progress)
    enough = moved is not None and moved.campaign.passed
    # Additions are of interest where they need about as few changes.
    most = len(moved.changes) + 1 if moved is not None and enough else MOST_CHANGES
    found = [p for p in (moved, _greedy(stage, campaign, "add", min(most, MOST_CHANGES), seed, progress)) if p]
    # What reaches the goal comes first, then what needs fewer changes.
    return sorted(found, key=lambda p: (not p.campaign.passed, len(p.changes) if p.campaign.passed else -p.after))


def _greedy(
    stage: Stage, campaign: Campaign, kind: str, most: int, seed: int, progress: Progress | None
) -> Proposal | None:
    """One change after the other, each by the objective, until a trial campaign is satisfied."""
    now, final = stage, None
    changes: list[Change] = []
    steps: list[float] = []
    rivals, tried = _failed(campaign.trials), _where(campaign)
    while len(changes) < most and rivals:
        choices = candidates(now, kind, [c.name for c in changes])
        if not choices:
            break
        known = Rivals.of(rivals)
        lack = [_objective(now.with_markers(c.apply(now.markers)), known, seed) for c in choices]
        changes.append(choices[int(np.argmin(lack))])
        now, final = now.with_markers(changes[-1].apply(now.markers)), None
        trial = run_campaign(now, seed=seed + len(changes), like=campaign, only=tried, progress=progress)
        steps.append(trial.share)
        # Rivals that are beaten still count: later changes must not bring them back.
        rivals = (_failed(trial.trials) + rivals)[:RIVALS]
        if trial.share >= SATISFIED:
            final = run_campaign(now, seed=seed + 100 + len(changes), like=campaign, views=VERIFIED, progress=progress)
            if final.share >= SATISFIED and final.passed:
                break
            rivals = (_failed(final.trials) + rivals)[:RIVALS]
    if not changes:
        return None
    final = final or run_campaign(now, seed=seed + 100, like=campaign, views=VERIFIED, progress=progress)
    sure = 2 * float(np.hypot(final.sigma, campaign.sigma))
    if final.share - campaign.share < sure or final.wrong > campaign.wrong:
        return None
    return Proposal(tuple(changes), campaign.share, final.share, tuple(steps), final, now)


def _failed(trials: list[Trial]) -> list[Trial]:
    """Views that were not identified, spread over all of them."""
    failed = [t for t in trials if t.outcome != "right"]
    return failed[:: max(1, -(-len(failed) // RIVALS))]


def _where(campaign: Campaign) -> NDArray[np.int64]:
    """Directions to try a change in: half of them those with the least success, half spread over all."""
    counted = np.flatnonzero(campaign.counted)
    rate = campaign.rate()[counted]
    worst = counted[np.argsort(rate, kind="stable")][: TRIED // 2]
    rest = np.setdiff1d(counted, worst)
    return np.concatenate([worst, rest[:: max(1, -(-len(rest) // (TRIED // 2)))]])


@dataclass(frozen=True, eq=False)
class Rivals:
    """Views that were not identified, as batches of R poses; ``is_one`` is False where there was no rival."""

    true: Pose
    rival: Pose
    is_one: NDArray[np.bool_]

    @staticmethod
    def of(trials: list[Trial]) -> Rivals:
        """Of some trials, at least one."""
        true, rival = [t.pose for t in trials], [t.rival or t.pose for t in trials]
        poses = [Pose(np.stack([p.rotation for p in some]), np.stack([p.translation for p in some]))
                 for some in (true, rival)]  # fmt: skip
        return Rivals(poses[0], poses[1], np.array([t.rival is not None for t in trials]))


def _objective(stage: Stage, rivals: Rivals, seed: int) -> float:
    """Expected share of the rivals' views in which the evidence is too small."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(0, 1, (DRAWN, len(stage.markers))) >= stage.settings.hidden_percent / 100
    gain, full = evidence(stage, rivals)
    lead, whole = drawn @ gain.T, drawn @ full.T
    # The smooth part tells candidates apart that are all sure, or all hopeless.
    smooth = 0.1 * np.exp(-np.maximum(lead, 0) / LEAD)
    return float(np.mean((lead < LEAD) + smooth + (whole < ENOUGH)))


def evidence(stage: Stage, rivals: Rivals) -> tuple[Array, Array]:
    """(R, N) evidence of each marker, if seen, for the true pose against the rival's, and against chance; nats."""
    markers, camera, limit = stage.markers, stage.camera, stage.settings.max_obliquity_deg
    variance = stage.settings.noise_px**2
    xy, seen = in_sight(markers.xyz, markers.normal, camera, rivals.true, limit)
    count = np.maximum(seen.sum(axis=1, keepdims=True), 1) * (1 + stage.settings.false_percent / 100)
    width, height = camera.size_px
    most = np.log(width * height / (count * 2 * np.pi * variance)) - 1
    full = np.where(seen, most, 0.0)
    other, there = in_sight(markers.xyz, markers.normal, camera, rivals.rival, limit)
    distance = _to_nearest(xy, other, there)
    among = _to_nearest(xy, xy, seen, itself=False)
    spacing = np.array([np.median(row[mask]) if mask.any() else np.inf for row, mask in zip(among, seen, strict=True)])
    explained = seen & (distance < GATE * spacing[:, None])
    squared = np.where(explained, distance, 0.0) ** 2
    excess = squared.sum(axis=1, keepdims=True) / 2 / np.maximum(explained.sum(axis=1, keepdims=True), 1)
    near = np.minimum(np.log1p(excess / variance), most)
    gain = np.where(explained, near, full)
    return np.where(rivals.is_one[:, None], gain, full), full


def _to_nearest(xy: Array, other: Array, there: NDArray[np.bool_], itself: bool = True) -> Array:
    """(R, N) distance of each spot to the nearest of the other places that are in sight, inf without one."""
    squared = ((xy[:, :, None] - other[:, None]) ** 2).sum(axis=-1)
    squared = np.where(there[:, None] & np.isfinite(squared), squared, np.inf)
    if not itself:
        squared[:, np.arange(xy.shape[1]), np.arange(xy.shape[1])] = np.inf
    return np.sqrt(squared.min(axis=2))
