"""windmark's own camera file: JSON with named fields and units; gives back every bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry import PARAMETERS, Camera, Pose, PoV
from windmark.io.cameras import record
from windmark.io.cameras.record import LENGTH_UNITS, CameraFile
from windmark.io.text import Pathlike

VERSION = 1

_FILE_NAMES = {"cx": "cx_px", "cy": "cy_px", "tilt_x": "tilt_x_rad", "tilt_y": "tilt_y_rad"}
_PARAMETER_KEYS = {_FILE_NAMES.get(name, name): name for name in PARAMETERS}
_KEYS = ("windmark", "version", "size_px", *_PARAMETER_KEYS, "covariance", "cam_from_model", "length_unit", "note")
_POV_KEYS = ("rx_deg", "ry_deg", "rz_deg", "dx", "dy", "dz", "fov_deg")


def own_content(camera: Camera, pose: Pose | None, unit: str | None) -> dict[str, Any]:
    """What is written as JSON."""
    content: dict[str, Any] = {"windmark": "camera", "version": VERSION, "size_px": camera.size_px}
    content |= {key: getattr(camera, name) for key, name in _PARAMETER_KEYS.items()}
    if camera.cov is not None:
        content["covariance"] = {"parameters": list(_PARAMETER_KEYS), "matrix": camera.cov}
    if pose is not None:
        pov = pose.to_pov(camera.focal_px, camera.size_px[0])
        content["cam_from_model"] = {"rotation": pose.rotation, "translation": pose.translation, "pov": pov}
        content["length_unit"] = unit
    return content


def parse_own(path: Pathlike, content: dict[str, Any]) -> CameraFile:
    """The camera, and the pose where the file has one, of a parsed file."""
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
    size = max(1.0, math.hypot(*a.translation))
    apart = math.hypot(*(a.translation - b.translation)) / size
    return bool(np.allclose(a.rotation, b.rotation, rtol=0, atol=1e-6) and apart < 1e-6)
