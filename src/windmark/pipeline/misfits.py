"""Images of a sequence whose residuals are neither noise nor what the others have, too: torn, turned, exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from windmark.errors import g2
from windmark.geometry import Pose
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import rules

CHANCE = 0.01
"""Chance, for all images together, that noise makes one of them stand out."""
TURNED = float(np.radians(10.0))
"""Half a turn about the camera's axis to so much: what the model moved from one image to another besides."""
HALF_TURN = Pose.from_rotvec([0.0, 0.0, np.pi], [0.0, 0.0, 0.0])


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


def turned(rows: Sequence[PoseRow]) -> dict[int, str]:
    """Pictures that were turned by half a turn, by their place among the rows: in words.

    Where the lens is a pinhole before the middle of the picture its markers fit as well as before: the model seems to
    stand on its head in that image. It is asked whether the pose is that of the last upright image, turned about the
    camera's axis; where that is so in half of the images, or more, nothing says which way is up.
    """
    good = [(k, row.cam_from_model, row.name) for k, row in enumerate(rows) if row.cam_from_model is not None]
    out: dict[int, str] = {}
    upright = good[:1]  # the last one
    for k, pose, name in good[1:]:
        _, before, of = upright[0]
        if (HALF_TURN @ before).angle_to(pose) < TURNED:
            out[k] = f"the picture is turned by 180 degrees against {of}, or the model is"
        else:
            upright = [(k, pose, name)]
    return out if 2 * len(out) < len(good) else {}


def lower_middle(values: Sequence[float] | np.ndarray) -> float:
    """The median, of an even number the lower of the two in the middle: half of the images may be spoilt."""
    return float(np.sort(values)[(len(values) - 1) // 2])


def with_misfits(rows: Sequence[PoseRow]) -> list[PoseRow]:
    """The rows, with the reason of those that stand out or are turned."""
    found = {k: m.words for k, m in misfits(rows).items()} | turned(rows)
    return [
        replace(row, reason="; ".join(filter(None, [row.reason, found[k]]))) if k in found else row
        for k, row in enumerate(rows)
    ]
