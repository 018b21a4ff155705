"""NASA's targets files (``.tgts``, written by DOTS, read by uPSP): targets, taps, virtuals, fiducials.

Rows are free-form: ``index x y z nx ny nz size zone i j name``, in sections ``*Targets``, ``*Taps``,
``*Virtuals`` and ``*Fiducials``; rows before any section are targets; ``#`` starts a comment.
Source: the file format pages of NASA's upsp-processing and its test data. The size is a *diameter*
(checked on that data), halved here. Zone, i and j place the entry in the grid file only roughly,
and are dropped.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from windmark.errors import UsageError
from windmark.io.atomic import atomic_write
from windmark.io.errors import LARGEST, FileError
from windmark.io.fields import written_by
from windmark.io.mesh_content import check_names
from windmark.io.text import Pathlike, read_text
from windmark.scene import MarkerSet

SECTIONS = {"*targets": "model", "*taps": "tap", "*virtuals": "virtual", "*fiducials": "fiducial"}
"""Role of the entries of each section."""

_TARGETS = "*targets"
_NOT_WRITTEN = re.compile(r"\s{2,}|[^\S ]|^\s|\s$|^$")
"""Spaces that a row of words does not give back."""

_NUMBERS = ("index", "x", "y", "z", "nx", "ny", "nz", "size", "zone", "i", "j")


@dataclass(frozen=True)
class _Entry:
    line: int
    role: str
    name: str
    xyz: tuple[float, ...]
    normal: tuple[float, ...]
    radius: float


def read_tgts(path: Pathlike) -> MarkerSet:
    """All entries of a ``.tgts`` file, told apart by role: model (targets), tap, virtual, fiducial.

    A name that an earlier section used already gets the role in front ("tap:st01").
    A size of 0 is an unknown radius, a normal of length 0 an unknown normal.

    Raises
    ------
    FileError
        Names the line.
    """
    role = "model"
    entries: list[_Entry] = []
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        words = text.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0].startswith("*"):
            section = "".join(words).lower()
            if section not in SECTIONS:
                known = ", ".join(key.title() for key in SECTIONS)
                raise FileError(path, f"unknown section {text.strip()!r}; expected one of {known}", line)
            role = SECTIONS[section]
            continue
        entries.append(_entry(path, line, role, words))
    return MarkerSet.make(
        _unique_names(path, entries),
        [entry.xyz for entry in entries],
        radius=[entry.radius for entry in entries],
        normal=[entry.normal for entry in entries],
        role=[entry.role for entry in entries],
    )


def _entry(path: Pathlike, line: int, role: str, words: list[str]) -> _Entry:
    if len(words) <= len(_NUMBERS):
        what = f"{len(words)} values; expected {len(_NUMBERS) + 1} ({' '.join(_NUMBERS)} name)"
        raise FileError(path, what, line)
    values = [_number(path, line, key, word) for key, word in zip(_NUMBERS, words, strict=False)]
    size = values[7]
    if size < 0:
        raise FileError(path, f"size is {size}; expected a diameter >= 0", line)
    name = " ".join(words[len(_NUMBERS) :])
    check_names(path, [name], line)
    return _Entry(
        line,
        role,
        name,
        tuple(values[1:4]),
        tuple(values[4:7]),
        size / 2 if size else math.nan,
    )


def _number(path: Pathlike, line: int, key: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST or "_" in word:
        most = f" of at most {LARGEST:g}" if math.isfinite(value) else ""
        raise FileError(path, f"{key} is {word!r}; expected a finite number{most}", line)
    return value


def _unique_names(path: Pathlike, entries: list[_Entry]) -> list[str]:
    """Names, with the role in front where an earlier section has the name already."""
    taken: dict[str, _Entry] = {}
    for entry in entries:
        first = taken.get(entry.name)
        name = entry.name if first is None or first.role == entry.role else f"{entry.role}:{entry.name}"
        if name in taken:
            what = f"the name {name!r} is already on line {taken[name].line}; names must be unique in a section"
            raise FileError(path, what, entry.line)
        taken[name] = entry
    return list(taken)


def write_tgts(path: Pathlike, markers: MarkerSet, *, length_unit: str = "") -> None:
    """Write markers as a ``.tgts`` file: a section per role, whole or not at all.

    Targets are model, wall, primary and secondary markers alike (`read_tgts` gives them back as model); their sigmas
    and volumes have no place. An unknown radius is a size of 0, an unknown normal 0 0 0, and zone, i and j, which
    nothing here knows, are 0. Every number keeps all its digits.

    Parameters
    ----------
    path : the file
    markers : the markers
    length_unit : unit of the coordinates, written as a comment

    Raises
    ------
    ValueError
        For a name that is empty or has spaces which a row of words does not give back.
    FileError
        When the file cannot be written.
    """
    for name in markers.name.tolist():
        if _NOT_WRITTEN.search(name):
            raise UsageError(f"write_tgts: a name must not be empty, nor have double or outer spaces: {name!r}")
    lines = [f"# {written_by()}"] + ([f"# length unit: {length_unit}"] if length_unit else [])
    section_of = {role: key for key, role in SECTIONS.items()}
    sections = [section_of.get(role, _TARGETS) for role in markers.role.tolist()]
    taken: set[str] = set()
    for section, role in SECTIONS.items():
        rows = [k for k, of in enumerate(sections) if of == section]
        lines += [f"*{section[1:].title()}"] if rows else []
        for index, k in enumerate(rows, start=1):
            bare = str(markers.name[k]).removeprefix(f"{role}:")
            name = bare if bare in taken else str(markers.name[k])  # read_tgts puts the role in front again
            lines.append(" ".join([str(index), *_words(markers, k), "0 0 0", name]))
        taken.update(str(markers.name[k]) for k in rows)
    with atomic_write(path) as stream:
        stream.write("\n".join(lines) + "\n")


def _words(markers: MarkerSet, k: int) -> list[str]:
    """X y z nx ny nz size; 0 for what is not known."""
    numbers = [*markers.xyz[k], *np.nan_to_num(markers.normal[k]), np.nan_to_num(2 * markers.radius[k])]
    return [repr(float(v)) for v in numbers]
