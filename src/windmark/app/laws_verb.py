"""The verb `windmark laws`: the built-in deformation laws, and the check of a user's own."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn, write_png
from windmark.app.laws_examples import HALF, UNIT, Shown, example, of_user, wing_points
from windmark.app.verdict_words import judged
from windmark.deformation import Law, UserLaw, check_law, laws_of_source
from windmark.deformation.laws import CATALOG, Entry
from windmark.errors import UsageError
from windmark.io.text import read_text
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.verdict.laws import laws_verdict

Record = dict[str, Any]


def built_in(pictures: Path | None, as_json: bool) -> None:
    """List the built-in laws; with a folder, one picture of each."""
    shown = {kind: example(kind) for kind in CATALOG}
    record: Record = {"laws": [_entry(entry, shown[kind].law) for kind, entry in CATALOG.items()]}
    lines = [line for entry in record["laws"] for line in _entry_lines(entry)]
    lines.append(f"Lengths are in the project's unit, {UNIT} here; the parameters are those of examples on {HALF}.")
    if pictures is not None:
        record |= _save(pictures, shown)
        lines += [*not_drawn(record["not_drawn"]), f"pictures: {pictures}"]
    console.answer(record, as_json, lines)


def check_file(file: Path, markers: Path | None, volume: str | None, pictures: Path | None, as_json: bool) -> None:
    """Load a user's file and check every law in it."""  # fmt: skip
    if volume is not None and markers is None:
        raise UsageError("--volume has no meaning without --markers")
    laws = laws_of_source(read_text(file), str(file))
    points, where = _points(markers, volume)
    entries = [{**_user_law(name, law), "remarks": check_law(law, points, name=name)} for name, law in laws.items()]
    record: Record = {"file": file, "points": len(points), "of": where, "laws": entries}
    lines = [f"{file}: {len(laws)} {'law' if len(laws) == 1 else 'laws'}, checked on {len(points)} {where}"]
    for entry in entries:
        lines += [*_entry_lines(entry), *(f"  remark: {text}" for text in entry["remarks"])]
        lines += [] if entry["remarks"] else ["  sound: finite, continuous, every parameter has an effect"]
    lines += judged(record, laws_verdict({e["name"]: e["remarks"] for e in entries}, len(points)))
    if pictures is not None:
        record |= _save(pictures, {name: of_user(law) for name, law in laws.items()})
        lines += [*not_drawn(record["not_drawn"]), f"pictures, on a half wing: {pictures}"]
    console.answer(record, as_json, lines)


def _points(markers: Path | None, volume: str | None) -> tuple[NDArray[np.float64], str]:
    """What laws are checked on: a volume's markers, or the half wing of the virtual wind tunnel."""
    if markers is None:
        return wing_points(), f"points of {HALF} (--markers takes your own)"
    every = Lengths().markers(markers)
    model = every.xyz[every.role != "wall"], every.volume[every.role != "wall"]
    if volume is None:
        return model[0], f"markers of {markers}"
    mine = model[1] == volume
    if not mine.any():
        raise io.FileError(markers, f"no marker of volume {volume!r}; it has {', '.join(sorted(set(model[1])))}")
    return model[0][mine], f"markers of volume {volume}"


def _save(folder: Path, shown: Mapping[str, Shown]) -> Record:
    """The pictures that were drawn, and those that could not be."""
    from windmark.app.laws_pictures import law_picture

    failed: list[str] = []
    with console.result_folder(folder) as out:
        for name, one in shown.items():
            write_png(out.place / f"{name}.png", partial(law_picture, name, one), failed)
        drawn = [f"{name}.png" for name in shown if (out.place / f"{name}.png").exists()]
    return {"pictures": drawn, "not_drawn": failed}


def _entry(entry: Entry, law: Law) -> Record:
    options = [
        {"name": o.name, "expected": o.expected, "meaning": o.meaning, "required": o.required,
         "default": None if o.required else o.default}
        for o in entry.options
    ]  # fmt: skip
    return {"name": entry.kind, "line": entry.line, "options": options, "example": entry.example, **_parameters(law)}


def _user_law(name: str, law: UserLaw) -> Record:
    text = (inspect.unwrap(law.function).__doc__ or "").strip().splitlines()
    options = [
        {"name": key, "expected": type(value).__name__, "meaning": "", "required": False, "default": value}
        for key, value in law.settings.items()
    ]
    return {"name": name, "line": text[0] if text else "", "source": law.source, "options": options,
            **_parameters(law)}  # fmt: skip


def _parameters(law: Law) -> Record:
    return {"parameters": [
        {"name": p.name, "unit": p.unit, "start": p.start, "sigma": p.sigma, "lower": p.lower, "upper": p.upper}
        for p in law.parameters
    ]}  # fmt: skip


def _entry_lines(entry: Record) -> list[str]:
    named = [p["name"] + (f" ({p['unit']})" if p["unit"] else "") for p in entry["parameters"]]
    more = [f"... {len(named)} in all"] if len(named) > 8 else []
    lines = [f"{entry['name']}" + (f": {entry['line']}" if entry["line"] else "")]
    for option in entry["options"]:
        text = f"; {option['meaning']}" if option["meaning"] else ""
        given = "required" if option["required"] else f"default {_shown(option['default'])}"
        lines.append(f"  option {option['name']}: {option['expected']}{text} [{given}]")
    return [*lines, f"  parameters: {', '.join([*named[:8], *more])}"]


def _shown(value: Any) -> str:
    if value is None or value == "":
        return "none"
    if isinstance(value, tuple | list | np.ndarray):
        return "[" + ", ".join(_shown(v) for v in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)
