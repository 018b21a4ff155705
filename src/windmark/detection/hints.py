"""What else to ask for where an image shows no markers: other settings are tried, the first that finds some is said."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from windmark.detection.detect import detect
from windmark.detection.either import AUTO, FEW

LOOSE_MERIT = 0.9  # a correlation of 0.69 with the top-hat


def hint(image: ArrayLike, options: dict[str, Any]) -> str:
    """In words, a setting with which markers are found; "" where none finds `either.FEW`.

    Tried are, one at a time and in this order: the other polarity, no radius, a looser merit, the paper's own
    decision. What is found so was refused by the given setting: whether it is markers is for the user to say.

    Parameters
    ----------
    image, options : as of `detect`, which found nothing
    """
    for change, flag, what in _trials(options):
        count = len(detect(image, **{**options, **change}))
        if count >= FEW:
            return f"{what}: {count} found with `{flag}`"
    return ""


def _trials(options: dict[str, Any]) -> list[tuple[dict[str, Any], str, str]]:
    """Changed options, the flag of the command line that stands for them, and what would be looked for."""
    polarity = options.get("polarity", "dark")
    out: list[tuple[dict[str, Any], str, str]] = []
    if polarity != AUTO:
        other = "bright" if polarity == "dark" else "dark"
        out.append(({"polarity": other}, f"--polarity {other}", f"{other} markers"))
    if options.get("radius_px") is not None:
        out.append(({"radius_px": None}, "no radius", "other sizes"))
    template = options.get("refine", "template") == "template"
    if options.get("merit_max", 0.7) < LOOSE_MERIT:
        out.append(({"merit_max": LOOSE_MERIT}, f"--merit-max {LOOSE_MERIT:g}", "worse discs"))
    if template:
        out.append(({"refine": "bowl"}, "--refine bowl", "holes that are no blurred discs"))
    return out
