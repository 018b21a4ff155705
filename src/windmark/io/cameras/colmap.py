"""COLMAP's text models: ``cameras.txt`` (interior parameters) and ``images.txt`` (poses).

COLMAP counts pixels from the *corner* of the top-left one, whose centre is (0.5, 0.5): its cx, cy are
windmark's + 0.5. Distortion has OpenCV's meaning and order. A pose is world to camera: a quaternion
w, x, y, z (Hamilton) and a translation, camera axes x right, y down, z forward: cam_from_model. The format
knows no length unit (windmark's own have it in a comment).
Each image takes two lines in images.txt, the second one (its points) may be empty.

Source: COLMAP's documentation, "Output Format" and "Camera Models".
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import quaternion
from windmark.io.added import atomic_folder
from windmark.io.cameras import record
from windmark.io.errors import LARGEST, FileError
from windmark.io.text import Pathlike, read_text

CAMERAS, IMAGES, POINTS = "cameras.txt", "images.txt", "points3D.txt"
_PARAMETERS = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""Names and order of COLMAP's parameters, from the smallest model on."""

_FISHEYE = "FISHEYE"  # in the names of models whose coefficients belong to the angle, as `cv2.fisheye` has it
_LENS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_ID = re.compile(r"[0-9]{1,18}")
_CAMERA_LINE = re.compile(r"\d+\s+[A-Z][A-Z_]+\s+\d+\s+\d+\s")


@dataclass(frozen=True)
class ColmapModel:
    """The cameras and poses of a COLMAP model.

    Parameters
    ----------
    cameras : camera number -> camera
    images : image name -> (camera number, cam_from_model)
    length_unit : of the poses, None where no comment of windmark's says it
    """

    cameras: Mapping[int, Camera]
    images: Mapping[str, tuple[int, Pose]]
    length_unit: str | None = None


def is_colmap(text: str) -> bool:
    """Whether the first line that is no comment looks like a line of cameras.txt."""
    lines = (line.strip() for line in text.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    return _CAMERA_LINE.match(first) is not None


def read_colmap(path: Pathlike) -> ColmapModel:
    """Read a text model: its folder, or its cameras.txt; images.txt is read where it lies beside.

    Raises
    ------
    FileError
        Names the line: an unknown lens model, a wrong number of parameters, an
        image of a camera that is not there.
    """
    place = Path(path)
    place = place / CAMERAS if place.is_dir() else place
    cameras: dict[int, Camera] = {}
    for number, words in _lines(read_text(place)):
        key, camera = _camera(place, number, words)
        if key in cameras:
            raise FileError(place, f"camera {key} is there twice", number)
        cameras[key] = camera
    if not cameras:
        raise FileError(place, "no camera; expected lines CAMERA_ID MODEL WIDTH HEIGHT PARAMS")
    beside = place.with_name(IMAGES)
    named = place.name == CAMERAS and beside.is_file()
    if not named:
        return ColmapModel(cameras, {})
    return ColmapModel(cameras, _images(beside, cameras), record.unit_in_comment(read_text(beside)))


def write_colmap(
    folder: Pathlike,
    cameras: Mapping[int, Camera],
    images: Mapping[str, tuple[int, Pose]] | None = None,
    *,
    unit: str | None = None,
) -> None:
    """Write cameras.txt, images.txt and an empty points3D.txt (COLMAP wants all three), together or not at all.

    Each camera gets the smallest of COLMAP's models that holds it.

    Raises
    ------
    ValueError
        For sensor tilts, an image of a camera that is not there, or a name with white space.
    FileError
        When the folder cannot be written.
    """
    rows = [_camera_line(number, camera) for number, camera in cameras.items()]
    views = []
    for index, (name, (number, pose)) in enumerate((images or {}).items(), start=1):
        if number not in cameras:
            raise UsageError(f"write_colmap: image {name!r} is of camera {number}; expected one of {list(cameras)}")
        if not name or name.split() != [name]:
            raise UsageError(f"write_colmap: an image's name must be one word, got {name!r}")
        values = [*quaternion(pose.rotation).tolist(), *pose.translation.tolist()]
        views.append(f"{index} {' '.join(map(repr, values))} {number} {name}\n\n")
    lengths = f", lengths in {unit}" if unit else ""
    with atomic_folder(folder) as place:
        head = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS (pixels from the corner of the top-left one)\n"
        (place / CAMERAS).write_text(head + "".join(rows), encoding="utf-8")
        head = f"# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME (world to camera{lengths}), then a line of points\n"
        (place / IMAGES).write_text(head + "".join(views), encoding="utf-8")
        (place / POINTS).write_text("# POINT3D_ID X Y Z R G B ERROR TRACK\n", encoding="utf-8")


def choose(path: Pathlike, model: ColmapModel, which: str | None) -> record.CameraFile:
    """One camera of a model: that of an image, with its pose, or one by its number; the only one if there is one.

    Raises
    ------
    FileError
        When there are several and none is chosen, or the choice is not there.
    """
    cameras = ", ".join(map(str, model.cameras))
    if which is None and len(model.images) == 1:
        which = next(iter(model.images))
    if which is not None and which in model.images:
        number, pose = model.images[which]
        return record.CameraFile(model.cameras[number], pose, model.length_unit, "colmap")
    if which is not None and (not _ID.fullmatch(which) or int(which) not in model.cameras):
        images = f" or {len(model.images)} images ({', '.join(list(model.images)[:3])} ...)" if model.images else ""
        raise FileError(path, f"no image or camera {which!r}; expected one of the cameras {cameras}{images}")
    if which is None and len(model.cameras) > 1:
        raise FileError(path, f"several cameras ({cameras}); choose one of them, or an image, by name (which)")
    camera = model.cameras[next(iter(model.cameras)) if which is None else int(which)]
    note = f"{len(model.images)} poses in {IMAGES} not taken: name an image to take its own" if model.images else ""
    return record.CameraFile(camera, None, None, "colmap", note)


def _lines(text: str) -> list[tuple[int, list[str]]]:
    numbered = ((number, line.split()) for number, line in enumerate(text.splitlines(), start=1))
    return [(number, words) for number, words in numbered if words and not words[0].startswith("#")]


def _camera(path: Path, line: int, words: list[str]) -> tuple[int, Camera]:
    if len(words) < 5 or not all(_ID.fullmatch(word) for word in (words[0], *words[2:4])):
        raise FileError(path, "not a camera; expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS", line)
    model, size_px = words[1], (int(words[2]), int(words[3]))
    names = _PARAMETERS.get(model)
    if names is None:
        raise FileError(path, f"the lens model is {model}; expected one of {', '.join(_PARAMETERS)}", line)
    values = _numbers(path, line, words[4:])
    if len(values) != len(names):
        raise FileError(path, f"{len(values)} parameters of {model}; expected {' '.join(names)}", line)
    given = dict(zip(names, values, strict=True))
    where = f"line {line}, {model}"
    fx, fy = (given.get(key, given.get("f", 0.0)) for key in ("fx", "fy"))
    matrix = [[fx, 0, given["cx"] - 0.5], [0, fy, given["cy"] - 0.5], [0, 0, 1]]
    fisheye = _FISHEYE in model
    lens = [given.get(key, 0.0) for key in (("k1", "k2", "k3", "k4") if fisheye else _LENS)]
    parameters = record.pinhole(path, where, matrix) | record.lens(path, where, lens, fisheye=fisheye)
    return int(words[0]), record.camera(path, size_px, parameters)


def _images(path: Path, cameras: Mapping[int, Camera]) -> dict[str, tuple[int, Pose]]:
    # A line of points follows each image, empty or not; comments and what is before the first image may be left out.
    lines = [(k, line) for k, line in enumerate(read_text(path).splitlines(), 1) if not line.lstrip().startswith("#")]
    images: dict[str, tuple[int, Pose]] = {}
    position = 0
    while position < len(lines):
        number, line = lines[position]
        words = line.split(maxsplit=9)
        if not words:
            position += 1
            continue
        if len(words) < 10 or not (_ID.fullmatch(words[0]) and _ID.fullmatch(words[8])):
            raise FileError(path, "not an image; expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", number)
        if int(words[8]) not in cameras:
            raise FileError(path, f"camera {words[8]} is not in {CAMERAS}", number)
        values = _numbers(path, number, words[1:8])
        if position + 1 < len(lines):
            _check_points(path, *lines[position + 1])
        images[words[9].strip()] = (int(words[8]), _pose(path, number, values))
        position += 2
    return images


def _check_points(path: Path, number: int, line: str) -> None:
    """An image that takes one line only would swallow the next image."""
    words = line.split()
    if len(words) % 3:
        raise FileError(path, "expected the line of the image's points X Y POINT3D_ID ..., perhaps empty", number)


def _pose(path: Path, line: int, values: list[float]) -> Pose:
    q = np.array(values[:4])
    size = math.hypot(*values[:4])  # no overflow, whatever the file says
    if abs(size - 1) > 1e-3:
        raise FileError(path, f"the quaternion has length {size:.4g}; expected 1", line)
    w, v = q[0] / size, q[1:] / size
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    rotation = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    return Pose(rotation, np.array(values[4:]))


def _numbers(path: Path, line: int, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [float("nan")]
    if not (np.abs(values) <= LARGEST).all():
        raise FileError(path, f"not finite numbers of at most {LARGEST:g}: {' '.join(words)[:60]}", line)
    return values


def _camera_line(number: int, camera: Camera) -> str:
    record.refuse_shear("COLMAP", camera)
    record.refuse_tilt("COLMAP", camera)
    fx, fy = camera.focal_px, camera.focal_px * camera.aspect
    values = {"f": fx, "fx": fx, "fy": fy, "cx": camera.cx + 0.5, "cy": camera.cy + 0.5}
    values |= {key: getattr(camera, key) for key in _LENS}
    needed = {key for key in _LENS if values[key]} | ({"fx"} if camera.aspect != 1 else set())
    fitting = [name for name in _PARAMETERS if (_FISHEYE in name) == (camera.lens == "fisheye")]
    model = next(name for name in fitting if needed <= set(_PARAMETERS[name]))
    width, height = camera.size_px
    return f"{number} {model} {width} {height} {' '.join(repr(values[key]) for key in _PARAMETERS[model])}\n"
