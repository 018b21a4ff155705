"""The verdict on pictures whose lens was undone: a lens that is none, or no lens for all of them; pictures left out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import corrected_camera
from windmark.errors import g2
from windmark.geometry import Camera
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict

_SIDE = 101
"""Places along each side of the picture at which the lens is tried."""
SAID = 0.01
"""Part of the picture beyond the corrected one that is told."""


def undistort_verdict(camera: Camera, target: Camera, count: int, unread: Mapping[str, str]) -> Verdict:
    """Judge corrected pictures.

    Parameters
    ----------
    camera, target : whose lens was undone, and that of the corrected pictures
    count : pictures that were corrected
    unread : those that were not, and why
    """
    found = []
    for name, why in unread.items():
        cause, step = told_by(why) or ("file", "read the reason; export the picture again")
        found.append(Finding(BAD, cause, why, step, name))
    moved = lens_displacement(camera)
    found += _lens(camera, moved)
    # Towards 90 degrees a flat picture has no end: what a wide lens does is told where the picture is.
    moved = np.where(drawn(camera, target), moved, np.nan)
    pictures = "the picture has" if count == 1 else f"{count} pictures have"
    said = f"{pictures} no distortion any more, which was {g2(np.nanmax(moved))} px at most"
    if (left_out := float((~drawn(camera, target, cells=True)).mean())) > SAID:
        said += f"; {g2(100 * left_out)} % of what was taken lies beyond the corrected picture"
    return Verdict.of(
        found, count + len(unread), said, "use camera.json with them; valid.png says which pixels have a value",
        what="pictures",
    )  # fmt: skip


def _lens(camera: Camera, moved: np.ndarray) -> list[Finding]:
    plain = corrected_camera(camera)
    if camera.lens == plain.lens and np.array_equal(camera.parameters(), plain.parameters()):
        said = "this camera has no distortion: the pictures are what they were"
        return [Finding(DOUBTFUL, "camera", said, "give the calibrated camera, or find its lens: windmark calibrate")]
    # A fisheye's picture is a circle: its corners show nothing, and no lens is asked for there.
    beyond = 0.0 if camera.lens == "fisheye" else float(np.isnan(moved).mean())
    if beyond > 0:
        said = f"{g2(100 * beyond)} % of the picture lie where the lens has no inverse: what is there is lost"
        step = "calibrate with markers as far as the corners, or take another model of the lens (calibrate --lens)"
        return [Finding(DOUBTFUL, "camera", said, step)]
    return []


def lens_displacement(camera: Camera) -> np.ndarray:
    """How far the lens moves places all over the picture, in pixels; NaN where it has no inverse."""
    xy = _places(camera)
    ideal, _ = corrected_camera(camera).project(camera.unproject(xy))
    return np.asarray(np.linalg.norm(xy - ideal, axis=1))


def drawn(camera: Camera, target: Camera, *, cells: bool = False) -> NDArray[np.bool_]:
    """Whether the same places of the picture, or the middles of as many equal cells, are in that of the target."""
    ideal, _ = target.project(camera.unproject(_places(camera, cells)))
    return target.in_image(ideal)


def _places(camera: Camera, cells: bool = False) -> NDArray[np.float64]:
    part = (np.arange(_SIDE) + 0.5) / _SIDE if cells else np.linspace(0.0, 1.0, _SIDE)
    x, y = np.meshgrid(*(part * side - 0.5 for side in camera.size_px))
    return np.stack([x, y], axis=-1).reshape(-1, 2)
