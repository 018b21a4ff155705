"""The verdict on a calibration and on a reconstruction: one network of pictures and markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from windmark.calibration import Calibration, NotCalibrated
from windmark.calibration.quality import residual_map
from windmark.calibration.three_points import turn_of_three
from windmark.errors import g2
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.doubts import STEPS, doubt_finding
from windmark.pipeline.verdict.picture import series_blur
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.calibrate.run import Calibrated
from windmark.tasks.reconstruct.result import NotReconstructed, Reconstruction

REFUSALS = {
    "too_few": "few",
    "degenerate": "weak",
    "misfit": "noise",
    "not_converged": "no match",
    "control": "control",
    "units": "units",
    "discs": "discs",
    "not_flat": "table",
    "no_pair": "no match",
    "baseline": "weak",
    "few_primaries": "few",
    "line": "one-sided",
    "not_found": "no match",
    "mirrored": "mirrored",
    "mirrored_marks": "mirrored",
    "ambiguous": "layout",
    "poses": "moved",
    "focal": "focal",
    "lens": "lens",
    "unconnected": "few",
    "adjustment": "noise",
}
"""Cause of a `NotCalibrated` or `NotReconstructed` -> cause of the verdict."""


def calibrate_verdict(
    done: Calibrated | NotCalibrated, unit: str, pictures: Sequence[Picture] | None = None
) -> Verdict:
    """Judge a calibration; ``pictures`` that it is from, None from a table of marks."""
    blurred = _blurred(pictures or ())
    if isinstance(done, NotCalibrated):
        return _refused(f"not calibrated: {done.reason}", done.cause, blurred)
    out = {p.name: p.problem or p.unread for p in pictures or () if p.problem or p.unread}
    found = [*blurred, *network_findings(done.result), *_left_out(out, len(pictures or ()))]
    if not isinstance(done.halves, NotCalibrated) and done.halves.ratio > rules.HALVES:
        found.append(
            Finding(
                DOUBTFUL,
                "lens",
                f"two halves of the pictures differ {g2(done.halves.ratio)} times as much as their covariances say",
                "trust the sigmas only times this number; more lens parameters (k3, tilts) may help",
            )
        )
    unchecked, more = _unchecked(done.result)
    return Verdict.of(
        found, 1, _good(done.result, unit) + unchecked,
        f"use the camera file; keep focus, zoom and aperture as they were{more}",
    )  # fmt: skip


def reconstruct_verdict(result: Reconstruction | NotReconstructed, unit: str, pictures: Sequence[Picture]) -> Verdict:
    """Judge a reconstruction from these pictures."""
    blurred = _blurred(pictures)
    if isinstance(result, NotReconstructed):
        return _refused(f"not reconstructed: {result.reason}", result.cause, blurred)
    found = [*blurred, *(doubt_finding(d) for d in result.doubts), *network_findings(result.calibration)]
    found += _left_out(result.dropped, len(pictures))
    if result.unrecognised:
        name, why = next(iter(result.unrecognised.items()))
        found.append(
            Finding(
                DOUBTFUL,
                "missing",
                f"primary marker {name} was not recognised: {why}"
                + (f" (and {len(result.unrecognised) - 1} more)" if len(result.unrecognised) > 1 else ""),
                "check its place in the table, or label it in two pictures",
            )
        )
    twice = int((result.count == 2).sum())
    if twice > rules.MISSING * len(result.markers) and len(pictures) > 2:
        found.append(
            Finding(
                DOUBTFUL,
                "few",
                f"{twice} of {len(result.markers)} markers are in two pictures only: a wrong link would not show",
                "take more pictures of them",
            )
        )
    # One that was recognised by its place alone checks the three that hold the frame.
    checked = (result.markers.role == "primary").sum() > 3 and not result.calibration.unchecked
    unchecked, more = ("", "") if checked else _unchecked(result.calibration)
    if result.unchecked:
        unchecked += f"; {result.unchecked}"
        more += "; more pictures, from more sides, and more known markers would check the cameras"
    return Verdict.of(
        found, 1, _good(result.calibration, unit) + unchecked,
        f"use markers.csv; its sigmas are those of this adjustment{more}",
    )  # fmt: skip


def _left_out(out: Mapping[str, str], count: int) -> list[Finding]:
    """Name and reason of each of ``count`` pictures that took no part, where that is no single one."""
    if len(out) <= max(1.0, rules.LEFT_OUT * count):
        return []
    name, why = next(iter(out.items()))
    return [
        Finding(
            DOUBTFUL,
            "lost",
            f"{len(out)} of {count} pictures took no part; {name}: {why}",
            "see the reason of each: correct what it names, label markers in these pictures, or take them again",
        )
    ]


def network_findings(result: Calibration) -> list[Finding]:
    """What speaks against an adjusted network."""
    found = [doubt_finding(d) for d in result.doubts]
    found += [
        Finding(DOUBTFUL, "swapped", f"{a} and {b} are exchanged in {view}", STEPS["swapped"])
        for a, b, view in result.swapped
    ]
    if result.sigma0 > rules.SIGMA0 and result.rms_px > rules.PLACE_PX:
        found.append(
            Finding(
                DOUBTFUL,
                "noise",
                f"residuals of {g2(result.rms_px)} px RMS are {g2(result.sigma0)} times what the marks' sigmas say",
                "look at the residual map for a pattern; give the marks their true sigma",
            )
        )
    out = int((~result.used).sum())
    if out > rules.LEFT_OUT * len(result.used):
        found.append(
            Finding(
                DOUBTFUL,
                "noise",
                f"{out} of {len(result.used)} marks were left out as gross errors",
                "see which pictures and markers they are of (residuals.csv)",
            )
        )
    return [*found, *_pattern(result), *_weak(result)]


def _pattern(result: Calibration) -> list[Finding]:
    """Residuals that depend on the place in the picture."""
    out = []
    for name in result.cameras:
        of_map = residual_map(result, name)
        cells = int((of_map.count > 2).sum())
        if cells >= 8 and of_map.excess > rules.MAP and result.rms_px > rules.PLACE_PX:
            out.append(
                Finding(
                    DOUBTFUL,
                    "lens",
                    f"{name}: mean residuals over the sensor are {g2(of_map.excess)} times what noise would "
                    "leave: the lens model misses something",
                    "free k3, the sensor's tilt or its shear (--free)",
                )
            )
    return out


def _weak(result: Calibration) -> list[Finding]:
    """Interior parameters that were asked for and are hardly determined."""
    out = []
    for name, camera in result.cameras.items():
        relative = result.sigma(name, "focal_px") / camera.focal_px
        if relative > rules.FOCAL:
            out.append(
                Finding(
                    DOUBTFUL,
                    "weak",
                    f"{name}: the focal length is known to {g2(100 * relative)} % (1 sigma) only",
                    "add pictures that are tilted by 30 deg and more, from several distances",
                )
            )
    return out


def _good(result: Calibration, unit: str) -> str:
    sigma = float(np.sqrt((result.markers.sigma**2).mean()))
    known = f", markers to {g2(sigma)} {unit}" if np.isfinite(sigma) and sigma > 0 else ""
    return (
        f"{len(result.views)} views agree: residuals of {g2(result.rms_px)} px RMS are {g2(result.sigma0)} times the "
        f"marks' noise{known}"
    )


def _unchecked(result: Calibration) -> tuple[str, str]:
    """What a good network of few known markers rests on, and what would check it; "" of others."""
    turn = turn_of_three(result)
    if turn is not None:
        return f"; {turn}", "; a fourth known marker would check the three, which all of it rests on"
    if not result.unchecked:
        return "", ""
    if not result.hardly_checked:
        return f"; {result.unchecked}", "; a further known distance, as long as it, would check it"
    worst = result.markers.name[result.hardly_checked[0].point]
    return f"; {result.unchecked}", f"; a further known marker near {worst} would check it"


def _blurred(pictures: Sequence[Picture]) -> list[Finding]:
    many = len({p.camera for p in pictures}) > 1
    return series_blur((p.camera if many else "", p.blur_px, p.radius_px) for p in pictures)


def _refused(reason: str, cause: str, blurred: Sequence[Finding]) -> Verdict:
    """No result; blurred pictures explain that."""
    steps = {
        "mirrored": "correct the sign of that axis in the table of primaries",
        "focal": "give the focal length that was found, or let it adjust (--free focal_px)",
        "lens": STEPS["lens"],
        "mirrored_marks": "count x to the right and y downward from the first pixel's centre, in pictures as the "
        "camera stores them; see the signs of the table's axes",
        "units": "give the distance (--distance) in the unit of the table of markers (--unit)",
        "table": "use one flat board; or mark three of its dots (--board-marks): then it is measured, and may be bent",
        "one-sided": "give the place of one more marker, beside that line", "few": "more pictures and markers",
        "weak": "pictures from more sides and distances", "control": STEPS["control"],
    }  # fmt: skip
    at = REFUSALS.get(cause, "no match")
    why = [replace(f, word=BAD, reason=f"{f.reason}; {reason}") for f in blurred[:1]]
    step = steps.get(cause, steps.get(at, "see the reason; windmark detect shows the spots"))
    return Verdict.of([*why, Finding(BAD, at, reason, step)], 1, "", "")
