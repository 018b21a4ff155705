"""The verdict on two pictures that were matched by hand: another lens, residuals beyond noise, what nothing checks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g1, g2
from windmark.geometry import Camera, Pose
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.lens import INTERIOR, lead_over_scatter, likeliest, prior
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.scene import Detections
from windmark.scene.detections import middle_sigma
from windmark.tasks.clicked_pair import ClickedPair, Clicks
from windmark.tasks.clicked_pair.interior import PoseFit, groups

Array = NDArray[np.float64]


def pair_verdict(
    result: ClickedPair, clicks: Clicks, spots: tuple[Detections, Detections], cameras: tuple[Camera, Camera] | None
) -> Verdict:
    """Judge the geometry of two pictures and their matches."""
    if not result:
        cause, step = told_by(result.reason) or (
            "few", "match more markers by hand, all over both pictures and not on one plane"
        )  # fmt: skip
        return Verdict.of([Finding(BAD, cause, result.reason, step)], 1, "", "")
    found = _unchecked(result, clicks)
    if cameras is not None and result.pose is not None:
        found += _misfit(result, spots, cameras, result.pose)
    count, rms = len(result.spot_a), float(np.sqrt((result.distance_px**2).mean()))
    gone = int(result.wrong.sum())
    left = f"; {gone} wrong click{'s' if gone > 1 else ''} left out" if gone else ""
    return Verdict.of(
        found, 1, f"{count} matches are {g2(rms)} px RMS from their epipolar lines{left}",
        "see that each line meets its marker in both pictures; labels.csv is for windmark reconstruct --labels",
    )  # fmt: skip


def _unchecked(result: ClickedPair, clicks: Clicks) -> list[Finding]:
    """Clicks on which the geometry hangs."""
    names = np.array(clicks.name)[result.unchecked].tolist()
    if not names:
        return []
    what = f"click {names[0]}" if len(names) == 1 else f"{len(names)} clicks ({', '.join(names[:5])})"
    said = f"nothing checks {what}: a wrong one would hardly show"
    return [Finding(DOUBTFUL, "few", said, "match more markers near them; see the notes")]


def _misfit(
    result: ClickedPair, spots: tuple[Detections, Detections], cameras: tuple[Camera, Camera], pose: Pose
) -> list[Finding]:  # fmt: skip
    """Distances from the lines beyond the spots' noise, by the pattern of another interior or without one."""
    spot = middle_sigma(np.concatenate([spots[0].cov[result.spot_a], spots[1].cov[result.spot_b]]))
    rms = float(np.sqrt((result.distance_px**2).sum() / max(len(result.distance_px) - 5, 1)))
    residuals = f"matches are {g2(rms)} px from their epipolar lines, {g2(rms / spot)} times their spots' sigma"
    lead, turn = _other_interior(result, spots, cameras, pose, spot)
    if lead > rules.PATTERN_NATS:
        return [Finding(
            DOUBTFUL, "lens",
            f"{residuals}, with the pattern of another lens, focal length or principal point ({lead:.0f} nats ahead of "
            f"scatter); with one that fits the second camera may be turned by some {g1(turn)} deg more",
            "calibrate the camera (windmark calibrate), and check that the file is this camera's",
        )]  # fmt: skip
    if rms > max(rules.PLACE_PX, 2 * spot):
        step = "calibrate the camera; see that nothing moved between the pictures, and that both are as they were taken"
        return [Finding(DOUBTFUL, "noise", residuals, step)]
    return []


def _other_interior(
    result: ClickedPair, spots: tuple[Detections, Detections], cameras: tuple[Camera, Camera], pose: Pose, spot: float
) -> tuple[float, float]:  # fmt: skip
    """Nats that another interior is ahead of scatter, and by how many degrees the pose would turn with it."""
    a, b = spots[0].xy[result.spot_a], spots[1].xy[result.spot_b]
    each, fit = groups(cameras), PoseFit(a, b, cameras, pose)
    if len(a) < 5 + 2 * len(INTERIOR) * len(each):
        return 0.0, 0.0
    inner = np.concatenate([
        fit.moved(which, dict(zip(INTERIOR, prior(cameras[which[0]]).tolist(), strict=True))) for which in each
    ], axis=1)  # fmt: skip
    if not (np.isfinite(inner).all() and np.isfinite(fit.distance).all()):
        return 0.0, 0.0
    free, b_free = fit.left(-fit.distance), fit.left(inner)
    step = fit.step(inner @ likeliest(free, b_free, spot))
    return lead_over_scatter(free, b_free), float(np.degrees(np.linalg.norm(step[:3])))
