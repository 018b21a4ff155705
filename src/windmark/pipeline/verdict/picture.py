"""What a picture itself says: how blurred its markers are, and how much of it is at its highest level."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.detection.fields import field_shift
from windmark.detection.template.crlb import bound_factor
from windmark.errors import g2
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding
from windmark.scene import Detections
from windmark.scene.levels import clipped_level
from windmark.tasks.blur import spot_blur


@dataclass(frozen=True)
class PictureState:
    """State of a picture.

    Parameters
    ----------
    blur_px : median blur of its markers, 1 sigma of a Gaussian; NaN where there are none
    radius_px : their median radius
    costs : best possible sigma of their centres over that of the same discs in a sharp picture; NaN likewise
    saturated : part of its pixels at the highest level; 0 unless it is clipped there
    level : that level
    empty : all pixels are at one level
    fields_px : how far its markers are apart in rows of odd and of even number, see `FieldShift.sure_px`
    """

    blur_px: float
    radius_px: float
    costs: float
    saturated: float
    level: float
    fields_px: float = 0.0
    empty: bool = False


def picture_state(image: NDArray[np.generic], spots: Detections | None, polarity: str) -> PictureState:
    """Look at an image (H, W) of grey levels and its spots, best first; ``polarity`` is theirs."""
    grey = np.asarray(image)
    if grey.size and (top := grey.max()) == grey.min():
        return PictureState(np.nan, np.nan, np.nan, 0.0, float(top), empty=True)
    saturated, level = _saturated(grey)
    if spots is None:
        return PictureState(np.nan, np.nan, np.nan, saturated, level)
    blur, size = spot_blur(grey, spots, polarity)
    fields = field_shift(grey, spots.xy, size).sure_px if size > 0 else 0.0
    costs = blur_costs(blur, size) if np.isfinite(blur) else np.nan
    return PictureState(blur, size, costs, saturated, level, fields)


def blur_costs(blur_px: float, radius_px: float) -> float:
    """Best possible sigma of a blurred disc's centre over that of the same disc in a sharp picture."""
    blurred, sharp = (bound_factor(radius_px, 0.0, of, samples=8) for of in (blur_px, rules.SHARP_PX))
    return float(blurred / sharp)


def _saturated(grey: NDArray[np.generic]) -> tuple[float, float]:
    """Part of the pixels at the level where the picture is clipped, and that; 0 and the highest where it is not."""
    if grey.dtype.kind not in "ui" or not grey.size:
        return 0.0, np.nan
    level = clipped_level(grey, surely=False)
    return (float((grey >= level).mean()), level) if level < np.inf else (0.0, float(grey.max()))  # type: ignore[operator]


def picture_findings(state: PictureState) -> list[Finding]:
    """Empty, saturated, blurred and interlaced pictures."""
    out = []
    if state.empty:
        said = f"every pixel is at the level {state.level:g}: the picture shows nothing"
        out.append(Finding(BAD, "file", said, "see whether this is the right picture, and how it was exported"))
    elif state.saturated > rules.SATURATED:
        out.append(
            Finding(
                DOUBTFUL,
                "saturated",
                f"{g2(100 * state.saturated)} % of the pixels are at the highest grey level, {state.level:.0f}",
                "expose shorter or dim the lamps; pixels there have no value",
            )
        )
    if state.costs > rules.BLUR_COSTS:
        out.append(_blurred("the picture is", state.blur_px, state.radius_px, state.costs))
    if state.fields_px > rules.PLACE_PX:
        out.append(_interlaced("the picture is", state.fields_px))
    return out


def series_blur(sights: Iterable[tuple[str, float, float]]) -> list[Finding]:
    """Cameras of which more than some of the pictures are blurred.

    Parameters
    ----------
    sights : camera, blur and radius of its spots in pixels, of every picture; NaN where unknown
    """
    of: dict[str, list[tuple[float, float]]] = {}
    for camera, blur, radius in sights:
        if np.isfinite(blur) and radius > 0:
            of.setdefault(camera, []).append((blur, radius))
    out = []
    for camera, pictures in of.items():
        blurs, radius = np.array(pictures).T
        size = float(np.median(radius))
        # More than `SOME` of the pictures are at least so blurred.
        blur = float(np.quantile(blurs, 1 - rules.SOME))
        if (costs := blur_costs(blur, size)) > rules.BLUR_COSTS:
            out.append(_blurred(f"pictures of {camera} are" if camera else "pictures are", blur, size, costs))
    return sorted(out, key=lambda f: f.reason)


def series_fields(sights: Iterable[tuple[str, float]]) -> list[Finding]:
    """Cameras of which more than some of the pictures are of two fields.

    Parameters
    ----------
    sights : camera, and how far its markers are apart in the two fields, px, of every picture
    """
    of: dict[str, list[float]] = {}
    for camera, apart in sights:
        of.setdefault(camera, []).append(apart)
    out = []
    for camera, every in of.items():
        far = [px for px in every if px > rules.PLACE_PX]
        if len(far) > rules.SOME * len(every):
            what = f"{len(far)} of {len(every)} pictures{f' of {camera}' if camera else ''} are"
            out.append(_interlaced(what, max(far)))
    return sorted(out, key=lambda f: f.reason)


def _interlaced(what: str, apart_px: float) -> Finding:
    return Finding(
        DOUBTFUL,
        "interlaced",
        f"{what} interlaced: rows of odd number show the markers up to {g2(apart_px)} px from where those of even "
        "number do",
        "expose both fields at once: progressive scan, or a flash",
    )


def _blurred(what: str, blur_px: float, radius_px: float, costs: float) -> Finding:
    return Finding(
        DOUBTFUL,
        "blurred",
        f"{what} blurred by {g2(blur_px)} px (1 sigma) at markers of {g2(radius_px)} px radius: their centres are "
        f"{g2(costs)} times less sure than in a sharp one",
        "focus, or expose shorter where the model moves; or paint larger markers",
    )
