"""Markers that must be in view and have no spot: missing, or beside a spot that no marker has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.errors import g2
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.registration import Registration
from windmark.scene.detections import FLAGS
from windmark.tasks.odd import CHANCE, nearest_spots

if TYPE_CHECKING:
    from windmark.pipeline.verdict.registered import Sighting

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SATURATED = next(bit for bit, flag in FLAGS.items() if flag == "saturated")


def odd_markers(seen: Sighting, answer: Registration) -> list[Finding]:
    """Markers without a spot where a spot without a marker is too near to be there by chance.

    What is within the sigma of that spot is no contradiction: it is at its place.
    """
    alone, free = _alone(seen, answer), _free(seen, answer)
    if not len(alone) or not len(free):
        return []
    place = answer.camera.project(answer.cam_from_model.apply(seen.markers.xyz[alone]))[0]
    nearest, chance = nearest_spots(place, seen.spots.xy[free], answer.camera.size_px)
    which = free[cKDTree(seen.spots.xy[free]).query(place)[1]]
    own = np.hypot(np.sqrt(np.trace(seen.spots.cov[which], axis1=1, axis2=2) / 2), answer.excess_px)
    odd = np.flatnonzero((len(alone) * chance < CHANCE) & (nearest > rules.GROSS * own))
    if not len(odd):
        return []
    # Of a spot whose pixels are in part at the highest level only the rest of it is seen: its centre is not the disc's.
    full = (seen.spots.flags[which[odd]] & SATURATED) > 0
    return [*_beside(seen, answer, alone[odd[~full]], nearest[odd[~full]]),
            *_in_full_light(seen, alone[odd[full]], nearest[odd[full]])]  # fmt: skip


def _in_full_light(seen: Sighting, markers: Ints, far: Array) -> list[Finding]:
    """Markers whose spots have saturated pixels, and so are so many pixels beside their places."""
    if not len(markers):
        return []
    k, more = int(np.argmin(far)), f" (and {len(markers) - 1} more)" if len(markers) > 1 else ""
    return [
        Finding(
            DOUBTFUL,
            "saturated",
            f"the spot of {seen.markers.name[markers[k]]}{more} is saturated in part, and {g2(far[k])} px from where "
            "its table has it",
            "expose shorter, dim the lamps, or turn the highlight away from the markers; the pose does not use them",
        )
    ]


def _beside(seen: Sighting, answer: Registration, markers: Ints, far: Array) -> list[Finding]:
    """Markers that are so many pixels from where the table has them."""
    if not len(markers):
        return []
    k = int(np.argmin(far))
    scale = _unit_per_px(answer)
    more = f" (and {len(markers) - 1} more)" if len(markers) > 1 else ""
    return [
        Finding(
            DOUBTFUL,
            "marker",
            f"{seen.markers.name[markers[k]]}{more} is {g2(far[k])} px ({g2(far[k] * scale)} "
            f"{seen.unit}) from where "
            "its table has it",
            "measure this marker again, or exchange the names if two of them are swapped",
        )
    ]


def missing(seen: Sighting, answer: Registration) -> list[Finding]:
    """So many markers without a spot that they are no accident."""
    found = len(answer.matching)
    expected = answer.n_expected if seen.expected is None else found + len(_alone(seen, answer))
    gone = expected - found
    if gone <= rules.MISSING * expected:
        return []
    return [
        Finding(
            DOUBTFUL,
            "missing",
            f"{gone} of {expected} markers that must be in view have no spot",
            "look at the red diamonds of the matching picture: covered, rubbed off, too faint, or not of this test?",
        )
    ]


def _alone(seen: Sighting, answer: Registration) -> Ints:
    """Markers that must be in view and have no spot.

    Not those at a spot that takes no part by the user's own word: that one is not judged, nor its marker.
    """
    if seen.expected is None:
        return np.zeros(0, np.int64)
    alone, out = np.setdiff1d(seen.expected, answer.matching.marker), _excluded(answer)
    if not (len(alone) and len(out)):
        return alone
    place = answer.camera.project(answer.cam_from_model.apply(seen.markers.xyz[alone]))[0]
    chance = nearest_spots(place, seen.spots.xy[out], answer.camera.size_px)[1]
    return alone[len(alone) * chance >= CHANCE]


def _free(seen: Sighting, answer: Registration) -> Ints:
    """Spots that take part and have no marker."""
    taken = np.union1d(answer.matching.detection, _excluded(answer))
    return np.setdiff1d(np.arange(len(seen.spots)), taken)


def _excluded(answer: Registration) -> Ints:
    """Spots that took no part in a registration."""
    return np.asarray(answer.options.get("excluded", ()), dtype=np.int64).ravel()


def _unit_per_px(answer: Registration) -> float:
    depth = float(np.median(answer.cam_from_model.apply(answer.matched_xyz)[:, 2]))
    return depth / answer.camera.focal_px
