"""Camera files: windmark's own JSON, OpenCV's YAML/XML/JSON, NASA's tunnel JSON, told apart by content."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from windmark.geometry import PARAMETERS, Camera, Pose, PoV
from windmark.io import camera_record as record
from windmark.io.camera_record import LENGTH_UNITS, CameraFile
from windmark.io.errors import FileError
from windmark.io.nasa import MATRIX as NASA_MATRIX
from windmark.io.nasa import parse_nasa
from windmark.io.opencv_files import has_camera_matrix, parse_opencv, write_opencv_yaml
from windmark.io.opencv_text import parse_xml, parse_yaml
from windmark.io.text import Pathlike, parse_json, read_text, write_json

VERSION = 1

_FILE_NAMES = {"cx": "cx_px", "cy": "cy_px", "tilt_x": "tilt_x_rad", "tilt_y": "tilt_y_rad"}
_PARAMETER_KEYS = {_FILE_NAMES.get(name, name): name for name in PARAMETERS}
_KEYS = ("windmark", "version", "size_px", *_PARAMETER_KEYS, "covariance", "cam_from_model", "length_unit", "note")
_COMMENT = re.compile(r"^[ \t]*//.*$", re.MULTILINE)
"""OpenCV puts comment lines into its JSON. No JSON text can span lines, so these are comments indeed."""

_POV_KEYS = ("rx_deg", "ry_deg", "rz_deg", "dx", "dy", "dz", "fov_deg")


def read_camera(
    path: Pathlike, *, unit: str | None = None, size_px: tuple[int, int] | None = None
) -> tuple[Camera, Pose | None]:
    """Read a camera and, where the file has one, its pose (cam_from_model).

    The format is told by the content: windmark's own JSON (see `write_camera`); OpenCV's or ROS's
    YAML, XML or JSON (camera_matrix, distortion_coefficients, image_width, image_height and perhaps
    rvec, tvec); NASA's tunnel JSON (uPSP_cameraMatrix).

    Parameters
    ----------
    path : the file
    unit : the length unit expected of the pose; a file that says another one is refused
    size_px : (width, height) for files that do not say; a file that says another size is refused

    Raises
    ------
    FileError
        Names the key or line: not a known format, missing or unknown key, skew, a lens with other
        terms than k1 k2 p1 p2 k3 and tilts, a matrix that is no rotation, another unit or size.
    """
    if unit is not None and unit not in LENGTH_UNITS:
        raise ValueError(f"read_camera: unit must be one of {', '.join(LENGTH_UNITS)}, got {unit!r}")
    content = read_camera_file(path, size_px=size_px)
    if unit is not None and content.length_unit not in (None, unit):
        raise record.key_error(path, "length_unit", f"{content.length_unit!r}; expected {unit!r}")
    if size_px is not None and content.camera.size_px != tuple(size_px):
        raise FileError(path, f"a camera of {content.camera.size_px} px; expected {tuple(size_px)}")
    return content.camera, content.cam_from_model


def read_camera_file(path: Pathlike, *, size_px: tuple[int, int] | None = None) -> CameraFile:
    """As `read_camera`, with the file's format and length unit."""
    text = read_text(path)
    start = text.lstrip()[:1]
    if start == "<":
        return parse_opencv(path, parse_xml(path, text), size_px)
    content = parse_json(path, _COMMENT.sub("", text)) if start in "{[/" else parse_yaml(path, text)
    if isinstance(content, dict):
        if "windmark" in content:
            return _parse_own(path, content)
        if NASA_MATRIX in content:
            return parse_nasa(path, content, size_px)
        if has_camera_matrix(content):
            return parse_opencv(path, content, size_px)
    keys = ", ".join(list(content)[:8]) if isinstance(content, dict) else "no keys"
    what = (
        f'not a camera file: it has {keys}; expected windmark\'s own JSON ("windmark": "camera"), '
        f"OpenCV's (camera_matrix) or NASA's ({NASA_MATRIX})"
    )
    raise FileError(path, what)


def write_camera(path: Pathlike, camera: Camera, pose: Pose | None = None, *, unit: str | None = None) -> None:
    """Write a camera and perhaps its pose, whole or not at all.

    Parameters
    ----------
    path : ``.json``: windmark's own format, which gives back every bit; ``.yml`` or ``.yaml``:
        OpenCV's, without the covariance
    camera : the interior parameters
    pose : cam_from_model, a single one
    unit : length unit of the pose: in, ft, mm, cm or m; needed with a pose

    Raises
    ------
    ValueError
        For another extension, a missing or unknown unit, a batch of poses.
    FileError
        When the file cannot be written.
    """
    if unit is not None and unit not in LENGTH_UNITS:
        raise ValueError(f"write_camera: unit must be one of {', '.join(LENGTH_UNITS)}, got {unit!r}")
    if pose is not None and unit is None:
        raise ValueError("write_camera: unit must say the length unit of the pose, got None")
    if pose is not None and pose.rotation.ndim != 2:
        raise ValueError(f"write_camera: pose must be a single one, got a batch {pose.rotation.shape[:-2]}")
    suffix = Path(path).suffix.lower()
    if suffix in (".yml", ".yaml"):
        write_opencv_yaml(path, camera, pose, unit)
    elif suffix == ".json":
        write_json(path, _own_content(camera, pose, unit))
    else:
        raise ValueError(f"write_camera: path must end in .json (windmark) or .yml (OpenCV), got {path}")


def _own_content(camera: Camera, pose: Pose | None, unit: str | None) -> dict[str, Any]:
    content: dict[str, Any] = {"windmark": "camera", "version": VERSION, "size_px": camera.size_px}
    content |= {key: getattr(camera, name) for key, name in _PARAMETER_KEYS.items()}
    if camera.cov is not None:
        content["covariance"] = {"parameters": list(_PARAMETER_KEYS), "matrix": camera.cov}
    if pose is not None:
        pov = pose.to_pov(camera.focal_px, camera.size_px[0])
        content["cam_from_model"] = {"rotation": pose.rotation, "translation": pose.translation, "pov": pov}
        content["length_unit"] = unit
    return content


def _parse_own(path: Pathlike, content: dict[str, Any]) -> CameraFile:
    kind = content["windmark"]
    if kind != "camera":
        raise record.key_error(path, "windmark", f"{kind!r}; expected 'camera'")
    _refuse_unknown(path, content, _KEYS)
    if content.get("version") != VERSION:
        raise record.key_error(path, "version", f"{content.get('version')}; this windmark reads version {VERSION}")
    for key in ("size_px", "focal_px"):
        if key not in content:
            raise record.key_error(path, key, "missing; expected it in every camera")
    parameters = {
        name: float(record.numbers(path, key, content[key], ()))
        for key, name in _PARAMETER_KEYS.items()
        if key in content
    }
    size_px = record.image_size(path, "size_px", content["size_px"])
    camera = record.camera(path, size_px, parameters, _covariance(path, content.get("covariance")))
    pose = None if content.get("cam_from_model") is None else _own_pose(path, content["cam_from_model"], camera)
    unit = content.get("length_unit")
    if (unit is None and pose is not None) or (unit is not None and unit not in LENGTH_UNITS):
        raise record.key_error(path, "length_unit", f"{unit!r}; expected one of {', '.join(LENGTH_UNITS)}")
    return CameraFile(camera, pose, unit, "windmark")


def _refuse_unknown(path: Pathlike, content: Any, known: tuple[str, ...], within: str = "") -> None:
    if not isinstance(content, dict):
        raise record.key_error(path, within, f"not an object; expected the keys {', '.join(known)}")
    for key in content:
        if key not in known:
            where = f"{within}.{key}" if within else key
            raise record.key_error(path, where, f"unknown key; known are {', '.join(known)}")


def _covariance(path: Pathlike, content: Any) -> Any:
    """(11, 11) in the order of `PARAMETERS`; null (NaN: not determined) is allowed."""
    if content is None:
        return None
    _refuse_unknown(path, content, ("parameters", "matrix"), "covariance")
    if content.get("parameters") != list(_PARAMETER_KEYS):
        raise record.key_error(path, "covariance.parameters", f"expected {', '.join(_PARAMETER_KEYS)}")
    n = len(PARAMETERS)
    matrix = np.array(content.get("matrix"), dtype=object)
    if matrix.shape != (n, n):
        raise record.key_error(path, "covariance.matrix", f"the shape is {matrix.shape}; expected {n} x {n} numbers")
    undetermined = matrix == None  # noqa: E711 - elementwise
    values = record.numbers(path, "covariance.matrix", np.where(undetermined, 0.0, matrix).tolist(), (n, n))
    return np.where(undetermined, np.nan, values)


def _own_pose(path: Pathlike, content: Any, camera: Camera) -> Pose:
    """Rotation and translation, or a point of view typed by hand; where both are given they must agree."""
    _refuse_unknown(path, content, ("rotation", "translation", "pov"), "cam_from_model")
    pov = None if content.get("pov") is None else _pov(path, content["pov"])
    if pov is not None and not math.isnan(pov.fov_deg) and abs(pov.fov_deg - camera.fov_deg) > 1e-6:
        what = f"{pov.fov_deg}; expected {camera.fov_deg} (from focal_px and size_px), or no fov_deg"
        raise record.key_error(path, "cam_from_model.pov.fov_deg", what)
    given = [key for key in ("rotation", "translation") if key in content]
    if pov is not None and not given:
        return Pose.from_pov(pov)
    if len(given) < 2:
        raise record.key_error(path, "cam_from_model", "incomplete; expected rotation and translation, or pov")
    rotation = record.numbers(path, "cam_from_model.rotation", content["rotation"], (3, 3))
    translation = record.numbers(path, "cam_from_model.translation", content["translation"], (3,))
    pose = record.pose(path, "cam_from_model.rotation", rotation, translation)
    if pov is not None and not _agree(pose, Pose.from_pov(pov)):
        what = "another pose than rotation and translation; expected the same one, or only one of the two"
        raise record.key_error(path, "cam_from_model.pov", what)
    return pose


def _pov(path: Pathlike, content: Any) -> PoV:
    _refuse_unknown(path, content, _POV_KEYS, "cam_from_model.pov")
    missing = [key for key in _POV_KEYS[:6] if key not in content]
    if missing:
        raise record.key_error(
            path, f"cam_from_model.pov.{missing[0]}", "missing; expected three angles, three distances"
        )
    return PoV(**{k: float(record.numbers(path, f"cam_from_model.pov.{k}", v, ())) for k, v in content.items()})


def _agree(a: Pose, b: Pose) -> bool:
    size = max(1.0, float(np.linalg.norm(a.translation)))
    apart = np.linalg.norm(a.translation - b.translation) / size
    return bool(np.allclose(a.rotation, b.rotation, rtol=0, atol=1e-6) and apart < 1e-6)
