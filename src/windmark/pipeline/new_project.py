"""A project file, with comments, from what was found in a folder."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from windmark.pipeline.folder import FolderContent, FoundPicture, camera_of
from windmark.scene import MarkerSet

Rel = Callable[[Path], str]
FEW = 3
"""Pictures that are listed one by one; more stand behind a pattern where one fits them."""


@dataclass
class Choice:
    """What has been chosen, and what is still missing.

    Parameters
    ----------
    unit : length unit; None unknown
    markers, grid : files; None where there is none
    cameras : picture -> its camera file; None where that is not clear
    roles : of the markers that take part
    missing : what is still to be said, in words
    """

    unit: str | None
    markers: Path | None
    grid: Path | None
    cameras: dict[Path, Path | None]
    roles: tuple[str, ...] = ()
    missing: list[str] = field(default_factory=list)

    def take_markers(self, content: FolderContent, markers: Path | None) -> None:
        """Choose a table, and of its roles the model's where there are walls as well."""
        self.markers = markers
        there = set(content.markers[markers].role.tolist()) if markers in content.markers else set()
        self.roles = ("model",) if {"model", "wall"} <= there else ()


def choose(content: FolderContent, given: Mapping[str, object]) -> Choice:
    """What the files themselves say; ``given`` (unit, camera, markers, grid) wins."""
    said = sorted(set(content.units.values()))
    unit = given.get("unit") or (said[0] if len(said) == 1 else None)
    tables = different_tables(content)
    markers = given.get("markers") or (tables[0] if len(tables) == 1 else None)
    grids = list(content.grids)
    grid = given.get("grid") or (grids[0] if len(grids) == 1 else None)
    cameras: dict[Path, Path | None] = {}
    for picture in content.pictures:
        fitting = [given["camera"]] if given.get("camera") else camera_of(picture, content)
        cameras[picture.path] = fitting[0] if len(fitting) == 1 else None  # type: ignore[assignment]
    out = Choice(unit, None, grid, cameras)  # type: ignore[arg-type]
    out.take_markers(content, markers)  # type: ignore[arg-type]
    out.missing = missing(content, out)
    return out


def different_tables(content: FolderContent) -> list[Path]:
    """The marker tables, the largest first, without those of which another one has every marker just so."""
    out: list[Path] = []
    for path in sorted(content.markers, key=lambda p: (-len(content.markers[p]), p.name)):
        if not any(_has_all(content.markers[larger], content.markers[path]) for larger in out):
            out.append(path)
    return out


def _has_all(larger: MarkerSet, table: MarkerSet) -> bool:
    """Whether every marker of a table is in a larger one, at the same place, of the same size and direction."""
    row = {name: k for k, name in enumerate(larger.name.tolist())}
    if larger.length_unit != table.length_unit or not set(row) >= set(table.name.tolist()):
        return False
    there = [row[name] for name in table.name.tolist()]
    return all(
        np.allclose(getattr(larger, of)[there], getattr(table, of), rtol=1e-9, atol=0.0, equal_nan=True)
        for of in ("xyz", "normal", "radius")
    )


def which_table(content: FolderContent) -> str:
    """The marker tables that differ from each other, in words; "" where there are not several."""
    several = different_tables(content)
    return f"it may be {' or '.join(p.name for p in several)}, which differ" if len(several) > 1 else ""


def missing(content: FolderContent, choice: Choice) -> list[str]:
    """What a run still needs."""
    out = []
    if not content.pictures:
        out.append("pictures: none was found that can be read (.tif, .png, .jpg, .bmp, recordings)")
    if choice.unit is None:
        said = sorted(set(content.units.values()))
        why = f"files say {' and '.join(said)}" if said else "no file says it, and it is never guessed"
        out.append(f"the length unit of markers and grid: {why} (--unit in, ft, mm, cm or m)")
    if not content.cameras and not any(choice.cameras.values()):
        out.append("a camera file: windmark calibrate makes one; those of OpenCV, COLMAP, NASA ... are read, too")
    for path, camera in choice.cameras.items():
        if camera is None and content.cameras:
            size = next(p.size_px for p in content.pictures if p.path == path)
            same = [c.name for c, f in content.cameras.items() if f.camera.size_px == size]
            why = f"it may be {' or '.join(same)}" if same else f"none is of {size[0]} x {size[1]} px"
            out.append(f"the camera of {path.name}: {why} (--camera FILE)")
    if choice.markers is None and (which := which_table(content)):
        out.append(f"the marker table: {which} (--markers FILE)")
    elif choice.markers is None:
        out.append("a marker table: CSV with name,x,y,z (and nx,ny,nz,radius), or .tgts; windmark convert --columns "
                   "makes one of another list of points, windmark reconstruct measures one")  # fmt: skip
    if choice.grid is None:
        several = ", ".join(p.name for p in content.grids)
        out.append(f"the grid: say which of {several} (--grid FILE)" if several else
                   "a surface grid: without one there are poses, but no values on the surface")  # fmt: skip
    return out


def project_text(content: FolderContent, choice: Choice, title: str, place: Path) -> str:
    """The project file, which will stand in the folder ``place``."""
    rel = relative_to(place)
    used = used_cameras(choice)
    names = dict(zip(used, unique_names(used), strict=True))
    lines = [
        "# A windmark project. Paths are relative to this file; every key is in the guide (docs/guide.md).",
        f"title = {quoted(title)}",
        "",
        *unit_lines(choice),
        "# Cameras: interior parameters. A pose in the file is only compared with, unless pose = \"known\".",
    ]
    for camera in used:
        lines += ["[[camera]]", f"name = {quoted(names[camera])}", f"file = {quoted(rel(camera))}", ""]
    if not used:
        lines += ['# [[camera]]', '# file = "camera.json"   # MISSING: windmark calibrate makes one', ""]
    lines += ["# Pictures. A pattern stands for all that it matches; quantity, labels, exclude ... are in the guide."]
    for file, taken_by in _pictures(content.pictures, choice):
        lines += ["[[image]]", f"file = {quoted(_pattern(rel, file))}"]
        if taken_by is None:
            lines += ['# camera = "..."   # MISSING: say which camera took it'] if len(used) != 1 else []
        elif len(used) > 1:
            lines += [f"camera = {quoted(names[taken_by])}"]
        lines += [""]
    lines += _markers(choice, rel) + _grid(choice, content, rel)
    lines += ["[output]", 'folder = "results"', "# nodes = [\"vtk\", \"tecplot\", \"plot3d\", \"csv\", \"netcdf\"]", ""]
    return "\n".join(lines)


def used_cameras(choice: Choice) -> list[Path]:
    """Camera files that took a picture, in the order of the pictures."""
    return list(dict.fromkeys(c for c in choice.cameras.values() if c is not None))


def relative_to(place: Path) -> Rel:
    """How files are written in a project file that stands in the folder ``place``."""

    def rel(path: Path) -> str:
        try:
            return Path(os.path.relpath(path.resolve(), place.resolve())).as_posix()
        except ValueError:  # another drive of Windows
            return path.resolve().as_posix()

    return rel


def unit_lines(choice: Choice) -> list[str]:
    """What a project says of its unit."""
    return [
        "# Unit of markers, grid and poses: in, ft, mm, cm or m. It is never guessed.",
        f"length_unit = {quoted(choice.unit)}" if choice.unit else '# length_unit = "mm"   # MISSING: say which',
        "",
    ]


def _markers(choice: Choice, rel: Rel) -> list[str]:
    if choice.markers is None:
        lines = ["# [markers]", '# file = "markers.csv"   # MISSING', ""]
    else:
        lines = ["[markers]", f"file = {quoted(rel(choice.markers))}"]
        if choice.roles:
            lines += ["# Walls stand still while the model moves: their markers take no part.",
                      f"roles = [{', '.join(map(quoted, choice.roles))}]"]  # fmt: skip
        lines += [""]
    return [
        *lines, "# How markers are found. Without radius_px each picture's own estimate is taken, and said.",
        "[detect]", "# radius_px = 4", '# polarity = "dark"   # or "bright"', "",
    ]  # fmt: skip


def _grid(choice: Choice, content: FolderContent, rel: Rel) -> list[str]:
    if choice.grid is None:
        return ["# [grid]", '# file = "model.grid"   # for values on the surface', ""]
    zones = '# volumes = { wing = ["zone01", "zone02"] }   # parts that move with the model; all by default'
    lines = ["[grid]", f"file = {quoted(rel(choice.grid))}", zones, ""]
    for path in content.points:
        lines += ["# Values at these points, too.", "[[points]]", f"file = {quoted(rel(path))}", ""]
    return [
        *lines, "# A virtual picture, and values along a cut: take the # away and say where.", "# [[view]]",
        '# name = "top"', "# direction = [0, 0, -1]", "# up = [0, 1, 0]", "# [[section]]", '# name = "mid-span"',
        "# point = [0, 0, 0]", "# normal = [0, 1, 0]", "",
    ]  # fmt: skip


def _pictures(pictures: list[FoundPicture], choice: Choice) -> list[tuple[str, Path | None]]:
    """Pictures as the project lists them: (path or pattern, camera)."""
    groups: dict[tuple[Path | None, Path], list[FoundPicture]] = {}
    for picture in pictures:
        groups.setdefault((choice.cameras[picture.path], picture.path.parent), []).append(picture)
    out: list[tuple[str, Path | None]] = []
    for (camera, _), some in groups.items():
        many = len(some) > FEW and not any(p.is_recording for p in some)
        pattern = common_pattern([p.path for p in some]) if many else None
        if pattern is not None:
            out.append((pattern, camera))
        else:
            out += [(f"{p.path}[0]" if p.is_recording else str(p.path), camera) for p in some]
    return out


def common_pattern(paths: list[Path]) -> str | None:
    """A pattern for exactly these files of one folder; None where there is none."""
    folder, names = paths[0].parent, [p.name for p in paths]
    if set(str(folder)) & set("*?[") or len({p.suffix for p in paths}) > 1:
        return None
    alike = os.path.commonprefix([p.stem for p in paths])  # noqa: RUF071 (letters are meant)
    heads = [re.split(r"\d", names[0])[0], alike.rstrip("0123456789"), alike]  # the one that fits more frames to come
    for head in heads:
        if not set(head) & set("*?[") and set(folder.glob(f"{head}*{paths[0].suffix}")) == set(paths):
            return str(folder / f"{head}*{paths[0].suffix}")
    return None


def _pattern(rel: Rel, file: str) -> str:
    path = Path(file)
    return Path(rel(path.parent) if rel(path.parent) != "." else "").joinpath(path.name).as_posix()


def unique_names(cameras: list[Path]) -> list[str]:
    """Names of cameras by their files."""
    stems = [c.stem for c in cameras]
    return stems if len(set(stems)) == len(stems) else [f"{c.parent.name}-{c.stem}" for c in cameras]


def quoted(text: object) -> str:
    """As TOML writes it."""
    return json.dumps(str(text), ensure_ascii=False)
