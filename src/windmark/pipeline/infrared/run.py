"""A whole infrared run: the model followed through the frames, temperatures, then heat flux from their histories."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, tee
from pathlib import Path
from typing import Any

import numpy as np

from windmark.errors import DataError, WindmarkError
from windmark.paint import dominant
from windmark.pipeline import same_run
from windmark.pipeline.deform.pictures import follow_deformation
from windmark.pipeline.deform.resume import inputs as deform_inputs
from windmark.pipeline.deform.resume import named, pictures_of, prints_of
from windmark.pipeline.deform.wind_off import wind_off_frames, zeroed
from windmark.pipeline.infrared.flux import FieldMaker, FrameFields, make_fluxes
from windmark.pipeline.infrared.frame import run_frame
from windmark.pipeline.infrared.jumps import jumps
from windmark.pipeline.infrared.load import InfraredRun, as_deform
from windmark.pipeline.infrared.odd import odd_frames
from windmark.pipeline.infrared.order import exchanged
from windmark.pipeline.infrared.outputs import PointHistories, reduced, write_frame, write_tables
from windmark.pipeline.infrared.record import FAILED, FrameRecord
from windmark.pipeline.infrared.repeats import REPEATS, repeated_in, without_repeats
from windmark.pipeline.infrared.sensors import even_reader
from windmark.pipeline.infrared.start import odd_start
from windmark.pipeline.infrared.steady import SteadyMap, steady_map
from windmark.pipeline.infrared.store import Store
from windmark.pipeline.resume import CHUNK, SeriesJournal, check_state, read_stopped
from windmark.tasks.deform.task import DeformedFrame, FrameImages
from windmark.tasks.infrared import CURVED, LATE, LATERAL

MEAN = "mean"
"""Name of the steady map among the frames."""
DOUBTFUL = LATE | LATERAL | CURVED


@dataclass
class InfraredResult:
    """What is left of a run when it is over.

    Parameters
    ----------
    records : of every frame
    points : histories at the wanted points
    steady : the mean of the frames; None where heat flux was wanted
    remarks : what is to be said of the whole run
    """

    records: list[FrameRecord]
    points: PointHistories
    steady: SteadyMap | None = None
    remarks: list[str] = field(default_factory=list)


def run_infrared(
    run: InfraredRun,
    folder: Path,
    *,
    say: Callable[[FrameRecord], None] = lambda _: None,
    resume: bool = False,
    finish: bool = False,
) -> InfraredResult:
    """Reduce all frames and write their results.

    A frame that cannot be reduced has a record with the reason, and its nodes have a gap there. Beside the results
    stands a journal, with which a run that was stopped goes on; heat flux is then made anew from all frames.

    Parameters
    ----------
    run : see `load_infrared`
    folder : existing, that the results go to
    say : called with the record of every frame
    resume : go on with the run that was stopped in ``folder``
    finish : only bring that run's results to their end, with the frames that it has reduced

    Raises
    ------
    FileError
        Where results cannot be written, no wind-off frame can be used, there is no run to go on with, or what it was
        made with has changed.
    """
    made = made_with(run)
    if resume or finish:
        same_run.check_begun(folder, made)
    loaded = zeroed(run.deforming, run.timeline, even_reader(run.sensors))[0]
    run = replace(run, deforming=loaded)
    names = named(loaded.test)
    stopped = read_stopped(folder, names, to_go_on=not finish) if resume or finish else None
    store = Store(folder, tuple(run.sensors))
    records: list[FrameRecord] = [] if stopped is None else list(stopped.frames)
    handed_on: dict[str, Any] = {}
    frames: Iterable[FrameImages] = run.timeline.frames
    if stopped is not None:
        if not finish:
            check_state(folder, stopped)
        now = [(f.key, pictures_of(f)) for f in run.timeline.frames[: len(records)]]
        same_run.check_pictures(folder, records, now)
        handed_on.update(stopped.handed_on(names))
        frames = [] if finish else islice(frames, len(records), None)
    journal = SeriesJournal(folder, names, stopped)
    try:
        if stopped is None:
            journal.begin(made, {})
        for record in _follow(run, store, frames, run.timeline.frames[: len(records)], handed_on):
            journal.add(record, handed_on)
            records.append(record)
            if len(records) % CHUNK == 0:
                journal.sync()
            say(record)
    finally:
        journal.close()
    return _finished(run, store, folder, records)


def _follow(
    run: InfraredRun, store: Store, frames: Iterable[FrameImages], before: Sequence[FrameImages],
    handed_on: dict[str, Any],
) -> Iterator[FrameRecord]:  # fmt: skip
    """The records of the frames; what they leave is in the store before."""
    taken: list[tuple[FrameImages, FrameImages]] = []

    def noted() -> Iterator[FrameImages]:
        given, asked = tee(frames)
        for whole, new in zip(given, without_repeats(asked, before, run.deforming.test), strict=True):
            taken.append((whole, new))
            yield new

    # Markers are looked for in even pictures: the pattern of unequal pixels stands still, as a repeated picture does.
    even = even_reader(run.sensors)
    for frame in follow_deformation(noted(), run.deforming.test, read=even, handed_on=handed_on):
        whole, new = taken.pop(0)
        yield replace(one_frame(run, store, frame, new), pictures=pictures_of(whole))


def one_frame(run: InfraredRun, store: Store, frame: DeformedFrame, images: FrameImages) -> FrameRecord:
    """Reduce a frame and put it into the store; whatever is wrong with its data becomes its record's reason."""
    pictures, repeated = pictures_of(images), repeated_in(images)
    said = [f"{name}: {REPEATS}" for name in repeated]
    try:
        if repeated and not images.images:
            raise DataError("; ".join(said))
        done = run_frame(run, frame, images, pictures)
    except WindmarkError as error:
        return FrameRecord(frame.key, frame.index, float(run.times[frame.index]), pictures, FAILED, str(error),
                           repeated=repeated)  # fmt: skip
    store.put(frame.index, done.vertices, done.cameras)
    return replace(done.record, remarks=(*said, *done.record.remarks), repeated=repeated)


def _finished(run: InfraredRun, store: Store, folder: Path, records: list[FrameRecord]) -> InfraredResult:
    """Heat flux or the mean, and all files."""
    good = [r.index for r in reduced(records)]
    remarks: list[str] = []
    done = make_fluxes(run, store, good)
    if run.walls and good and not done:
        remarks.append("there is no heat flux: no frame with temperatures is left before the heating began, or after")
    if (said := odd_start(run, store, done)):
        remarks.append(said)
    if (said := exchanged(run, store, done)) or (said := odd_frames(run, store, done)):
        remarks.append(said)
    remarks += jumps(run, store, done)
    maker, points = FieldMaker(run, store, done), PointHistories(run)
    out, every = [], run.project.output.every
    last = good[-1] if good else -1
    for record in records:
        if record.index not in good:
            out.append(record)
            continue
        fields = maker.fields(record.index)
        record = _with_flux(record, fields)
        points.add(record, fields)
        if record.index % every == 0 or record.index == last:
            write_frame(folder, run, record, run.mesh.moved(store.vertices(record.index)), fields)
        out.append(record)
    result = InfraredResult(out, points, None, remarks)
    if not run.walls and len(good) > 1:
        _steady(run, store, folder, result, good)
    write_tables(folder, run, out)
    points.write(folder)
    return result


def _with_flux(record: FrameRecord, fields: FrameFields) -> FrameRecord:
    if fields.no_flux:
        said = f"most of the nodes that have a heat flux in other frames have none: {fields.no_flux}"
        record = replace(record, no_flux=fields.no_flux, remarks=(*record.remarks, said))
    q = fields.flux
    if q is None or not q.known.any():
        return record
    on = q.known
    return replace(
        record, median_q=float(np.median(q.value[on])), median_sigma_q=float(np.median(q.sigma[on])),
        flagged=float(np.mean((fields.flags[on] & DOUBTFUL) > 0)), causes={**record.causes, "q": dominant(q)},
    )  # fmt: skip


def _steady(run: InfraredRun, store: Store, folder: Path, result: InfraredResult, good: list[int]) -> None:
    """The mean over all frames, on the grid at rest."""
    even = [1 / (s.frames + 1) for s in run.sensors.values() if s.cold is not None]
    mean = steady_map(store, good, max(even, default=0.0))
    if isinstance(mean, str):
        result.remarks.append(f"there is no mean map: {mean}")
        return
    result.steady = mean
    key = {r.index: r.key for r in result.records}
    if mean.course is not None:
        result.remarks.append(mean.course.words)
    result.remarks += [f"frame {key[i]} does not count in the mean: {why}" for i, why in mean.left_out.items()]
    none = np.where(mean.count > 0, 0, 1).astype(np.uint16)
    fields = FrameFields(mean.field, None, none, np.where(mean.count > 0, 0, -1).astype(np.int8))
    record = FrameRecord(MEAN, -1, float("nan"), {}, "reduced", causes={"T": dominant(mean.field)})
    write_frame(folder, run, record, run.mesh, fields)


def made_with(run: InfraredRun) -> dict[str, Any]:
    """See `same_run.made_with`; where the results go is left out."""
    project = run.project
    options = json.loads(project.model_dump_json(exclude={"path": True, "output": {"folder"}}))
    files = deform_inputs(as_deform(project))
    for c in project.camera:
        files += [] if c.black_bodies is None else [(f"camera {c.name}: black_bodies", c.black_bodies)]
    if project.surface.table is not None:
        files.append(("surface.table", project.surface.table))
    files += [(f"points {p.label}: file", p.file) for p in project.points]
    said = {f"[{k}] of the project": v for k, v in options.items()}
    wind_off = wind_off_frames(run.deforming.project, run.timeline)
    items = [item for frame in run.timeline.frames for item in frame.images.values()]
    pictures = {item if isinstance(item, Path) else item.path for item in items}
    files = same_run.with_all(files, run.read, project.path, pictures)
    return same_run.made_with("infrared", said | prints_of(wind_off), files)
