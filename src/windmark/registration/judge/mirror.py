"""The mirror image of the table as an explanation: a picture or a table that is mirrored.

A symmetric model looks like its mirror image with left and right exchanged, a nearly flat one like the one with its
relief turned over. Where the mirrored table explains the spots better, picture or table are mirrored; where it explains
them as well, the picture cannot tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.registration.settle._kernels.fit import MIN_MATCHES
from windmark.registration.settle._kernels.settle import STEADY, settle_kernel
from windmark.registration.settle._kernels.state import state_of
from windmark.registration.settle.solution import Solution
from windmark.registration.settle.views import Views

Array = NDArray[np.float64]

FAR = 10.0
"""A mirrored marker this many times the misfit away from its spot (in the middle) is no rival. Some of the way is
depth, which the pose takes."""
FLIP = np.diag([-1.0, 1.0, 1.0])


def mirrored_views(views: Views) -> Views:
    """The same spots with the mirrored table; normals unknown, what faces away is hidden instead."""
    sights = views.sights
    other = replace(views, modes=views.modes @ FLIP)
    other.__dict__["leads"], other.__dict__["densities"] = views.leads, views.densities
    other.__dict__["sights"] = sights._replace(
        xyz=np.ascontiguousarray(sights.xyz @ FLIP), normal=np.zeros_like(sights.normal),
        modes=np.ascontiguousarray(other.modes),
    )  # fmt: skip
    return other


def mirror_of(views: Views, best: Solution, most: int) -> Solution | None:
    """The best solution with the mirrored table that the layout's improper near-symmetries make of one.

    The mirrored model may be as bent as the solution, and is tried rigid, too, as in ``views``: with a table that is
    mirrored a deformation explains what is none. ``most`` motions are tried, those that bring most markers onto others
    first. None without any.
    """
    onto, turn, shift = views.layout.mirrors
    near = [k for k in range(min(most, len(onto))) if _could_be(best, onto[k], turn[k], shift[k])]
    ways = [mirrored_views(views), *([mirrored_views(best.views)] if best.is_bent else [])] if near else []
    found: Solution | None = None
    for image, a, s in ((onto[k], turn[k], shift[k]) for k in near):
        moved = np.flatnonzero(image >= 0)
        match, hidden = np.full_like(best.state.match, -1), np.ones_like(best.state.hidden)
        match[:, image[moved]] = best.state.match[:, moved]
        hidden[:, image[moved]] = ~(best.state.faces | (best.state.match >= 0))[:, moved]
        # F x_o is about F (A x_m + s) and must be seen where x_m was.
        rotation = best.state.rotation @ (FLIP @ a).T
        for way in ways:
            state = state_of(way.sights, rotation, best.state.translation - rotation @ (FLIP @ s), match)
            state.hidden[:] = hidden
            if settle_kernel(way.sights, state, 0) != STEADY:
                continue
            solution = Solution(way, state)
            if found is None or solution.evidence > found.evidence:
                found = solution
    return found


def _could_be(best: Solution, onto: NDArray[np.int32], turn: Array, shift: Array) -> bool:
    """Whether the mirrored table could explain the spots as well, by how far its markers are seen from their spots.

    Where a picture is mirrored, that is what the best solution without a mirror leaves as its misfit: it takes the
    markers for others that are about where they are. So a near-symmetry that is much coarser than the misfit is none.
    """
    pairs = (best.state.match >= 0) & (onto >= 0)
    if pairs.sum() < MIN_MATCHES:
        return False
    marker = np.flatnonzero(pairs.any(axis=0))
    xyz = best.views.sights.xyz
    off = (xyz[onto[marker]] - shift) @ turn - xyz[marker]  # in the model, A^-1 = A'
    for c in np.flatnonzero(pairs.any(axis=1)):
        place = xyz[marker] @ best.state.rotations[c].T + best.state.translations[c]
        moved = off @ best.state.rotations[c].T
        across = moved[:, :2] - place[:, :2] * moved[:, 2:] / place[:, 2:]
        away = best.state.camera[c, 0] * np.median(np.linalg.norm(across, axis=1) / place[:, 2])
        noise = max(float(best.misfit_px[c]), best.views.planes[c].task.typical_sigma_px)
        if away > FAR * noise:
            return False
    return True
