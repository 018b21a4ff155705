"""Agisoft Metashape's camera calibration (XML, ``<calibration>``).

Image coordinates count from the *corner* of the top-left pixel, and the principal point is an offset from
the middle of the image, so windmark's cx is ``width/2 + cx - 1/2``. With x = X/Z, y = Y/Z (x right, y down,
z forward) and r^2 = x^2 + y^2::

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + p1 (r^2 + 2 x^2) + 2 p2 x y
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + p2 (r^2 + 2 y^2) + 2 p1 x y
    u  = width/2  + cx + f x' + b1 x' + b2 y'
    v  = height/2 + cy + f y'

So p1 and p2 are OpenCV's p2 and p1, the focal length along x is f + b1, along y it is f, and the skew b2 is
focal length times shear. k4 and the higher decentring terms p3, p4 have no place in windmark's camera and must
be zero. A calibration has no pose. Keys that are not there are zero, as Metashape leaves them out.

Source: Metashape Professional user manual, appendix "Camera models", frame cameras.
"""

from __future__ import annotations

from typing import Any

from windmark.geometry import Camera
from windmark.io.atomic import atomic_write
from windmark.io.cameras import record
from windmark.io.cameras.opencv_text import refuse_doubles
from windmark.io.errors import FileError
from windmark.io.text import Pathlike

ROOT = "calibration"
_NAMES = {"k1": "k1", "k2": "k2", "k3": "k3", "p1": "p2", "p2": "p1"}
"""Metashape's name -> ours."""
_NOT_HELD = {"k4": "k4 (r^8)", "p3": "p3", "p4": "p4"}
_OLD = ("fx", "fy", "skew")


def parse_metashape(path: Pathlike, root: Any) -> record.CameraFile:
    """The camera of a parsed XML file."""
    refuse_doubles(path, root)
    content = {child.tag: (child.text or "").strip() for child in root}
    kind = content.get("projection", content.get("type", "frame"))
    if kind != "frame":
        raise record.key_error(path, "projection", f"{kind!r}; expected 'frame'")
    old = [key for key in _OLD if key in content]
    if old:
        what = "a PhotoScan file of before version 1.2, in which cx, cy and p1, p2 mean something else"
        raise record.key_error(path, old[0], f"{what}; expected f, cx, cy, b1, b2 (export it again)")
    for key in ("width", "height", "f"):
        if key not in content:
            raise record.key_error(path, key, "missing; expected width, height and f in every calibration")
    size_px = record.image_size(path, "width", [_number(path, content, "width"), _number(path, content, "height")])
    for key, words in _NOT_HELD.items():
        value = _number(path, content, key)
        if value:
            what = f"{words} is {value:g}; expected 0 (windmark's camera lacks it: calibrate again without it)"
            raise record.key_error(path, key, what)
    f, b1 = _number(path, content, "f"), _number(path, content, "b1")
    if f <= 0 or f + b1 <= 0:
        raise record.key_error(path, "f", f"the focal lengths are {f + b1:g} and {f:g}; expected > 0")
    parameters = {ours: _number(path, content, theirs) for theirs, ours in _NAMES.items()}
    parameters |= {"focal_px": f + b1, "aspect": f / (f + b1), "shear": _number(path, content, "b2") / (f + b1)}
    for key, ours, size in (("cx", "cx", size_px[0]), ("cy", "cy", size_px[1])):
        parameters[ours] = (size - 1) / 2 + _number(path, content, key)
    return record.CameraFile(record.camera(path, size_px, parameters), None, None, "metashape")


def write_metashape(path: Pathlike, camera: Camera) -> None:
    """Write a frame calibration.

    Raises
    ------
    ValueError
        For sensor tilts and wide lenses, which Metashape's frame model lacks.
    """
    record.refuse_tilt("Metashape's frame camera", camera)
    record.refuse_lens("Metashape's frame camera", camera)
    width, height = camera.size_px
    f = camera.focal_px * camera.aspect
    values: dict[str, float] = {"f": f, "cx": camera.cx - (width - 1) / 2, "cy": camera.cy - (height - 1) / 2}
    values |= {"b1": camera.focal_px - f} if camera.aspect != 1 else {}
    values |= {"b2": camera.focal_px * camera.shear} if camera.shear else {}
    values |= {theirs: getattr(camera, ours) for theirs, ours in _NAMES.items()}
    lines = [f"  <{key}>{value!r}</{key}>\n" for key, value in values.items()]
    head = f"  <projection>frame</projection>\n  <width>{width}</width>\n  <height>{height}</height>\n"
    with atomic_write(path) as stream:
        stream.write(f'<?xml version="1.0" encoding="UTF-8"?>\n<{ROOT}>\n{head}{"".join(lines)}</{ROOT}>\n')


def _number(path: Pathlike, content: dict[str, str], key: str) -> float:
    text = content.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        raise record.key_error(path, key, f"{text!r} is no number; expected a finite number") from None
    return float(record.numbers(path, key, value, ()))


def refuse_document(path: Pathlike, tag: str) -> FileError:
    """What to say of an XML file of another kind."""
    hint = "; export the calibration itself (Tools, Camera Calibration, Save)" if tag == "document" else ""
    what = f"the XML's root is <{tag}>; expected OpenCV's <opencv_storage> or Metashape's <{ROOT}>{hint}"
    return FileError(path, what)
