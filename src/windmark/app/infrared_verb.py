"""The verb `windmark infrared`: reduce an infrared run, write whole, say how it went."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.infrared_report import infrared_page, noise_kelvin
from windmark.app.progress import progress
from windmark.app.project_place import project_in
from windmark.app.provenance import Provenance
from windmark.app.series_folder import series_folder
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import job_time
from windmark.pipeline.alike import alike, listed
from windmark.pipeline.infrared import (
    FAILED,
    FrameRecord,
    InfraredResult,
    InfraredRun,
    load_infrared,
    read_infrared_project,
    reduced,
    run_infrared,
)
from windmark.pipeline.infrared.likely import odd_units
from windmark.pipeline.verdict.grid import grid_findings
from windmark.pipeline.verdict.infrared import infrared_verdict, unit_findings
from windmark.pipeline.verdict.wanted import far_findings, valueless_findings

Record = dict[str, Any]

SHOWN = 20
"""Frames with something to be said that are listed on the terminal; all are in the report."""


def infrared(path: Path, output: Path | None, go_on: str, as_json: bool) -> None:
    """Reduce every frame of a project; ``go_on`` "resume" or "finish" what was stopped, "" begins anew."""
    start = job_time()
    path = project_in(path, "infrared")
    run = load_infrared(read_infrared_project(path, output))
    for remark in run.remarks:
        console.note(path, remark)
    folder = run.project.output.folder
    with progress(len(run.timeline.frames)) as show, series_folder(folder, go_on) as (out, go_on):
        result = run_infrared(
            run, out.place, say=lambda r: show(f"frame {r.key}: {r.status}"), resume=go_on == "resume",
            finish=go_on == "finish",
        )  # fmt: skip
        show("draw the report")
        record = summary(run, result)
        unit = run.project.length_unit
        beside = grid_findings(run.deforming.test.markers, run.mesh, unit)
        beside += unit_findings(odd_units(run), run.project.surface.surroundings_K)
        beside += [*far_findings(run.points, unit), *valueless_findings(result.points.valueless())]
        verdict = infrared_verdict(result.records, result.remarks, unit, beside)
        page = infrared_page(run, result, out.place)
        put_verdict(page, verdict)
        page.provenance(Provenance.of_project(run.project, out.sources()))
        (out.place / "report.html").write_text(page.html(), encoding="utf-8")
        record |= {"verdict": verdict.record(), "not_drawn": page.failed, "seconds": job_time() - start}
        console.write_summary(out, record, path.resolve().parent)
        out.refused = not reduced(result.records)
    record["folder"] = folder
    good = bool(reduced(result.records))
    if good or not as_json:
        console.answer(record, as_json, [
            *_lines(result), *verdict_lines(verdict), *not_drawn(record["not_drawn"]),
            f"report: {folder / 'report.html'}",
        ])  # fmt: skip
    if not good:
        why = result.records[0].reason if result.records else "there are no frames"
        console.refuse(f"no frame could be reduced; the first: {why}", as_json, record)


def summary(run: InfraredRun, result: InfraredResult) -> Record:
    """The figures of a run."""
    done = reduced(result.records)
    out: Record = {
        "frames": len(result.records), "reduced": len(done), "failed": sum(r.status == FAILED for r in result.records),
        "cameras": {name: {"noise_K": noise_kelvin(run, name)} for name in run.sensors},
        "remarks": [*run.remarks, *result.remarks],
        "results": [_frame(r) for r in result.records],
    }  # fmt: skip
    if result.steady is not None:
        field = result.steady.field
        out["mean"] = {"frames": len(done) - len(result.steady.left_out),
                       "median_temperature_K": float(np.median(field.value[field.known])),
                       "median_sigma_K": float(np.median(field.sigma[field.known])),
                       "scatter_over_noise": result.steady.excess}  # fmt: skip
    return out


def _frame(r: FrameRecord) -> Record:
    out: Record = {"frame": r.key, "time_s": r.time_s if np.isfinite(r.time_s) else None, "status": r.status,
                   "reason": r.reason, "remarks": list(r.remarks)}  # fmt: skip
    if r.status == FAILED:
        return out
    flux = {} if not np.isfinite(r.median_q) else {
        "median_heat_flux": r.median_q, "median_sigma_heat_flux": r.median_sigma_q, "flagged": r.flagged,
    }  # fmt: skip
    return out | {
        "rms_px": r.rms_px, "seen": r.seen, "cameras": list(r.cameras), "median_temperature_K": r.median_T,
        "median_sigma_temperature_K": r.median_sigma_T, **flux,
        "causes": {k: [[n, s] for n, s in of[:5]] for k, of in r.causes.items()}, "seconds": r.seconds,
    }  # fmt: skip


def _lines(result: InfraredResult) -> list[str]:
    """The result in words."""
    records, done = result.records, reduced(result.records)
    lines = [f"{len(records)} frames: {len(done)} reduced, {len(records) - len(done)} failed"]
    told = [*alike((r.key, words) for r in records for words in (r.reason, *r.remarks) if words).items()]
    lines += [f"  {listed('frame', names)}: {words}" for words, names in told[:SHOWN]]
    lines += [f"  ... {len(told) - SHOWN} more (frames.csv)"] if len(told) > SHOWN else []
    lines += [f"  {remark}" for remark in result.remarks]
    for r in done[:1] + done[1:][-1:]:
        flux = (f", heat flux {r.median_q:z.0f} ± {r.median_sigma_q:.0f} W/m2" if np.isfinite(r.median_q) else "")
        lines.append(f"  frame {r.key}: {100 * r.seen:.0f} % of the nodes seen, temperature {r.median_T:.2f} ± "
                     f"{r.median_sigma_T:.2f} K{flux} (medians, 1 sigma)")  # fmt: skip
    if result.steady is not None:
        field = result.steady.field
        lines.append(f"  mean of the frames: {np.median(field.value[field.known]):.2f} ± "
                     f"{np.median(field.sigma[field.known]):.3f} K (medians, 1 sigma)")  # fmt: skip
    return lines
