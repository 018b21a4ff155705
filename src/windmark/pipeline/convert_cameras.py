"""A camera file into another program's format, and proof that it is the same camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.io.cameras.plausible import focal_doubt
from windmark.pipeline.convert_units import scale_to

Record = dict[str, Any]
_CHECKED = 41
"""Pixels along each side at which the written camera is compared."""


@dataclass(frozen=True)
class CameraOptions:
    """How a camera is converted; see the options of ``windmark convert``."""

    from_format: str | None = None
    to_format: str | None = None
    size_px: tuple[int, int] | None = None
    unit: str | None = None
    to_unit: str | None = None
    pixel_mm: tuple[float, ...] = ()
    which: str | None = None
    no_pose: bool = False


def convert_camera(source: Path, target: Path, options: CameraOptions) -> Record:
    """Read, write, read back and compare.

    Returns
    -------
    What was done, in figures; ``notes`` in words.

    Raises
    ------
    ValueError
        For options that are none, and for what the other format cannot hold.
    FileError
        For a file that cannot be read or written, or is not what the options say.
    """
    if options.from_format is not None and options.from_format not in io.CAMERA_FORMATS:
        raise UsageError(f"--from must be one of {', '.join(io.CAMERA_FORMATS)}, got {options.from_format!r}")
    if len(options.pixel_mm) > 2:
        raise UsageError(f"--pixel-mm must be given once, or for x and y, got {len(options.pixel_mm)} values")
    content = io.read_camera_file(source, size_px=options.size_px, which=options.which)
    if options.from_format not in (None, content.format):
        raise io.FileError(source, f"this is {content.format}; expected {options.from_format}, as --from says")
    camera, pose = content.camera, None if options.no_pose else content.cam_from_model
    if options.size_px not in (None, camera.size_px):
        raise io.FileError(source, f"a camera of {camera.size_px} px; expected {options.size_px}, as --size says")
    unit, factor, pose_cov = None, 1.0, None
    if pose is not None:
        factor, unit = scale_to(source, _unit(source, content, options.unit), options.to_unit)
        pose = replace(pose, translation=factor * pose.translation)
        if content.pose_cov is not None:
            scale = np.array([1.0] * 3 + [factor] * 3)
            pose_cov = content.pose_cov * np.outer(scale, scale)
    pixel_mm = (options.pixel_mm[0], options.pixel_mm[-1]) if options.pixel_mm else None
    kind = io.written_camera_format(target, options.to_format)
    io.write_camera(target, camera, pose, unit=unit, format=options.to_format, pixel_mm=pixel_mm, pose_cov=pose_cov)
    again = io.read_camera_file(target)
    return {
        "kind": "camera", "input": source, "from": content.format, "output": target, "to": kind,
        "size_px": camera.size_px, "focal_px": camera.focal_px, "pose": pose is not None, "length_unit": unit,
        "scale": factor, "notes": [n for n in (content.note, *_lost(content, kind, options.no_pose)) if n],
        "distance": None if pose is None else float(np.linalg.norm(pose.translation)),
        "doubtful": focal_doubt(camera),
        "read_back_largest_px": largest_difference_px(camera, again.camera),
    }  # fmt: skip


def largest_difference_px(camera: Camera, other: Camera) -> float:
    """How far apart two cameras show the rays of the first one's pixels, at the worst place of the image."""
    width, height = camera.size_px
    columns, rows = np.meshgrid(np.linspace(0, width - 1, _CHECKED), np.linspace(0, height - 1, _CHECKED))
    rays = camera.directions(np.stack([columns, rows], axis=-1).reshape(-1, 2))
    distance = np.linalg.norm(other.project(rays)[0] - camera.project(rays)[0], axis=1)
    return float(np.nanmax(distance, initial=0.0))


def _unit(source: Path, content: io.CameraFile, unit: str | None) -> str:
    if content.length_unit is not None and unit not in (None, content.length_unit):
        raise io.FileError(source, f"the length unit is {content.length_unit}; expected {unit}, as --unit says")
    found = content.length_unit or unit
    if found is None:
        raise UsageError(f"{source}: the file does not say the pose's length unit: give --unit, or --no-pose")
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
