"""The verb `windmark study`: measure, draw, write one folder, say it in a few lines."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.progress import progress
from windmark.app.provenance import Provenance
from windmark.app.verdict_words import judged, put_verdict
from windmark.compiling import job_time
from windmark.pipeline.study import Study, StudySettings, run_study
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.study import study_verdict

Record = dict[str, Any]


def study(settings: StudySettings, output: Path, as_json: bool) -> None:
    """Run the study and write table, pictures and page into ``output``, whole or not at all."""
    start = job_time()
    with progress() as show, console.result_folder(output) as out:
        done = run_study(settings, show)
        show("draw")
        verdict = study_verdict(done.summary())
        failed = write_study(done, verdict, out)
        record = {**done.record(), "seconds": job_time() - start, "folder": output, "not_drawn": failed}
        said = judged(record, verdict)
        console.write_summary(out, record)
    lines = [*map(_line, record["summary"]), *said, *not_drawn(failed), f"report: {output / 'study.html'}"]
    console.answer(record, as_json, lines)
    if (done.missed == done.markers).all():
        console.refuse("no marker was found at these settings; nothing can be said of the error", as_json,
                       next_step=verdict.next_step)  # fmt: skip


def write_study(done: Study, verdict: Verdict, out: io.ResultFolder) -> list[str]:
    """Table, pictures and page of a study; what could not be drawn."""
    from windmark.app.study_pictures import study_page

    place = out.place
    io.write_table(place / "study.csv", done.columns())
    page = study_page(done, place)
    put_verdict(page, verdict)
    page.provenance(Provenance.of_verb(out))
    (place / "study.html").write_text(page.html(), encoding="utf-8")
    return page.failed


def _line(row: Record) -> str:
    head = f"r0 = {row['r0_px']:g} px, {row['method']}: "
    if row["missed"] == row["markers"]:
        return f"{head}none of {row['markers']} markers found"
    times = row["rms_over_crlb"]
    known = math.isfinite(times)
    bound = f"{times:.2f} times the Cramer-Rao bound" if known else "no bound (markers within one pixel)"
    return (
        f"{head}2 RMS {row['two_rms_px']:.4f} px per axis (worst real radius {row['worst_two_rms_px']:.4f}),"
        f" {bound}; {row['missed']} of {row['markers']} not found,"
        f" {row['false_spots']} false"
    )
