"""The mirror image of the table as an explanation: a picture or a table that is mirrored.

A symmetric model looks like its mirror image with left and right exchanged, a nearly flat one like the one with its
relief turned over. Where the mirrored table explains the spots better, picture or table are mirrored; where it explains
them as well, the picture cannot tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.registration.search.layout import FLIP
from windmark.registration.settle._kernels.mirror import mirrors_kernel, start
from windmark.registration.settle._kernels.settle import STEADY, fit_kernel, settle_kernel
from windmark.registration.settle._kernels.state import state_of
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

FAR = 5.0
"""Mirrored markers that leave residuals of so many times the misfit (their median) with the labels as they are make no
rival. Where a picture is mirrored, what the best solution without a mirror leaves is its misfit: it takes markers for
others that are about where they are. So a near-symmetry that is much coarser than the misfit is none."""
AT_ONE, ALIKE = 1e-7, 1e-4
"""Two images whose places differ by less than the first (radians, part of the distance), and whose cameras and
coefficients by less than the second (sigmas of their priors), came to rest at one."""


def reach_of(best: Solution) -> Array:
    """(C,) px, the median residual that a rival may leave with the labels as they are."""
    return FAR * np.maximum(best.misfit_px, [plane.task.typical_sigma_px for plane in best.views.planes])


def mirror_of(views: Views, best: Solution, most: int) -> Solution | None:
    """The best solution with the mirrored table that the layout's improper near-symmetries make of one.

    The mirrored model may be as bent as the solution, and is tried rigid, too, as in ``views``: with a table that is
    mirrored a deformation explains what is none. ``most`` motions are tried, those that bring most markers onto others
    first. None without any.
    """
    onto, turn, shift, across = views.layout.mirror_starts
    onto, turn, shift = onto[:most], turn[:most], shift[:most]
    if not len(onto):
        return None
    reach = reach_of(best)
    found: Solution | None = None
    for way in [views.mirrored(FLIP), *([best.views.mirrored(FLIP)] if best.is_bent else [])]:
        near, *rest = mirrors_kernel(way.sights, best.state, onto, turn, shift, reach, across)
        for b in _unlike(np.flatnonzero(near), onto, *rest) if near.any() else ():
            image = b % len(onto)
            state = state_of(way.sights, best.state.rotation, best.state.translation, best.state.match)
            start(best.state, state, onto[image], turn[image], shift[image])
            state.rotation[:], state.translation[:], state.nuisance[:], state.bent[:] = (part[b] for part in rest)
            if not fit_kernel(way.sights, state) or settle_kernel(way.sights, state, 0) != STEADY:
                continue
            solution = Solution(way, state)
            if found is None or solution.evidence > found.evidence:
                found = solution
    return found


def _unlike(
    images: NDArray[np.int64], onto: Ints, rotations: Array, translations: Array, nuisances: Array, bent: Array
) -> list[int]:  # fmt: skip
    """The mirror images that do not come to rest with the labels, in the place, with the cameras and as bent as one
    before.
    """  # fmt: skip
    kept: list[int] = []
    for b in images.tolist():
        if not any(
            np.array_equal(onto[a % len(onto)], onto[b % len(onto)])
            and np.allclose(rotations[b], rotations[a], rtol=0.0, atol=AT_ONE)
            and np.allclose(translations[b], translations[a], rtol=AT_ONE, atol=0.0)
            and np.allclose(nuisances[b], nuisances[a], rtol=0.0, atol=ALIKE)
            and np.allclose(bent[b], bent[a], rtol=0.0, atol=ALIKE)
            for a in kept
        ):
            kept.append(b)
    return kept
