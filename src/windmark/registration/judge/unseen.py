"""What a deformation that the picture does not show would do to the pose of a rigid answer.

A flat model that bows along the line of sight looks like one that is turned a little, so what is found is the pose of a
straight model, and its root is turned against it. Where the bow is lost in the noise nothing of it can be in the
residuals; how large it may be, and how far the root is turned then, the normal equations say to first order.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.registration.judge import rules
from windmark.registration.judge.bending import PRIOR
from windmark.registration.judge.root import may_be_root
from windmark.registration.result import Unchecked
from windmark.registration.search.field import STIFF
from windmark.registration.settle._kernels.doubt import doubt_kernel
from windmark.registration.settle.settling import opened
from windmark.registration.settle.solution import Solution, beyond_rigid

Array = NDArray[np.float64]

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
    field = layout.far_field
    amplitude = PRIOR * most * layout.size * field.amplitude(STIFF)
    modes = amplitude[:, None, None] * field.modes
    if not len(modes):
        return 0.0, 0.0
    views = best.views.bent(modes)
    normal, _ = doubt_kernel(views.sights, opened(views, best.state))
    bends = len(normal) - len(modes)
    normal[6:, 6:] += np.eye(len(normal) - 6)
    # The rigid fit takes up a part of the deformation; where a root goes is the rest of its motion.
    taken = np.linalg.solve(normal[:bends, :bends], normal[:bends, bends:])
    told = np.linalg.cholesky(normal[bends:, bends:] - normal[bends:, :bends] @ taken)
    open_ = np.linalg.inv(told).T  # a root of what stays open of the coefficients
    matched = np.asarray((best.state.match >= 0).any(axis=0))
    roots = may_be_root(field, matched)
    turns = (best.state.rotation @ (amplitude * field.motions[roots, :3]) - taken[:3]) @ open_
    _, sigma, way = np.linalg.svd(turns[(turns**2).sum(axis=(1, 2)).argmax()], full_matrices=False)
    # Among deformations of so many nats, and no larger than is allowed.
    reach = math.sqrt(2 * margin)
    rest = beyond_rigid(layout.model.xyz[matched], modes[:, matched]) / layout.size
    rest = reach * (open_.T @ rest.reshape(len(modes), -1)).reshape(rest.shape)
    own = float(np.linalg.norm(np.tensordot(way[0], rest, 1), axis=1).max())
    turn = (most / own if own > most else 1.0) * reach * float(sigma[0])
    bow = math.sqrt(float((rest**2).sum(axis=(0, 2)).max()))
    return min(bow, most), turn


def unchecked_bend(best: Solution, most: float, margin: float) -> list[Unchecked]:
    """What is to be said of it: nothing where the root would hardly be turned."""
    if best.is_bent or most <= 0.0:
        return []
    bow, turn = unseen_bend(best, most, margin)
    if turn < rules.CHECKED["bending"]:
        return []
    return [Unchecked("bending", WORDS.format(bow=100 * bow, turn=math.degrees(turn)))]
