"""Spots that no pose explains: would the mirror image of the table?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from windmark.geometry import Camera
from windmark.registration import NotRegistered, Registration, register
from windmark.scene import Detections, MarkerSet

UNEXPLAINED = ("nothing", "weak", "misfit")
"""Refusals after which the mirror image of the table is tried."""


def mirrored(
    found: Detections, markers: MarkerSet, camera: Camera, no: NotRegistered, options: Mapping[str, Any]
) -> NotRegistered:
    """The refusal ``no``, or that picture or table are mirrored where the mirror image of the table is registered.

    Nothing less is asked of it than of the table itself, so chance is no answer. ``options`` are those of `register`
    without a prior. What hides a marker is unknown then; where the table without that does as well, it is the grid that
    is wrong, and of a symmetric model both do.
    """
    if no.cause not in UNEXPLAINED:
        return no
    turned = np.array([-1.0, 1.0, 1.0])
    mirror = replace(markers, xyz=markers.xyz * turned, normal=markers.normal * turned)
    bare = {**options, "visible": None}
    answer = register(found, mirror, camera, **bare)
    if not isinstance(answer, Registration) or register(found, markers, camera, **bare):
        return no
    reason = (
        f"the mirror image of the table explains the spots ({len(answer.matching)} of {answer.n_expected} markers in "
        "view), the table does not: the picture or the table is mirrored"
    )
    return NotRegistered(reason, "mirrored", options=answer.options)
