"""What a camera file says, whatever its format, and the checks that all formats share."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.io.errors import LARGEST, FileError
from windmark.io.text import Pathlike
from windmark.scene.units import LENGTH_UNITS as LENGTH_UNITS

Array = NDArray[np.float64]

FREE = "free"
"""Written as the unit of a reconstruction without scale; not read where a length matters."""

_SAID = re.compile(rf"^[ \t]*#.*\blengths in ({'|'.join(LENGTH_UNITS)})\b", re.MULTILINE)
_OPENCV_LENGTHS = (4, 5, 8, 12, 14)
_ROUNDED = 1e-3
"""A rotation in text form this far from orthonormal was rounded; further off it is something else."""


@dataclass(frozen=True)
class CameraFile:
    """The content of a camera file.

    Parameters
    ----------
    camera : the interior parameters
    cam_from_model : the pose, None where the file has none
    length_unit : of the pose, None where the file does not say
    format : one of `CAMERA_FORMATS`
    note : what had to be done to read it, and what is doubtful of its numbers; empty where there is nothing to say
    pose_cov : (6, 6) covariance of the pose, of ``delta`` in ``exp(delta) @ cam_from_model``; None where the file
        has none
    """

    camera: Camera
    cam_from_model: Pose | None
    length_unit: str | None
    format: str
    note: str = ""
    pose_cov: Array | None = None


def unit_in_comment(text: str) -> str | None:
    """The length unit that windmark writes into a comment, "lengths in mm", of formats without a place for it."""
    found = _SAID.search(text)
    return found[1] if found else None


def key_error(path: Pathlike, key: str, what: str) -> FileError:
    """`FileError` that names a key."""
    return FileError(path, what, f"key {key!r}")


def refuse_unknown(path: Pathlike, content: Any, known: tuple[str, ...], within: str = "") -> None:
    """Raise for content that is no object, or has a key that is not known."""
    if not isinstance(content, dict):
        raise key_error(path, within, f"not an object; expected the keys {', '.join(known)}")
    for key in content:
        if key not in known:
            where = f"{within}.{key}" if within else key
            raise key_error(path, where, f"unknown key; known are {', '.join(known)}")


def numbers(path: Pathlike, key: str, value: Any, shape: tuple[int, ...]) -> Array:
    """A list (of lists) of finite numbers of the given shape; one-dimensional lists of the same size are taken too."""
    wanted = f"expected {' x '.join(map(str, shape))} finite numbers" if shape else "expected a finite number"
    try:
        array = np.array(value, dtype=object).astype(float)
    except (TypeError, ValueError, OverflowError):
        raise key_error(path, key, f"not numbers; {wanted}") from None
    flat = array.ndim <= 1 or 1 in array.shape  # a vector may be written as a row or as a column
    if array.shape != shape and not (shape and array.ndim and flat and array.size == np.prod(shape)):
        raise key_error(path, key, f"the shape is {array.shape}; {wanted}")
    if not np.isfinite(array).all() or _has_bool_or_text(value):
        raise key_error(path, key, f"not finite numbers; {wanted}")
    if (np.abs(array) > LARGEST).any():
        raise key_error(path, key, f"{np.abs(array).max():g} is too large; {wanted} of at most {LARGEST:g}")
    return array.reshape(shape)


def _has_bool_or_text(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(map(_has_bool_or_text, value))
    return isinstance(value, bool | str)


def image_size(path: Pathlike, key: str, value: Any) -> tuple[int, int]:
    """(width, height) as positive whole numbers."""
    width, height = numbers(path, key, value, (2,))
    if width < 1 or height < 1 or width % 1 or height % 1:
        raise key_error(path, key, f"{value} is no image size; expected width and height in whole pixels")
    return int(width), int(height)


def lens(path: Pathlike, key: str, value: Any, *, fisheye: bool = False) -> dict[str, Any]:
    """OpenCV's distortion vector (``cv2.fisheye``'s four) as named parameters of `Camera`, with the name of its lens.

    Raises
    ------
    FileError
        For a wrong number of coefficients, and for the thin prism s1-s4, which windmark's lenses lack, when not zero.
    """
    size = np.size(np.array(value, dtype=object))
    if fisheye:
        if size != 4:
            raise key_error(path, key, f"{size} coefficients of a fisheye lens; expected 4 (k1 k2 k3 k4)")
        given = numbers(path, key, value, (4,)).tolist()
        return {**dict(zip(("k1", "k2", "k3", "k4"), given, strict=True)), "lens": "fisheye"}
    if size not in (0, *_OPENCV_LENGTHS):
        raise key_error(path, key, f"{size} coefficients; expected 4, 5, 8, 12 or 14 (k1 k2 p1 p2 k3 ...)")
    d = np.zeros(14)
    d[:size] = numbers(path, key, value, (size,)) if size else 0.0
    if d[8:12].any():
        there = [name for name, v in zip(("s1", "s2", "s3", "s4"), d[8:12], strict=True) if v]
        what = f"{', '.join(there)} not zero: a thin-prism lens; expected k1 k2 p1 p2 k3 k4 k5 k6 alone"
        raise key_error(path, key, f"{what} (calibrate again without these terms)")
    names = ("k1", "k2", "p1", "p2", "k3", *(("k4", "k5", "k6") if d[5:8].any() else ()))
    found: dict[str, Any] = dict(zip(names, d[: len(names)].tolist(), strict=True))
    found["lens"] = "rational" if d[5:8].any() else "brown"
    return found | {"tilt_x": float(d[12]), "tilt_y": float(d[13])}


def coefficients(camera: Camera) -> list[float]:
    """OpenCV's distortion vector of a camera, without the tilts: 5, of a rational lens 8, of a fisheye lens its 4."""
    if camera.lens == "fisheye":
        return [camera.k1, camera.k2, camera.k3, camera.k4]
    wide = [camera.k4, camera.k5, camera.k6] if camera.lens == "rational" else []
    return [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3, *wide]


def refuse_lens(who: str, camera: Camera, *known: str) -> None:
    """`UsageError` for a lens that a format has no words for."""
    if camera.lens not in ("brown", *known):
        what = f"expected {' or '.join(('k1 k2 p1 p2 k3', *known))}, got a {camera.lens} lens"
        raise UsageError(f"write_camera: {who} cannot hold this lens; {what}")


def pinhole(path: Pathlike, key: str, value: Any) -> dict[str, float]:
    """A 3 x 3 camera matrix as named parameters of `Camera`.

    Raises
    ------
    FileError
        For what is no camera matrix.
    """
    k = numbers(path, key, value, (3, 3))
    if k[1, 0] or k[2].tolist() != [0, 0, 1]:
        raise key_error(path, key, "not a camera matrix; expected [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    if k[0, 0] <= 0 or k[1, 1] <= 0:
        raise key_error(path, key, f"the focal lengths are {k[0, 0]:g} and {k[1, 1]:g}; expected > 0")
    focal, cx, cy = float(k[0, 0]), float(k[0, 2]), float(k[1, 2])
    return {"focal_px": focal, "aspect": float(k[1, 1] / k[0, 0]), "cx": cx, "cy": cy, "shear": float(k[0, 1]) / focal}


def camera(path: Pathlike, size_px: tuple[int, int], parameters: Mapping[str, Any], cov: Array | None = None) -> Camera:
    """The camera, its own complaints as `FileError`."""
    try:
        return Camera(size_px=size_px, cov=cov, **parameters)
    except ValueError as error:
        raise FileError(path, str(error)) from error


def pose(path: Pathlike, key: str, rotation: Array, translation: Array, *, mend: bool = False) -> Pose:
    """The pose; ``mend`` replaces a rotation that was rounded in the file by the nearest true one.

    Raises
    ------
    FileError
        When the matrix is no rotation: mirrored, scaled, or off by more than rounding.
    """
    if np.abs(rotation).max() > 2:
        raise key_error(path, key, "not a rotation; expected an orthonormal matrix with determinant +1")
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if mend and 1e-12 < error < _ROUNDED and np.linalg.det(rotation) > 0:
        u, _, vt = np.linalg.svd(rotation)
        rotation = u @ vt
    try:
        return Pose(rotation, translation)
    except ValueError as problem:
        raise key_error(path, key, str(problem)) from problem


def refuse_shear(who: str, camera: Camera) -> None:
    """`UsageError` for axes that are not square: OpenCV's functions and most programs do not look at a skew."""
    if camera.shear:
        raise UsageError(f"write_camera: {who} cannot hold a shear; expected zero, got {camera.shear:g}")


def refuse_tilt(who: str, camera: Camera) -> None:
    """`UsageError` for a tilted sensor, which only OpenCV's and windmark's own files can hold."""
    if camera.tilt_x or camera.tilt_y:
        tilts = f"tilt_x {camera.tilt_x:g}, tilt_y {camera.tilt_y:g}"
        raise UsageError(f"write_camera: {who} cannot hold sensor tilts; expected zeros, got {tilts}")
