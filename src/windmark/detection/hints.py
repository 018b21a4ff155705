"""What else to ask for where an image shows few markers or none: other settings are tried, one that helps is said."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from windmark.detection.detect import detect
from windmark.detection.either import AUTO, FEW

LOOSE_MERIT = 0.9  # a correlation of 0.69 with the top-hat
SIZES_PX = (1.5, 2.5, 4.0, 6.5, 10.0, 16.0)  # that are tried where none prevails


def hint(image: ArrayLike, options: dict[str, Any], found: int = 0) -> str:
    """In words, a setting with which markers are found; "" where none finds `either.FEW` and twice as many as were.

    Tried are, one at a time and in this order: the other polarity, no radius (where none was given, several), a looser
    merit, the paper's own decision. What is found so was refused by the given setting: whether it is markers is for the
    user to say.

    Parameters
    ----------
    image, options : as of `detect`, which found so few
    found : how many they were
    """
    for change, flag, what in _trials(image, options):
        count = len(detect(image, **{**options, **change}))
        if count >= max(FEW, 2 * found):
            return f"{what}: {count} found {flag}"
    return ""


def _trials(image: ArrayLike, options: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Changed options, how the command line says them, and what would be looked for."""
    polarity = options.get("polarity", "dark")
    if polarity != AUTO:
        other = "bright" if polarity == "dark" else "dark"
        yield {"polarity": other}, f"with `--polarity {other}`", f"{other} markers"
    if options.get("radius_px") is not None:
        yield {"radius_px": None}, "without `--radius`", "other sizes"
    else:
        some = detect(image, **{**options, "radius_px": SIZES_PX}).radius_px
        if some.size >= FEW:
            radius = round(max(float(np.median(some)), 1.0), 1)
            yield {"radius_px": radius}, f"with `--radius {radius:g}`", "markers of a size that few share"
    if options.get("merit_max", 0.7) < LOOSE_MERIT:
        yield {"merit_max": LOOSE_MERIT}, f"with `--merit-max {LOOSE_MERIT:g}`", "worse discs"
    if options.get("refine", "template") == "template":
        yield {"refine": "bowl"}, "with `--refine bowl`", "spots that are no blurred discs"
