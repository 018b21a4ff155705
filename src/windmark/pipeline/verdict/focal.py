"""A focal length that is not the given one in a followed sequence: in words, and in the sigmas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g1, g2
from windmark.geometry import Camera
from windmark.pipeline.focal_series import FocalSeries, pose_step, pov_change
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.registration import Unchecked
from windmark.scene import MarkerSet

Array = NDArray[np.float64]

MATTERS = 2.0
"""Sigmas of an image's point of view by which it must be off, for a deviation to be said."""
ASKED = 1e-3
"""Part of a focal length by which it changes with the temperature, or from one use of an autofocus to another."""
MOST, FEW = 0.1, 3
"""Part of a focal length that a single image shows with hardly any marker; markers that a pose takes."""
STANDING = "follow markers on walls by themselves, too (--roles wall): a camera that stands still sees them stand still"


def focal_findings(rows: Sequence[PoseRow], series: FocalSeries, unit: str) -> list[Finding]:
    """What the images together tell of the focal length, where it matters."""
    found = series.found
    if found is None or not _matters(rows, series):
        return []
    posed = [r for r in rows if r.cam_from_model is not None]
    far = max((e[3:] for e in series.effect), key=lambda e: float(np.linalg.norm(e)))
    off = f"distances are off by {g2(np.linalg.norm(far))} {unit} for it"
    most = f"{off} ({g2(_sigmas(rows, series))} of their sigmas, which now hold that)"
    part, word = f"{g2(100 * abs(found.part))} ± {g1(100 * found.sigma)} %", "longer" if found.part > 0 else "shorter"
    given, other = series.focal_px, series.focal_px * (1 + found.part * (-1 if found.at_end else 1))
    ends = (other, given) if found.at_end else (given, other)
    if_given = ", if the camera file has that of the beginning" if found.either else ""
    became = f"({ends[0]:.1f} -> {ends[1]:.1f} ± {g1(series.focal_px * found.sigma)} px{if_given})"
    if found.kind == "constant":
        said = f"the focal length is {part} {word} than the camera file says {became}"
        rival, step = "or the table is off smoothly", "calibrate the camera (windmark calibrate)"
    elif found.kind == "drift":
        said = f"the focal length was {part} {word} at the end ({posed[-1].name}) than at the start {became}"
        rival, step = "or the model bends as time goes on", "lock zoom and focus, and calibrate anew"
    else:
        said = f"the focal length is {part} {word} from {rows[found.first].name} on {became}"
        rival, step = "or the model is bent from there on", "if zoom or focus were touched, calibrate for either part"
    if _is_bent(series):
        return [_bent(found.kind, rows[found.first].name, found.smooth)]
    beside = f"; {rival}, which is about as likely" if found.smooth > -rules.PATTERN_NATS else ""
    told = f"{len(posed)} images together tell it, none by itself"
    return [Finding(DOUBTFUL, "lens", f"{said}{beside}: {most}; {told}", f"{step}; or {STANDING}")]


def _bent(kind: str, first: str, lead: float) -> Finding:
    """The same where a smooth error of the table is what it looks like."""
    when = {"constant": "in all images alike", "drift": "more and more from the first image to the last"}
    what = "markers are off their table smoothly" if kind == "constant" else "the model bends"
    said = (
        f"{what} {when.get(kind, f'from {first} on')}: all images together tell it ({g2(lead)} nats ahead of another "
        "focal length); poses are those of a rigid model as its table has it"
    )
    step = "measure the markers (windmark reconstruct)" if kind == "constant" else "measure it (windmark deform)"
    return Finding(DOUBTFUL, "table" if kind == "constant" else "bent", said, step)


def focal_unchecked(
    rows: Sequence[PoseRow], series: FocalSeries, markers: MarkerSet, camera: Camera, unit: str
) -> list[Unchecked]:
    """That the focal length is taken from its file, where all images together would not show 0.1 % of it."""
    posed = [r for r in rows if r.cam_from_model is not None and r.matched > FEW]
    if not posed or series.found is not None:
        return []
    some = posed[:: max(len(posed) // 8, 1)]
    off = np.array([pov_change(r, markers, camera, ASKED) for r in some])
    far = float(np.median(np.linalg.norm(off[:, 3:], axis=1)))
    times = float(np.median(np.abs(off / np.array([r.sigma for r in some])).max(axis=1)))
    if not times * series.shown > MATTERS * ASKED:
        return []
    unseen = f"less than {g1(100 * series.shown)} %" if series.shown < MOST else "a deviation"
    words = (
        f"the focal length is taken from the camera file: {unseen} would go unnoticed in {_together(len(posed))}, and "
        f"0.1 % of it changes distances by {g2(far)} {unit} ({g2(times)} of their sigmas, which take it as known); "
        f"{STANDING}"
    )
    return [Unchecked("focal length", words)]


def _together(count: int) -> str:
    return f"these {count} images together" if count > 1 else "this image"


def with_focal(rows: Sequence[PoseRow], series: FocalSeries) -> list[PoseRow]:
    """The rows with what a focal length has done to them in their sigmas, where it matters."""
    if not _matters(rows, series) or _is_bent(series):
        return list(rows)
    return [replace(r, sigma=np.hypot(r.sigma, e)) for r, e in zip(rows, series.effect, strict=True)]


def cov_with_focal(
    cov: Array, rows: Sequence[PoseRow], series: FocalSeries, markers: MarkerSet, camera: Camera
) -> Array:  # fmt: skip
    """The same in the covariance (6, 6) of the last pose among the rows; rows as `with_focal` takes them."""
    if not _matters(rows, series) or _is_bent(series):
        return cov
    k = max(k for k, row in enumerate(rows) if row.cam_from_model is not None)
    step = pose_step(rows[k], markers, camera, float(series.part[k]))
    return cov + np.outer(step, step)


def _is_bent(series: FocalSeries) -> bool:
    """Whether it is no focal length, but a table or a model that is off smoothly."""
    return series.found is not None and series.found.smooth > rules.PATTERN_NATS


def _matters(rows: Sequence[PoseRow], series: FocalSeries) -> bool:
    return series.found is not None and _sigmas(rows, series) > MATTERS


def _sigmas(rows: Sequence[PoseRow], series: FocalSeries) -> float:
    """How far the most deceived image is off, in its stated sigmas."""
    each = [np.abs(e / r.sigma).max() for e, r in zip(series.effect, rows, strict=True) if r.cam_from_model is not None]
    return float(max(each, default=0.0))
