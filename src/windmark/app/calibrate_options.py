"""What is typed for `windmark calibrate`, as settings: datum, lens, distances, cameras, labels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from windmark import io
from windmark.app import console
from windmark.calibration import Distance, Fixed, Free, Weighted
from windmark.calibration.datum import Datum
from windmark.calibration.self_calibrate import FREE, FREE_OF
from windmark.calibration.setup import FOCUS, PRINCIPAL
from windmark.errors import UsageError
from windmark.geometry import PARAMETERS, Camera
from windmark.pipeline.calibrate import Board
from windmark.tasks.calibrate.board_picture import MARK_KINDS

TABLES = (".csv", ".txt")
"""Matches, not pictures."""
LENSES = {"pinhole": FREE[:4], "radial": FREE[:6], "brown": FREE}
WIDE = ("rational", "fisheye")
MORE = {"k3": ("k3",), "tilts": ("tilt_x", "tilt_y"), "shear": ("shear",)}

DATUM_HELP = (
    "--datum is needed; what fixes position, direction and size is never guessed. "
    "free: the markers neither shift, turn nor grow on average against the table (best where nothing is known better); "
    "free:A,B,C only these hold it. "
    "fixed:A,B,C,D: these markers are exactly where the table has them; fixed: all of them. "
    "weighted: all markers with a sigma in the table are known so well; weighted:A,B,C these; weighted:A,B,C=0.1 or "
    "weighted=0.1 with this sigma"
)


def parse_datum(text: str | None, needed: bool = True) -> Datum | None:
    """``free[:names]``, ``fixed[:names]`` or ``weighted[:names][=sigma]``; nothing where it is not needed.

    Raises
    ------
    ValueError
        Explains the choices.
    """
    if text is None and not needed:
        return None
    if not text:
        raise UsageError(DATUM_HELP)
    head, equals, end = text.partition("=") if text.startswith("weighted") else (text, "", "")
    kind, colon, listed = head.partition(":")
    names = tuple(n.strip() for n in listed.split(",") if n.strip())
    if kind not in ("free", "fixed", "weighted") or (colon and not names):
        raise UsageError(f"--datum: {text!r} is none of the choices. {DATUM_HELP}")
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise UsageError(f"--datum: {twice[0]} is named twice")
    if kind == "fixed":
        if names and len(names) < 3:
            raise UsageError(f"--datum fixed: expected at least three markers, not on a line, or none for all, got "
                             f"{len(names)}")  # fmt: skip
        return Fixed(names or None)
    if kind == "free":
        if names and len(names) < 3:
            raise UsageError(f"--datum free: expected at least three markers, or none for all, got {len(names)}")
        return Free(names or None)
    sigma = _number(end, "--datum weighted", "a sigma behind =") if equals else None
    if sigma is not None and not sigma > 0:
        raise UsageError(f"--datum weighted: sigma must be > 0, got {sigma:g}")
    return Weighted(names or None, sigma)


def expanded(inputs: Sequence[Path]) -> tuple[io.PictureFile, ...]:
    """The inputs with recordings frame by frame; tables stay as they are."""
    parts = [[path] if path.suffix.lower() in TABLES else io.pictures([path]) for path in inputs]
    return tuple(item for part in parts for item in part)


def parse_lens(lens: str | None, free: str | None) -> tuple[str | None, tuple[str, ...] | None]:
    """The lens model, None where the marks or the camera's file say it, and the free parameters, None for its usual."""
    base, *more = (lens or "").split("+")
    if lens is None and free is None:
        return None, None
    if base in WIDE:
        named = None if free is None else parse_free(None, free)
        wrong = [m for m in more if m == "k3" or m not in MORE]
        if wrong or (more and named is not None):
            raise UsageError(f"--lens: expected {base}, {base}+tilts or {base}+shear, got {lens!r}")
        return base, (*FREE_OF[base], *(p for m in dict.fromkeys(more) for p in MORE[m])) if more else named
    return (None if lens is None else "brown"), parse_free(lens, free)


def parse_free(lens: str | None, free: str | None) -> tuple[str, ...]:
    """Parameters that are free: of a lens such as brown, +k3 or radial+tilts, or named one by one."""
    if free is not None:
        if lens is not None:
            raise UsageError("--lens and --free both say which parameters are free: give one of them")
        names = tuple(n.strip() for n in free.split(",") if n.strip())
        wrong = [n for n in names if n not in PARAMETERS]
        if wrong:
            raise UsageError(f"--free: {wrong[0]!r} is none of {', '.join(PARAMETERS)}")
        return names
    base, *more = (lens or "brown").split("+")
    wrong = [m for m in more if m not in MORE]
    if (base and base not in LENSES) or wrong:
        raise UsageError(
            f"--lens: expected {', '.join((*LENSES, *WIDE))}, followed by {' or '.join('+' + m for m in MORE)}, "
            f"got {lens!r}"
        )
    return (*LENSES[base or "brown"], *(p for m in dict.fromkeys(more) for p in MORE[m]))


def parse_distances(texts: Sequence[str]) -> tuple[Distance, ...]:
    """``A,B,length,sigma`` each."""
    out = []
    for text in texts:
        parts = [p.strip() for p in text.split(",")]
        if len(parts) != 4:
            raise UsageError(f"--distance: expected A,B,length,sigma, got {text!r}")
        length, sigma = (_number(p, "--distance", "A,B,length,sigma") for p in parts[2:])
        if not (length > 0 and sigma > 0) or parts[0] == parts[1]:
            raise UsageError(f"--distance: expected two markers, length > 0 and sigma > 0, got {text!r}")
        out.append(Distance(parts[0], parts[1], length, sigma))
    return tuple(out)


OF_PICTURES = {FOCUS: "--free-focal", PRINCIPAL: "--free-principal"}
"""What is said of single pictures, and the option that says of which."""
USUAL = {FOCUS: "0.003", PRINCIPAL: "10"}
"""How far they differ where a camera focuses by itself."""


def parse_priors(texts: Sequence[str], asked: Mapping[str, Sequence[str] | None]) -> dict[str, float]:
    """``parameter=sigma`` each; ``asked``: pictures by the options of `OF_PICTURES`."""
    out = {}
    for text in texts:
        name, _, end = text.partition("=")
        if name not in (*PARAMETERS, *OF_PICTURES):
            raise UsageError(f"--prior-sigma: {name!r} is none of {', '.join((*PARAMETERS, *OF_PICTURES))}")
        out[name] = _number(end, "--prior-sigma", "PARAMETER=sigma")
        if not out[name] > 0:
            raise UsageError(f"--prior-sigma: sigma must be > 0, got {text!r}")
        if (option := OF_PICTURES.get(name)) and not asked[option]:
            raise UsageError(f"--prior-sigma: {name} is of the pictures of {option}, which names none (or all)")
    for name, option in OF_PICTURES.items():
        if name not in out and list(asked[option] or ()) == ["all"]:
            raise UsageError(
                f"{option} all: where every picture has its own nothing tells the camera's; say how far they differ, "
                f"as in --prior-sigma {name}={USUAL[name]}"
            )
    return out


def read_cameras(texts: Sequence[str]) -> dict[str, Camera]:
    """Start values from files, named ``NAME=FILE`` or, where there are several, by the file's stem."""
    out: dict[str, Camera] = {}
    for text in texts:
        name, equals, file = text.partition("=")
        path = Path(file if equals else text)
        key = name if equals else path.stem if len(texts) > 1 else "camera"
        if key in out:
            raise UsageError(f"--camera: two cameras have the name {key}; give NAME=FILE")
        out[key] = console.read_lens(path)
    return out


def parse_patterns(texts: Sequence[str]) -> dict[str, str]:
    """``NAME=PATTERN`` each: camera -> pattern of its images' names."""
    out: dict[str, str] = {}
    for text in texts:
        name, _, pattern = text.partition("=")
        if not name or "*" not in pattern:
            raise UsageError(f"--images-of: expected NAME=PATTERN with a * in it, such as left=*_0, got {text!r}")
        if name in out:
            raise UsageError(f"--images-of: the camera {name} is there twice; give one pattern for each")
        out[name] = pattern
    return out


def parse_board(pitch: float | None, marks: str | None, size: str | None, layout: str, unit: str) -> Board | None:
    """The board, from its pitch in a length unit, ``KIND:column,row:...`` of its marks, COLUMNSxROWS and
    LAYOUT[:aspect].
    """
    if pitch is None:
        if marks is not None or size is not None or layout != "square":
            raise UsageError("--board-marks, --board-size and --board-layout describe a board: --board PITCH is needed")
        return None
    kind, cells = _board_marks(marks)
    columns, rows = _board_size(size)
    name, colon, end = layout.partition(":")
    aspect = _number(end, "--board-layout", "LAYOUT:ASPECT") if colon else 1.0
    if name not in ("square", "staggered") or not aspect > 0:
        raise UsageError(f"--board-layout: expected square or staggered, then perhaps :ASPECT > 0, got {layout!r}")
    return Board(pitch, cells, kind, columns, rows, name, aspect, unit)


def _board_size(text: str | None) -> tuple[int | None, int | None]:
    if text is None:
        return None, None
    found = re.fullmatch("([0-9]{1,6})x([0-9]{1,6})", text.lower())
    columns, rows = (int(part) for part in found.groups()) if found else (0, 0)
    if not (columns and rows):
        raise UsageError(f"--board-size: expected COLUMNSxROWS, as in 12x9, got {text!r}")
    return columns, rows


def _board_marks(text: str | None) -> tuple[str, tuple[tuple[int, int], ...]]:
    if text is None:
        return MARK_KINDS[0], ()
    form = f"expected {', '.join(MARK_KINDS)}, then :column,row of two dots or more, such as holes:0,0:5,0:0,3"
    kind, *cells = text.split(":")
    try:
        found = tuple((int(column), int(row)) for column, row in (c.split(",") for c in cells))
    except ValueError:
        raise UsageError(f"--board-marks: {form}, got {text!r}") from None
    if kind not in MARK_KINDS or len(set(found)) < max(2, len(found)):
        raise UsageError(f"--board-marks: {form}, got {text!r}")
    return kind, found


def parse_labels(texts: Sequence[str], table: Path | None) -> dict[str, dict[str, tuple[float, float]]]:
    """``IMAGE:NAME=x,y`` each, and a table ``image,name,x,y``."""
    out: dict[str, dict[str, tuple[float, float]]] = {}
    if table is not None:
        known = io.read_matches(table)
        for image, name, (x, y) in zip(known.image, known.name, known.xy, strict=True):
            out.setdefault(str(image), {})[str(name)] = (float(x), float(y))
    for text in texts:
        who, _, place = text.rpartition("=")
        image, colon, name = who.partition(":")
        xy = place.split(",")
        if not (image and colon and name) or len(xy) != 2:
            raise UsageError(f"--label: expected IMAGE:NAME=x,y, got {text!r}")
        x, y = (_number(p, "--label", "IMAGE:NAME=x,y") for p in xy)
        if name in out.setdefault(image, {}):
            raise UsageError(f"--label: {name} is given twice in {image}; a marker has one place")
        out[image][name] = (x, y)
    return out


def _number(text: str, option: str, form: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{option}: expected {form}, a number, got {text!r}") from None
    if value != value or value in (float("inf"), float("-inf")):
        raise UsageError(f"{option}: expected {form}, a finite number, got {text!r}")
    return value
