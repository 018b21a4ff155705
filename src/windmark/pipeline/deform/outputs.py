"""Results of a sequence as files, written frame by frame: whole rows of whole frames, whenever the run ends."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import Deformation
from windmark.io.errors import refusal
from windmark.io.interrupts import interrupts_wait
from windmark.io.journal import AppendedFile
from windmark.pipeline.deform.frames import FrameTable
from windmark.pipeline.deform.grid_output import write_grid
from windmark.pipeline.deform.inbox import Arrival
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.names import is_number, number_of, stamp_text
from windmark.pipeline.deform.points import COLUMNS, FramePoints
from windmark.pipeline.deform.record import FrameRecord
from windmark.pipeline.deform.resume import Kept, named
from windmark.pipeline.deform.series import series_content
from windmark.pipeline.resume import CHUNK, SeriesJournal, Stopped, replaced_file
from windmark.tasks.deform.task import DeformedFrame, FrameImages
from windmark.tasks.deform.why import words_of
from windmark.tasks.deform.zero import MOTION, Zero, displaced_since, motion_point

Array = NDArray[np.float64]

GROWN = 16
"""A long NetCDF file is written anew when it has grown by this part of its frames: the work stays in proportion."""


class Writer:
    """Open files of a running sequence; a context manager.

    ``deformation.csv`` has one row per frame, ``cameras.csv`` one per frame and camera, ``span.csv`` one per frame and
    station, ``markers.csv`` one per frame and marker seen, ``deformation.nc`` all of it as arrays over frames;
    ``points-NAME.csv`` has one per frame, camera and point; ``arrivals.csv``, live, one per file seen.

    A frame is in all tables or in none, in the journal (`SeriesJournal`) after them. ``deformation.nc`` is put in its
    place whole, every `CHUNK` frames, at last with all of them.

    Parameters
    ----------
    folder : an existing folder
    loaded : the project, its markers as the wind-off zero has them
    table : what is known of the frames besides
    made : what the run is made with, see `made_with`
    stopped : the run that is gone on with; None for a new one
    arrived : live, the files whose fate is known: they are in the table with the next frame, or at the end, and then no
        longer in this list. None for files on a disk
    zero : the wind-off state that displacements are relative to; None for the table of markers
    """

    def __init__(
        self, folder: Path, loaded: Loaded, table: FrameTable, made: Mapping[str, Any],
        stopped: Stopped[Kept] | None = None, *, arrived: list[Arrival] | None = None, zero: Zero | None = None,
    ) -> None:  # fmt: skip
        self._folder, self._loaded, self._table, self._made, self._arrived = folder, loaded, table, made, arrived
        self._names = loaded.test.volumes.names
        self._stopped, self._zero = stopped, zero
        self._rows: list[FrameRecord] = [] if stopped is None else [kept.row for kept in stopped.frames]
        self._in_series = 0
        self._files: dict[str, AppendedFile] = {}
        self._lines: dict[str, list[str]] = {}
        self._sizes: dict[str, int] = {}
        self._crcs: dict[str, int] = {}
        self._crcs_kept: dict[str, int] = {}
        self._journal: SeriesJournal | None = None

    def __enter__(self) -> Writer:
        try:
            self._open_all()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._commit()
                self._write_series()
            else:
                self.undo()
                with suppress(io.FileError):  # what stopped the run is what is said
                    self._write_series()
        finally:
            self._close()

    def add(
        self, frame: DeformedFrame, images: FrameImages, row: FrameRecord, mapped: Mapping[str, Array],
        points: Sequence[FramePoints] = (), *, state: Deformation | None = None, compared: bool = False,
        pictured: bool = False, handed_on: Mapping[str, Any] | None = None, pictures: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        """Write one frame.

        Parameters
        ----------
        frame, images, row : the frame, what it was measured from, its numbers
        mapped, points : values at the grid's nodes, see `Mapper.frame`, and at points
        state : what the film keeps of it
        compared : it is the most deformed one so far
        pictured : it is one of those whose pictures are shown
        handed_on : what it hands on to the next, see `follow_deformation`
        pictures : camera -> what tells whether its picture is still the same when the run goes on
        """
        self._frame_row(row)
        number = self._label(row)
        for name, sight in row.cameras.items():
            self._line("cameras.csv", [
                number, _cell(row.time_s), _quoted(name), _cell(sight.lag_s), sight.expected, sight.found,
                _quoted(sight.reason),
            ])  # fmt: skip
        if self._loaded.stations is not None and frame.state is not None:
            columns = (row.bending, row.bending_sigma, row.twist, row.twist_sigma, row.pitch, row.pitch_sigma)
            for s, eta in enumerate(self._loaded.stations.eta):
                self._line("span.csv", [number, _cell(eta), *(_cell(c[s]) for c in columns)])
        if frame.state is not None:
            self._markers(number, frame, frame.state)
            write_grid(self._folder, self._loaded, frame, frame.state, mapped, self._zero)
        for found in points:
            self._points(number, found)
        whole = all(isinstance(item, Path) for item in images.images.values())
        with_images = (frame, images if whole else None)
        most, shown = with_images if compared else None, with_images if pictured else None
        assert self._journal is not None
        with interrupts_wait():  # or tables would be taken back of a frame that the journal has
            self._commit()
            sizes = {name: file.size for name, file in self._files.items()}
            self._journal.add(
                Kept(row, state, most, shown, pictures or {}, sizes, dict(self._crcs)), handed_on or {}
            )
            self._rows.append(row)
            self._sizes, self._crcs_kept = sizes, dict(self._crcs)
            if self._arrived is not None:
                self._arrived.clear()
        if len(self._rows) % CHUNK == 0:
            self._sync()

    @property
    def frames(self) -> set[str]:
        """The frames that have their rows."""
        return {row.key for row in self._rows}

    def undo(self) -> None:
        """Take back what the tables have of a frame that did not come to its end."""
        for name, size in self._sizes.items():
            self._files[name].take_back(size)
            self._lines[name].clear()
        self._crcs = dict(self._crcs_kept)

    # --- whole or not at all ---------------------------------------------------------------
    def _commit(self) -> None:
        for a in self._arrived or ():
            self._line("arrivals.csv", [_quoted(a.file), _quoted(a.camera), _quoted(a.key), a.fate, _quoted(a.reason)])
        for name, lines in self._lines.items():
            if lines:
                self._append(name, "".join(lines))
                lines.clear()

    def _append(self, name: str, text: str) -> None:
        content = text.encode()
        self._files[name].append(content)
        self._crcs[name] = zlib.crc32(content, self._crcs.get(name, 0))

    def _sync(self) -> None:
        """Make all of it outlast a power failure, and the series readable."""
        assert self._journal is not None
        for file in self._files.values():
            file.sync()
        self._journal.sync()
        if len(self._rows) - self._in_series >= max(CHUNK, len(self._rows) // GROWN):
            try:
                self._write_series()
            except io.FileError as error:
                # On Windows a file that somebody looks at cannot be replaced: next time, or at the end.
                if not isinstance(refusal(error), PermissionError):
                    raise

    def _write_series(self) -> None:
        replaced_file(self._folder, "deformation.nc", series_content(self._loaded, self._table, self._rows))
        self._in_series = len(self._rows)

    def _close(self) -> None:
        for file in self._files.values():
            file.close()
        if self._journal is not None:
            self._journal.close()

    # --- parts -----------------------------------------------------------------------------
    def _open_all(self) -> None:
        """Open tables and journal, with their heads or with what the run that was stopped has in them."""
        stopped, unit = self._stopped, self._loaded.project.length_unit
        of_laws = [p.unit for p in self._loaded.test.volumes.parameters]
        if stopped is not None:
            self._sizes = dict(stopped.frames[-1].sizes if stopped.frames else stopped.sizes)
        for name, (head, about) in self._tables().items():
            self._files[name] = AppendedFile(self._folder / name, self._sizes.get(name))
            self._lines[name] = []
            first = about + ",".join(map(_quoted, head)) + "\n"
            if name not in self._sizes:
                self._append(name, first)
            elif stopped is not None:
                self._crcs[name] = stopped.frames[-1].crcs[name] if stopped.frames else zlib.crc32(first.encode())
        with io.atomic_write(self._folder / "units.json") as stream:
            point = motion_point(self._loaded.test.markers).round(9).tolist()
            units_of = {"length": unit, "parameters": dict(zip(self._names, of_laws, strict=True)),
                        "motion": {"shift": unit, "turn": "deg", "shift_of_model_point": point},
                        "relative_to": self._relative_to()}  # fmt: skip
            stream.write(json.dumps(units_of, indent=2) + "\n")
        self._sizes = {name: file.size for name, file in self._files.items()}
        self._crcs_kept = dict(self._crcs)
        self._journal = SeriesJournal(self._folder, named(self._loaded.test), stopped)
        if stopped is None:
            self._journal.begin(self._made, self._sizes)
        self._write_series()

    def _relative_to(self) -> str:
        """What all parameters, motions and displacements are relative to, in words."""
        if self._zero is None:
            return "the table of markers"
        return f"the wind-off frames {', '.join(self._loaded.project.sequence.zero)}: the mean of {self._zero.frames}"

    def _tables(self) -> dict[str, tuple[Sequence[str], str]]:
        """Table -> its columns and what stands before them."""
        head = ["frame", "time_s", *self._table.columns, "status", "spots", "outliers", "doubtful", "rms_px",
                "sigma0"]  # fmt: skip
        for name in (*self._names, *MOTION):
            head += [name, f"sigma_{name}"]
        out: dict[str, tuple[Sequence[str], str]] = {
            "deformation.csv": ([*head, "few", "seconds", "reason", "stamp", "name", "warnings"], ""),
            "cameras.csv": (["frame", "time_s", "camera", "lag_s", "expected", "spots", "reason"], ""),
        }
        if self._loaded.stations is not None:
            out["span.csv"] = ([
                "frame", "eta", "bending", "sigma_bending", "twist_deg", "sigma_twist_deg", "twist_with_motion_deg",
                "sigma_twist_with_motion_deg",
            ], "")  # fmt: skip
        out["markers.csv"] = ([
            "frame", "marker", "x", "y", "z", "dx", "dy", "dz", "sigma_dx", "sigma_dy", "sigma_dz", "outlier",
        ], "")  # fmt: skip
        about = f"# length unit: {self._loaded.project.length_unit}\n# value, sigma: grey level\n"
        for entry in self._loaded.project.points:
            out[f"points-{entry.label}.csv"] = (COLUMNS, about)
        if self._arrived is not None:
            out["arrivals.csv"] = (["file", "camera", "frame", "fate", "reason"], "")
        return out

    def _frame_row(self, row: FrameRecord) -> None:
        at = self._table.row(row.key)
        more = [_cell(v[at]) if at is not None else "" for v in self._table.columns.values()]
        cells = [self._label(row), _cell(row.time_s), *more, row.status, row.spots, row.outliers, len(row.doubtful),
                 *map(_cell, (row.rms_px, row.sigma0))]  # fmt: skip
        for values, sigma in ((row.q, row.q_sigma), (row.motion, row.motion_sigma)):
            for value, size in zip(values, sigma, strict=True):
                cells += [_cell(value), _cell(size)]
        label = self._label(row)
        name = "" if label == row.key else row.key
        self._line("deformation.csv", [
            *cells, _quoted(words_of(row.cameras)), _cell(row.seconds), _quoted(row.reason), stamp_text(row.key),
            _quoted(name), _quoted("; ".join(row.warnings)),
        ])  # fmt: skip

    @staticmethod
    def _label(row: FrameRecord) -> str:
        """What a frame is called in the tables: its number, a 64-bit one; or its name."""
        return str(number_of(row.key, row.index)) if is_number(row.key) else _quoted(row.key)

    def _line(self, name: str, cells: Sequence[Any]) -> None:
        self._lines[name].append(",".join(map(str, cells)) + "\n")

    def _markers(self, number: str, frame: DeformedFrame, state: Deformation) -> None:
        """Place of every marker that was seen, in the tunnel, and how it moved by laws and motion since the zero."""
        markers, seen = self._loaded.test.markers, frame.observations
        assert seen is not None
        point = np.unique(seen.point[markers.role[seen.point] != "wall"])
        # The state's own placed markers: theirs are the last place and its derivatives that were worked out.
        moved, cov = (column[point] for column in displaced_since(self._zero, state, state.placed))
        place = state.tunnel_from_model.apply(state.placed.place(state.q))[point]
        sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        bad = np.unique(seen.point[~state.used])
        for k, p in enumerate(point):
            numbers = (*place[k], *moved[k], *sigma[k])
            name = _quoted(str(markers.name[p]))
            self._line("markers.csv", [number, name, *map(_cell, numbers), int(p in bad)])

    def _points(self, number: str, found: FramePoints) -> None:
        """A camera's values at one list of points."""
        v, words = found.values, found.values.words
        for k, name in enumerate(found.of.names.tolist()):
            numbers = (*v.xyz[k], v.value[k], v.sigma[k], found.ratio[k], found.sigma_ratio[k])
            self._line(f"points-{found.of.name}.csv",
                       [number, found.camera, _quoted(name), *map(_cell, numbers), words[k]])  # fmt: skip


def _cell(value: float) -> str:
    return "" if value != value else f"{float(value):.9g}"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n') else text
