"""A whole deformation test: wind-off zero, then every frame, from a disk or live."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.deformation import Deformation, zero_markers
from windmark.pipeline.deform.follow import follow_deformation, identified_again
from windmark.pipeline.deform.frames import FrameTable, instants_of, read_frame_table
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.outputs import Writer, gridded
from windmark.pipeline.deform.points import PointMapper
from windmark.pipeline.deform.record import FrameRecord, Zero, record
from windmark.pipeline.deform.task import DeformedFrame, FrameImages
from windmark.pipeline.deform.timeline import Timeline, key_of
from windmark.pipeline.deform.values import Compared, Mapper
from windmark.scene import View

Array = NDArray[np.float64]

KEPT = 120
"""States that are kept for the film; with more frames every second one is dropped, again and again."""


@dataclass
class Sequence:
    """What is left of a sequence when it is over.

    Parameters
    ----------
    records : the numbers of every frame
    zero : the wind-off state; None without one
    moved : (N, 3) how far the zero moved the markers from their table; None without one
    film : some evenly spaced frames with their states
    table : what is known of the frames besides
    interrupted : Ctrl-C ended it
    compared : the most deformed frame mapped with and without its deformation; None without values and zero
    clock : the camera whose pictures are the instants; "" where pictures of one number are of one instant
    remarks : what is odd about the pictures' times
    """

    records: list[FrameRecord] = field(default_factory=list)
    zero: Zero | None = None
    moved: Array | None = None
    film: list[tuple[FrameRecord, Deformation]] = field(default_factory=list)
    table: FrameTable = field(default_factory=FrameTable)
    interrupted: bool = False
    compared: Compared | None = None
    clock: str = ""
    remarks: tuple[str, ...] = ()
    _stride: int = 1

    def keep(self, row: FrameRecord, state: Deformation | None) -> None:
        """Add a frame; memory stays that of its few numbers."""
        self.records.append(row)
        if state is not None and row.index % self._stride == 0:
            self.film.append((row, state))
        if len(self.film) > KEPT:
            self._stride *= 2
            self.film = [kept for kept in self.film if kept[0].index % self._stride == 0]

    @property
    def good(self) -> list[FrameRecord]:
        """The frames with a state."""
        return [r for r in self.records if r.status != "lost"]


def run_sequence(
    loaded: Loaded,
    folder: Path,
    *,
    frames: Iterable[FrameImages] | None = None,
    live: bool = False,
    say: Callable[[FrameRecord], None] | None = None,
) -> Sequence:
    """Follow a test and write its results.

    Parameters
    ----------
    loaded : the project with everything it names
    folder : an existing folder that the results go to
    frames : images; None takes those on the disk
    live : the images arrive now: latency is measured, Ctrl-C is the usual end, and files are readable all the time
    say : called with the numbers of every frame

    Raises
    ------
    FileError
        For images or tables that do not fit, or a wind-off zero of which no frame can be used.
    """
    project = loaded.project
    table = read_frame_table(project)
    if frames is not None and project.has_clocks:
        raise io.FileError(project.path, "images that arrive are paired by their numbers; cameras with clocks of their "
                           "own are measured from the disk", "camera")  # fmt: skip
    known = instants_of(project) if frames is None or project.sequence.zero else Timeline([], "")
    frames = known.frames if frames is None else frames
    out = Sequence(table=table, clock=known.clock, remarks=known.remarks)
    points = PointMapper(loaded) if project.points and loaded.mesh is not None else None
    loaded, out.zero, out.moved, still = zeroed(loaded, known)
    test = loaded.test
    mapper = _mapper(loaded, still)
    if points is not None:
        points.reference(still)
    model = test.markers.role != "wall"
    centre = test.markers.xyz[model].mean(axis=0)
    with Writer(folder, loaded, table) as writer:
        try:
            for frame, images, arrived in _followed(frames, loaded):
                latency = time.time() - arrived if live else float("nan")
                row = record(
                    frame, out.zero, loaded.stations, test.markers, centre,
                    _time(frame, images, table, project.sequence.rate_hz), latency, len(test.volumes.names),
                )  # fmt: skip
                values = mapper.frame(frame, images) if mapper and gridded(project.output, frame) else {}
                writer.add(frame, row, values, points.frame(frame, images) if points is not None else ())
                out.keep(row, frame.state)
                if live:
                    writer.live()
                if say is not None:
                    say(row)
        except KeyboardInterrupt:
            if not live:
                raise
            out.interrupted = True
    out.compared = None if mapper is None else mapper.compared
    return out


def _mapper(loaded: Loaded, still: list[tuple[DeformedFrame, FrameImages]]) -> Mapper | None:
    """What maps pictures onto the grid, with the wind-off ones; None where no values are wanted."""
    wanted = loaded.project.values
    if wanted is None or loaded.mesh is None:
        return None
    mapper = Mapper(loaded.test, loaded.mesh, wanted)
    mapper.reference(still)
    return mapper


def _followed(frames: Iterable[FrameImages], loaded: Loaded) -> Iterator[tuple[DeformedFrame, FrameImages, float]]:
    """Frames with their images and the time stamp of the newest one."""
    taken: list[tuple[FrameImages, float]] = []

    def noted() -> Iterator[FrameImages]:
        for frame in frames:
            items = [p for p in frame.images.values() if isinstance(p, io.PictureFile)]
            paths = [p if isinstance(p, Path) else p.path for p in items]
            taken.append((frame, max((p.stat().st_mtime for p in paths if p.exists()), default=time.time())))
            yield frame

    for frame in follow_deformation(noted(), loaded.test):
        yield frame, *taken.pop(0)


def _time(frame: DeformedFrame, images: FrameImages, table: FrameTable, rate_hz: float | None) -> float:
    """By the cameras' clocks, the table, the rate, or the first camera whose recording has time stamps."""
    if np.isfinite(images.time_s):
        return images.time_s
    row = table.row(frame.key)
    if row is not None and np.isfinite(table.time_s[row]):
        return float(table.time_s[row])
    if rate_hz:
        return frame.instant / rate_hz
    stamps = [item.time_s for item in images.images.values() if isinstance(item, io.Frame)]
    return next((t for t in stamps if np.isfinite(t)), float("nan"))


def zeroed(
    loaded: Loaded, timeline: Timeline
) -> tuple[Loaded, Zero | None, Array | None, list[tuple[DeformedFrame, FrameImages]]]:
    """The test with the markers where the wind-off frames show them, the wind-off state, and these frames."""
    project = loaded.project
    wanted = [key_of(k) for k in project.sequence.zero]
    if not wanted:
        return loaded, None, None, []
    known = {f.key: f for f in timeline.frames}
    missing = [k for k in wanted if k not in known]
    if missing:
        raise io.FileError(project.path, f"frame {missing[0]} has no image; expected a wind-off frame", "sequence.zero")
    good, why = [], ""
    for key in wanted:  # each for itself: wind-off frames may be far apart
        frame = next(follow_deformation([known[key]], loaded.test))
        if frame.state is None:
            why = f"frame {key}: {frame.reason}"
        else:
            good.append((frame, known[key]))
    if not good:
        raise io.FileError(project.path, f"no wind-off frame can be used; {why}", "sequence.zero")
    states, seen = [f.state for f, _ in good if f.state], [f.observations for f, _ in good if f.observations]
    corrected = zero_markers(states, seen, [[View(n, n) for n in f.views] for f, _ in good], loaded.test.markers)
    test = replace(loaded.test, markers=corrected.markers, marker_cov=corrected.cov)
    good = [(identified_again(frame, test), images) for frame, images in good]
    zero = Zero.of([f.state for f, _ in good if f.state], loaded.stations)
    return replace(loaded, test=test), zero, corrected.shift, good
