"""The length unit of a job: every file of it that has lengths is read here, and mixed units are refused."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from windmark import io
from windmark.errors import UsageError
from windmark.io.cameras.record import FREE
from windmark.io.markers import TARGET_ROLES
from windmark.pipeline.settings import COMMAND_LINE
from windmark.scene import MarkerCovariance, MarkerSet, Mesh
from windmark.scene.units import IN_WORDS, either
from windmark.tasks.likely_unit import Array, Box, likely_unit, model_box

Noun = TypeVar("Noun", MarkerSet, Mesh, io.PointList)


class Lengths:
    """The length unit of a job, and who says it: the user, or else the first file that does.

    What a file says must be the job's unit; lengths of a file that says none are in the job's, which `notes` tells
    where other files say theirs. Points of such a file that are beside the grid and would be at it in another unit are
    refused. Poses that are not used are not asked (a camera that is read for its lens only).

    Parameters
    ----------
    unit : what the user says; None: nothing
    by : where it is said, for messages: an option, or a file's key
    """

    def __init__(self, unit: str | None = None, by: str = "--unit") -> None:
        if unit is not None and unit not in io.LENGTH_UNITS:
            raise UsageError(f"{by} must be one of {', '.join(io.LENGTH_UNITS)}, got {unit or 'none'!r}")
        self.unit, self.by = unit, by
        self._telling: list[Path] = []
        """Files that say their unit."""
        self._silent: list[Path] = []
        self._points: dict[Path, Array] = {}
        """Places that belong on the grid, without those of walls."""
        self._boxes: dict[Path, Box] = {}

    @staticmethod
    def of_project(path: Path, unit: str) -> Lengths:
        """That of a project file, or of the command line in its place."""
        return Lengths(unit, "--unit" if path.name == COMMAND_LINE else f"length_unit of {path.name}")

    def agree(self, path: Path, said: str | None, what: str = "lengths are") -> None:
        """Take note of the unit that a file says ("" or None: none) of its ``what``.

        Raises
        ------
        FileError
            Where it is another one than the job's, no unit that is known, or that of a result without scale. Names both
            files or keys, and both units.
        """
        if not said:
            _note(self._silent, path)
            return
        unit = IN_WORDS.get(said.lower(), said)
        wanted = f"expected one of {', '.join(io.LENGTH_UNITS)}"
        if unit == FREE:
            raise io.FileError(path, f"its {what} without scale (a free reconstruction); {wanted}", _KEY)
        if unit not in io.LENGTH_UNITS:
            raise io.FileError(path, f"its {what} in {said!r}, which is no unit known here; {wanted}", _KEY)
        if self.unit is None:
            self.unit, self.by = unit, str(path)
        if unit != self.unit:
            words = f"its {what} in {unit}, {self.by} is {self.unit}; expected the same"
            raise io.FileError(path, f"{words} (windmark convert --to-unit {self.unit})", _KEY)
        _note(self._telling, path)

    def notes(self) -> tuple[tuple[Path, str], ...]:
        """What is to be said of files that say no unit, beside others that do: in which their lengths are taken."""
        out = []
        for path in self._silent if self._telling else ():
            text = f"says no length unit; its lengths are taken in {self.unit}, as {self._telling[0]} says"
            likely = next((units for _, units, _ in self._doubts(path)), None)
            out.append((path, f"{text}; by their size they are rather in {either(likely)}" if likely else text))
        return tuple(out)

    def _doubts(self, path: Path) -> Iterator[tuple[Path, list[str], bool]]:
        """Points or grids that ``path`` does not fit, the units that it is likely in, and whether that is sure."""
        for table, points in self._points.items():
            for grid, box in self._boxes.items():
                if path in (table, grid) and self.unit is not None:
                    units, sure = likely_unit(points, box, self.unit, of_surface=path == grid)
                    if units:
                        yield grid if path == table else table, units, sure

    def _check_sizes(self) -> None:
        """`FileError` for points and a grid of which one says no unit and is surely in another one."""
        for path in self._silent:
            for other, units, sure in self._doubts(path):
                if sure:
                    there = f"{other}{' (which says none, either)' if other in self._silent else ''}"
                    taken = either([str(self.unit)])
                    words = f"says none; in {taken} it does not lie at {there}, in {either(units)} it would"
                    hint = f"windmark convert --unit {units[0]} --to-unit {self.unit}"
                    raise io.FileError(path, f"{words} ({hint})", _KEY)

    def markers(self, path: Path, roles: Sequence[str] | None = TARGET_ROLES) -> MarkerSet:
        """`io.read_markers`, in the job's unit."""
        markers = self._agreed(path, io.read_markers(path, roles=roles))
        self._points[path] = markers.xyz[markers.role != "wall"]
        self._check_sizes()
        return markers

    def covariance(self, path: Path, markers: MarkerSet) -> MarkerCovariance:
        """`io.read_marker_covariance`, in the job's unit, of ``markers``; `FileError` where it names another one."""
        known = io.read_marker_covariance(path)
        self.agree(path, known.length_unit, "covariances are")
        missing = [str(n) for n in known.name if str(n) not in set(markers.name.tolist())]
        if missing:
            raise io.FileError(path, f"names {missing[0]!r}, which the table of markers does not have")
        return known

    def points(self, path: Path, roles: Sequence[str] | None = None, *, strict: bool = False) -> io.PointList:
        """`io.read_points`, in the job's unit."""
        points = self._agreed(path, io.read_points(path, roles=roles, strict=strict))
        self._points[path] = points.xyz
        self._check_sizes()
        return points

    def mesh(self, path: Path, **options: Any) -> Mesh:
        """`io.read_mesh`, in the job's unit."""
        mesh = self._agreed(path, io.read_mesh(path, **options))
        self._boxes[path] = model_box(mesh)
        self._check_sizes()
        return mesh

    def camera(self, path: Path, **options: Any) -> io.CameraFile:
        """`io.read_camera_file`, its pose in the job's unit."""
        content = io.read_camera_file(path, **options)
        if content.cam_from_model is not None:
            self.agree(path, content.length_unit, "pose is")
        return content

    def rig(self, path: Path) -> io.RigFile:
        """`io.read_rig`, its poses in the job's unit."""
        content = io.read_rig(path)
        self.agree(path, content.length_unit, "poses are")
        return content

    def _agreed(self, path: Path, noun: Noun) -> Noun:
        self.agree(path, noun.length_unit)
        return replace(noun, length_unit=self.unit or "")


_KEY = "length unit"


def _note(paths: list[Path], path: Path) -> None:
    if path not in paths:
        paths.append(path)
