"""Projects of `deform`, `psp` and `infrared`, and the commands of `calibrate` and `reconstruct`, from a folder."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.pipeline.folder import FolderContent
from windmark.pipeline.new_pictures import common_of_cameras, frames_and_others, places_of, series, series_of
from windmark.pipeline.new_project import (
    Choice,
    Rel,
    common_pattern,
    quoted,
    relative_to,
    unique_names,
    unit_lines,
    used_cameras,
    which_table,
)
from windmark.scene import MarkerSet

Array = NDArray[np.float64]

PROJECTS = ("run", "deform", "psp", "infrared")
"""Verbs that have a project file."""
COMMANDS = ("calibrate", "reconstruct")
"""Verbs that are told everything on the command line."""
_LAW = '# law = "beam"   # how it deforms: windmark laws lists them; without a law it is rigid'
_ENDS = "clamped at root: the ends of its markers, look where they really are"
_TABLES = {
    "points": "[points] table, one row per point with its conditions and pictures",
    "cell": "[paint] cell, the paint's calibration (pressure, temperature, ratio)",
}
_SURFACE = {"emissivity": "0.95", "emissivity_sigma": "0.02", "surroundings_K": "293", "surroundings_sigma_K": "2"}


def series_text(content: FolderContent, choice: Choice, kind: str, title: str, place: Path) -> str:
    """The project file of a verb of `PROJECTS` but `run`, which will stand in the folder ``place``."""
    rel = relative_to(place)
    lines = [
        f"# A project of windmark {kind}. Paths are relative to this file; every key is in the guide (docs/guide.md).",
        f"title = {quoted(title)}", "", *unit_lines(choice),
    ]  # fmt: skip
    if kind == "psp":
        lines += _found("points", "table", "points.csv", csv_with(content.folder, {"point", "on"}), rel)
    lines += _cameras(content, choice, kind, rel)
    lines += ["[markers]", f"file = {quoted(rel(choice.markers))}", ""] if choice.markers else [
        "# [markers]", '# file = "markers.csv"   # MISSING', ""]  # fmt: skip
    lines += ["[grid]", f"file = {quoted(rel(choice.grid))}",
              '# volumes = { wing = ["zone01", "zone02"] }   # which zones make up which part',
              ""] if choice.grid else ["# [grid]", '# file = "model.grid"', ""]  # fmt: skip
    lines += ["[look]", "# radius_px = 4   # without it each picture's own estimate is taken, and said", ""]
    lines += _volumes(content, choice)
    lines += _psp(content, choice, rel) if kind == "psp" else _deform() if kind == "deform" else _infrared()
    for path in content.points if kind != "psp" else []:
        lines += ["# Values at these points, too.", "# [[points]]", f"# file = {quoted(rel(path))}", ""]
    return "\n".join([*lines, "[output]", f"folder = {quoted('deformation' if kind == 'deform' else kind)}", ""])


def series_missing(content: FolderContent, choice: Choice, kind: str) -> list[str]:
    """What a run of such a project needs beside what `new_project.missing` says."""
    out = []
    for path in used_cameras(choice):
        if path in content.cameras and content.cameras[path].cam_from_model is None:
            out.append(f"the pose of camera {path.name}: windmark register finds it from one picture of the model at "
                       "rest")  # fmt: skip
    if kind == "psp":
        tables = {"points": csv_with(content.folder, {"point", "on"}), "cell": csv_with(content.folder, {"ratio"})}
        out += [words for name, words in _TABLES.items() if tables[name] is None]
    if kind == "infrared":
        out += [f"[surface] {', '.join(_SURFACE)}: no file says them", "what each camera's numbers are (quantity)"]
    return out


def known_markers(content: FolderContent) -> Path | None:
    """The one table whose markers are all primary: what `reconstruct` is told is known."""
    tables = [p for p, markers in content.markers.items() if len(markers) and (markers.role == "primary").all()]
    return tables[0] if len(tables) == 1 else None


def command(content: FolderContent, choice: Choice, verb: str, output: Path | None = None) -> tuple[str, list[str]]:
    """The command line of a verb of `COMMANDS`, with <...> for what is missing, and that in words."""
    missing, words = [], ["windmark", verb]
    files = [p.path for p in content.pictures if not p.is_recording]
    for group in dict.fromkeys(series(p) for p in files):
        some = [p for p in files if series(p) == group]
        pattern = common_pattern(some)
        words += [_unquoted(pattern)] if pattern else [shlex.quote(str(p)) for p in some]
    if not files:
        missing.append("pictures")
        words.append("<pictures>")
    cameras = used_cameras(choice)
    if len(cameras) == 1:
        words += ["-c", shlex.quote(str(cameras[0]))]
    elif verb == "reconstruct":
        missing.append("the camera file" if not cameras else "one camera: the pictures of several are found one by one")
        words += ["-c", "<camera.json>"]
    if choice.markers is not None:
        words += ["-m" if verb == "calibrate" else "-p", shlex.quote(str(choice.markers))]
    elif verb == "calibrate":
        which = which_table(content)
        missing.append(f"the marker table (-m): {which}" if which else
                       "a rough marker table (-m), or the pitch of a dot board (--board)")  # fmt: skip
        words += ["-m", "<rough.csv>"]
    elif which := which_table(content):
        missing.append(f"which markers are known (-p; or --free-frame): {which}")
        words += ["-p", "<primary.csv>"]
    else:
        words += ["--free-frame"]
    if choice.unit:
        words += ["--unit", choice.unit]
    elif choice.markers is not None or verb == "calibrate":
        missing.append("the length unit (--unit in, ft, mm, cm or m)")
        words += ["--unit", "<unit>"]
    if verb == "calibrate":
        words += ["--datum", _datum(content, choice)]
    words += [] if output is None else ["-o", shlex.quote(str(output))]
    return " ".join(words), missing


def _datum(content: FolderContent, choice: Choice) -> str:
    """What holds a calibration: markers with a sigma do; of a rough table all together, none alone."""
    markers = None if choice.markers is None else content.markers.get(choice.markers)
    known = markers is not None and int(np.isfinite(markers.sigma).all(axis=1).sum()) >= 3
    return "weighted" if known else "free"


def csv_with(folder: Path, columns: set[str]) -> Path | None:
    """The one CSV of a folder that has a column for each of these (units and kinds may follow: on_reference)."""
    found = []
    for path in sorted(folder.glob("*.csv")):
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            head = next((line for line in stream if line.strip() and not line.startswith("#")), "")
        if columns <= {c.strip().partition("_")[0] for c in head.split(",")}:
            found.append(path)
    return found[0] if len(found) == 1 else None


def _found(table: str, key: str, example: str, path: Path | None, rel: Rel) -> list[str]:
    """A table of the project with the file that was found for it."""
    if path is None:
        return [f"# [{table}]", f'# {key} = "{example}"   # MISSING', ""]
    return [f"[{table}]", f"{key} = {quoted(rel(path))}", ""]


def _cameras(content: FolderContent, choice: Choice, kind: str, rel: Rel) -> list[str]:
    used = used_cameras(choice) or (list(content.cameras) if kind == "psp" else [])
    lines = ["# Cameras with their poses to the model at rest, and their pictures in the order of the frames."]
    for camera, name in zip(used, unique_names(used), strict=True):
        lines += ["[[camera]]", f"name = {quoted(name)}", f"file = {quoted(rel(camera))}"]
        if kind != "psp":
            mine = [p for p in content.pictures if choice.cameras[p.path] == camera]
            frames, others = frames_and_others(mine, content.folder)
            lines += [f"images = {_list(series_of(frames, rel))}"]
            even = [p for p in others if re.search("even|cold|warm", p.path.stem, re.IGNORECASE)]
            if kind == "infrared" and even:
                others = [p for p in others if p not in even]
                lines += [f"even = {_list(series_of(even, rel))}"]
            lines += [f"# no frames, by their names: {', '.join(series_of(others, rel))}"] if others else []
        if kind == "infrared":
            lines += ['# quantity = "temperature"   # MISSING: counts, temperature or radiance, see the guide',
                      '# unit = "K"', "# band_um = [8, 12]"]  # fmt: skip
        lines += [""]
    return lines if used else [*lines, "# [[camera]]", '# file = "camera.json"   # MISSING', ""]


def _list(names: list[str]) -> str:
    return quoted(names[0]) if len(names) == 1 else f"[{', '.join(map(quoted, names))}]"


def _volumes(content: FolderContent, choice: Choice) -> list[str]:
    """The parts that the marker table names."""
    lines = ['# The model\'s parts. One that hangs at another one: parent = "...".']
    names = parts_of(content, choice)
    for name in names:
        lines += ["[[volume]]", f"name = {quoted(name)}", _LAW]
        if (ends := ends_of(content.markers[choice.markers], name)) is not None:  # type: ignore[index]
            root, tip = ([round(float(v), 3) for v in end] for end in ends)
            lines += [f"# options = {{ root = {root}, tip = {tip} }}   # {_ENDS}"]
        lines += [""]
    return lines if names else [*lines, "# [[volume]]", '# name = "wing"', _LAW, ""]


def parts_of(content: FolderContent, choice: Choice) -> list[str]:
    """The model's parts that the marker table names."""
    markers = content.markers.get(choice.markers) if choice.markers is not None else None
    return [] if markers is None else [str(v) for v in np.unique(markers.volume[markers.role != "wall"]) if v]


def ends_of(markers: MarkerSet, volume: str) -> tuple[Array, Array] | None:
    """(3,), (3,) ends of a part's markers along their longest direction, first the one that is nearer to the others.

    None for fewer than three markers, and for markers in one place.
    """
    model = markers.xyz[markers.role != "wall"]
    own = markers.volume[markers.role != "wall"] == volume
    xyz, rest = model[own], model[~own]
    if len(xyz) < 3:
        return None
    middle = xyz.mean(axis=0)
    _, size, axes = np.linalg.svd(xyz - middle, full_matrices=False)
    if not size[0] > 0:
        return None
    along = (xyz - middle) @ axes[0]
    ends = [middle + along.min() * axes[0], middle + along.max() * axes[0]]
    if len(rest):
        ends.sort(key=lambda end: float(np.linalg.norm(rest - end, axis=1).min()))
    return ends[0], ends[1]


def _deform() -> list[str]:
    return [
        "# Bending and twist along a part: take the # away and say where.", "# [stations]", '# volume = "wing"',
        "# start = [0, 0, 0]", "# end = [0, 1000, 0]", "# chord = [150, 0, 0]", "",
        "# When the frames were, and those without wind, which also correct the markers' places.", "# [sequence]",
        "# rate_hz = 50", '# zero = ["0:3"]', "",
    ]  # fmt: skip


def _psp(content: FolderContent, choice: Choice, rel: Rel) -> list[str]:
    pressures = csv_with(content.folder, {"point", "name", "pressure"})
    temperatures = csv_with(content.folder, {"point", "name", "temperature"})
    taps = None if pressures is None else places_of(content, pressures)
    wells = None if temperatures is None else places_of(content, temperatures)
    lines = [
        *_found("paint", "cell", "paint-cell.csv", csv_with(content.folder, {"ratio"}), rel),
        "# The wall's temperature; thermocouples, maps of an infrared camera or a temperature paint say it better.",
        "[temperature]", "recovery = 0.896",
    ]  # fmt: skip
    if temperatures is not None and wells is not None:
        lines += [f"thermocouples = {quoted(rel(wells))}", f"readings = {quoted(rel(temperatures))}"]
    if pressures is not None and taps is not None:
        lines += ["", "[taps]", f"file = {quoted(rel(taps))}", f"pressures = {quoted(rel(pressures))}", ""]
    else:
        lines += ["", "# [taps]", '# file = "taps.csv"', '# pressures = "tap-pressures.csv"', ""]
    found = {word: common_of_cameras(content, choice, word, rel) for word in ("dark", "flat")}
    lines += ["# Pictures without light, and of even light: without them the level without light is taken as 0.",
              "[radiometry]" if any(found.values()) else "# [radiometry]"]  # fmt: skip
    for word, pattern in found.items():
        lines += [f"{word} = {quoted(pattern)}" if pattern else f'# {word} = "{word}-{{camera}}-*.tif"']
    return [*lines, ""]


def _infrared() -> list[str]:
    return [
        "# MISSING: the surface as the cameras see it; the numbers are examples.", "[surface]",
        *(f"# {name} = {example}" for name, example in _SURFACE.items()), "",
        "# Heat flux needs what is below the surface, too: [heat] and [[wall]], see the guide.", "",
    ]  # fmt: skip


def _unquoted(pattern: str) -> str:
    """A pattern as a shell takes it: whatever else it would read is quoted, its * left to work."""
    return "*".join(shlex.quote(part) if part else "" for part in pattern.split("*"))
