"""What a picture file says that its values are: the words of a TIFF's description or of a table's head."""

from __future__ import annotations

import os
import re

from windmark.io.errors import FileError, reading
from windmark.io.recordings.address import frame_address
from windmark.io.text import Pathlike

_UNITS = {"k": "K", "kelvin": "K", "c": "degC", "°c": "degC", "degc": "degC", "celsius": "degC", "f": "degF",
          "°f": "degF", "degf": "degF", "fahrenheit": "degF"}  # fmt: skip
_BEFORE = r"(?:^|[;\t\"]|\b(?:values are|object|image|quantity\s*[:=]))[ \t]*"
"""A name inside a line is that of a parameter: "reflected temperature"."""
_BETWEEN = r"\s*(?:unit|values?)?\s*(?:in|=|:|,|;|\[|\()\s*[\[(]?\s*"
_BEHIND = r"(?![\w/])(?![ \t]*[\])]*[ \t]*[;,\t:=]?[ \t]*[-+\d])"
"""A number behind the unit makes it a parameter, too."""
_TEMPERATURE = re.compile(
    _BEFORE + r"temp(?:erature)?s?\b" + _BETWEEN + r"(°?[CKF]|deg[CF]|kelvin|celsius|fahrenheit)" + _BEHIND,
    re.IGNORECASE | re.MULTILINE,
)
_RADIANCE = re.compile(
    _BEFORE + r"radiance\b" + _BETWEEN + r"(m?W[\w/^.*·()² -]*?)\)?(?=[\]\"';,\r\n]| \(|$)" + _BEHIND,
    re.IGNORECASE | re.MULTILINE,
)
_HEAD_BYTES = 8192


def told_quantity(path: Pathlike) -> tuple[str, str] | None:
    """(quantity, unit) that a picture's file says of its values; None where it says nothing, or two things.

    Looked at are the description of a TIFF's first page and the lines of words at the head of a text table:
    "temperature in K", "Temperature [°C]", "radiance, W/m2/sr". A name alone, or a unit alone, says nothing, nor does a
    parameter ("reflected temperature [°C]; 20").

    Raises
    ------
    FileError
        When the file cannot be opened.
    """
    address = frame_address(path)
    path = address.file
    if os.path.isdir(path):
        return None
    with reading(path), open(path, "rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return _in_words(_description(path))
    if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return None
    code = "utf-16" if head.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    text = head[: len(head) // 2 * 2].decode(code, "replace")
    if "\ufffd" in text:
        text = head.decode("cp1252", "replace")  # programs of Windows write ° so
    return _in_words("\n".join(line for line in text.splitlines() if re.search(r"[A-Za-z]{3}", line)))


def _description(path: Pathlike) -> str:
    import tifffile

    try:
        with tifffile.TiffFile(path) as file:
            return str(file.pages[0].aspage().description)
    except Exception as error:  # damage shows in many ways; who reads the picture says so
        raise FileError(path, f"damaged: its description cannot be read ({error})") from error


def _in_words(text: str) -> tuple[str, str] | None:
    found = {("temperature", _UNITS[unit.lower()]) for unit in _TEMPERATURE.findall(text)}
    found |= {("radiance", _plain(unit)) for unit in _RADIANCE.findall(text)}
    return found.pop() if len(found) == 1 else None


def _plain(unit: str) -> str:
    """W/(m²·sr) as W/m2/sr."""
    return re.sub(r"/\(([\w]+)[·*. ]([\w]+)\)?", r"/\1/\2", unit.strip().replace("²", "2"))
