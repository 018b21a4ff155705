"""The verb `windmark deform`: follow a deforming model through a sequence, from a disk or live."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.deform_report import deform_page
from windmark.app.progress import progress
from windmark.app.project_place import project_in
from windmark.app.provenance import Provenance
from windmark.app.series_folder import left, series_folder
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import job_time
from windmark.deformation import weak_directions
from windmark.errors import g3
from windmark.io.staging import check_free
from windmark.pipeline.alike import alike, listed
from windmark.pipeline.deform import (
    Changes,
    FrameRecord,
    Loaded,
    Sequence,
    Watch,
    load,
    read_deform_project,
    run_sequence,
)
from windmark.pipeline.deform.names import key_of
from windmark.pipeline.deform.record import MISFIT
from windmark.pipeline.deform.series import NOT_TRIED, STATUS
from windmark.pipeline.resume import begun_with
from windmark.pipeline.verdict import Verdict, rules
from windmark.pipeline.verdict.deform import deform_verdict
from windmark.pipeline.verdict.grid import grid_findings
from windmark.pipeline.verdict.table import hinge_findings, walls_findings
from windmark.pipeline.verdict.wanted import far_findings
from windmark.tasks.deform.task import DeformationTest

Record = dict[str, Any]

NUMBER = re.compile(r"[0-9.]+(e[-+]?[0-9]+)?")
FRAMES_SHOWN, FEW_SHOWN = 20, 5
"""Frames of a camera with few markers that are listed; all are in cameras.csv."""


@dataclass(frozen=True)
class Live:
    """Pictures arrive in ``folder``; ``idle_s`` and ``frames`` end it, see `Watch`."""

    folder: Path
    idle_s: float | None = None
    frames: int | None = None


def deform(path: Path, changed: Changes, live: Live | None, go_on: str, as_json: bool) -> None:
    """Follow, write whole, say how it went.

    Live results appear in the folder itself. What was stopped on the way is gone on with (``go_on`` "resume") or
    brought to its end with what it has ("finish").
    """
    start = job_time()
    path = project_in(path, "deform")
    loaded = load(read_deform_project(path, changed))
    for remark in loaded.remarks:
        console.note(path, remark)
    folder = loaded.project.output.folder
    alive = live is not None or (go_on == "finish" and begun_with(folder) is not None)
    if alive and not go_on and (count := left(folder)):
        check_free(folder)
        raise io.FileError(
            folder, f"holds {count} frames of a run that was stopped; --resume goes on with them, --finish makes do "
            "with them, --output takes another folder",
        )  # fmt: skip
    shown: AbstractContextManager[Callable[[str], None]]
    shown = progress() if live is None else nullcontext(_quiet)  # live, every frame has its line
    with shown as show, series_folder(folder, go_on, live=alive) as (out, go_on):
        if live is not None:
            sequence = _live(loaded, folder, live, go_on == "resume", as_json)
        else:
            show("compile and find the first frame")
            sequence = run_sequence(
                loaded, out.place, frames=[] if alive else None, live=alive,
                say=lambda row: show(f"frame {row.key}: {row.status}"), resume=go_on == "resume",
                finish=go_on == "finish",
            )  # fmt: skip
        show("draw the report")
        record = _finish(loaded, sequence, out, start)
        out.refused = not sequence.good
    record["folder"] = folder
    good = bool(sequence.good)
    if good or not as_json:
        console.answer(record, as_json, [
            *_lines(loaded, sequence, record), *verdict_lines(Verdict.of_record(record["verdict"])),
            *not_drawn(record["not_drawn"]), f"report: {folder / 'report.html'}",
        ])  # fmt: skip
    if not good:
        why = sequence.records[0].reason if sequence.records else "no frame arrived"
        console.refuse(f"no frame gave a deformation; the first: {why}", as_json, record)


def _live(loaded: Loaded, folder: Path, live: Live, resume: bool, as_json: bool) -> Sequence:
    tell = console.Narration()
    say: Callable[[FrameRecord], None] | None = None if as_json else lambda row: tell(live_line(row))
    if not as_json:
        tell(f"watching {live.folder} (Ctrl-C ends), results in {folder}")
    arriving = Watch(loaded.project, live.folder, idle_s=live.idle_s, stop_after=live.frames)
    return run_sequence(loaded, folder, frames=arriving, live=True, say=say, resume=resume)


def _quiet(_: str) -> None:
    """Show nothing."""


def live_line(row: FrameRecord) -> str:
    """One frame as it comes."""
    latency = f"{1e3 * row.latency_s:.0f} ms" if np.isfinite(row.latency_s) else ""
    if row.status == "lost":
        return f"frame {row.key}: lost: {row.reason}"
    if row.status in NOT_TRIED:
        return f"frame {row.key}: {row.status}: {row.reason}"
    tip = ""
    if len(row.twist):
        tip = (f", tip: twist {row.twist[-1]:+z.4f} ± {row.twist_sigma[-1]:.4f} deg,"
               f" bending {row.bending[-1]:+z.3f} ± {row.bending_sigma[-1]:.3f}")  # fmt: skip
    return f"frame {row.key}: {row.spots - row.outliers} spots, RMS {row.rms_px:.3f} px{tip}, {latency}"


def _finish(loaded: Loaded, sequence: Sequence, out: io.ResultFolder, start: float) -> Record:
    """Report, film and summary beside the tables."""
    record, folder = summary(loaded, sequence), out.place
    zero = [key_of(key) for key in loaded.project.sequence.zero]
    unit = loaded.project.length_unit
    beside = [] if loaded.mesh is None else grid_findings(loaded.test.markers, loaded.mesh, unit)
    beside += far_findings(loaded.places, unit)
    beside += hinge_findings(loaded.test.markers, loaded.test.volumes)
    beside += walls_findings(loaded.test.markers, sequence.good, unit)
    verdict = deform_verdict(sequence.records, weakest(loaded, sequence, that_matter=True), unit, zero,
                             loaded.test.volumes.names, beside,
                             None if sequence.zero is None else sequence.zero.apart)  # fmt: skip
    page = deform_page(loaded, sequence, record, folder)
    put_verdict(page, verdict)
    page.provenance(Provenance.of_project(loaded.project, out.sources()))
    (folder / "report.html").write_text(page.html(), encoding="utf-8")
    record |= {"verdict": verdict.record(), "not_drawn": page.failed, "seconds": job_time() - start}
    console.write_summary(out, record, loaded.project.path.resolve().parent)
    return record


def summary(loaded: Loaded, sequence: Sequence) -> Record:
    """The figures of a sequence."""
    rows, good = sequence.records, sequence.good
    record: Record = {"frames": len(rows), "cameras": cameras_record(sequence)}
    if sequence.clock:
        record["clock"] = sequence.clock
    for status in STATUS:
        record[status] = sum(r.status == status for r in rows)
    if sequence.arrivals:
        record["files"] = dict(sequence.arrivals)
    if (zero := sequence.zero) is not None:
        record["zero"] = {"frames": zero.frames, "marker": zero.marker, "deformed": zero.deformed,
                          "deformed_sigma": zero.deformed_sigma}  # fmt: skip
        if zero.scatter is not None:
            record["zero"]["scatter"] = dict(zip(("of", "difference", "sigmas"), zero.scatter, strict=True))
    if good:
        record["median_spots"] = float(np.median([r.spots for r in good]))
        record["outliers"] = int(sum(r.outliers for r in good))
        record["median_rms_px"] = float(np.median([r.rms_px for r in good]))
        record["median_sigma0"] = float(np.median([r.sigma0 for r in good]))
        record["median_frame_ms"] = 1e3 * float(np.median([r.seconds for r in good]))
        latency = [r.latency_s for r in good if np.isfinite(r.latency_s)]
        if latency:
            record["median_latency_ms"] = 1e3 * float(np.median(latency))
        record["warnings"] = sentences(sequence, "warnings")
        record["unchecked"] = dict.fromkeys(unwatched(loaded.test), len(good)) | sentences(sequence, "unchecked")
        record["suspect"] = dict(Counter(n for r in good for n in r.suspect))
        record["weak"] = list(weakest(loaded, sequence))
        last = good[-1]
        record["last"] = {
            name: {"value": float(v), "sigma": float(s)}
            for name, v, s in zip(loaded.test.volumes.names, last.q, last.q_sigma, strict=True)
        }
        if len(last.twist):
            record["last_twist_deg"], record["last_twist_sigma_deg"] = last.twist.tolist(), last.twist_sigma.tolist()
            record["last_bending"], record["last_bending_sigma"] = last.bending.tolist(), last.bending_sigma.tolist()
    return record


def sentences(sequence: Sequence, which: str) -> dict[str, int]:
    """What frames warn of, or leave unchecked -> in how many of them, most first.

    Numbers, names of markers and what is left of a law differ from frame to frame: they are those of the first one.
    """
    first: dict[str, str] = {}
    count: Counter[str] = Counter()
    for row in sequence.good:
        # Of several of one kind the frame's first one stays.
        kinds = {NUMBER.sub("#", words.partition(": ")[0]): words for words in reversed(getattr(row, which))}
        for kind, words in kinds.items():
            first.setdefault(kind, f"frame {row.key}: {words}")
        count.update(kinds.keys())
    return {first[kind]: n for kind, n in count.most_common()}


def unwatched(test: DeformationTest) -> tuple[str, ...]:
    """What no frame tells of cameras that are taken as fixed: without markers on walls nothing there stands still."""
    if (test.markers.role == "wall").any() or all(s.moves for s in test.stations):
        return ()
    return ("whether the cameras kept their places and focal lengths, or the model moved: no markers on walls",)


def cameras_record(sequence: Sequence) -> Record:
    """For each camera: frames without an image, frames with few markers, the reasons, and its largest lag."""
    out: Record = {}
    for name in dict.fromkeys(n for r in sequence.records for n in r.cameras):
        seen = [(r.key, r.cameras[name]) for r in sequence.records if name in r.cameras]
        lag = np.array([s.lag_s for _, s in seen])
        few = [
            {"frame": key, "expected": s.expected, "spots": s.found, "reason": s.reason} for key, s in seen if s.reason
        ]
        out[name] = {
            "few": few, "median_spots": float(np.median([s.found for _, s in seen])),
            "max_lag_s": float(np.nanmax(np.abs(lag))) if np.isfinite(lag).any() else None,
        }  # fmt: skip
    return out


def weakest(loaded: Loaded, sequence: Sequence, *, that_matter: bool = False) -> tuple[str, ...]:
    """What the last frame that was kept says of the set-up; all of it, or what is beyond `rules.ANGLE_DEG`."""
    if not sequence.film:
        return ()
    state = sequence.film[-1][1]
    from_prior = tuple(f"{name} is known from its prior alone" for name in state.from_prior)
    markers = loaded.test.markers
    centre = markers.xyz[markers.role != "wall"].mean(axis=0)
    size = float(np.linalg.norm(markers.xyz[markers.role != "wall"] - centre, axis=1).max())
    least = np.radians(rules.ANGLE_DEG) * size if that_matter else 0.0
    return (*weak_directions(state, centre, unit=loaded.project.length_unit, least=least), *from_prior)


def _lines(loaded: Loaded, sequence: Sequence, record: Record) -> list[str]:
    """The figures in words, and one line for frames that were not simply tracked."""
    lines = [f"{record['frames']} frames: {record['tracked']} tracked, {record['cold']} found without help, "
             f"{record['lost']} lost"
             + "".join(f", {record[n]} {n}" for n in (*NOT_TRIED, MISFIT) if record[n])
             + (", interrupted" if sequence.interrupted else "")]  # fmt: skip
    if sequence.arrivals:
        fates = ", ".join(f"{count} {fate}" for fate, count in sequence.arrivals.most_common())
        lines.append(f"{sequence.arrivals.total()} files: {fates} (arrivals.csv)")
    told = alike((r.key, f"{r.status}: {r.reason}") for r in sequence.records if r.reason)
    lines += [f"  {listed('frame', names)}: {words}" for words, names in told.items()][:FRAMES_SHOWN]
    for name, of in record["cameras"].items():
        lines += [f"  few markers: {name}, frame {few['frame']}: {few['spots']} of {few['expected']}: {few['reason']}"
                  for few in of["few"][:FEW_SHOWN]]  # fmt: skip
        lines += [f"  ... {len(of['few']) - FEW_SHOWN} more of {name}"] if len(of["few"]) > FEW_SHOWN else []
    lines += [f"  {remark}" for remark in sequence.remarks]
    if sequence.clock:
        lags = ", ".join(f"{n} up to {g3(1e3 * of['max_lag_s'])} ms" for n, of in record["cameras"].items()
                         if n != sequence.clock and of["max_lag_s"] is not None)  # fmt: skip
        lines.append(f"instants: those of {sequence.clock}; others' spots are interpolated between their pictures "
                     f"(nearest picture off by: {lags or 'none'})")  # fmt: skip
    if sequence.zero is not None:
        lines.append(f"wind-off zero: {sequence.zero.words(loaded.project.length_unit)}")
    if sequence.good:
        lines.append(
            f"median: {record['median_spots']:.0f} spots, RMS {record['median_rms_px']:.3f} px, sigma0 "
            f"{record['median_sigma0']:.2f}, {record['median_frame_ms']:.0f} ms per frame"
            + (f", latency {record['median_latency_ms']:.0f} ms" if "median_latency_ms" in record else "")
        )
        for kind, key in (("warning", "warnings"), ("unchecked", "unchecked")):
            lines += [f"{kind}: {words} ({n} of {len(sequence.good)} frames)" for words, n in
                      [*record[key].items()][:FEW_SHOWN]]  # fmt: skip
        lines += [f"weak: {words}" for words in record["weak"]]
        last, unit = sequence.good[-1], loaded.project.length_unit
        if len(last.twist):
            lines.append(
                f"frame {last.key}, tip: twist {last.twist[-1]:+z.4f} ± {last.twist_sigma[-1]:.4f} deg, bending "
                f"{last.bending[-1]:+z.3f} ± {last.bending_sigma[-1]:.3f} {unit} (1 sigma)"
            )
    return lines
