"""The verb `windmark psp`: reduce a paint test, write whole, say how it went."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.progress import progress
from windmark.app.project_place import project_in
from windmark.app.provenance import Provenance
from windmark.app.psp_report import psp_page
from windmark.app.report import measured
from windmark.app.series_folder import series_folder
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import job_time
from windmark.pipeline.alike import alike, listed
from windmark.pipeline.psp import FAILED, PointRecord, PspTest, grouped, load_psp, read_psp_project, reduced, run_psp
from windmark.pipeline.verdict import Finding
from windmark.pipeline.verdict.cell import calibration_findings
from windmark.pipeline.verdict.grid import grid_findings
from windmark.pipeline.verdict.lamps import lamps_findings
from windmark.pipeline.verdict.lengths import psp_lengths
from windmark.pipeline.verdict.paint import (
    black_findings,
    flat_findings,
    psp_verdict,
    response_findings,
    shared_findings,
    stranger_findings,
)
from windmark.pipeline.verdict.wanted import far_findings
from windmark.tasks.psp.plausible import UNCHECKED

Record = dict[str, Any]

SHOWN = 20
"""Points with something to be said that are listed on the terminal; all are in the report."""
WHOLE = 0.98
"""Part of the surface that cameras show from which its loads are called those of the model."""


def psp(
    path: Path, output: Path | None, threads: int, go_on: str, as_json: bool, *, scheduler: str | None = None
) -> None:
    """Reduce every point of a project; ``go_on`` "resume" or "finish" what was stopped, "" begins anew."""
    start = job_time()
    path = project_in(path, "psp")
    test = load_psp(read_psp_project(path, output))
    for remark in test.remarks:
        console.note(path, remark)
    folder = test.project.output.folder
    with progress(len(test.rows)) as show, series_folder(folder, go_on, of="points") as (out, go_on):
        records = run_psp(
            test, out.place, threads=threads, scheduler=scheduler, say=lambda r: show(f"point {r.name}: {r.status}"),
            resume=go_on == "resume", finish=go_on == "finish",
        )  # fmt: skip
        show("draw the report")
        record = summary(test, records)
        markers = test.deforming.test.markers
        unit = test.project.length_unit
        sections = [s.name for s in test.project.section]
        views = [(s.camera, s.cam_from_tunnel) for s in test.deforming.test.stations]
        lamps = [lamp.position for lamp in test.lamps]
        places = [*grid_findings(markers, test.mesh, unit), *lamps_findings(test.mesh, lamps, views, unit)]
        verdict = psp_verdict(records, places, unit, sections, _further(test, records))
        page = psp_page(test, records, out.place)
        put_verdict(page, verdict)
        page.provenance(Provenance.of_project(test.project, out.sources()))
        (out.place / "report.html").write_text(page.html(), encoding="utf-8")
        record |= {"verdict": verdict.record(), "not_drawn": page.failed, "seconds": job_time() - start}
        console.write_summary(out, record, path.resolve().parent)
        out.refused = not reduced(records)
    record["folder"] = folder
    good = bool(reduced(records))
    if good or not as_json:
        console.answer(record, as_json, [
            *_lines(records), *verdict_lines(verdict), *not_drawn(record["not_drawn"]),
            f"report: {folder / 'report.html'}",
        ])  # fmt: skip
    if not good:
        why = records[0].reason if records else "the table has no points"
        console.refuse(f"no point could be reduced; the first: {why}", as_json, record)


def _further(test: PspTest, records: list[PointRecord]) -> list[Finding]:
    """What is found in the project and its files, and between points."""
    return [
        *black_findings([name for name, sensor in test.sensors.items() if not sensor.black_given]),
        *response_findings({name: sensor.odd for name, sensor in test.sensors.items()}),
        *flat_findings({name: sensor.flat_clipped for name, sensor in test.sensors.items()},
                       test.project.radiometry.max_saturated),
        *calibration_findings(test.paint.warnings),
        *shared_findings(records, test.rows),
        *stranger_findings(test.remarks),
        *far_findings(test.places, test.project.length_unit),
        *psp_lengths(test.mesh, test.project),
    ]  # fmt: skip


def summary(test: PspTest, records: list[PointRecord]) -> Record:
    """The figures of a test."""
    return {
        "points": len(records), "reduced": len(reduced(records)), "failed": sum(r.status == FAILED for r in records),
        "paint": test.paint.record(),
        "cameras": {name: {"gain": sensor.model.gain, "gain_from": sensor.gain_from}
                    for name, sensor in test.sensors.items()},
        "remarks": list(test.remarks),
        "loads_by": None if test.project.loads is None else test.project.loads.record(),
        "results": [_point(r) for r in records],
    }  # fmt: skip


def _point(r: PointRecord) -> Record:
    out: Record = {"point": r.name, "alpha_deg": r.alpha_deg, "status": r.status, "reason": r.reason}
    if r.status == FAILED:
        return out
    taps = {} if r.taps is None else {"rms_cp": r.taps.rms}
    return out | {
        "alpha_seen_deg": r.alpha_seen_deg, "beta_seen_deg": r.beta_seen_deg, "rms_px": r.rms_px,
        "pictures": list(r.pictures_used), "seen": r.seen,
        "median_sigma_cp": r.median_sigma_cp, "flicker": r.flicker,
        "cameras_differ": r.systematic, "in_situ": dict(r.fit), "taps": taps,
        "area_shown": dict(r.shown),
        "loads": {v: {c: list(pair) for c, pair in of.items()} for v, of in r.loads.items()},
        "causes": {k: [[n, s] for n, s in of[:5]] for k, of in r.causes.items()}, "remarks": list(r.remarks),
        "unchecked": [remark for remark in r.remarks if remark.startswith(UNCHECKED)], "seconds": dict(r.seconds),
    }  # fmt: skip


def _lines(records: list[PointRecord]) -> list[str]:
    """The result in words."""
    done = reduced(records)
    lines = [f"{len(records)} points: {len(done)} reduced, {len(records) - len(done)} failed"]
    failed = alike((r.name, r.reason) for r in records if r.reason)
    lines += [f"  {listed('point', names)}: {why}" for why, names in failed.items()][:SHOWN]
    for r in done[:SHOWN]:
        loads = r.loads.get("all", {})
        words = ", ".join(f"{c} {' ± '.join(measured(*loads[c], sign='+'))}" for c in ("CL", "CD", "Cm") if c in loads)
        taps = "" if r.taps is None or not np.isfinite(r.taps.rms) else f", taps {r.taps.rms:.4f} RMS in Cp"
        part = r.shown.get("all", 1.0)
        of = "" if part > WHOLE else f"loads of the {100 * part:.0f} % of the surface that cameras show: "
        lines.append(f"  point {r.name}: alpha {r.alpha_deg:+z.2f} deg, sigma(Cp) {r.median_sigma_cp:.4f}{taps}"
                     + (f", {of}{words} (1 sigma)" if words else ""))  # fmt: skip
    lines += [f"  note: {remark} ({len(names)} of {len(done)} points)" for remark, names in
              [*grouped(done).items()][:SHOWN]]  # fmt: skip
    return lines
