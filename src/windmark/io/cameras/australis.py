"""Parameters as Australis, iWitness and PhotoModeler report them, in a plain text layout.

Those programs keep cameras in files of their own, so what is read and written here is the table of their
reports, one ``NAME VALUE [UNIT]`` per line, in any order, ``#`` for comments::

    width   3004
    height  2000
    pixel_x 0.0074 mm
    pixel_y 0.0074 mm
    C       24.512 mm
    XP      0.021 mm
    YP     -0.013 mm
    K1      1.1e-4
    K2, K3, P1, P2, B1, B2: zero where they are not given

The meaning is in `windmark.io.cameras.backward`: middle of the sensor, y up, corrections in mm. PhotoModeler
gives its principal point from the top-left corner: subtract half of the format's width from xp and turn
``height/2 - yp`` round likewise. No pose.
"""

from __future__ import annotations

import re

from windmark.errors import DataError, WindmarkError
from windmark.geometry import Camera
from windmark.io.atomic import atomic_write
from windmark.io.cameras import record
from windmark.io.cameras.backward import BackwardCamera, backward_camera, forward_camera
from windmark.io.errors import FileError
from windmark.io.text import Pathlike

REFIT_RMS_PX = 0.05
"""Half of what a marker's centre is known to: a lens model that stands for another one worse than this is refused."""

_NEEDED = ("width", "height", "pixel_x", "pixel_y", "c", "xp", "yp")
_LENS = ("k1", "k2", "k3", "p1", "p2", "b1", "b2")
_LINE = re.compile(r"([A-Za-z_]\w*)\s*[:=]?\s+(\S+)(?:\s+\S+)?$")


def is_australis(text: str) -> bool:
    """Whether the text has the lines that only this layout has."""
    names = {line.split(maxsplit=1)[0].lower().rstrip(":=") for line in text.splitlines() if line.strip()}
    return {"pixel_x", "c"} <= names or {"xp", "yp"} <= names


def parse_australis(path: Pathlike, text: str, size_px: tuple[int, int] | None) -> record.CameraFile:
    """The camera refitted with windmark's forward lens; ``size_px`` where the text has no width and height.

    Raises
    ------
    FileError
        Names the line or key; also where the refit is off by more than 0.05 px RMS over the sensor.
    """
    given = _values(path, text)
    if "width" not in given and "height" not in given:
        if size_px is None:
            raise FileError(path, "no image size; expected the keys width and height, or the size from the caller")
        given |= {"width": float(size_px[0]), "height": float(size_px[1])}
    for key in _NEEDED:
        if key not in given:
            raise record.key_error(path, key, f"missing; expected {', '.join(_NEEDED)}")
    for key in ("pixel_x", "pixel_y", "c"):
        if given[key] <= 0:
            raise record.key_error(path, key, f"{given[key]:g}; expected millimetres > 0")
    size = record.image_size(path, "width", [given["width"], given["height"]])
    lens = {key: given.get(key, 0.0) for key in _LENS}
    pixel_mm = (given["pixel_x"], given["pixel_y"])
    backward = BackwardCamera(size, pixel_mm, given["c"], given["xp"], given["yp"], **lens)
    try:
        camera, refit = forward_camera(backward)
    except WindmarkError as error:
        raise FileError(path, str(error)) from error
    if not refit.rms_px <= REFIT_RMS_PX:
        what = f"the lens refitted as k1 k2 p1 p2 k3 is off: {refit}; expected at most {REFIT_RMS_PX} px RMS"
        raise FileError(path, f"{what} (calibrate with windmark's own model instead)")
    return record.CameraFile(camera, None, None, "australis", f"lens refitted from a backward model: {refit}")


def write_australis(path: Pathlike, camera: Camera, pixel_mm: tuple[float, float]) -> None:
    """Write the backward camera nearest to ``camera``; the misfit stands in the file.

    Raises
    ------
    ValueError
        Where the lens has no inverse on the sensor, or the backward model is off by more than 0.05 px RMS.
    """
    try:
        backward, refit = backward_camera(camera, pixel_mm)
    except WindmarkError as error:
        raise DataError(f"write_camera: {error}") from error
    if not refit.rms_px <= REFIT_RMS_PX:
        tilts = " (sensor tilts do not fit it)" if camera.tilt_x or camera.tilt_y else ""
        what = f"the backward model K1 K2 K3 P1 P2 B1 B2 is off: {refit}"
        raise DataError(f"write_camera: {what}; expected at most {REFIT_RMS_PX} px RMS{tilts}")
    lines = [f"# Backward lens model in mm, y up; refitted: {refit}"]
    lines += [f"{key:<8}{side}" for key, side in zip(("width", "height"), camera.size_px, strict=True)]
    lines += [f"{key:<8}{pitch!r} mm" for key, pitch in zip(("pixel_x", "pixel_y"), pixel_mm, strict=True)]
    lines += [f"{key:<8}{getattr(backward, key.lower())!r} mm" for key in ("C", "XP", "YP")]
    lines += [f"{key.upper():<8}{getattr(backward, key)!r}" for key in _LENS]
    with atomic_write(path) as stream:
        stream.write("\n".join(lines) + "\n")


def _values(path: Pathlike, text: str) -> dict[str, float]:
    given: dict[str, float] = {}
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split("#", 1)[0].strip()
        if not line:
            continue
        found = _LINE.match(line)
        key = found[1].lower() if found else ""
        if found is None or key not in (*_NEEDED, *_LENS):
            known = ", ".join((*_NEEDED, *_LENS))
            raise FileError(path, f"{line[:40]!r} is no camera parameter; expected NAME VALUE with {known}", number)
        if key in given:
            raise record.key_error(path, key, "there more than once")
        try:
            value = float(found[2])
        except ValueError:
            raise FileError(path, f"{found[2]!r} is no number; expected a finite number for {key}", number) from None
        given[key] = float(record.numbers(path, key, value, ()))
    return given
