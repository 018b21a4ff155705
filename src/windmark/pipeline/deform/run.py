"""A whole deformation test: wind-off zero, then every frame, from a disk or live."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.pipeline.deform.frames import FrameTable, instants_of, read_frame_table
from windmark.pipeline.deform.grid_output import gridded, write_grid_series
from windmark.pipeline.deform.live import Watch
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.outputs import Writer
from windmark.pipeline.deform.pictures import follow_deformation
from windmark.pipeline.deform.points import PointMapper
from windmark.pipeline.deform.record import FrameRecord, record
from windmark.pipeline.deform.resume import (
    ARRIVALS,
    Kept,
    check_tables,
    files_told,
    made_with,
    named,
    pictures_of,
    states_of,
)
from windmark.pipeline.deform.sequence import Sequence
from windmark.pipeline.deform.series import NOT_TRIED
from windmark.pipeline.deform.timeline import Timeline
from windmark.pipeline.deform.values import Mapper
from windmark.pipeline.deform.wind_off import wind_off_frames, zeroed
from windmark.pipeline.resume import Stopped, check_state, cut, read_stopped
from windmark.pipeline.same_run import check_begun, check_pictures
from windmark.tasks.deform.task import DeformedFrame, FrameImages
from windmark.tasks.deform.zero import motion_point

FEW_NAMED = 5
"""Files that a remark names."""


def run_sequence(
    loaded: Loaded,
    folder: Path,
    *,
    frames: Iterable[FrameImages] | None = None,
    live: bool = False,
    say: Callable[[FrameRecord], None] | None = None,
    resume: bool = False,
    finish: bool = False,
) -> Sequence:
    """Follow a test and write its results.

    Beside the results stands what a run needs that goes on with this one, should it be stopped; `clear` takes it away.

    Parameters
    ----------
    loaded : the project with everything it names
    folder : an existing folder that the results go to
    frames : images; None takes those on the disk
    live : the images arrive now: latency is measured, Ctrl-C is the usual end
    say : called with the numbers of every frame
    resume : go on with the run that was stopped in ``folder``
    finish : only bring that run's results to their end, with the frames that it has measured

    Raises
    ------
    FileError
        For images or tables that do not fit, a wind-off zero of which no frame can be used, results that cannot be
        written; and where there is no run to go on with, or what it was made with has changed since.
    """
    project = loaded.project
    table = read_frame_table(project)
    if frames is not None and project.has_clocks:
        raise io.FileError(project.path, "images that arrive are paired by their numbers; cameras with clocks of their "
                           "own are measured from the disk", "camera")  # fmt: skip
    known = instants_of(project) if frames is None or project.sequence.zero else Timeline([], "")
    made = made_with(project, wind_off_frames(project, known), loaded.read)
    if resume or finish:
        check_begun(folder, made)
    out = Sequence(table=table, clock=known.clock, remarks=known.remarks)
    points = PointMapper(loaded) if project.points and loaded.mesh is not None else None
    loaded, out.zero, out.moved, still = zeroed(loaded, known)
    stopped = read_stopped(folder, named(loaded.test), to_go_on=not finish) if resume or finish else None
    mapper = _mapper(loaded, still)
    if points is not None:
        points.reference(still)
    job = _Job(loaded, out, mapper, points, live, frames if isinstance(frames, Watch) else None)
    frames = known.frames if frames is None else frames
    if stopped is not None:
        frames = job.take_up(stopped, frames, known.frames, folder, finish)
    arrived = frames.told if isinstance(frames, Watch) else [] if live else None
    with Writer(folder, loaded, table, made, stopped, arrived=arrived, zero=out.zero) as writer:
        try:
            job.follow(frames, writer, say)
        except KeyboardInterrupt:
            if not live:
                raise
            out.interrupted = True
            writer.undo()
        if isinstance(frames, Watch):
            job.close_watch(frames, writer)
    if live:
        out.arrivals.update(fate for _, fate in files_told(folder))
    write_grid_series(folder, project.output, out.records)
    out.compared = None if mapper is None else mapper.compared
    return out


@dataclass
class _Job:
    """What takes the frames of a sequence, one after the other; parameters as in `run_sequence`."""

    loaded: Loaded
    out: Sequence
    mapper: Mapper | None
    points: PointMapper | None
    live: bool
    watch: Watch | None
    handed_on: dict[str, Any] = field(default_factory=dict)

    def take_up(
        self, stopped: Stopped[Kept], frames: Iterable[FrameImages], known: list[FrameImages], folder: Path,
        finish: bool,
    ) -> Iterable[FrameImages]:  # fmt: skip
        """Go on with a run that was stopped; the frames that it has not measured."""
        if stopped.frames:
            check_tables(folder, stopped.frames[-1])
        if not finish:
            check_state(folder, stopped)
        self.handed_on.update(stopped.handed_on(named(self.loaded.test)))
        if isinstance(frames, Watch):
            self._take_back_what_was_left(stopped, folder)
        done, count = stopped.frames, len(stopped.frames)
        if isinstance(frames, list) and not finish:
            check_pictures(folder, done, [(frame.key, pictures_of(frame)) for frame in frames[:count]])
        for kept in done:
            self.out.keep(kept.row, kept.state)
        there = {f.key: f for f in known}
        self._compare_again(done, there)
        for kept in done:
            if kept.pictured is not None and (images := kept.pictured[1] or there.get(kept.key)) is not None:
                self.out.gallery.look(kept.row, kept.pictured[0], images, self.loaded.test)
        if isinstance(frames, Watch):
            sizes = done[-1].sizes if done else stopped.sizes
            # One that had gone may be there again.
            told = [file for file, fate in files_told(folder, sizes[ARRIVALS]) if fate != "gone"]
            states = states_of(done)
            measured = sum(kept.row.status not in NOT_TRIED for kept in done)
            frames.go_on([kept.row.key for kept in done], {file: states.get(file) for file in told}, measured)
            return frames
        return [] if finish else islice(frames, count, None)

    def follow(self, frames: Iterable[FrameImages], writer: Writer, say: Callable[[FrameRecord], None] | None) -> None:
        """Measure and write frame after frame."""
        taken: list[FrameImages] = []
        for frame in follow_deformation(_noted(frames, taken), self.loaded.test, handed_on=self.handed_on):
            row = self._write(frame, taken.pop(0), writer)
            if say is not None:
                say(row)

    def close_watch(self, frames: Watch, writer: Writer) -> None:
        """Rows for the frames that were seen and not measured, fates of the last files, and what is odd about them."""
        left = [f for f in frames.left("the run was ended before it was measured") if f.key not in writer.frames]
        followed = follow_deformation(left, self.loaded.test, handed_on=self.handed_on)
        for frame, images in zip(followed, left, strict=True):
            self._write(frame, images, writer)
        for what, names in (("match no camera's pattern and were left alone", frames.foreign),
                            ("changed after they had been read: measured is what was in them then",
                             frames.changed_since())):  # fmt: skip
            if names:
                some = ", ".join(names[:FEW_NAMED]) + (", ..." if len(names) > FEW_NAMED else "")
                self.out.remarks = (*self.out.remarks, f"{len(names)} files {what}: {some}")

    # --- parts -----------------------------------------------------------------------------
    def _take_back_what_was_left(self, stopped: Stopped[Kept], folder: Path) -> None:
        """Frames that a run left when it was to end, before it was killed: they are measured when it goes on."""
        count = len(stopped.frames)
        while count and stopped.frames[count - 1].row.status == "left":
            count -= 1
        if count < len(stopped.frames):
            cut(stopped, folder, count)
            self.handed_on["index"] = count  # all else that they hand on is the last measured one's

    def _write(self, frame: DeformedFrame, images: FrameImages, writer: Writer) -> FrameRecord:
        loaded, project, out = self.loaded, self.loaded.project, self.out
        markers = loaded.test.markers
        centre = motion_point(markers)
        time_s = time_of(frame, images, out.table, project.sequence.rate_hz, bool(out.clock))
        row = record(
            frame, out.zero, loaded.stations, markers, centre, time_s, time.monotonic() - images.seen_s,
            len(loaded.test.volumes.names),
        )  # fmt: skip
        before = None if self.mapper is None else self.mapper.compared
        values = self.mapper.frame(frame, images) if self.mapper and gridded(project.output, frame) else {}
        of_points = self.points.frame(frame, images) if self.points is not None else ()
        compared = self.mapper is not None and self.mapper.compared is not before
        kept = frame.state if out.films(row) else None
        pictures = self.watch.prints(images) if self.watch else {} if self.live else pictures_of(images)
        pictured = out.gallery.look(row, frame, images, loaded.test)
        writer.add(
            frame, images, row, values, of_points, state=kept, compared=compared, pictured=pictured,
            handed_on=self.handed_on, pictures=pictures,
        )  # fmt: skip
        out.keep(row, kept)
        return row

    def _compare_again(self, done: list[Kept], known: dict[str, FrameImages]) -> None:
        """The most deformed frame so far is mapped again, where its pictures are still there."""
        most = next((k.compared for k in reversed(done) if k.compared is not None), None)
        if most is None or self.mapper is None:
            return
        frame, images = most
        images = images or known.get(frame.key)
        if images is not None:
            with suppress(io.FileError):
                self.mapper.frame(frame, images)


def _mapper(loaded: Loaded, still: list[tuple[DeformedFrame, FrameImages]]) -> Mapper | None:
    """What maps pictures onto the grid, with the wind-off ones; None where no values are wanted."""
    wanted = loaded.project.values
    if wanted is None or loaded.mesh is None:
        return None
    mapper = Mapper(loaded.test, loaded.mesh, wanted)
    mapper.reference(still)
    return mapper


def _noted(frames: Iterable[FrameImages], taken: list[FrameImages]) -> Iterator[FrameImages]:
    """The same frames, each of them put into a list before it is handed on."""
    for frame in frames:
        taken.append(frame)
        yield frame


def time_of(frame: DeformedFrame, images: FrameImages, table: FrameTable, rate_hz: float | None, clocks: bool) -> float:
    """By the cameras' clocks, the table, the names' stamps, the rate, or a recording that has time stamps."""
    row = table.row(frame.key)
    if not clocks and row is not None and np.isfinite(table.time_s[row]):
        return float(table.time_s[row])
    if np.isfinite(images.time_s):
        return images.time_s
    if rate_hz:
        return frame.instant / rate_hz
    stamps = [item.time_s for item in images.images.values() if isinstance(item, io.Frame)]
    return next((t for t in stamps if np.isfinite(t)), float("nan"))
