"""Images of a sequence whose residuals are neither noise nor what the others have, too: torn, turned, exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from windmark.errors import g2
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import rules

CHANCE = 0.01
"""Chance, for all images together, that noise makes one of them stand out."""


@dataclass(frozen=True)
class Misfit:
    """An image that stands out.

    Parameters
    ----------
    name : the image's
    each_px : its residuals, 1 sigma per coordinate
    spot_px : its spots' own sigma
    others_px : the same residuals of the others, at its noise
    """

    name: str
    each_px: float
    spot_px: float
    others_px: float

    @property
    def words(self) -> str:
        """Its figures, and why neither table nor lens explains them."""
        return (
            f"residuals of {g2(self.each_px)} px per coordinate, {self.each_px / self.spot_px:.0f} times its spots' "
            f"sigma, beside {g2(self.others_px)} px in other images, which have the same table and lens: part of it may"
            " be of another moment (torn, decoded amiss), or it is turned or of another camera"
        )


def misfits(rows: Sequence[PoseRow]) -> dict[int, Misfit]:
    """Those that stand out, by their place among the rows.

    More than half of the squared residuals is neither their spots' noise nor what a typical image has (table and lens
    are the same in all), and that is no chance: the residuals by their redundancy are chi squared, and all images
    are asked together (Bonferroni). The typical image is the middle one, the lower of two, so that it is one of the
    better half. What grows slowly, as an error of the lens does where the model moves through the picture, is no fault
    of an image: a misfit that matters little (`rules.PLACE_PX`) must stand out from the neighbours, too.
    """
    at = [k for k, row in enumerate(rows) if row.cam_from_model is not None and row.spot_px > 0]
    good = [rows[k] for k in at]
    if not good:
        return {}
    own, noise = (np.array([getattr(r, key) for r in good]) ** 2 for key in ("excess_px", "spot_px"))
    redundancy = np.array([max(2 * r.matched - 6, 1) for r in good])
    calm = lower_middle(own)
    beside = np.maximum(np.append(own[1:], calm), np.append(calm, own[:-1]))
    usual = noise + np.where(own > rules.PLACE_PX**2, calm, np.maximum(beside, calm))
    times = (own + noise) / usual
    odd = (times > 1 + rules.NOISE_TIMES**2) & (chi2.sf(times * redundancy, redundancy) * len(good) < CHANCE)
    return {
        at[k]: Misfit(good[k].name, *(float(np.sqrt(v[k])) for v in (own + noise, noise, noise + calm)))
        for k in np.flatnonzero(odd)
    }


def lower_middle(values: Sequence[float] | np.ndarray) -> float:
    """The median, of an even number the lower of the two in the middle: half of the images may be spoilt."""
    return float(np.sort(values)[(len(values) - 1) // 2])


def with_misfits(rows: Sequence[PoseRow]) -> list[PoseRow]:
    """The rows, with the reason of those that stand out."""
    found = misfits(rows)
    return [
        replace(row, reason="; ".join(filter(None, [row.reason, found[k].words]))) if k in found else row
        for k, row in enumerate(rows)
    ]
