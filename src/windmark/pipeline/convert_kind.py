"""What a file is that is to be converted: a camera, a grid, a table of markers, pictures; by content and extension."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from windmark import io
from windmark.errors import UsageError
from windmark.io.apart import read_apart
from windmark.io.csv_rows import HINT
from windmark.io.errors import reading
from windmark.io.text import UTF_16
from windmark.io.vtk_read import VTK_SUFFIXES

KINDS = ("camera", "grid", "markers", "pictures")
WORDS = {"camera": "a camera", "grid": "a surface grid", "markers": "a table of markers", "pictures": "pictures"}
TARGETS = {
    "camera": (".json", ".yml", ".yaml", ".cameramodel", ".xml", ".txt", "(no extension)"),
    "grid": io.GRID_SUFFIXES,
    "markers": (".csv", ".tgts"),
    "pictures": (
        ".tif", ".tiff", ".h5", ".hdf5", ".nc", ".avi", ".mkv", ".png", ".jpg", ".jpeg", ".bmp", "(no extension)",
    ),
}  # fmt: skip
"""Extensions that each kind can be written under."""

PICTURE_SUFFIXES = (
    ".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".pnm", ".jp2", ".fits", ".fit", ".fts", ".cine",
    ".mraw", ".cih", ".cihx", ".avi", ".mp4", ".mov", ".mkv", ".npy", ".npz", ".h5", ".hdf5", ".hdf", ".raw", ".seq",
    ".ptw", ".im7", ".b16", ".spe", ".m4v", ".mpg", ".mpeg", ".wmv", ".webm", ".fz",
)  # fmt: skip
_BY_SUFFIX = {
    **dict.fromkeys((".tgts",), "markers"),
    **dict.fromkeys((".cameramodel", ".yml", ".yaml"), "camera"),
    **dict.fromkeys((".stl", ".obj", ".ply", ".tri", *VTK_SUFFIXES), "grid"),
    **dict.fromkeys((s for s in io.GRID_SUFFIXES if s not in (".dat", ".nc")), "grid"),
    **dict.fromkeys(PICTURE_SUFFIXES, "pictures"),
}
_HEAD_BYTES = 65536
_LEAST_WIDE = 16
"""Numbers per line from which a rectangle of them may be a picture."""
_TECPLOT = re.compile(r"^\s*(#[^\n]*\n\s*)*(TITLE|VARIABLES|ZONE)\b", re.IGNORECASE)
_TECPLOT_RECORD = re.compile(r"^[ \t]*(VARIABLES\b|ZONE\b)", re.IGNORECASE | re.MULTILINE)
_NUMBERS = re.compile(r"^[\s,;0-9.eEdD+*-]+$")
_OTHER_TABLES = (
    (("image", "x", "y", "merit"), "a table of detections"),
    (("image", "name", "x", "y"), "a table of matches"),
    (("node", "x", "y", "z"), "a table of node values"),
)


@dataclass(frozen=True)
class Guess:
    """What a file may be: the kinds, best first, and where there is none, what it is in words."""

    kinds: tuple[str, ...]
    instead: str = ""


def kind_of(source: Path, said: str | None = None) -> str:
    """One of `KINDS`.

    Parameters
    ----------
    source : the file, or a folder (a COLMAP model, or numbered pictures)
    said : what the user says it is

    Raises
    ------
    ValueError
        For an unknown ``said``, and where the content leaves it open.
    FileError
        For a file that is missing, or is none of them.
    """
    if said is not None and said not in KINDS:
        raise UsageError(f"--as must be one of {', '.join(KINDS)}, got {said!r}")
    address = io.frame_address(source)
    if address.number is not None or address.dataset is not None:
        return "pictures"
    if not source.exists():
        if io.is_recording(source):  # a pattern
            return "pictures"
        raise io.FileError(source, "no such file")
    if said is not None:
        return said
    guess = _guess(source)
    if len(guess.kinds) == 1:
        return guess.kinds[0]
    if guess.kinds:
        words = " or ".join(WORDS[kind] for kind in guess.kinds)
        raise UsageError(f"{source}: could be {words}; say which with --as {' or --as '.join(guess.kinds)}")
    what = f"is {guess.instead}" if guess.instead else "is of no known kind"
    raise io.FileError(source, f"{what}; expected a camera, a surface grid, a table of markers or pictures")


def refuse_target(source: Path, kind: str, target: Path) -> None:
    """Refuse a target that is not one of the kind's: one sentence that names what the source is and can become.

    Raises
    ------
    ValueError
    """
    suffixes = TARGETS[kind]
    suffix = target.suffix.lower() or "(no extension)"
    if suffix not in suffixes and not (kind == "pictures" and target.is_dir()):
        known = ", ".join(suffixes)
        verb = "holds" if kind == "pictures" else "is"
        raise UsageError(f"{source}: {verb} {WORDS[kind]}; the target's path must end in one of {known}, got {target}")


def _guess(source: Path) -> Guess:
    if source.is_dir():
        if (source / "cameras.txt").is_file():
            return Guess(("camera",))
        pictures = io.is_recording(source)
        return Guess(("pictures",) if pictures else (), "a folder without pictures and without cameras.txt")
    known = _BY_SUFFIX.get(source.suffix.lower())
    if known is not None:
        return Guess((known,))
    with reading(source), open(source, "rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if not head.strip():
        return Guess((), "empty")
    if head.startswith((b"\x89HDF\r\n\x1a\n", b"CDF")):
        return Guess((_hdf(source),))
    if head.startswith(UTF_16):
        return _text(source, head[: len(head) // 2 * 2].decode("utf-16", "replace"))
    if b"\0" in head:
        return _binary(source, head)
    return _text(source, head.decode("utf-8-sig", "replace"))


def _hdf(source: Path) -> str:
    """NetCDF of node values, or pictures."""
    try:
        names = read_apart("windmark.io.recordings.hdf:hdf_names", source)["names"]
    except io.FileError:  # the reader says what is wrong
        return "grid"
    return "grid" if {"vertices", "triangles"} <= set(names) else "pictures"


def _binary(source: Path, head: bytes) -> Guess:
    if io.is_recording(source):
        return Guess(("pictures",))
    if head.startswith(b"#!TDV") or source.suffix.lower() == ".dat":
        return Guess(("grid",))  # binary Tecplot is refused by the reader, in words
    try:
        io.fitting_layouts(source)
    except io.FileError:
        return Guess((), "binary, and no PLOT3D grid")
    return Guess(("grid",))


def _text(source: Path, text: str) -> Guess:
    """What a text file may be by what stands at its head."""
    start, suffix = text.lstrip()[:1], source.suffix.lower()
    if start == "<":
        return Guess(("grid",)) if "<VTKFile" in text else Guess(("camera",))
    if suffix == ".json" or start == "{":
        return Guess(("camera",))
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if lines and HINT.fullmatch(lines[0].strip()):
        lines = lines[1:]
    words = {word.strip().strip('"').lower() for word in re.split(r"[,;\t]", lines[0])} if lines else set()
    if {"name", "x", "y", "z"} <= {word.split(" [")[0] for word in words} and "node" not in words:
        return Guess(("markers",))
    for columns, what in _OTHER_TABLES:
        if set(columns) <= {word.split(" [")[0] for word in words}:
            return Guess((), f"{what}, which is not converted")
    if _TECPLOT.match(text) and _TECPLOT_RECORD.search(text):
        return Guess(("grid",))
    if lines and lines[0].split()[0].lower() in ("*targets", "*taps", "*virtuals", "*fiducials"):
        return Guess((), "a targets file; name it .tgts")
    if lines and all(_NUMBERS.match(line) for line in lines[:50]):
        return _numbers(source, suffix, lines)
    if io.is_camera_text(text):
        return Guess(("camera",))
    if suffix == ".csv" and io.is_recording(source):  # a table of an infrared camera, words at its head
        return Guess(("pictures",))
    return Guess((), "text of no known form (of markers: --columns names its columns)")


def _numbers(source: Path, suffix: str, lines: list[str]) -> Guess:
    """Nothing but numbers: a matrix of an infrared camera, a PLOT3D grid in text, or both could be meant."""
    try:
        io.fitting_layouts(source)
        kinds = ["grid"]
    except io.FileError:
        kinds = []
    cells = {len([c for c in re.split(r"[,;\s]+", line.strip()) if c]) for line in lines[:20]}
    if suffix == ".csv" and len(cells) == 1 and max(cells) >= _LEAST_WIDE and io.is_recording(source):
        kinds.append("pictures")
    what = f"a table of {max(cells)} numbers per line without a header (of markers: --columns names them)"
    return Guess(tuple(kinds), "" if kinds else what)
