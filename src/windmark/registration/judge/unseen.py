"""What a picture does not show of a deformation and of a second copy, and what that would do to the answer.

A flat model that bows along the line of sight looks like one that is turned a little, so what is found is the pose of a
straight model, and its root is turned against it. Where the bow is lost in the noise nothing of it can be in the
residuals; how large it may be, and how far the root is turned then, the normal equations say to first order.

A regular layout of which the picture's border hides one end may go on beyond its table at the other: shifted by a row,
the labels fit as well, and no spot is left to say so.

A second model of which few markers are seen is no evidence: what a spot more is worth must first pay for the pose.
"""

from __future__ import annotations

import math

import numpy as np

from windmark.errors import g2
from windmark.registration import rules
from windmark.registration.judge.first_order import Look
from windmark.registration.judge.own import in_both
from windmark.registration.result import Unchecked
from windmark.registration.settle._kernels.state import EXPECTED, PAIRS
from windmark.registration.settle._kernels.worth import LINKS, PER_LINK, SEEN_LEAST, SEEN_MOST
from windmark.registration.settle.solution import Solution
from windmark.registration.task import MIN_COUNT

WORDS = (
    "a bend of the model by up to {bow} % of its size would go unnoticed here; its root would then be turned by up "
    "to {turn} deg against this pose (the pose and its sigma are those of a straight model)"
)
COPY = (
    "a second copy of the model (a ghost, a reflection) of which fewer than {least} markers are seen would go "
    "unnoticed among the {spots} spots that are left"
)
COPY_UNSEEN = (
    "whether the model is in the picture a second time was not looked for to the end, as the work was over (max_time_s)"
)
TWICE = (
    "which of the names {names} is that of the spot: the table has the marker twice, at one place (leave one out)"
)
SAME_PLACE = 1e-6
"""Of the table's size: markers that are no farther apart are one, written down with so many digits."""


SHIFT = (
    "whether the layout goes on beyond its table: with {other} where {best} is now, and all others shifted alike, it "
    "fits as well and leaves only spots that could be more of the same rows"
)


def unchecked_twice(best: Solution) -> list[Unchecked]:
    """What is to be said of markers at one place: their labels are a matter of chance. Back to back they are two."""
    markers, layout = best.views.planes[0].task.markers, best.views.layout
    size = SAME_PLACE * layout.frame.scale
    some, matched = np.flatnonzero(layout.spacing <= size), np.asarray((best.state.match >= 0).any(axis=0))
    out: list[Unchecked] = []
    for k, a in enumerate(some.tolist()):
        apart = np.linalg.norm(markers.xyz[some[k + 1 :]] - markers.xyz[a], axis=1)
        opposite = (markers.normal[some[k + 1 :]] * markers.normal[a]).sum(axis=1) < 0  # not of unknown ones
        same = [b for b in some[k + 1 :][(apart <= size) & ~opposite].tolist() if matched[a] or matched[b]]
        out += [Unchecked("twice", TWICE.format(names=f"{markers.name[a]} and {markers.name[b]}")) for b in same]
    return out


def unchecked_shift(best: Solution, shifted: Solution | None) -> list[Unchecked]:
    """What is to be said of a labelling that is shifted, if there is one."""
    if shifted is None:
        return []
    both = in_both(best, shifted)
    c = max(best.seeing, key=lambda n: len(both[n]))
    middle, names = both[c][len(both[c]) // 2], best.views.planes[c].task.markers.name
    here, there = (names[marker[spot == middle][0]] for spot, marker in (best.pairs(c), shifted.pairs(c)))
    return [Unchecked("shift", SHIFT.format(best=here, other=there), c)]


def unchecked_bend(look: Look) -> list[Unchecked]:
    """What is to be said of it: nothing where the root would hardly be turned."""
    if look.turn < rules.CHECKED["bending"]:
        return []
    return [Unchecked("bending", WORDS.format(bow=g2(100 * look.bow), turn=g2(math.degrees(look.turn))))]


def least_copy(best: Solution, c: int, margin: float) -> int:
    """How many markers of a second copy camera c must show for it to lead chance by the margin (nats).

    A pair is worth what one of the solution is, and the copy's pose costs what the solution's does. What is missing is
    missing by itself or hidden in one piece, whichever is likelier, see `worth_kernel`.
    """
    expected, markers = int(best.state.numbers[c, EXPECTED]), best.state.match.shape[1]
    pair = float(best.weighed[c, PAIRS]) / int(best.counts[c])
    count = np.arange(MIN_COUNT, expected + 1)
    seen = np.clip((count + 1.0) / (expected + 2.0), SEEN_LEAST, SEEN_MOST)
    alone = count * np.log(seen) + (expected - count) * np.log(1.0 - seen)
    piece = -math.log(markers) - 0.5 * PER_LINK * LINKS * np.minimum(count, expected - count)
    enough = count * pair + np.maximum(alone, piece) + best.freedom > margin
    return int(count[enough.argmax()]) if enough.any() else expected + 1


def unchecked_copy(best: Solution, part: float, margin: float) -> list[Unchecked]:
    """What is to be said of second copies that show less than is evidence, or than ``part`` of their markers in view.

    Nothing where too few spots are left for a pose, or labels say which one is meant. Of a rig by the camera that has
    most of them.
    """
    if any(plane.task.fixed for plane in best.views.planes):
        return []
    if part >= 1.0:
        return [Unchecked("copy", COPY_UNSEEN)]
    left = [len(plane.task.xy) - int(n) for plane, n in zip(best.views.planes, best.counts, strict=True)]
    c = int(np.argmax(np.where(best.counts > 0, left, -1)))
    if left[c] < MIN_COUNT:
        return []
    least = max(least_copy(best, c, margin), math.ceil(part * float(best.state.numbers[c, EXPECTED])))
    return [Unchecked("copy", COPY.format(least=least, spots=left[c]), best.views.names[c])]
