"""What the noise of pictures says of their levels: it grows straight with the light from that of the dark pictures.

Photons' variance is gain times light (`paint.photon_transfer`). Where the dark pictures are not the level without
light, or the response is bent (a gamma, a sensor near its full scale), the line through the variances does not end at
the dark pictures' own noise. No tap is asked: it is the pictures themselves that contradict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from windmark.errors import g2
from windmark.paint import PhotonTransfer, SensorModel
from windmark.paint.photons import soft_limit
from windmark.pipeline.psp.taken import Taken
from windmark.scene.levels import clipped_level

SURE = 5.0
"""Sigmas by which the noise at no light must miss that of the dark pictures."""
MATTERS = 0.01
"""Part of the brightest light that the level without light must be wrong by: less is a few thousandths of a ratio."""
BENT = 2.0
"""Misfit of the line, in sigmas, from which on it is the response rather than the level without light."""
QUIET = "its response bends at its brightest pixels: "
"""Begins, after the camera's name, what is said where bright light has too little noise."""


@dataclass(frozen=True)
class OddResponse:
    """How the noise of a camera's pictures contradicts their levels.

    Parameters
    ----------
    level : grey levels by which the level without light is other than that of the dark pictures, were the response
        straight
    part : of the brightest light
    bent : the noise does not grow straight with the light
    """

    level: float
    part: float
    bent: bool


def odd_response(found: PhotonTransfer, dark_noise: float) -> OddResponse | None:
    """What contradicts; None where nothing does, or nothing is told.

    Parameters
    ----------
    found : of pictures less the dark ones
    dark_noise : variance of a pixel of one dark picture, NaN where unknown. Pictures that are each the mean of several
        have less than that, so that too little noise is odd from where it would be less than none
    """
    if not np.isfinite(dark_noise):
        return None
    most = float(found.levels.max())
    least = found.intercept if found.intercept < 0 else max(found.intercept - dark_noise, 0.0)
    if not (found.gain > 0 and abs(least) > SURE * found.sigma[1]):
        return None
    level = float(-least / found.gain)
    if not abs(level) > MATTERS * most:
        return None
    return OddResponse(level, abs(level) / most, found.misfit > BENT)


def soft_words(kind: str, camera: str, pictures: Sequence[Taken], sensor: SensorModel) -> str:
    """What is to be said of a kind's pictures whose brightest pixels are quieter than light is; "" of others.

    A sensor near its full scale, and whatever limits levels softly, makes bright places darker than they are: there the
    ratio is wrong, and taps that are right contradict it.
    """
    good = [p for p in pictures if p.image is not None]
    if len(good) < 2 or sensor.linearity is not None:
        return ""
    limit = min(sensor.saturation, *(clipped_level(np.asarray(p.image)) for p in good))
    frames = np.stack([np.where(np.isfinite(p.light), np.asarray(p.image, dtype=float), np.nan) for p in good])
    found = soft_limit(frames, sensor.gain, sensor.read_variance, dark=sensor.dark, limit=limit)
    if found is None:
        return ""
    level = found.level + float(np.median(sensor.dark))
    return (f"{camera}: {QUIET}from grey level {level:.0f} on {kind} pictures have {g2(100 * found.part)} % of the "
            "variance that light's noise has")  # fmt: skip
