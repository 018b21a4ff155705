"""The verb `windmark convert`: a camera file into another program's format, and proof that it is the same camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windmark import io
from windmark.app import console
from windmark.geometry import Camera

_CHECKED = 41
"""Pixels along each side at which the written camera is compared."""


@dataclass(frozen=True)
class Wishes:
    """What is wanted of `windmark convert`; see its options."""

    from_format: str | None = None
    to_format: str | None = None
    size_px: tuple[int, int] | None = None
    unit: str | None = None
    pixel_mm: tuple[float, ...] = ()
    which: str | None = None
    no_pose: bool = False


def convert(source: Path, target: Path, wishes: Wishes, as_json: bool) -> None:
    """Read, write, read back and compare, say it."""
    if wishes.from_format is not None and wishes.from_format not in io.CAMERA_FORMATS:
        raise ValueError(f"--from must be one of {', '.join(io.CAMERA_FORMATS)}, got {wishes.from_format!r}")
    if len(wishes.pixel_mm) > 2:
        raise ValueError(f"--pixel-mm must be given once, or for x and y, got {len(wishes.pixel_mm)} values")
    content = io.read_camera_file(source, size_px=wishes.size_px, which=wishes.which)
    if wishes.from_format not in (None, content.format):
        raise io.FileError(source, f"this is {content.format}; expected {wishes.from_format}, as --from says")
    camera, pose = content.camera, None if wishes.no_pose else content.cam_from_model
    if wishes.size_px not in (None, camera.size_px):
        raise io.FileError(source, f"a camera of {camera.size_px} px; expected {wishes.size_px}, as --size says")
    unit = _unit(source, content, wishes.unit) if pose is not None else None
    pixel_mm = (wishes.pixel_mm[0], wishes.pixel_mm[-1]) if wishes.pixel_mm else None
    kind = io.written_camera_format(target, wishes.to_format)
    pose_cov = None if pose is None else content.pose_cov
    io.write_camera(target, camera, pose, unit=unit, format=wishes.to_format, pixel_mm=pixel_mm, pose_cov=pose_cov)
    again = io.read_camera_file(target)
    off = largest_difference_px(camera, again.camera)
    notes = [note for note in (content.note, *_lost(content, kind, wishes.no_pose)) if note]
    record = {
        "input": source, "from": content.format, "output": target, "to": kind, "size_px": camera.size_px,
        "focal_px": camera.focal_px, "pose": pose is not None, "notes": notes,
        "read_back_largest_px": off,
    }  # fmt: skip
    lines = [
        f"{source} ({content.format}): {camera.size_px[0]} x {camera.size_px[1]} px, focal length"
        f" {camera.focal_px:.3f} px, {'with' if pose is not None else 'no'} pose",
        *notes,
        f"written: {target} ({kind}); read back, it shows the same rays within {off:.2g} px",
    ]
    console.answer(record, as_json, lines)


def parse_size(text: str | None) -> tuple[int, int] | None:
    """``WIDTHxHEIGHT`` in pixels."""
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise ValueError(f"--size must be WIDTHxHEIGHT in pixels, as in 1280x800, got {text!r}")
    return int(width), int(height)


def largest_difference_px(camera: Camera, other: Camera) -> float:
    """How far apart two cameras show the rays of the first one's pixels, at the worst place of the image."""
    width, height = camera.size_px
    columns, rows = np.meshgrid(np.linspace(0, width - 1, _CHECKED), np.linspace(0, height - 1, _CHECKED))
    rays = camera.unproject(np.stack([columns, rows], axis=-1).reshape(-1, 2))
    distance = np.linalg.norm(other.project(rays)[0] - camera.project(rays)[0], axis=1)
    return float(np.nanmax(distance, initial=0.0))


def _unit(source: Path, content: io.CameraFile, unit: str | None) -> str:
    if content.length_unit is not None and unit not in (None, content.length_unit):
        raise io.FileError(source, f"the length unit is {content.length_unit}; expected {unit}, as --unit says")
    found = content.length_unit or unit
    if found is None:
        raise ValueError(f"{source}: the file does not say the pose's length unit: give --unit, or --no-pose")
    return found


def _lost(content: io.CameraFile, kind: str, no_pose: bool) -> list[str]:
    lost = []
    if content.camera.cov is not None and kind != "windmark":
        lost.append(f"left out: the covariance, which {kind} cannot hold")
    if content.pose_cov is not None and kind != "windmark" and not no_pose:
        lost.append(f"left out: the pose's covariance, which {kind} cannot hold")
    if no_pose and content.cam_from_model is not None:
        lost.append("left out: the pose, as asked for")
    return lost
