"""What a deformation that the picture does not show would do to the pose of a rigid answer.

A flat model that bows along the line of sight looks like one that is turned a little, so what is found is the pose of a
straight model, and its root is turned against it. Where the bow is lost in the noise nothing of it can be in the
residuals; how large it may be, and how far the root is turned then, the normal equations say to first order.
"""

from __future__ import annotations

import math

import numpy as np

from windmark.registration.judge import rules
from windmark.registration.judge.bending import PRIOR
from windmark.registration.judge.root import may_be_root
from windmark.registration.result import Unchecked
from windmark.registration.settle._kernels.unseen import unseen_kernel
from windmark.registration.settle.solution import Solution

WORDS = (
    "a bend of the model by up to {bow:.2g} % of its size would go unnoticed here; its root would then be turned by up "
    "to {turn:.2g} deg against this pose (the pose and its sigma are those of a straight model)"
)


def unseen_bend(best: Solution, most: float, margin: float) -> tuple[float, float]:
    """How far the model may be bent, and its root be turned, without a bent model that leads by the margin.

    Parameters
    ----------
    best : rigid
    most : largest displacement that the model may have, as part of its size
    margin : nats

    Returns
    -------
    Largest displacement of a matched marker beyond a rigid motion (part of the model's size), and largest turn of a
    part that may be the root against the pose (radians). Both zero where the model cannot bend.
    """
    layout = best.views.layout
    size = PRIOR * most * layout.size
    if not (size > 0.0 and len(layout.far_field.modes)):
        return 0.0, 0.0
    roots = np.zeros(best.state.match.shape[1], np.bool_)
    roots[may_be_root(layout.far_field, np.asarray((best.state.match >= 0).any(axis=0)))] = True
    # Among deformations of so many nats, and no larger than is allowed.
    reach = math.sqrt(2 * margin)
    bow, turn = unseen_kernel(
        best.views.sights, best.state, layout.stiff_bows_of_each, layout.stiff_turns_of_each, roots, size, reach,
        most * layout.size,
    )  # fmt: skip
    return bow / layout.size, turn


def unchecked_bend(best: Solution, most: float, margin: float) -> list[Unchecked]:
    """What is to be said of it: nothing where the root would hardly be turned."""
    if best.is_bent or most <= 0.0:
        return []
    bow, turn = unseen_bend(best, most, margin)
    if turn < rules.CHECKED["bending"]:
        return []
    return [Unchecked("bending", WORDS.format(bow=100 * bow, turn=math.degrees(turn)))]
