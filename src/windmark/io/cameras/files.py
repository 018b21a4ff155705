"""Reading a camera file of any known format, and writing one."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.io.cameras import colmap, record
from windmark.io.cameras.australis import is_australis, parse_australis, write_australis
from windmark.io.cameras.metashape import ROOT as METASHAPE_ROOT
from windmark.io.cameras.metashape import parse_metashape, refuse_document, write_metashape
from windmark.io.cameras.mrcal import is_mrcal, parse_mrcal, write_mrcal
from windmark.io.cameras.nasa import MATRIX as NASA_MATRIX
from windmark.io.cameras.nasa import parse_nasa
from windmark.io.cameras.opencv import has_camera_matrix, parse_opencv, write_opencv
from windmark.io.cameras.opencv_text import parse_xml, parse_yaml, xml_content
from windmark.io.cameras.own import own_content, parse_own
from windmark.io.cameras.plausible import with_doubts
from windmark.io.cameras.record import FREE, LENGTH_UNITS, CameraFile
from windmark.io.errors import FileError
from windmark.io.text import Pathlike, parse_json, read_text, write_json
from windmark.scene.shown import PATH, check_kinds, optional

CAMERA_FORMATS = ("windmark", "opencv", "nasa", "colmap", "mrcal", "metashape", "australis")
"""What is read; all but nasa are written, too."""

_EXTENSIONS = {
    ".json": "windmark", ".yml": "opencv", ".yaml": "opencv", ".cameramodel": "mrcal", ".xml": "metashape",
    ".txt": "australis", "": "colmap",
}  # fmt: skip
OTHERS = {
    **dict.fromkeys((".csv", ".tgts"), "a table"),
    **dict.fromkeys((".grid", ".x", ".xyz", ".stl", ".obj", ".ply", ".vtk", ".vtp", ".vtu"), "a surface grid"),
    **dict.fromkeys((".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp"), "a picture"),
    ".toml": "a project",
}
"""What a file that is no camera is, by the end of its name."""
_WITHOUT_POSE = ("metashape", "australis")
_COMMENT = re.compile(r"^[ \t]*//.*$", re.MULTILINE)
"""OpenCV puts comment lines into its JSON. No JSON text can span lines, so these are comments indeed."""


def read_camera(
    path: Pathlike, *, unit: str | None = None, size_px: tuple[int, int] | None = None, which: str | None = None
) -> tuple[Camera, Pose | None]:
    """Read a camera and, where the file has one, its pose (cam_from_model).

    The format is told by the content: windmark's own JSON (see `write_camera`); OpenCV's or ROS's
    YAML, XML or JSON (camera_matrix, distortion_coefficients, image_width, image_height and perhaps
    rvec, tvec); NASA's tunnel JSON (uPSP_cameraMatrix); COLMAP's text model (its folder or cameras.txt);
    mrcal's .cameramodel; Metashape's calibration XML; a table of Australis' parameters, whose backward
    lens is refitted. Origins and signs: `windmark.io.cameras`.

    Parameters
    ----------
    path : the file
    unit : the length unit expected of the pose; a file that says another one is refused
    size_px : (width, height) for files that do not say; a file that says another size is refused
    which : of a COLMAP model the image (with its pose) or the camera's number, where there are several

    Raises
    ------
    FileError
        Names the key or line: not a known format, missing or unknown key, skew, a lens with other
        terms than k1 k2 p1 p2 k3 and tilts, a matrix that is no rotation, another unit or size.

    Examples
    --------
    >>> import tempfile
    >>> import windmark as wm
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_camera(f"{folder}/cam1.json", wm.Camera((640, 480), 800.0), wm.Pose.identity(), unit="mm")
    ...     camera, cam_from_model = wm.read_camera(f"{folder}/cam1.json", unit="mm")
    >>> camera.focal_px, cam_from_model.translation.tolist()
    (800.0, [0.0, 0.0, 0.0])
    """
    if unit is not None and unit not in LENGTH_UNITS:
        raise UsageError(f"read_camera: unit must be one of {', '.join(LENGTH_UNITS)}, got {unit!r}")
    content = read_camera_file(path, size_px=size_px, which=which)
    if unit is not None and content.length_unit not in (None, unit):
        raise record.key_error(path, "length_unit", f"{content.length_unit!r}; expected {unit!r}")
    if size_px is not None and content.camera.size_px != tuple(size_px):
        raise FileError(path, f"a camera of {content.camera.size_px} px; expected {tuple(size_px)}")
    return content.camera, content.cam_from_model


def read_camera_file(path: Pathlike, *, size_px: tuple[int, int] | None = None, which: str | None = None) -> CameraFile:
    """As `read_camera`, with the file's format and length unit, what had to be done to read it, and what is doubtful of
    its numbers (`plausible`).
    """
    return with_doubts(_read(path, size_px, which))


def _read(path: Pathlike, size_px: tuple[int, int] | None, which: str | None) -> CameraFile:
    """A camera file of any format."""
    if Path(path).is_dir():
        if not (Path(path) / colmap.CAMERAS).is_file():
            what = f"a folder without {colmap.CAMERAS}; expected a camera file or COLMAP's model as text"
            raise FileError(path, f"{what} (binary models: colmap model_converter --output_type TXT)")
        return colmap.choose(path, colmap.read_colmap(path), which)
    try:
        return _of_text(path, size_px, which)
    except FileError as error:
        other = OTHERS.get(Path(path).suffix.lower())
        if other is None or not Path(path).is_file():
            raise
        raise FileError(path, f"is {other}, by its name; expected a camera file") from error


def _of_text(path: Pathlike, size_px: tuple[int, int] | None, which: str | None) -> CameraFile:
    """A camera file that is no folder."""
    text = read_text(path)
    if colmap.is_colmap(text):
        return colmap.choose(path, colmap.read_colmap(path), which)
    if which is not None:
        raise FileError(path, f"not a COLMAP model, so there is no {which!r} to choose")
    start = text.lstrip()[:1]
    if start == "<":
        return _parse_xml(path, text, size_px)
    if is_mrcal(text):
        return parse_mrcal(path, text)
    if is_australis(text):
        return parse_australis(path, text, size_px)
    content = parse_json(path, _COMMENT.sub("", text)) if start in "{[/" else parse_yaml(path, text)
    if isinstance(content, dict):
        if "windmark" in content:
            return parse_own(path, content)
        if NASA_MATRIX in content:
            return parse_nasa(path, content, size_px)
        if has_camera_matrix(content):
            return parse_opencv(path, content, size_px)
    keys = ", ".join(list(content)[:8]) if isinstance(content, dict) else "no keys"
    what = (
        f'not a camera file: it has {keys}; expected windmark\'s own JSON ("windmark": "camera"), '
        f"OpenCV's (camera_matrix), NASA's ({NASA_MATRIX}), mrcal's (lensmodel), COLMAP's cameras.txt, "
        "Metashape's XML or a table of Australis' parameters"
    )
    raise FileError(path, what)


def is_camera_text(text: str) -> bool:
    """Whether a text has the marks of a camera file that `read_camera_file` knows; nothing is checked."""
    keys = ("camera_matrix", "cameraMatrix", NASA_MATRIX)
    return colmap.is_colmap(text) or is_mrcal(text) or is_australis(text) or any(key in text for key in keys)


def _parse_xml(path: Pathlike, text: str, size_px: tuple[int, int] | None) -> CameraFile:
    root = parse_xml(path, text)
    if root.tag == METASHAPE_ROOT:
        return parse_metashape(path, root)
    if root.tag == "opencv_storage":
        return parse_opencv(path, xml_content(path, root), size_px)
    raise refuse_document(path, root.tag)


def write_camera(
    path: Pathlike,
    camera: Camera,
    pose: Pose | None = None,
    *,
    unit: str | None = None,
    format: str | None = None,
    pixel_mm: float | tuple[float, float] | None = None,
    pose_cov: NDArray[np.float64] | None = None,
) -> None:
    """Write a camera and perhaps its pose, whole or not at all.

    Only windmark's own format gives back every bit and holds the covariance.

    Parameters
    ----------
    path : its extension tells the format: ``.json`` windmark, ``.yml`` or ``.yaml`` opencv, ``.cameramodel``
        mrcal, ``.xml`` metashape, ``.txt`` australis, none: the folder of a COLMAP model
    camera : the interior parameters
    pose : cam_from_model, a single one
    unit : length unit of the pose: in, ft, mm, cm or m; needed with a pose
    format : one of `CAMERA_FORMATS` but nasa, instead of what the extension says; opencv with ``.json`` is
        OpenCV's JSON
    pixel_mm : pitch of the pixels (one number, or along x and y) for australis, which counts in mm
    pose_cov : (6, 6) covariance of the pose, of ``delta`` in ``exp(delta) @ pose``; other formats leave it out

    Raises
    ------
    ValueError
        For another extension or format, a missing or unknown unit, a batch of poses, and for what the format
        cannot hold: a pose, sensor tilts, a lens that a backward model does not fit.
    FileError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import windmark as wm
    >>> camera = wm.Camera((640, 480), 800.0, k1=-0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     wm.write_camera(f"{folder}/cam1.yml", camera)  # as OpenCV keeps it
    ...     read, pose = wm.read_camera(f"{folder}/cam1.yml")
    >>> read.k1, pose is None
    (-0.1, True)
    """
    check_kinds("write_camera", path=(path, PATH), camera=(camera, Camera), pose=(pose, optional(Pose)))
    if unit is not None and unit not in (*LENGTH_UNITS, FREE):
        raise UsageError(f"write_camera: unit must be one of {', '.join(LENGTH_UNITS)}, got {unit!r}")
    if pose is not None and unit is None:
        raise UsageError("write_camera: unit must say the length unit of the pose, got None")
    if pose is not None and pose.rotation.ndim != 2:
        raise ValueError(f"write_camera: pose must be a single one, got a batch {pose.rotation.shape[:-2]}")
    kind = written_camera_format(path, format)
    if pose is not None and kind in _WITHOUT_POSE:
        raise UsageError(f"write_camera: {kind} holds no pose; expected pose None")
    if kind == "windmark":
        if pose_cov is not None and (pose is None or np.shape(pose_cov) != (6, 6) or not np.isfinite(pose_cov).all()):
            what = f"got {np.shape(pose_cov)}" + ("" if pose is not None else " without a pose")
            raise ValueError(f"write_camera: pose_cov must be (6, 6) finite numbers, with a pose; {what}")
        write_json(path, own_content(camera, pose, unit, pose_cov))
    elif kind == "opencv":
        write_opencv(path, camera, pose, unit)
    elif kind == "mrcal":
        write_mrcal(path, camera, pose, unit)
    elif kind == "metashape":
        write_metashape(path, camera)
    elif kind == "australis":
        write_australis(path, camera, _pitch(pixel_mm))
    else:
        colmap.write_colmap(path, {1: camera}, None if pose is None else {"image": (1, pose)}, unit=unit)


def written_camera_format(path: Pathlike, format: str | None) -> str:
    """The format that `write_camera` takes.

    Raises
    ------
    ValueError
        For an unknown one.
    """
    if format is None:
        kind = _EXTENSIONS.get(Path(path).suffix.lower())
        if kind is None:
            known = ", ".join(f"{suffix or 'nothing'} ({name})" for suffix, name in _EXTENSIONS.items())
            raise UsageError(f"write_camera: path must end in {known}, or format be given; got {path}")
        return kind
    writable = [name for name in CAMERA_FORMATS if name != "nasa"]
    if format not in writable:
        raise UsageError(f"write_camera: format must be one of {', '.join(writable)}, got {format!r}")
    return format


def _pitch(pixel_mm: float | tuple[float, float] | None) -> tuple[float, float]:
    pitch = (pixel_mm, pixel_mm) if isinstance(pixel_mm, int | float) else pixel_mm
    if pitch is None or len(pitch) != 2 or not all(0 < float(p) < float("inf") for p in pitch):
        raise UsageError(f"write_camera: pixel_mm must give the pixels' pitch in mm for australis, got {pixel_mm}")
    return float(pitch[0]), float(pitch[1])
