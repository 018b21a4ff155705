"""The verdict on a followed sequence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.errors import g1, g2
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.picture import series_blur
from windmark.pipeline.verdict.series import bad_series, lost_findings, middle
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding, Verdict


def track_verdict(rows: Sequence[PoseRow], unit: str) -> Verdict:
    """Judge a followed sequence."""
    good = [r for r in rows if r.cam_from_model is not None]
    if not good:
        reason = rows[0].reason if rows else "there are no images"
        return bad_series(
            "no match", f"no image gave a pose; the first: {reason}", "run windmark register on one image first"
        )
    found = lost_findings([(r.name, r.reason) for r in rows if r.cam_from_model is None], len(rows), "images")
    excess, spot = (middle([getattr(r, k) for r in good]) for k in ("excess_px", "spot_px"))
    if excess > max(rules.PLACE_PX, rules.NOISE_TIMES * spot):
        found.append(
            Finding(
                DOUBTFUL,
                "table",
                f"markers about {g1(middle([r.off_table for r in good]))} {unit} off their table "
                f"(median of {len(good)} images): residuals are {np.hypot(excess, spot) / spot:.0f} "
                f"times their spots' sigma",
                "measure the markers (windmark reconstruct), or calibrate the lens",
            )
        )
    bent = [r for r in good if r.bent_px > rules.PLACE_PX]
    if len(bent) > rules.SOME * len(good):
        far = max(r.bent_px for r in bent)
        found.append(
            Finding(
                DOUBTFUL,
                "bent",
                f"the model is bent in {len(bent)} of {len(good)} images (up to {g2(far)} px); its pose is "
                "that of a rigid one",
                "measure the deformation (windmark deform)",
            )
        )
    found += series_blur(("", r.blur_px, r.radius_px) for r in good)
    few = [r for r in good if r.matched < rules.FEW]
    if len(few) > rules.SOME * len(good):
        found.append(
            Finding(
                DOUBTFUL,
                "few",
                f"{len(few)} of {len(good)} images rest on fewer than {rules.FEW} markers",
                "paint more markers, or choose roles that are seen",
            )
        )
    gone = [r for r in good if r.matched < (1 - rules.MISSING) * r.expected]
    if len(gone) > rules.SOME * len(good):
        worst = min(gone, key=lambda r: r.matched / max(r.expected, 1))
        found.append(
            Finding(
                DOUBTFUL,
                "missing",
                f"{len(gone)} of {len(good)} images lack over a third of their markers; "
                f"{worst.name}: {worst.matched} of {worst.expected}",
                "look at windmark detect on this image",
            )
        )
    rms = middle([r.rms_px for r in good])
    return Verdict.of(
        found,
        1,
        f"all {len(good)} images have a pose, residuals of {g2(rms)} px RMS are the spots' noise",
        "use poses.csv",
    )
