"""Spots that no pose explains: would the table mirrored, with its normals turned round, or without its sigmas?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from windmark.geometry import Camera
from windmark.registration import NotRegistered, Registration, register
from windmark.registration.result import Cause
from windmark.scene import Detections, MarkerSet
from windmark.scene.units import SIGMAS_OFF

UNEXPLAINED = ("nothing", "weak", "misfit")
"""Refusals after which other tables are tried."""
LARGE = 0.003
"""Sigmas of markers of such a part of their extent are tried without: no table is so unsure, in the right unit."""


def unexplained(
    found: Detections, markers: MarkerSet, camera: Camera, no: NotRegistered, options: Mapping[str, Any]
) -> NotRegistered:
    """The refusal ``no``, or what is wrong with the table where a changed one is registered.

    Nothing less is asked of it than of the table itself, so chance is no answer. ``options`` are those of `register`
    without a prior. What hides a marker is unknown then; where the table without that does as well, it is the grid that
    is wrong, and of a symmetric model both do.
    """
    if no.cause not in UNEXPLAINED:
        return no
    bare = {**options, "visible": None}
    for cause, other, words in _others(markers):
        answer = register(found, other, camera, **bare)
        if isinstance(answer, Registration):
            if register(found, markers, camera, **bare):
                return no
            seen = f"the spots ({len(answer.matching)} of {answer.n_expected} markers in view)"
            return NotRegistered(words.format(seen), cause, options=answer.options)
    return no


def _others(markers: MarkerSet) -> list[tuple[Cause, MarkerSet, str]]:
    """Cause, changed table, and the sentence where it is registered and the table is not."""
    turned = np.array([-1.0, 1.0, 1.0])
    out: list[tuple[Cause, MarkerSet, str]] = [(
        "mirrored", replace(
            markers, xyz=markers.xyz * turned, normal=markers.normal * turned,
            curvature=markers.curvature * np.outer(turned, turned),
        ),
        "the mirror image of the table explains {}, the table does not: the picture or the table is mirrored",
    )]  # fmt: skip
    if np.isfinite(markers.normal).any():
        out.append((
            "discs", replace(markers, normal=-markers.normal, curvature=-markers.curvature),
            "with their normals turned round the markers explain {}, as they are they do not: the normals of the table "
            "point into the model",
        ))  # fmt: skip
    known = markers.sigma[np.isfinite(markers.sigma)]
    extent = float(np.linalg.norm(np.ptp(markers.xyz, axis=0)))
    if len(known) and (typical := float(np.median(known))) > LARGE * extent:
        part = f"{100 * typical / extent:.1g} % of their extent"
        out.append((
            "misfit", replace(markers, sigma=np.full_like(markers.sigma, np.nan)),
            f"without their sigmas the markers explain {{}}: {SIGMAS_OFF} (typically {part})",
        ))  # fmt: skip
    return out
