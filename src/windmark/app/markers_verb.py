"""The verb `windmark markers check`: read, check, draw, write one folder, say it in a few lines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.progress import progress
from windmark.app.provenance import Provenance
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import job_time
from windmark.errors import UsageError
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.layout import layout_verdict
from windmark.tasks.marker_check import CheckSettings, MarkerCheck, check_markers

Record = dict[str, Any]

QUICK_VIEWS = 120


@dataclass(frozen=True)
class Files:
    """What is read and written.

    Parameters
    ----------
    markers, camera, grid : the files; camera and grid may be None
    unit : length unit of markers and grid
    roles : roles that are checked; empty takes all painted markers
    output : folder of the results
    """

    markers: Path
    camera: Path | None
    grid: Path | None
    unit: str
    roles: tuple[str, ...]
    output: Path


def check(files: Files, settings: CheckSettings, as_json: bool) -> None:
    """Check a layout and write table, pictures and page into a folder, whole or not at all."""
    start = job_time()
    lengths = Lengths(files.unit)
    markers = lengths.markers(files.markers, **({"roles": files.roles} if files.roles else {}))
    camera = console.read_lens(files.camera) if files.camera else None
    mesh = None
    if files.grid:
        from windmark.pipeline.grid import read_grid
        from windmark.pipeline.project_entries import GridEntry

        mesh = read_grid(GridEntry(file=files.grid), lengths)
    console.notes(lengths)
    with progress() as show, console.result_folder(files.output) as out:
        done = check_markers(markers, files.unit, camera=camera, mesh=mesh, settings=settings, progress=show)
        show("draw")
        record: Record = {"file": files.markers, **done.record(), "camera_file": files.camera,
                          "grid_file": files.grid, "seconds": job_time() - start,
                          "folder": files.output}  # fmt: skip
        verdict = layout_verdict(done)
        record |= {"verdict": verdict.record(), "not_drawn": write_check(done, verdict, out, files.markers.name)}
        console.write_summary(out, record, files.markers.resolve().parent)
    head, *lines = done.lines()
    page = files.output / "check.html"
    console.answer(
        record, as_json, [f"{files.markers.name}: {len(markers)} markers, {head}", *lines,
                          *verdict_lines(verdict), *not_drawn(record["not_drawn"]), f"report: {page}"],
    )  # fmt: skip
    if not done.identifiable:
        # With --json the record is out already; the reason is in it.
        console.refuse(f"{files.markers}: {done.reason()}", False)


def write_check(done: MarkerCheck, verdict: Verdict, out: io.ResultFolder, name: str) -> list[str]:
    """Table of directions, the changed layout, pictures and page; what could not be drawn."""
    from windmark.app.markers_pictures import check_page

    place = out.place
    io.write_table(place / "directions.csv", done.columns())
    if done.proposals:
        io.write_markers(place / "markers-proposed.csv", done.proposals[0].stage.markers)
    page = check_page(done, name, place)
    put_verdict(page, verdict)
    page.provenance(Provenance.of_verb(out))
    (place / "check.html").write_text(page.html(), encoding="utf-8")
    return page.failed


def view_from(text: str | None) -> tuple[float, float] | None:
    """``azimuth,elevation`` in degrees.

    Raises
    ------
    ValueError
        When the text is not two numbers.
    """
    if text is None:
        return None
    try:
        azimuth, elevation = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--view-from: expected azimuth,elevation in degrees, such as 0,90, got {text!r}") from None
    return azimuth, elevation
