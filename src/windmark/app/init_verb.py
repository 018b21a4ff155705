"""The verb `windmark init`: a commented project file from a folder of pictures, tables, grids and cameras."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import typer

from windmark import io
from windmark.app import console
from windmark.app.progress import progress
from windmark.errors import UsageError
from windmark.pipeline.folder import FolderContent, look_into
from windmark.pipeline.new_project import Choice, choose, different_tables, missing, project_text
from windmark.pipeline.new_series import (
    COMMANDS,
    PROJECTS,
    command,
    known_markers,
    parts_of,
    series_missing,
    series_text,
)
from windmark.pipeline.typed import typed

SHOWN = 8
"""Files that could not be used that are listed."""


def init(folder: Path, output: Path | None, given: dict[str, Any], title: str | None, ask: bool, as_json: bool,
         verb: str = "run") -> None:  # fmt: skip
    """Look, choose, ask for what is not clear (on a terminal), write, say what is missing."""
    if verb not in (*PROJECTS, *COMMANDS):
        raise UsageError(f"--for: expected one of {', '.join((*PROJECTS, *COMMANDS))}, got {verb}")
    if not folder.is_dir():
        raise UsageError(f"{folder}: expected a folder with pictures, marker table, camera and grid")
    target = output or folder / ("project.toml" if verb == "run" else f"{verb}.toml")
    if verb in PROJECTS and target.exists():
        raise UsageError(f"{target} is there already and is not written over; --output OTHER.toml, or take it away")
    unit = given.get("unit")
    if unit is not None and unit not in io.LENGTH_UNITS:
        raise UsageError(f"--unit must be one of {', '.join(io.LENGTH_UNITS)}, got {unit}")
    given = {k: v for k, v in given.items() if v is not None}
    with progress() as show:
        content = look_into(folder, show)
        _read_given(content, given)
    if not (content.pictures or content.cameras or content.markers or content.grids):
        why = "; ".join(f"{p.name}: {w}" for p, w in list(content.left_out.items())[:3])
        said = f"{folder}: nothing of a test was found in it{f' ({why})' if why else ''}"
        raise UsageError(f"{said}; expected pictures, a marker table, a camera file, a grid")
    if verb == "reconstruct" and (primary := known_markers(content)) is not None:
        given = {"markers": primary} | given
    choice = choose(content, given)
    if ask and not as_json and sys.stdin.isatty() and sys.stderr.isatty():
        _ask(content, choice)
    if verb in COMMANDS:
        _say_command(content, choice, verb, output, as_json)
        return
    name = title or folder.resolve().name
    if verb == "run":
        text = project_text(content, choice, name, target.parent)
    else:
        choice.missing += series_missing(content, choice, verb)
        text = series_text(content, choice, verb, name, target.parent)
    with io.atomic_write(target) as stream:
        stream.write(text)
    record = {
        "project": target, "pictures": len(content.pictures), "cameras": [str(p) for p in content.cameras],
        "markers": choice.markers, "grid": choice.grid, "length_unit": choice.unit, "missing": choice.missing,
        "left_out": {str(p): w for p, w in content.left_out.items()},
    }  # fmt: skip
    console.answer(record, as_json, _lines(content, choice, target, verb))


def _read_given(content: FolderContent, given: dict[str, Any]) -> None:
    """Files that were named are read, too, wherever they are: they must be what they are said to be."""
    if (path := given.get("camera")) is not None and path not in content.cameras:
        content.cameras[path] = io.read_camera_file(path)
    if (path := given.get("markers")) is not None and path not in content.markers:
        content.markers[path] = io.read_markers(path, roles=None)
    if (path := given.get("grid")) is not None and path not in content.grids:
        content.grids[path] = io.grid_format(path)


def _ask(content: FolderContent, choice: Choice) -> None:
    """Ask for what is not clear; Ctrl-C writes nothing."""
    try:
        if choice.unit is None:
            choice.unit = _chosen("Length unit of markers and grid", list(io.LENGTH_UNITS))
        tables = different_tables(content)
        if choice.markers is None and len(tables) > 1:
            choice.take_markers(content, _file("Marker table", tables))
        if choice.grid is None and len(content.grids) > 1:
            choice.grid = _file("Surface grid", list(content.grids))
        known: dict[tuple[int, int], Path] = {}
        for picture in content.pictures:
            fitting = [p for p, c in content.cameras.items() if c.camera.size_px == picture.size_px]
            if choice.cameras[picture.path] is None and len(fitting) > 1:
                known[picture.size_px] = chosen = _file(f"Camera of {picture.path.name}", fitting)
                choice.cameras[picture.path] = chosen
    except typer.Abort:  # Ctrl-C, or the end of the input
        raise KeyboardInterrupt from None
    choice.missing = missing(content, choice)


def _chosen(question: str, answers: list[str]) -> str:
    while True:
        said = str(typer.prompt(f"{question} ({', '.join(answers)})", err=True)).strip()
        if said in answers:
            return said
        typer.echo(f"  expected one of {', '.join(answers)}", err=True)


def _file(question: str, files: list[Path]) -> Path:
    names = [p.name for p in files]
    return files[names.index(_chosen(question, names))]


def _say_command(content: FolderContent, choice: Choice, verb: str, output: Path | None, as_json: bool) -> None:
    """Verbs without a project: the command line, ready to be copied."""
    line, lacking = command(content, choice, verb, output)
    lines = [*_found(content, choice), *(f"missing: {words}" for words in lacking), f"next: {line}"]
    if "--datum free" in line:
        lines.append(
            "  --datum free: the table is rough as a whole, and holds the frame as a whole; windmark calibrate --help "
            "says what to write where markers are known"
        )
    console.answer({"command": line, "missing": lacking}, as_json, lines)


def _lines(content: FolderContent, choice: Choice, target: Path, verb: str) -> list[str]:
    lines = _found(content, choice)
    lines += [f"missing: {words}" for words in choice.missing]
    lines += [f"written: {target}"]
    parts = parts_of(content, choice) if verb == "deform" else []
    if parts:
        lines += [f"  parts: {', '.join(parts)}; each is rigid until the file gives it a law"]
    step = "complete it, then " if choice.missing else ""
    return [*lines, f"next: {step}{typed('windmark', 'check', target)}, then {typed('windmark', verb, target)}"]


def _found(content: FolderContent, choice: Choice) -> list[str]:
    used, count = {c for c in choice.cameras.values() if c is not None}, len(content.pictures)
    unused = sorted(c.name for c in content.cameras if c not in used)
    found = [
        f"{count} picture{'s' if count != 1 else ''}",
        f"camera{'s' if len(used) != 1 else ''} {', '.join(sorted(c.name for c in used)) or 'none'}",
        f"markers {choice.markers.name if choice.markers else 'none'}",
        f"grid {choice.grid.name if choice.grid else 'none'}",
    ]  # fmt: skip
    out = [f"found: {'; '.join(found)}"]
    out += [f"  not used, of no picture: {', '.join(unused)}"] if used and unused else []
    return out + [f"  left out: {p.name}: {why}" for p, why in list(content.left_out.items())[:SHOWN]]
