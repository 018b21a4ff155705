"""The verdict on a series: a followed model, a deformation test, an infrared run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.errors import g1, g2
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.deform.record import MISFIT
from windmark.pipeline.deform.record import FrameRecord as DeformFrame
from windmark.pipeline.infrared import FrameRecord as InfraredFrame
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.followed import followed_findings
from windmark.pipeline.verdict.picture import series_blur
from windmark.pipeline.verdict.registered import camera_at_fault
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict


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


def _followed(record: DeformFrame) -> Followed:
    doubts = tuple(zip(record.causes, record.warnings, strict=True))
    return Followed(f"frame {record.key}", record.cameras, doubts, record.sigma0)


def deform_verdict(
    records: Sequence[DeformFrame],
    weak: Sequence[str] = (),
    unit: str = "",
    zero: Sequence[str] = (),
    parameters: Sequence[str] = (),
) -> Verdict:
    """Judge a deformation test; ``weak`` is what its set-up hardly determines, in words; ``unit`` that of lengths.

    ``zero``: keys of the wind-off frames; ``parameters``: names of those of the laws.
    """
    good = [r for r in records if r.status in ("cold", "tracked", MISFIT)]
    if not good:
        reason = records[0].reason if records else "no frame arrived"
        cause = "moved" if "not where it should be" in reason else "no match"
        step = "place the named camera anew" if cause == "moved" else "see the reason of the first frame"
        return bad_series(cause, f"no frame gave a deformation; the first: {reason}", step)
    found = lost_findings([(r.key, r.reason) for r in records if r.status == "lost"], len(records), "frames")
    found += followed_findings([_followed(r) for r in good], unit)
    found += _zero(good, zero, parameters)
    if weak:
        found.append(
            Finding(
                DOUBTFUL,
                "weak",
                f"weakly determined: {weak[0]}",
                "add a camera or markers for it, or take it out of the law",
            )
        )
    s0, rms = middle([r.sigma0 for r in good]), middle([r.rms_px for r in good])
    return Verdict.of(
        found,
        1,
        f"{len(good)} frames identified, residuals of {g2(rms)} px RMS are {g2(s0)} times the spots' noise",
        "use deformation.csv with its sigmas",
    )


def _zero(good: Sequence[DeformFrame], zero: Sequence[str], parameters: Sequence[str]) -> list[Finding]:
    """Wind-off frames that differ by a part of what the wind does: one of them is not wind-off."""
    off = [r for r in good if r.key in zero]
    if len(off) < 2 or not len(off[0].q):
        return []
    q, sigma = np.array([r.q for r in off]), np.max([r.q_sigma for r in off], axis=0)
    every = np.ptp([r.q for r in good], axis=0)
    apart = np.ptp(q, axis=0)
    bad = (apart > rules.WIND_OFF_SIGMAS * sigma) & (apart > rules.WIND_OFF * every)
    if not bad.any():
        return []
    k = int(np.argmax(np.where(bad, apart / np.maximum(every, 1e-300), 0.0)))
    first, last = off[int(q[:, k].argmin())].key, off[int(q[:, k].argmax())].key
    name = parameters[k] if k < len(parameters) else f"parameter {k + 1}"
    return [
        Finding(
            DOUBTFUL,
            "table",
            f"the wind-off frames {first} and {last} differ in {name} by {100 * apart[k] / every[k]:.0f} % of all that "
            "is seen of it",
            "see that sequence.zero names frames without load",
        )
    ]


def infrared_verdict(records: Sequence[InfraredFrame], remarks: Sequence[str] = (), unit: str = "") -> Verdict:
    """Judge an infrared run; ``remarks`` are on the whole of it, ``unit`` is that of lengths."""
    good = [r for r in records if r.status == "reduced"]
    if not good:
        return bad_series(
            "no match",
            f"no frame could be reduced; the first: {records[0].reason if records else 'none'}",
            "see the reason; run windmark register on one of its pictures",
        )
    found = lost_findings([(r.key, r.reason) for r in records if r.status != "reduced"], len(records), "frames")
    found += followed_findings([r.followed for r in good], unit)
    if (seen := middle([r.seen for r in good])) < rules.COVERED * max(r.seen for r in good):
        found.append(
            Finding(
                DOUBTFUL,
                "covered",
                f"{100 * seen:.0f} % of the nodes have a temperature (median), half of what the best frame shows",
                "add a camera, or leave parts out of the grid",
            )
        )
    sigma, kelvin = middle([r.median_sigma_T for r in good]), middle([r.median_T for r in good])
    if sigma > rules.TEMPERATURE * kelvin:
        found.append(
            Finding(
                BAD,
                "units",
                f"temperatures are known to {g2(sigma)} K only (median, 1 sigma): the pictures' numbers are not in the "
                "unit that is said, or emissivity and surroundings are hardly known",
                "say the unit of the camera's numbers; give emissivity and surroundings with their sigma",
            )
        )
    flagged = [r.flagged for r in good if np.isfinite(r.flagged)]
    if flagged and middle(flagged) > rules.SOME:
        found.append(
            Finding(
                DOUBTFUL,
                "weak",
                f"{100 * middle(flagged):.0f} % of the heat fluxes are flagged (late, lateral, curved)",
                "a shorter test, or the wall's true layers",
            )
        )
    if remarks:
        found.append(Finding(DOUBTFUL, "noise", remarks[0], "see the remark"))
    return Verdict.of(
        found,
        1,
        f"{len(good)} frames reduced, temperatures to {g2(sigma)} K (median, 1 sigma; emissivity, surroundings and "
        "their sigmas as given)",
        "use the fields with their sigmas",
    )


def lost_findings(lost: Sequence[tuple[str, str]], count: int, what: str) -> list[Finding]:
    """Name and reason of each of ``count`` that gave no result, where they are more than some."""
    if len(lost) <= rules.LOST * count:
        return []
    name, why = lost[0]
    return [
        Finding(
            DOUBTFUL,
            "lost",
            f"{len(lost)} of {count} {what} gave no result; {name}: {why}",
            f"look at the first of these {what}",
        )
    ]


def bad_series(cause: str, reason: str, step: str) -> Verdict:
    """No result at all; a camera that the reason finds at fault comes before ``cause``."""
    cause, step = camera_at_fault(reason) or (cause, step)
    return Verdict.of([Finding(BAD, cause, reason, step)], 1, "", "")


def middle(values: Sequence[float]) -> float:
    """The median of those that are known; NaN without."""
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else float("nan")
