"""windmark's own camera file: JSON with named fields and units; gives back every bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import PARAMETERS, Camera, Pose, PoV
from windmark.geometry.camera import PLAIN, WIDE
from windmark.geometry.lens import LENSES
from windmark.io.cameras import record
from windmark.io.cameras.edited import ANGLES_DISTANCES, as_written, chosen_focal, chosen_pose, read_as_written
from windmark.io.cameras.record import LENGTH_UNITS, CameraFile
from windmark.io.text import Pathlike

VERSION = 1

_FILE_NAMES = {"cx": "cx_px", "cy": "cy_px", "tilt_x": "tilt_x_rad", "tilt_y": "tilt_y_rad"}
_PARAMETER_KEYS = {_FILE_NAMES.get(name, name): name for name in PARAMETERS}
_KEYS = ("windmark", "version", "size_px", *_PARAMETER_KEYS, "lens", "covariance", "cam_from_model", "length_unit",
         "as_written", "note")  # fmt: skip
_POV_KEYS = (*ANGLES_DISTANCES, "fov_deg")


def own_content(
    camera: Camera, pose: Pose | None, unit: str | None, pose_cov: NDArray[np.float64] | None = None
) -> dict[str, Any]:
    """What is written as JSON."""
    content: dict[str, Any] = {"windmark": "camera", "version": VERSION, "size_px": camera.size_px}
    # A plain lens is written as it always was.
    keys = list(_PARAMETER_KEYS)[: PLAIN if camera.lens == "brown" else WIDE]
    if camera.shear or (camera.cov is not None and camera.cov[-1].any()):
        keys.append("shear")
    if camera.lens != "brown":
        content["lens"] = camera.lens
    content |= {key: getattr(camera, _PARAMETER_KEYS[key]) for key in keys}
    if camera.cov is not None:
        own = [PARAMETERS.index(_PARAMETER_KEYS[key]) for key in keys]
        content["covariance"] = {"parameters": keys, "matrix": camera.cov[np.ix_(own, own)]}
    if pose is not None:
        pov = pose.to_pov(camera.focal_px, camera.size_px[0])
        content["cam_from_model"] = {"rotation": pose.rotation, "translation": pose.translation, "pov": pov}
        if pose_cov is not None:
            content["cam_from_model"]["covariance"] = pose_cov
        content["length_unit"] = unit
        content["as_written"] = as_written(camera.size_px[0], camera.focal_px, pose, pov)
    return content


def parse_own(path: Pathlike, content: dict[str, Any]) -> CameraFile:
    """The camera, and the pose where the file has one, of a parsed file.

    What the file holds twice (pose and point of view, focal length and field of view) may be given once. Where both
    are there and disagree the one that was edited counts (see `edited`), and that is said in the note.
    """
    kind = content["windmark"]
    if kind != "camera":
        raise record.key_error(path, "windmark", f"{kind!r}; expected 'camera'")
    record.refuse_unknown(path, content, _KEYS)
    if content.get("version") != VERSION:
        raise record.key_error(path, "version", f"{content.get('version')}; this windmark reads version {VERSION}")
    if "size_px" not in content:
        raise record.key_error(path, "size_px", "missing; expected it in every camera")
    written = read_as_written(path, content.get("as_written"))
    place = content.get("cam_from_model")
    pov = None if place is None else _own_pov(path, place)
    camera, notes = _own_camera(path, content, pov, written)
    pose, pose_cov = None, None
    if place is not None:
        pose, note = chosen_pose(path, _own_matrix(path, place), pov, written)
        pose_cov = _pose_covariance(path, place.get("covariance"), edited=bool(note))
        notes += [note] if note else []
    unit = content.get("length_unit")
    if (unit is None and pose is not None) or (unit is not None and unit not in LENGTH_UNITS):
        what = "missing, and the pose has lengths" if unit is None else repr(unit)
        raise record.key_error(path, "length_unit", f"{what}; expected one of {', '.join(LENGTH_UNITS)}")
    return CameraFile(camera, pose, unit, "windmark", "; ".join(notes), pose_cov)


def _own_camera(path: Pathlike, content: dict[str, Any], pov: PoV | None, written: dict[str, str]
                ) -> tuple[Camera, list[str]]:  # fmt: skip
    lens = content.get("lens", "brown")
    if lens not in LENSES:
        raise record.key_error(path, "lens", f"{lens!r}; expected one of {', '.join(LENSES)}")
    parameters: dict[str, Any] = {
        name: float(record.numbers(path, key, content[key], ()))
        for key, name in _PARAMETER_KEYS.items()
        if key in content
    }
    size_px = record.image_size(path, "size_px", content["size_px"])
    given = None if pov is None or math.isnan(pov.fov_deg) else pov.fov_deg
    parameters["focal_px"], note = chosen_focal(path, parameters.get("focal_px"), given, size_px[0], written)
    cov = _covariance(path, content.get("covariance"))
    if note and cov is not None:
        cov, note = None, f"{note}; the camera's covariance is that of another focal length and is left out"
    return record.camera(path, size_px, {**parameters, "lens": lens}, cov), [note] if note else []


def _covariance(path: Pathlike, content: Any) -> Any:
    """(15, 15) in the order of `PARAMETERS`, zero of what is not named; null (NaN: not determined) is allowed."""
    if content is None:
        return None
    record.refuse_unknown(path, content, ("parameters", "matrix"), "covariance")
    keys, named = list(_PARAMETER_KEYS), content.get("parameters")
    if not isinstance(named, list) or any(n not in keys or named.count(n) > 1 for n in named):
        raise record.key_error(path, "covariance.parameters", f"expected names out of {', '.join(keys)}, each once")
    n = len(named)
    matrix = np.array(content.get("matrix"), dtype=object)
    if matrix.shape != (n, n):
        raise record.key_error(path, "covariance.matrix", f"the shape is {matrix.shape}; expected {n} x {n} numbers")
    undetermined = matrix == None  # noqa: E711 - elementwise
    values = record.numbers(path, "covariance.matrix", np.where(undetermined, 0.0, matrix).tolist(), (n, n))
    full, own = np.zeros((len(keys),) * 2), [keys.index(name) for name in named]
    full[np.ix_(own, own)] = np.where(undetermined, np.nan, values)
    return full


def _own_pov(path: Pathlike, content: Any) -> PoV | None:
    """The point of view of a pose, None where it has none; the field of view NaN where that is not given."""
    record.refuse_unknown(path, content, ("rotation", "translation", "covariance", "pov"), "cam_from_model")
    if content.get("pov") is None:
        return None
    record.refuse_unknown(path, content["pov"], _POV_KEYS, "cam_from_model.pov")
    missing = [key for key in ANGLES_DISTANCES if key not in content["pov"]]
    if missing:
        raise record.key_error(
            path, f"cam_from_model.pov.{missing[0]}", "missing; expected three angles, three distances"
        )
    return PoV(**{k: float(record.numbers(path, f"cam_from_model.pov.{k}", v, ())) for k, v in content["pov"].items()})


def _own_matrix(path: Pathlike, content: Any) -> Pose | None:
    """The pose of rotation and translation, None where neither is given."""
    given = [key for key in ("rotation", "translation") if key in content]
    if not given:
        return None
    if len(given) < 2:
        what = f"incomplete, {given[0]} alone; expected rotation and translation, or pov"
        raise record.key_error(path, "cam_from_model", what)
    rotation = record.numbers(path, "cam_from_model.rotation", content["rotation"], (3, 3))
    translation = record.numbers(path, "cam_from_model.translation", content["translation"], (3,))
    return record.pose(path, "cam_from_model.rotation", rotation, translation)


def _pose_covariance(path: Pathlike, content: Any, edited: bool) -> NDArray[np.float64] | None:
    """(6, 6); that of a pose which was edited says nothing any more."""
    if content is None:
        return None
    cov = record.numbers(path, "cam_from_model.covariance", content, (6, 6))
    return None if edited else cov
