"""Why a file is no TOML, in words: a picture, a table or a JSON file in place of a project; a key given twice."""

from __future__ import annotations

import re
from pathlib import Path

PROJECT = "expected a windmark project file (TOML)"
_PICTURES = (b"\x89PNG", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"BM", b"GIF8")
_TABLES = (".csv", ".tsv", ".tgts", ".dat")
_AT = re.compile(r"\(at line (\d+), column (\d+)\)")
_TWICE = re.compile("^(Cannot overwrite a value|Cannot declare .* twice)")


def why_no_toml(path: Path, content: bytes, error: ValueError) -> str:
    """What a file is instead of a project, or where its TOML is wrong.

    Parameters
    ----------
    path : of the file
    content : of the file
    error : what the library says
    """
    if content.startswith(_PICTURES):
        return f"is a picture; {PROJECT}"
    if isinstance(error, UnicodeDecodeError):
        return f"is no text in UTF-8; {PROJECT}"
    if content.lstrip()[:1] == b"{":
        return f"is a JSON file, as those of cameras and rigs; {PROJECT}"
    if content.lstrip()[:1] == b"<":
        return f"is an XML file; {PROJECT}"
    if path.suffix.lower() in _TABLES:
        return f"is a table; {PROJECT}"
    said = str(error)
    if (at := _AT.search(said)) is not None and _TWICE.match(said):
        text = content.decode("utf-8-sig").splitlines()[int(at[1]) - 1].strip()
        what = "a table" if text.startswith("[") else "a key"
        return f"line {at[1]}: {what} is given twice ({text.partition('=')[0].strip()[:60]}); give it once"
    return f"is not valid TOML ({said}); expected a windmark project file"
