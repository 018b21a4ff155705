"""What no camera is: a focal length or a principal point whose unit is hardly the pixel, said when the file is read.

Nothing is refused: a part that was cut out of a picture has its principal point outside, and lenses of any angle may
come. A number in millimetres, in parts of the width or of another size of the picture is read like one in pixels.
"""

from __future__ import annotations

import math
from dataclasses import replace

from windmark.errors import g3
from windmark.geometry import Camera
from windmark.io.cameras.record import CameraFile

WIDEST_DEG = 160.0
"""Angle of view across the diagonal that no lens has that is not a fisheye; the widest sold have 140."""
NARROWEST_DEG = 0.05
"""A telescope's; the longest camera lenses have a whole degree."""
MIDDLE = 0.05
"""Part of the shorter side within which the principal points of whole pictures are from their middle."""


def with_doubts(content: CameraFile) -> CameraFile:
    """A camera file as it was read, with what is doubtful of its numbers in its note."""
    said = "; ".join([content.note, *doubts_of(content.camera)] if content.note else doubts_of(content.camera))
    return replace(content, note=said) if said != content.note else content


def doubts_of(camera: Camera) -> list[str]:
    """Sentences on the focal length and the principal point of a camera; empty where both may be."""
    return [said for said in (focal_doubt(camera), principal_doubt(camera)) if said]


def focal_doubt(camera: Camera) -> str:
    """Why the focal length is hardly one in pixels; empty where it may be."""
    width, height = camera.size_px
    diagonal = math.hypot(width, height) / camera.focal_px
    if camera.lens == "fisheye":
        angle, widest = math.degrees(diagonal), 360.0
    else:
        angle, widest = math.degrees(2 * math.atan(diagonal / 2)), WIDEST_DEG
    if NARROWEST_DEG <= angle <= widest:
        return ""
    return (
        f"a focal length of {g3(camera.focal_px)} px sees {g3(angle)} degrees across a picture of {width} x {height} "
        "px, as no lens does: is it in pixels (not in mm, nor in parts of the width), and of this size of the picture?"
    )


def principal_doubt(camera: Camera) -> str:
    """That the principal point is outside of the picture, or in the middle of it with width and height exchanged;
    empty where it may be.
    """
    width, height = camera.size_px
    off = max(abs(camera.cx - height / 2), abs(camera.cy - width / 2))
    if off < MIDDLE * min(width, height) and abs(width - height) > 4 * MIDDLE * min(width, height):
        return (
            f"the principal point, {g3(camera.cx)}, {g3(camera.cy)} px, is in the middle of a picture of {height} x "
            f"{width} px, not of {width} x {height}: width and height of the size are exchanged, it seems"
        )
    if -0.5 <= camera.cx <= width - 0.5 and -0.5 <= camera.cy <= height - 0.5:
        return ""
    return (
        f"the principal point, {g3(camera.cx)}, {g3(camera.cy)} px, is outside of the picture of {width} x {height} "
        "px: right for a part that was cut out of a picture; else it is of another size of the picture, or not in "
        "pixels"
    )
