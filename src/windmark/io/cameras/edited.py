"""Numbers that windmark's camera file holds twice: which of the two was edited by hand, and so is meant.

The file names a pose twice, as rotation and translation and as the paper's point of view, and so the focal length
and the field of view. It keeps a check value of each as it was written: what no longer fits its own was edited.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from windmark.geometry import Pose, PoV
from windmark.io.cameras import record
from windmark.io.text import Pathlike

PARTS = ("focal", "fov", "pose", "pov")
"""Keys of ``as_written``: focal length and width; field of view; rotation and translation; angles and distances."""
ANGLES_DISTANCES = ("rx_deg", "ry_deg", "rz_deg", "dx", "dy", "dz")
_AGREE = 1e-6
"""Angle (rad) and shift (as part of the distance) up to which two poses, and focal lengths, are the same."""


def check_value(numbers: Iterable[float]) -> str:
    """Twelve letters and digits that change when any bit of the numbers does, but not with how they are printed."""
    text = json.dumps([float(v) + 0.0 for v in numbers])  # + 0.0: no minus zero
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def as_written(width: int, focal_px: float, pose: Pose, pov: PoV) -> dict[str, str]:
    """The check values of a file."""
    return {
        "focal": check_value((width, focal_px)),
        "fov": check_value((pov.fov_deg,)),
        "pose": check_value((*pose.rotation.ravel(), *pose.translation)),
        "pov": check_value(getattr(pov, name) for name in ANGLES_DISTANCES),
    }


def read_as_written(path: Pathlike, content: Any) -> dict[str, str]:
    """The check values, none where the file has none."""
    if content is None:
        return {}
    if not isinstance(content, dict) or not all(k in PARTS and isinstance(v, str) for k, v in content.items()):
        what = f"unusable; expected texts named {', '.join(PARTS)}, as windmark wrote them, or no such key"
        raise record.key_error(path, "as_written", what)
    return content


def _edited(first: tuple[str, Iterable[float]], second: tuple[str, Iterable[float]], written: Mapping[str, str]
            ) -> str | None:  # fmt: skip
    """Which of two parts alone does not fit its check value any more; None for neither, both or no check values."""
    off = [key for key, values in (first, second) if key in written and written[key] != check_value(values)]
    known = first[0] in written and second[0] in written
    return off[0] if known and len(off) == 1 else None


def chosen_focal(
    path: Pathlike, focal_px: float | None, fov_deg: float | None, width: int, written: Mapping[str, str]
) -> tuple[float, str]:
    """The focal length in pixels that is meant, and what to say about it.

    Raises
    ------
    FileError
        When neither is given, when they disagree and not just one of them was edited, and for a field of view that
        is none.
    """
    key = "cam_from_model.pov.fov_deg"
    if fov_deg is None:
        if focal_px is None:
            raise record.key_error(path, "focal_px", "missing; expected it in every camera, or fov_deg in its pov")
        return focal_px, ""
    if not 0 < fov_deg < 180:
        raise record.key_error(path, key, f"{fov_deg:g}; expected an angle between 0 and 180 degrees")
    by_fov = width / (2 * math.tan(math.radians(fov_deg) / 2))
    if focal_px is None:
        return by_fov, ""
    if abs(by_fov - focal_px) <= _AGREE * abs(focal_px):
        return focal_px, ""
    which = _edited(("focal", (width, focal_px)), ("fov", (fov_deg,)), written)
    if which == "fov":
        return by_fov, f"fov_deg was edited: it is taken ({fov_deg:g} deg), not focal_px ({focal_px:g} px)"
    if which == "focal":
        return focal_px, f"focal_px or size_px was edited: focal_px is taken ({focal_px:g} px), not fov_deg"
    what = (
        f"{fov_deg:.10g}, which is a focal length of {by_fov:.10g} px, but focal_px is {focal_px:.10g}; expected"
        " the same, or only one of the two"
    )
    raise record.key_error(path, key, what)


def chosen_pose(path: Pathlike, matrix: Pose | None, pov: PoV | None, written: Mapping[str, str]) -> tuple[Pose, str]:
    """The pose that is meant, and what to say about it. ``matrix`` is that of rotation and translation.

    Raises
    ------
    FileError
        When neither is given, or when they disagree and not just one of them was edited.
    """
    if matrix is None and pov is None:
        what = "incomplete; expected rotation and translation, or pov"
        raise record.key_error(path, "cam_from_model", what)
    if matrix is None or pov is None:
        return (Pose.from_pov(pov), "") if pov is not None else (matrix, "")  # type: ignore[return-value]
    typed = Pose.from_pov(pov)
    named = [getattr(pov, name) for name in ANGLES_DISTANCES]
    which = _edited(("pose", (*matrix.rotation.ravel(), *matrix.translation)), ("pov", named), written)
    if which == "pov":
        return typed, "the numbers of pov were edited: they are taken, not rotation and translation"
    if which == "pose":
        return matrix, "rotation or translation was edited: they are taken, not the numbers of pov"
    if not _same(matrix, typed):
        what = (
            f"another pose ({_words(pov)}) than rotation and translation ({_words(matrix.to_pov())}); expected the"
            " same one, or only one of the two"
        )
        raise record.key_error(path, "cam_from_model.pov", what)
    return matrix, ""


def _same(a: Pose, b: Pose) -> bool:
    size = max(1.0, math.hypot(*a.translation))
    apart = math.hypot(*(a.translation - b.translation)) / size
    return bool(np.allclose(a.rotation, b.rotation, rtol=0, atol=_AGREE) and apart < _AGREE)


def _words(pov: PoV) -> str:
    return ", ".join(f"{name} {getattr(pov, name):.7g}" for name in ANGLES_DISTANCES)
