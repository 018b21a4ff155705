"""The light of a picture: its levels without the pixels that say nothing of it."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import detection
from windmark.pipeline.quantity import Quantity
from windmark.scene.levels import missing_at, saturated_as_missing, saturation_level

Image = NDArray[Any]
Mask = NDArray[np.bool_]

GREY = Quantity()
_DEAD: dict[int, tuple[weakref.ref[Image], NDArray[np.intp] | None]] = {}
"""By the picture's identity: itself, as long as it is there, and the places of its hot and dead pixels."""


def light_of(image: Image, mixed: Mask | None = None, quantity: Quantity = GREY) -> Image:
    """A picture (H, W) in its quantity as values are taken of it; itself where all of its pixels can be.

    NaN where a pixel is saturated, was made of saturated ones (``mixed``, of `io.read_levels`), or is a hot or dead
    one, which leaves its neighbours as nothing does that an optic has imaged.
    """
    light = saturated_as_missing(quantity.of(image), image)[0]
    return missing_at(missing_at(light, mixed), _dead_of(image))


def _dead_of(image: Image) -> Mask | None:
    """`detection.dead_pixels`, remembered while the picture is there: mapping, merging and alignment ask once more."""
    key = id(image)
    if (known := _DEAD.get(key)) is not None and known[0]() is image:
        place = known[1]
    else:
        found = detection.dead_pixels(image)
        place = np.flatnonzero(found) if found is not None else None
        _DEAD[key] = (weakref.ref(image, lambda _: _DEAD.pop(key, None)), place)
    if place is None:
        return None
    out = np.zeros(image.shape, bool)
    out.flat[place] = True
    return out


def without_dead(light: Image) -> Image:
    """Light (H, W), corrected as far as dark, flat or even pictures do, with NaN where pixels do not measure all the
    same: hot and dead ones, in groups and lines as well. Asked after the correction, as what it evens out is no defect;
    what is saturated has to be NaN before.
    """
    return missing_at(light, detection.dead_pixels(light))


def full_pixels(image: Image, mixed: Mask | None = None) -> tuple[Mask | None, str]:
    """The pixels that are saturated or were made of such, and from which level on, in words; None and "" if none is."""
    level = saturation_level(image)
    full = np.asarray(image >= level)
    if mixed is not None and (mixed & ~full).any():
        return full | mixed, "at the highest level of at least one colour"
    return (full, f"at {level:g} and above") if full.any() else (None, "")
