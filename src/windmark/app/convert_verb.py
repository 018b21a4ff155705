"""The verb `windmark convert`: what the source is, whether it can become the target, the job, and what it came to."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.app.commands.matching_options import grid_settings
from windmark.app.progress import progress
from windmark.app.verdict_words import judged
from windmark.errors import UsageError, g2
from windmark.pipeline.convert_cameras import CameraOptions, convert_camera
from windmark.pipeline.convert_frames import FrameOptions, convert_frames
from windmark.pipeline.convert_frames import lines as frames_lines
from windmark.pipeline.convert_grids import GridOptions, convert_grid
from windmark.pipeline.convert_kind import WORDS, kind_of, refuse_target
from windmark.pipeline.convert_markers import MarkerOptions, convert_markers
from windmark.pipeline.verdict.converted import converted_verdict

Record = dict[str, Any]

OPTIONS_OF = {
    "from_format": ("camera",), "to_format": ("camera",), "size": ("camera",), "pixel_mm": ("camera",),
    "which": ("camera",), "no_pose": ("camera",), "unit": ("camera", "grid", "markers"),
    "to_unit": ("camera", "grid", "markers"), "volume": ("grid",), "volume_face": ("grid",), "orientation": ("grid",),
    "plot3d": ("grid",), "from_plot3d": ("grid",), "values": ("grid",), "frames": ("pictures",),
    "pictures": ("pictures",), "columns": ("markers",),
}  # fmt: skip
"""What each option is for; given with another kind of source it is an error."""
_NAMES = {"from_format": "from", "to_format": "to"}


@dataclass(frozen=True)
class Wishes:
    """What is wanted of `windmark convert`: what the source is said to be, and its options as typed."""

    said: str | None
    typed: Record

    def of(self, *names: str) -> Record:
        """Some of the options, those that were given."""
        return {name: self.typed[name] for name in names if self.typed.get(name) not in (None, (), False)}


def convert(sources: list[Path], target: Path, wishes: Wishes, as_json: bool) -> None:
    """Convert the sources, say what came of it."""
    said = wishes.said or ("markers" if wishes.typed.get("columns") else None)
    kinds = [kind_of(source, said) for source in sources]
    kind = kinds[0]
    if len(set(kinds)) > 1 or (len(sources) > 1 and kind != "pictures"):
        which = ", ".join(f"{path} ({WORDS[k]})" for path, k in zip(sources, kinds, strict=True))
        raise UsageError(f"several sources must all be pictures, which become one recording, got {which}")
    for name in wishes.of(*OPTIONS_OF):
        if kind not in OPTIONS_OF[name]:
            option = f"--{_NAMES.get(name, name).replace('_', '-')}"
            meant = ", ".join(OPTIONS_OF[name])
            raise UsageError(f"{option} is for {meant}, and {sources[0]} is {WORDS[kind]}")
    for source in sources:
        if target.exists() and source.exists() and source.samefile(target):
            raise UsageError(f"{target}: is the source itself; expected another file as the target")
    if not (kind == "camera" and wishes.typed.get("to_format")):
        refuse_target(sources[0], kind, target)
    if not target.is_dir() and target.suffix:  # a file
        io.try_paths([target], console.complain)
    record = _JOBS[kind](sources, target, wishes)
    lines = _LINES[kind](record)
    console.answer(record, as_json, [*lines, *judged(record, converted_verdict(record))])


def _camera(sources: list[Path], target: Path, wishes: Wishes) -> Record:
    given = wishes.of("from_format", "to_format", "unit", "to_unit", "pixel_mm", "which", "no_pose")
    return convert_camera(sources[0], target, CameraOptions(size_px=parse_size(wishes.typed.get("size")), **given))


def _grid(sources: list[Path], target: Path, wishes: Wishes) -> Record:
    given = wishes.of("unit", "to_unit", "volume_face", "orientation", "plot3d", "from_plot3d", "values")
    options = GridOptions(volumes=parse_volumes(wishes.typed.get("volume") or ()), **given)
    return convert_grid(sources[0], target, options)


def _markers(sources: list[Path], target: Path, wishes: Wishes) -> Record:
    return convert_markers(sources[0], target, MarkerOptions(**wishes.of("unit", "to_unit", "columns")))


def _pictures(sources: list[Path], target: Path, wishes: Wishes) -> Record:
    options = FrameOptions(**wishes.of("frames", "pictures"))
    with progress() as show:
        return {"kind": "pictures", **convert_frames(
            sources, target, options, progress=show, say=console.complain, about=console.about(target)
        )}  # fmt: skip


def parse_size(text: str | None) -> tuple[int, int] | None:
    """``WIDTHxHEIGHT`` in pixels."""
    if text is None:
        return None
    found = re.fullmatch("([0-9]{1,6})x([0-9]{1,6})", text.lower())
    width, height = (int(part) for part in found.groups()) if found else (0, 0)
    if not (width and height):
        raise UsageError(f"--size must be WIDTHxHEIGHT in pixels, as in 1280x800, got {text!r}")
    return width, height


def parse_volumes(texts: tuple[str, ...] | list[str]) -> dict[str, tuple[str, ...]]:
    """``NAME=zone01,zone02`` (or a zone's own name) several times: the zones of each volume."""
    volumes: dict[str, tuple[str, ...]] = grid_settings(Path(), list(texts)).get("volumes", {})
    taken: dict[str, str] = {}
    for name, zones in volumes.items():
        for zone in zones:
            if zone in taken:
                raise UsageError(f"--volume: {zone} is in {taken[zone]} and in {name}; expected it once")
            taken[zone] = name
    return volumes


def _scaled(record: Record) -> list[str]:
    """A change of unit, and what is lost."""
    said = [f"scaled by {record['scale']:.10g}, into {record['length_unit']}"] if record["scale"] != 1 else []
    return [*said, *(f"lost: {text}" for text in record.get("lost", ()))]


def _camera_lines(record: Record) -> list[str]:
    width, height = record["size_px"]
    return [
        f"{record['input']} ({record['from']}): {width} x {height} px, focal length"
        f" {record['focal_px']:.3f} px, {'with' if record['pose'] else 'no'} pose",
        *record["notes"],
        *_scaled(record),
        f"written: {record['output']} ({record['to']}); read back, it shows the same rays within"
        f" {g2(record['read_back_largest_px'])} px",
    ]


def _grid_lines(record: Record) -> list[str]:
    volumes = record["volumes"]
    some = f"{', '.join(volumes[:6])}{' ...' if len(volumes) > 6 else ''}"
    holds = [f"{record['nodes']} nodes", f"{record['triangles']} triangles"]
    holds += [f"{record['blocks']} block{'s' * (record['blocks'] > 1)}"] if record["blocks"] else []
    holds += [f"volume{'s' * (len(volumes) > 1)} {some}"]
    holds += [f"values {', '.join(record['values'])}"] if record["values"] else []
    written = ", ".join(map(str, [record["output"], *record["beside"]]))
    kind = f"{record['to']}: {record['layout']}" if record["layout"] else record["to"]
    return [
        f"{record['input']} ({record['from']}): {', '.join(holds)}",
        *record["done"],
        *_scaled(record),
        f"written: {written} ({kind}); read back: {record['nodes_read_back']} nodes, {record['triangles']} triangles,"
        f" {record['read_back']}",
    ]


def _marker_lines(record: Record) -> list[str]:
    roles = ", ".join(f"{count} {role}" for role, count in record["roles"].items())
    return [
        f"{record['input']} ({record['from']}): {record['markers']} markers ({roles}), {record['with_normal']} with"
        f" normal, {record['with_radius']} with radius",
        *_scaled(record),
        f"written: {record['output']} ({record['to']}); read back: {record['markers']} markers, every number within"
        f" {g2(record['read_back_largest'])}",
    ]


_JOBS: dict[str, Callable[[list[Path], Path, Wishes], Record]] = {
    "camera": _camera, "grid": _grid, "markers": _markers, "pictures": _pictures,
}  # fmt: skip
_LINES: dict[str, Callable[[Record], list[str]]] = {
    "camera": _camera_lines, "grid": _grid_lines, "markers": _marker_lines, "pictures": frames_lines,
}  # fmt: skip
