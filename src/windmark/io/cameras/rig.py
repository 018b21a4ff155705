"""The file of a rig: where cameras stand that do not move against each other. JSON with named fields and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Pose
from windmark.io.cameras import record
from windmark.io.cameras.record import LENGTH_UNITS
from windmark.io.text import Pathlike, read_json, write_json

Array = NDArray[np.float64]

_KEYS = ("length_unit", "cam_from_rig", "covariance_of")
_CAMERA_KEYS = ("rotation", "translation", "station", "covariance")
_COVARIANCE_OF = "exp(delta) @ cam_from_rig, delta = [rotation in radians, translation]"


@dataclass(frozen=True)
class RigFile:
    """The content of a rig's file.

    Parameters
    ----------
    cam_from_rig : camera -> its pose, from a frame that is fixed to all of them
    length_unit : of these poses
    cov : camera -> (6, 6) of ``delta`` in ``exp(delta) @ cam_from_rig``, of those that have one
    """

    cam_from_rig: Mapping[str, Pose]
    length_unit: str
    cov: Mapping[str, Array] = field(default_factory=dict)


def write_rig(
    path: Pathlike, cam_from_rig: Mapping[str, Pose], *, unit: str, cov: Mapping[str, Array] | None = None
) -> None:
    """Write where the cameras of a rig are.

    Parameters
    ----------
    cam_from_rig : camera -> its pose, from a frame that is fixed to all of them
    unit : length unit of the poses
    cov : camera -> (6, 6) of ``delta`` in ``exp(delta) @ cam_from_rig``
    """
    if unit not in LENGTH_UNITS:
        raise UsageError(f"write_rig: unit must be one of {', '.join(LENGTH_UNITS)}, got {unit!r}")
    cameras: dict[str, Any] = {}
    for name, pose in cam_from_rig.items():
        cameras[name] = {"rotation": pose.rotation, "translation": pose.translation, "station": pose.center}
        if cov is not None and name in cov:
            cameras[name]["covariance"] = cov[name]
    write_json(path, {"length_unit": unit, "cam_from_rig": cameras, "covariance_of": _COVARIANCE_OF})


def read_rig(path: Pathlike) -> RigFile:
    """Where the cameras of a rig are. ``station`` is for other readers.

    Raises
    ------
    FileError
        Naming the file and the key that is wrong.
    """
    content = read_json(path)
    record.refuse_unknown(path, content, _KEYS)
    unit = content.get("length_unit")
    if unit not in LENGTH_UNITS:
        what = "missing" if unit is None else repr(unit)
        raise record.key_error(path, "length_unit", f"{what}; expected one of {', '.join(LENGTH_UNITS)}")
    cameras = content.get("cam_from_rig")
    if not isinstance(cameras, dict) or not cameras:
        raise record.key_error(path, "cam_from_rig", "expected the cameras of a rig by name, each with its pose")
    poses, cov = {}, {}
    for name, place in cameras.items():
        key = f"cam_from_rig.{name}"
        record.refuse_unknown(path, place, _CAMERA_KEYS, key)
        parts = {}
        for part, shape in (("rotation", (3, 3)), ("translation", (3,))):
            if part not in place:
                raise record.key_error(path, f"{key}.{part}", "missing; expected it of every camera")
            parts[part] = record.numbers(path, f"{key}.{part}", place[part], shape)
        poses[name] = record.pose(path, f"{key}.rotation", parts["rotation"], parts["translation"], mend=True)
        if "covariance" in place:
            cov[name] = record.numbers(path, f"{key}.covariance", place["covariance"], (6, 6))
    return RigFile(poses, unit, cov)
