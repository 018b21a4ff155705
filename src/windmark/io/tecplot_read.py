"""Read Tecplot ASCII surfaces: ordered zones, triangles and quadrilaterals with values at their nodes."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError, reading
from windmark.io.fields import LENGTH, split_label
from windmark.io.mesh_content import check_names
from windmark.io.numbers_text import NumberText, parse_numbers
from windmark.io.structured import Volumes, rename_volumes, structured_mesh
from windmark.io.tecplot import equals_fill
from windmark.scene import Block, Mesh

Array = NDArray[np.float64]

# A line of words; lines of numbers may also begin with the letters of NaN or infinity, as other programs write them.
_WORDS = re.compile(rb'^[ \t]*(?!nan|inf)[A-Za-z"#(].*$', re.MULTILINE | re.IGNORECASE)
_SETTING = re.compile(r'(?<!\w)([A-Za-z_]\w*+)\s*+=\s*+("[^"]*"|\([^)]*\)|[^\s,"()]+)')
_NAME = re.compile(r'"([^"]*)"|([^\s,"]+)')
_SHARED = re.compile(r"\(\[([\d,-]+)\]=(\d{1,9})\)")
_DIGITS, _LONGEST = 15, 100_000
_SIZE_KEYS = {True: (("I",), ("J",), ("K",)), False: (("N", "NODES"), ("E", "ELEMENTS"))}
_NODES_OF = {"FETRIANGLE": 3, "FEQUADRILATERAL": 4}
_IGNORED = ("TITLE", "VARAUXDATA", "FILETYPE")
_UNKNOWN = ("TEXT", "GEOMETRY", "CUSTOMLABELS", "USERREC")


@dataclass
class _Zone:
    """A zone as written: settings in capitals, auxiliary data in small letters."""

    line: int
    header: str
    aux: dict[str, str] = field(default_factory=dict)
    pieces: list[bytes] = field(default_factory=list)
    data_line: int = 0

    @property
    def data(self) -> bytes:
        """The numbers, whatever words stand between them."""
        return b"".join(self.pieces)

    @property
    def settings(self) -> dict[str, str]:
        return {key.upper(): value.strip('"') for key, value in _SETTING.findall(self.header)}


@dataclass
class _Content:
    path: Path
    variables: str = ""
    aux: dict[str, str] = field(default_factory=dict)
    zones: list[_Zone] = field(default_factory=list)


@dataclass(frozen=True)
class _Part:
    """A zone's content: ``shape`` is None for finite elements, ``values`` those of zone ``shared`` if there is one."""

    name: str
    volume: str
    values: Array
    elements: NDArray[np.int64]
    shape: tuple[int, int, int] | None
    shared: int | None


def read_tecplot(
    path: str | os.PathLike[str], *, volumes: Volumes = None
) -> tuple[Mesh, dict[str, NDArray[np.floating]]]:
    """Read the mesh and the values per node of a Tecplot ASCII file.

    Parameters
    ----------
    path : the file. Read are ordered zones that are surfaces and zones of triangles or quadrilaterals, in POINT
        or BLOCK packing; x, y and z must be among the variables
    volumes : one volume name for all, or {volume in the file: volume} for some; in the file it is the zone's
        auxiliary ``Volume`` or its name

    Returns
    -------
    mesh : with blocks if all zones are ordered
    fields : variable's name -> (V,) values. A variable ``iblank`` becomes the mesh's blanked nodes, the fill value
        that the file names becomes NaN, and ``valid`` beside it is left out

    Raises
    ------
    FileError
        For what is no such file, or holds other numbers than its zones declare: names the line.
    """
    with reading(path):
        raw = Path(path).read_bytes()
    mesh, columns, _ = _read(path, raw, volumes)
    return mesh, columns


def read_tecplot_nodes(
    path: str | os.PathLike[str], *, volumes: Volumes = None
) -> tuple[Mesh, dict[str, NDArray[np.floating]], dict[str, str]]:
    """As `read_tecplot`, with names and units apart.

    Returns
    -------
    mesh, fields (name -> (V,) values), units (name -> unit where the name carries one as ``name [unit]``, and "length"
    of the coordinates)
    """
    with reading(path):
        raw = Path(path).read_bytes()
    mesh, columns, length_unit = _read(path, raw, volumes)
    apart = {text: split_label(text) for text in columns}
    short = [name for name, _ in apart.values()]
    fields, units = {}, {LENGTH: length_unit}
    for text, values in columns.items():
        name, unit = apart[text] if short.count(apart[text][0]) == 1 else (text, "")
        fields[name], units[name] = values, unit
    return mesh, fields, {name: unit for name, unit in units.items() if unit}


def _read(
    path: str | os.PathLike[str], raw: bytes, volumes: Volumes
) -> tuple[Mesh, dict[str, NDArray[np.floating]], str]:
    """Mesh, columns by their variables' names, the coordinates' unit ("" where nothing says it)."""
    content = _parse(raw, Path(path))
    names = [quoted or bare for quoted, bare in _NAME.findall(content.variables)]
    _check_once(content.path, names)
    parts: list[_Part] = []
    for zone in content.zones:
        parts.append(_part(content.path, zone, len(names), len(parts)))
    if not parts:
        raise FileError(path, "no ZONE; expected a Tecplot ASCII file")
    columns = dict(zip(names, np.concatenate([p.values for p in parts], axis=1), strict=True))
    fill = _fill(content)
    blank = next((n for n in names if n.lower() == "iblank"), None)
    blanked = None if blank is None else columns.pop(blank) == 0
    if fill is not None:
        columns = {n: np.where(equals_fill(c, fill), np.nan, c) for n, c in columns.items()}
        columns.pop("valid", None)
    axes = [split_label(name) for name in columns]
    told = next((unit for name, unit in axes if name.strip().lower() == "x"), "")
    vertices = np.stack([_axis(content.path, columns, axis) for axis in "xyz"], axis=1)
    fields: dict[str, NDArray[np.floating]] = dict(columns)
    unit = content.aux.get("lengthunit", told)
    return replace(_mesh(vertices, parts, blanked, volumes), length_unit=unit), fields, unit


def _check_once(path: Path, names: list[str]) -> None:
    """`FileError` where one name means two variables; coordinates and blanking go by any case, and with any unit."""
    bare = [split_label(name)[0].strip().lower() for name in names]
    any_case = ("x", "y", "z", "iblank")
    meant = [word if word in any_case else name.strip() for word, name in zip(bare, names, strict=True)]
    twice = next((name for name, times in Counter(meant).items() if times > 1), None)
    if twice is not None:
        told = " and ".join(repr(n) for n, m in zip(names, meant, strict=True) if m == twice)
        raise FileError(path, f"{told} are two variables of one name; expected a name of its own for each", "VARIABLES")


def _fill(content: _Content) -> float | None:
    """The value that stands for NaN, if the file names one."""
    text = content.aux.get("nanvalue")
    try:
        return None if text is None else float(text)
    except ValueError:
        raise FileError(content.path, f"NanValue is {text!r}; expected a number", "DATASETAUXDATA") from None


def _axis(path: Path, columns: dict[str, Array], axis: str) -> Array:
    """Take a coordinate out of the columns; its name may carry a unit."""
    for name in columns:
        if split_label(name)[0].strip().lower() == axis:
            return columns.pop(name)
    raise FileError(path, f"no variable {axis}; it has {list(columns)}", "VARIABLES")


def _parse(raw: bytes, path: Path) -> _Content:
    """Split the file into its records; numbers stay text."""
    content = _Content(path)
    record = ""
    for text, line, data, data_line in _lines_of_words(raw):
        if not text.startswith("#"):
            word = re.match(r"\w*", text)[0].upper()  # type: ignore[index]
            rest = text[len(word) :]
            if word in _UNKNOWN:
                raise FileError(path, f"{word} records are not read; expected zones only", line)
            if word == "ZONE":
                content.zones.append(_Zone(line, rest))
            elif word == "VARIABLES":
                content.variables = rest.replace("=", " ", 1)
            elif word in ("DATASETAUXDATA", "AUXDATA"):
                aux = content.zones[-1].aux if word == "AUXDATA" and content.zones else content.aux
                aux.update({key.lower(): value.strip('"') for key, value in _SETTING.findall(rest)})
            elif word not in _IGNORED:
                _continue(content, record, text, line)
            record = word if word in ("ZONE", "VARIABLES", "DATASETAUXDATA", "AUXDATA", *_IGNORED) else record
        if data.strip():
            if not content.zones:
                raise FileError(path, "numbers before the first ZONE", data_line)
            zone = content.zones[-1]
            zone.data_line = zone.data_line or data_line
            zone.pieces.append(data)
    return content


def _continue(content: _Content, record: str, text: str, line: int) -> None:
    """A line that continues the record above it."""
    if record == "ZONE" and not content.zones[-1].pieces:
        content.zones[-1].header += " " + text
        size = len(content.zones[-1].header)
    elif record == "VARIABLES":
        content.variables += " " + text
        size = len(content.variables)
    else:
        raise FileError(content.path, f"expected a record of a Tecplot ASCII file, got {text[:30]!r}", line)
    if size > _LONGEST:
        raise FileError(content.path, f"the {record} record has over {_LONGEST} characters; expected fewer", line)


def _lines_of_words(raw: bytes) -> Iterator[tuple[str, int, bytes, int]]:
    """Each line of words with its number, and the numbers between it and the next with theirs."""
    matches = list(_WORDS.finditer(raw))
    first = raw[: matches[0].start()] if matches else raw
    if first.strip():
        yield "#", 1, first, 1
    line, at = 1, 0
    for match, after in zip(matches, [*matches[1:], None], strict=True):
        line, at = line + raw.count(b"\n", at, match.start()), match.start()
        data = raw[match.end() : after.start() if after else len(raw)]
        yield match.group().decode("utf-8", "replace").strip(), line, data, line


def _part(path: Path, zone: _Zone, n_variables: int, index: int) -> _Part:
    """Take a zone's numbers apart as its header says."""
    settings = zone.settings
    kind, packing = _kind(path, zone, settings, n_variables)
    sizes = [_whole(path, zone, settings, *keys) for keys in _SIZE_KEYS[kind == "ORDERED"]]
    shape = None
    if kind == "ORDERED":
        shape = (sizes[0], sizes[1], sizes[2])
        if min(shape) > 1:
            raise FileError(path, f"a zone of {shape} nodes is a volume; expected a surface", zone.line)
    nodes, elements = (math.prod(sizes), 0) if shape else (sizes[0], sizes[1])
    per_element = _NODES_OF.get(kind, 0)
    shared = _shared(path, zone, settings, n_variables, index)
    n_values = 0 if shared is not None else nodes * n_variables
    numbers = parse_numbers(zone.data, path, zone.data_line)
    if numbers.total != n_values + elements * per_element:
        what = f"{n_values} values of {nodes} nodes and {elements * per_element} node numbers"
        raise FileError(path, f"the zone holds {numbers.total} numbers; expected {what}", zone.line)
    values = numbers.all()[:n_values]
    columns = values.reshape(-1, n_variables).T if packing == "POINT" else values.reshape(n_variables, -1)
    corners = _corners(path, zone, numbers, n_values, nodes, per_element)
    name = settings.get("T", f"zone{index + 1:02d}")
    volume = zone.aux.get("volume", name)
    check_names(path, (name, volume), zone.line)
    return _Part(name, volume, columns, corners, shape, shared)


def _kind(path: Path, zone: _Zone, settings: dict[str, str], n_variables: int) -> tuple[str, str]:
    """(zone type, packing) in capitals, from the words of new and old files."""
    old = settings.get("F", "").upper()
    element = f"FE{settings.get('ET', 'TRIANGLE')}".upper() if old.startswith("FE") else "ORDERED"
    kind = settings.get("ZONETYPE", element).upper()
    if kind not in ("ORDERED", *_NODES_OF):
        raise FileError(path, f"zone type {kind} is not read; expected one of {['ORDERED', *_NODES_OF]}", zone.line)
    if "CELLCENTERED" in settings.get("VARLOCATION", "").upper():
        raise FileError(path, "values at cell centres are not read; expected values at nodes", zone.line)
    for key in ("PASSIVEVARLIST", "CONNECTIVITYSHAREZONE"):
        if key in settings:
            raise FileError(path, f"{key} is not read; expected all variables and elements in every zone", zone.line)
    packing = settings.get("DATAPACKING", old.removeprefix("FE")).upper()
    if not packing and len(zone.data.lstrip().split(b"\n", 1)[0].split()) == n_variables:
        packing = "POINT"
    if packing not in ("POINT", "BLOCK"):
        raise FileError(path, f"DATAPACKING is {packing or 'missing'}; expected POINT or BLOCK", zone.line)
    return kind, packing


def _whole(path: Path, zone: _Zone, settings: dict[str, str], *keys: str) -> int:
    """A size of the zone; I, J and K are 1 where they are left out."""
    text = next((settings[key] for key in keys if key in settings), "1" if len(keys) == 1 else "")
    if not text.isdecimal() or len(text) > _DIGITS or int(text) < 1:
        raise FileError(path, f"{keys[0]} is {text[:40] or 'missing'}; expected a whole number above 0", zone.line)
    return int(text)


def _shared(path: Path, zone: _Zone, settings: dict[str, str], n_variables: int, index: int) -> int | None:
    """The 0-based zone whose nodes this one shares."""
    if "VARSHARELIST" not in settings:
        return None
    match = _SHARED.fullmatch("".join(settings["VARSHARELIST"].split()))
    if match is None or match[1] != f"1-{n_variables}" or not 1 <= int(match[2]) <= index:
        what = f"VARSHARELIST is {settings['VARSHARELIST']}; expected ([1-{n_variables}]=N) with a zone N above"
        raise FileError(path, what, zone.line)
    return int(match[2]) - 1


def _corners(path: Path, zone: _Zone, numbers: NumberText, at: int, nodes: int, per_element: int) -> NDArray[np.int64]:
    """(E, 3) 0-based triangles; quadrilaterals are split, and halves without a third corner left out."""
    if not per_element:
        return np.zeros((0, 3), dtype=np.int64)
    corners = numbers.all()[at:].reshape(-1, per_element)
    if len(corners) and not (corners.min() >= 1 and corners.max() <= nodes and (corners == np.floor(corners)).all()):
        raise FileError(path, f"an element names a node that is none; expected whole numbers 1 to {nodes}", zone.line)
    index = corners.astype(np.int64) - 1
    if per_element == 3:
        return index
    halves = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])
    a, b, c = halves.T
    return halves[(a != b) & (b != c) & (c != a)]


def _mesh(vertices: Array, parts: list[_Part], blanked: NDArray[np.bool_] | None, volumes: Volumes) -> Mesh:
    """Put the zones together."""
    starts = np.cumsum([0, *(p.values.shape[1] for p in parts)]).tolist()
    names = rename_volumes([p.volume for p in parts], volumes)
    blocks = tuple(Block(p.name, p.shape, s) for p, s in zip(parts, starts, strict=False) if p.shape)
    if len(blocks) == len(parts):
        return structured_mesh(vertices, blocks, blanked, volumes=names)
    triangles, of_triangle = [], []
    for k, part in enumerate(parts):
        first = starts[k if part.shared is None else part.shared]
        own = part.elements + first
        if part.shape:
            one = structured_mesh(vertices, (Block(part.name, part.shape, first),), blanked)
            own = one.triangles.astype(np.int64)
        elif blanked is not None:
            own = own[~blanked[own].any(axis=1)]
        triangles.append(own)
        of_triangle += [names[k]] * len(own)
    mesh = Mesh.make(vertices, np.concatenate(triangles).astype(np.int32), np.array(of_triangle, dtype=np.str_))
    return Mesh(mesh.vertices, mesh.triangles, mesh.volume, (), blanked)
