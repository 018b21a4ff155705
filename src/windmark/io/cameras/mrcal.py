"""mrcal's ``.cameramodel``: a Python dictionary as text, with comments.

``lensmodel`` names the lens; ``intrinsics`` are fx, fy, cx, cy and OpenCV's distortion coefficients;
``imagersize`` is [width, height]. (0, 0) is the centre of the top-left pixel, as here. ``extrinsics``
(newer files: ``rt_cam_ref``) are a rotation vector and a translation that take points of the reference
frame into the camera's frame: cam_from_model. All zeros is what mrcal writes for a camera that is its own
reference, so it is read as no pose. The format knows no length unit; windmark's own files have it in a comment.

Source: mrcal's documentation, "Camera model representation", "Lens models".
"""

from __future__ import annotations

import ast
import re
from typing import Any

from windmark.geometry import Camera, Pose
from windmark.io.atomic import atomic_write
from windmark.io.cameras import record
from windmark.io.errors import FileError
from windmark.io.text import Pathlike

_COEFFICIENTS = {"PINHOLE": 0, "OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8, "OPENCV12": 12}
_PREFIX = "LENSMODEL_"
_MARK = re.compile(r"""^[ \t{]*['"]lensmodel['"]\s*:""", re.MULTILINE)


def is_mrcal(text: str) -> bool:
    """Whether the text has mrcal's key for the lens."""
    return _MARK.search(text) is not None


def parse_mrcal(path: Pathlike, text: str) -> record.CameraFile:
    """The camera, and the pose where the file has one, of the text of a file."""
    content = _dictionary(path, text)
    for key in ("intrinsics", "imagersize"):
        if key not in content:
            raise record.key_error(path, key, "missing; expected lensmodel, intrinsics, imagersize and extrinsics")
    model = content["lensmodel"]
    known = ", ".join(f"{_PREFIX}{name}" for name in _COEFFICIENTS)
    count = _COEFFICIENTS.get(str(model).removeprefix(_PREFIX))
    if count is None or not str(model).startswith(_PREFIX):
        raise record.key_error(path, "lensmodel", f"{model!r}; expected one of {known}")
    fx, fy, cx, cy, *lens = record.numbers(path, "intrinsics", content["intrinsics"], (4 + count,)).tolist()
    parameters = record.pinhole(path, "intrinsics", [[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    parameters |= record.lens(path, "intrinsics", lens)
    size_px = record.image_size(path, "imagersize", content["imagersize"])
    camera, pose = record.camera(path, size_px, parameters), _pose(path, content)
    return record.CameraFile(camera, pose, None if pose is None else record.unit_in_comment(text), "mrcal")


def write_mrcal(path: Pathlike, camera: Camera, pose: Pose | None, unit: str | None) -> None:
    """Write the smallest of mrcal's models that holds the camera; without a pose zeros, as mrcal does.

    Raises
    ------
    ValueError
        For sensor tilts and fisheye lenses, which mrcal's OPENCV models lack.
    """
    record.refuse_shear("mrcal's models", camera)
    record.refuse_tilt("mrcal's OPENCV models", camera)
    record.refuse_lens("mrcal's OPENCV models", camera, "rational")
    name = "OPENCV8" if camera.lens == "rational" else "OPENCV5" if camera.k3 else "OPENCV4"
    lens = record.coefficients(camera)
    name = name if any(lens) else "PINHOLE"
    values = [camera.focal_px, camera.focal_px * camera.aspect, camera.cx, camera.cy, *lens[: _COEFFICIENTS[name]]]
    extrinsics = [0.0] * 6 if pose is None else [*pose.rotvec.tolist(), *pose.translation.tolist()]
    lengths = f"; lengths in {unit}" if pose is not None else ""
    text = (
        "{\n"
        f"    'lensmodel': '{_PREFIX}{name}',\n\n"
        "    # fx, fy, cx, cy, distortion\n"
        f"    'intrinsics': {values!r},\n\n"
        f"    # rt_fromref: rotation vector and translation, camera from reference{lengths}\n"
        f"    'extrinsics': {extrinsics!r},\n\n"
        f"    'imagersize': {list(camera.size_px)!r},\n"
        "}\n"
    )
    with atomic_write(path) as stream:
        stream.write(text)


def _dictionary(path: Pathlike, text: str) -> dict[str, Any]:
    try:
        content = ast.literal_eval(text.strip())
    except SyntaxError as error:
        raise FileError(path, f"not an mrcal camera model: {error.msg}", error.lineno) from error
    except (ValueError, TypeError, MemoryError, RecursionError):
        what = "not an mrcal camera model: a value is no plain number, text or list (nan and inf are not allowed)"
        raise FileError(path, what) from None
    if not isinstance(content, dict) or "lensmodel" not in content:
        raise FileError(path, "not an mrcal camera model; expected a dictionary with the key 'lensmodel'")
    return content


def _pose(path: Pathlike, content: dict[str, Any]) -> Pose | None:
    key = next((k for k in ("rt_cam_ref", "extrinsics") if content.get(k) is not None), None)
    if key is None:
        return None
    values = record.numbers(path, key, content[key], (6,))
    return Pose.from_rotvec(values[:3], values[3:]) if values.any() else None
