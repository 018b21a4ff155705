"""What the noise of pictures says of their levels: it grows straight with the light from that of the dark pictures.

Photons' variance is gain times light (`paint.photon_transfer`). Where the dark pictures are not the level without
light, or the response is bent (a gamma, a sensor near its full scale), the line through the variances does not end at
the dark pictures' own noise. No tap is asked: it is the pictures themselves that contradict.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.paint import PhotonTransfer

SURE = 5.0
"""Sigmas by which the noise at no light must miss that of the dark pictures."""
MATTERS = 0.01
"""Part of the brightest light that the level without light must be wrong by: less is a few thousandths of a ratio."""
BENT = 2.0
"""Misfit of the line, in sigmas, from which on it is the response rather than the level without light."""


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
