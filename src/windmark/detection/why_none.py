"""Why an image has no markers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from windmark.detection.detect import explain
from windmark.detection.either import AUTO, find_markers
from windmark.detection.hints import hint
from windmark.detection.image import check_image, check_mask, check_polarity, prepare, usable_sample
from windmark.detection.options import Options, check_radii
from windmark.detection.radius import prevailing
from windmark.detection.rejected import REASONS
from windmark.detection.search import few_levels


def why_none(image: ArrayLike, **options: Any) -> str:
    """Why `detect` finds nothing in an image, in one sentence; "" where it does find markers.

    Parameters
    ----------
    image, **options : see `detect`

    Returns
    -------
    str
        What is wrong with the image or the radius; else how many candidates were rejected, with the reasons, or that
        nothing of this size rises out of the noise; and a setting with which markers are found, see `hints.hint`.
    """
    if options.get("polarity") == AUTO:
        return _why_neither(image, options)
    asked, grey, given = Options(**options), check_image(image), dict(options)
    height, width = grey.shape
    if usable_sample(grey, check_mask(asked.mask, grey.shape)).size == 0:
        return "no pixel can be used: all are masked out or not finite"
    prepared = prepare(grey, check_polarity(asked.polarity), asked.mask) if min(grey.shape) >= 3 else None
    if prepared is None:
        return "the image is smaller than 3 x 3 px" if min(grey.shape) < 3 else "all pixels that can be used are equal"
    if asked.radius_px is None:
        estimate = prevailing(prepared)
        if not estimate:
            return _with_hint(estimate.reason, image, given)
        options["radius_px"] = estimate.radii_px
    radii = check_radii(options["radius_px"])
    if min(grey.shape) < 2.0 * radii[0]:
        return f"the image of {width} x {height} px is smaller than a marker of radius {radii[0]:g} px"
    found, rejected = explain(image, **options)
    if len(found):
        return ""
    if not len(rejected):
        none = f"nothing {asked.polarity} of this size rises out of the noise"
        return few_levels(prepared) or _with_hint(none, image, given)
    codes, counts = np.unique(rejected.reason, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    words = "; ".join(f"{counts[k]} {REASONS[int(codes[k])]}" for k in order)
    many = "s were" if len(rejected) > 1 else " was"
    return _with_hint(f"{len(rejected)} candidate{many} rejected: {words}", image, given)


def _with_hint(why: str, image: ArrayLike, options: dict[str, Any]) -> str:
    """The reason, with the setting that finds something."""
    other = hint(image, options)
    return f"{why}; {other}" if other else why


def _why_neither(image: ArrayLike, options: dict[str, Any]) -> str:
    """Why there are neither dark nor bright markers; "" where there are."""
    look = find_markers(image, **options)
    if len(look.detections):
        return ""
    dark, bright = (why_none(image, **{**options, "polarity": polarity}) for polarity in ("dark", "bright"))
    return dark if dark == bright else f"dark: {dark}; bright: {bright or look.words}"
