"""What cameras and places that are taken as exact do to the pose where they are as good as calibrated ones are.

Without a covariance a camera counts as exact, and the pose's sigma is that of the spots and the table alone. An error
that the residuals would show is another explanation (`judge.doubts`, `judge.cameras`); one that they do not show moves
the pose, often by many of its sigmas. How far is told by the normal equations (external reliability: Baarda 1968).
"""

from __future__ import annotations

import numpy as np

from windmark.errors import g2
from windmark.geometry import Pose
from windmark.registration import rules
from windmark.registration.judge.first_order import FirstOrder
from windmark.registration.result import Unchecked
from windmark.registration.settle._kernels.doubt import DOUBTS, doubt_kernel
from windmark.registration.settle._kernels.state import PLACE, WIDE
from windmark.registration.settle.settling import accepted, opened
from windmark.registration.settle.solution import Solution

CALIBRATED = 2e-4
"""By which a camera that was calibrated may be off: parts of the focal length, of the aspect, of the image's diagonal
(principal point), and of the corner's distance from the centre (lens)."""
PLACED = 1e-4
"""By which a place in a rig may be: radians, and part of the camera's distance from the model."""
MATTERS = 3.0
"""Sigmas of the pose from which on that is worth a word."""


def of_cameras(best: Solution, parts: dict[str, tuple[int, ...]], units: dict[str, float]) -> list[Unchecked]:
    """What is to be said of cameras without a covariance: of the one, and of the thing in it, that does most.

    ``parts`` are the columns of `doubted_camera` of each thing that may be off, ``units`` 1 sigma of these.
    """
    best = accepted(best)
    views = best.views.doubted()
    normal, side = doubt_kernel(views.sights, opened(views, best.state))
    columns, own = views.loose.shape[2], len(DOUBTS)
    asked = [6 + c * columns + columns - own + k for c in range(len(views.planes)) for k in range(own)]
    first, most, said = FirstOrder(normal, side, np.array(asked)), MATTERS, list[Unchecked]()
    for c in best.seeing:
        task = best.views.planes[c].task
        for what, (start, *rest) in parts.items() if task.camera.cov is None else ():
            if what == "focal length" and task.free_focal:
                continue
            at, unit = own * c + start, units[what]
            effect, size = first.pull(at, at + 1 + len(rest), CALIBRATED / unit, rules.DOUBT)
            if effect > most:
                most, amount = effect, size * unit
                much = f"{g2(100 * amount)} %"
                if what == "principal point":
                    much = f"{g2(amount * float(np.hypot(*task.camera.size_px)))} px"
                words = (
                    f"the camera is taken as exact: its {what} off by {much} would go unnoticed here, and the pose be "
                    f"off by up to {g2(effect)} of its sigmas; with its covariance they have that (windmark calibrate)"
                )
                said = [Unchecked("camera", words, best.views.names[c])]
    return said


def of_places(best: Solution, first: FirstOrder, what: str) -> list[Unchecked]:
    """The same of places in a rig without a covariance, of which ``first`` has six unknowns of each camera.

    They are in radians and in parts of the camera's distance.
    """
    most, said, views = MATTERS, list[Unchecked](), best.views
    exact = [c for c in best.seeing if not views.loose[c, PLACE:WIDE].any()]
    for c in exact if len(exact) > 1 else ():  # a single one has the rig's frame
        given = views.cam_from_rig[c]
        if given.angle_to(Pose.identity()) == 0 and not given.translation.any():
            continue  # that frame is its own
        for at, motion in ((6 * c, "turned by {} degrees"), (6 * c + 3, "moved by {} % of its distance")):
            effect, amount = first.pull(at, at + 3, PLACED, rules.DOUBT)
            if effect > most:
                most = effect
                told = motion.format(g2(np.degrees(amount) if at == 6 * c else 100 * amount))
                words = (
                    f"a place that is taken as exact: {told} it would go unnoticed here, and the pose be off by up to "
                    f"{g2(effect)} of its sigmas; with its covariance they have that (rig_cov)"
                )
                said = [Unchecked(what, words, views.names[c])]
    return said
