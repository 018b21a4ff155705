"""Cameras as OpenCV and ROS write them: YAML, XML, JSON.

OpenCV's pixel origin is windmark's: the centre of the top-left pixel. Of its distortion coefficients (4, 5, 8, 12
or 14) windmark's camera holds k1 k2 p1 p2 k3, the rational k4 k5 k6, and tau_x, tau_y; thin-prism ones must be zero.
A fisheye lens (`cv2.fisheye`, k1 to k4) is one whose file says so: ``distortion_model: equidistant`` (ROS) or a true
``fisheye_model``; its four numbers alone look like k1 k2 p1 p2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.io.atomic import atomic_write
from windmark.io.cameras import record
from windmark.io.errors import FileError
from windmark.io.text import Pathlike, to_json

MATRIX_KEYS = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "mtx", "intrinsic_matrix")
LENS_KEYS = (
    "distortion_coefficients", "dist_coeffs", "distCoeffs", "Distortion_Coefficients", "D", "dist", "distortion",
    "dist_k1_k2_p1_p2",
)  # fmt: skip
SIZE_KEYS = ("image_size_wh", "image_size", "imageSize", "size_px")
ROTATION_KEYS = ("rvec", "R", "rotation_vector", "rotation_matrix", "rmat")
TRANSLATION_KEYS = ("tvec", "T", "t", "translation_vector")
_PLAIN_LENSES = ("", "plumb_bob", "rational_polynomial", "brown", "opencv", "radtan", "none")
_FISHEYES = ("equidistant", "fisheye", "kannala_brandt", "kannalabrandt", "kannala_brandt4", "opencv_fisheye")
_KINDS = ("camera_type", "calibration_type", "lens_model", "model", "type")
"""Keys that other programs write beside OpenCV's; they say anything, of a lens too."""
_FISHEYE_WORDS = ("fisheye", "fish_eye", "equidistant", "kannala")


def has_camera_matrix(content: dict[str, Any]) -> bool:
    """Whether a parsed file has a camera matrix under one of OpenCV's usual names."""
    return any(content.get(key) is not None for key in MATRIX_KEYS)


def parse_opencv(path: Pathlike, content: dict[str, Any], size_px: tuple[int, int] | None) -> record.CameraFile:
    """The camera, and the pose where the file has one, of a parsed file.

    ``size_px`` is used where the file does not say. Keys that are not needed (reprojection errors,
    image points, flags) are not read.
    """
    fisheye = _is_fisheye(path, content)
    matrix_key, lens_key = _first(path, content, MATRIX_KEYS), _first(path, content, LENS_KEYS)
    if matrix_key is None:
        raise FileError(path, f"no camera matrix; expected one of the keys {', '.join(MATRIX_KEYS)}")
    if lens_key is None:
        what = f"no distortion coefficients; expected one of the keys {', '.join(LENS_KEYS)} (zeros for none)"
        raise FileError(path, what)
    parameters = record.pinhole(path, matrix_key, _plain(path, matrix_key, content[matrix_key]))
    parameters |= record.lens(path, lens_key, _plain(path, lens_key, content[lens_key]), fisheye=fisheye)
    camera = record.camera(path, _size(path, content) or size_px or _no_size(path), parameters)
    unit = content.get("length_unit")
    if unit is not None and unit not in record.LENGTH_UNITS:
        raise record.key_error(path, "length_unit", f"{unit!r}; expected one of {', '.join(record.LENGTH_UNITS)}")
    return record.CameraFile(camera, _pose(path, content), unit, "opencv")


def write_opencv(path: Pathlike, camera: Camera, pose: Pose | None, unit: str | None) -> None:
    """Write what OpenCV's FileStorage reads: JSON where the name ends in .json, else YAML; no covariance."""
    d = record.coefficients(camera)
    record.refuse_shear("OpenCV", camera)
    if camera.lens == "fisheye":
        record.refuse_tilt("OpenCV's fisheye model", camera)
    elif camera.tilt_x or camera.tilt_y:
        d += [0.0] * (12 - len(d)) + [camera.tilt_x, camera.tilt_y]
    matrices = {"camera_matrix": camera.matrix, "distortion_coefficients": np.array([d])}
    if pose is not None:
        matrices |= {"rvec": pose.rotvec.reshape(3, 1), "tvec": pose.translation.reshape(3, 1)}
    model = "equidistant" if camera.lens == "fisheye" else None
    text = (_json if Path(path).suffix.lower() == ".json" else _yaml)(camera.size_px, matrices, model, unit)
    with atomic_write(path) as stream:
        stream.write(text)


def _yaml(
    size_px: tuple[int, int], matrices: dict[str, NDArray[np.float64]], model: str | None, unit: str | None
) -> str:
    parts = [f"%YAML:1.0\n---\nimage_width: {size_px[0]}\nimage_height: {size_px[1]}\n"]
    for key, values in matrices.items():
        rows, cols = values.shape
        data = ", ".join(map(repr, values.ravel().tolist()))
        parts.append(f"{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n")
    parts += [f'distortion_model: "{model}"\n'] if model else []
    return "".join(parts) + (f'length_unit: "{unit}"\n' if unit else "")


def _json(
    size_px: tuple[int, int], matrices: dict[str, NDArray[np.float64]], model: str | None, unit: str | None
) -> str:
    content: dict[str, Any] = {"image_width": size_px[0], "image_height": size_px[1]}
    content |= {"distortion_model": model} if model else {}
    for key, values in matrices.items():
        rows, cols = values.shape
        shape = {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d"}
        content[key] = {**shape, "data": values.ravel().tolist()}
    return to_json(content | ({"length_unit": unit} if unit else {})) + "\n"


def _first(path: Pathlike, content: dict[str, Any], keys: tuple[str, ...]) -> str | None:
    """The key that a thing has in this file; where it stands under several they must say the same."""
    there = [key for key in keys if content.get(key) is not None]
    for other in there[1:]:
        # A rotation may be there as a vector and as a matrix.
        one, two = (np.ravel(np.array(_plain(path, key, content[key]), dtype=object)) for key in (there[0], other))
        if len(one) == len(two) and (one != two).any():
            raise record.key_error(path, other, f"another value than {there[0]} has; expected one of them, or the same")
    return there[0] if there else None


def _plain(path: Pathlike, key: str, value: Any) -> Any:
    """The numbers of an OpenCV matrix (rows, cols or sizes, and data) as lists; other values as they are."""
    if not isinstance(value, dict):
        return value
    shape = value.get("sizes", [value.get("rows"), value.get("cols")])
    data = value.get("data")
    if not isinstance(data, list) or not isinstance(shape, list) or not all(type(n) is int and n >= 0 for n in shape):
        raise record.key_error(path, key, "not a matrix; expected rows, cols and data")
    if len(data) != np.prod(shape):
        raise record.key_error(path, key, f"{len(data)} numbers in data; expected {' x '.join(map(str, shape))}")
    return np.array(data, dtype=object).reshape(shape).tolist()


def _size(path: Pathlike, content: dict[str, Any]) -> tuple[int, int] | None:
    key = _first(path, content, SIZE_KEYS)
    size = None if key is None else record.image_size(path, key, content[key])
    if "image_width" not in content or "image_height" not in content:
        return size
    own = record.image_size(path, "image_width", [content["image_width"], content["image_height"]])
    if key is not None and size != own:
        turned = ": height before width; expected (width, height), as they have it" if size == own[::-1] else ""
        what = f"{size} beside image_width and image_height of {own}{turned or '; expected the same'}"
        raise record.key_error(path, key, what)
    return own


def _no_size(path: Pathlike) -> tuple[int, int]:
    what = "no image size; expected the keys image_width and image_height, or the size from the caller (size_px)"
    raise FileError(path, what)


def _pose(path: Pathlike, content: dict[str, Any]) -> Pose | None:
    turn, shift = _first(path, content, ROTATION_KEYS), _first(path, content, TRANSLATION_KEYS)
    if turn is None and shift is None:
        return None
    if turn is None or shift is None:
        raise record.key_error(path, turn or shift or "", "a rotation without a translation, or the other way round")
    values = _plain(path, turn, content[turn])
    translation = record.numbers(path, shift, _plain(path, shift, content[shift]), (3,))
    if np.size(np.array(values, dtype=object)) == 3:
        vector = record.numbers(path, turn, values, (3,))
        if np.linalg.norm(vector) > 2 * np.pi:
            what = f"a turn by {np.linalg.norm(vector):.4g} radians; expected at most 2 pi (are these degrees?)"
            raise record.key_error(path, turn, what)
        return Pose.from_rotvec(vector, translation)
    return record.pose(path, turn, record.numbers(path, turn, values, (3, 3)), translation, mend=True)


def _is_fisheye(path: Pathlike, content: dict[str, Any]) -> bool:
    """Whether the file says so; fisheye and omnidirectional models use the same keys with another meaning."""
    model = str(content.get("distortion_model") or content.get("camera_model") or "")
    known = (*_PLAIN_LENSES, "pinhole", *_FISHEYES)
    if model.lower() not in known:
        what = f"{model!r}; expected plumb_bob (k1 k2 p1 p2 k3), rational_polynomial or equidistant"
        raise record.key_error(path, "distortion_model", what)
    if content.get("xi"):
        what = f"{content['xi']}: an omnidirectional lens; expected a pinhole or equidistant"
        raise record.key_error(path, "xi", what)
    fisheye = bool(content.get("fisheye_model")) or model.lower() in _FISHEYES
    for key in _KINDS:
        said = str(content.get(key) or "").lower()
        if not fisheye and any(word in said for word in _FISHEYE_WORDS):
            if model and model.lower() != "pinhole":
                raise record.key_error(path, key, f"{content[key]!r} beside {model!r}; expected one lens")
            fisheye = True
    return fisheye
