"""The verbs behind the command line: load, do, write whole, say it in a few lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.app.progress import progress
from windmark.app.project_place import project_in
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import compiling_seconds, job_time
from windmark.errors import g2
from windmark.pipeline import merge_outputs, outputs
from windmark.pipeline.clock import Clock, Progress
from windmark.pipeline.job import run_project
from windmark.pipeline.merge import MergeResult
from windmark.pipeline.project import Project, make_project, read_project
from windmark.pipeline.result_place import check_output
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.settings import COMMAND_LINE
from windmark.pipeline.truth import Comparison
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.run import run_verdict
from windmark.registration import Registration

Record = dict[str, Any]


def run(
    path: Path,
    output: Path | None,
    as_json: bool,
    *,
    max_time_s: float | None = None,
    roles: tuple[str, ...] = (),
    no_occlusion: bool = False,
    binding: bool = False,
    method: str | None = None,
) -> None:
    """The main job from a project file; what is given besides replaces the file's own."""
    given: dict[str, dict[str, Any]] = {"register": {}}
    path = project_in(path, "run")
    if output is not None:
        check_output(path, output)
        given["output"] = {"folder": output.resolve()}
    if max_time_s is not None:
        given["register"]["max_time_s"] = max_time_s
    if no_occlusion:
        given["register"]["occlusion"] = False
    if binding:
        given["register"]["binding"] = True
    if method is not None:
        given["register"]["method"] = method
    if roles:
        given["markers"] = {"roles": roles}
    project = read_project(path, given)
    finish(*carry_out(project), as_json)


def run_settings(settings: Mapping[str, Any], as_json: bool) -> None:
    """The main job from settings of the command line."""
    finish(*carry_out(make_project(Path(COMMAND_LINE), settings)), as_json)


def carry_out(project: Project, truth: Callable[[RunResult], Comparison] | None = None) -> tuple[RunResult, Record]:
    """Run, write everything as one unit, return the result and its summary.

    ``truth`` compares a result with what is known of a synthetic test.
    """
    with progress() as show, console.result_folder(project.output.folder) as out:
        return carry_out_in(out, project, show, truth)


def carry_out_in(
    out: io.ResultFolder, project: Project, show: Progress, truth: Callable[[RunResult], Comparison] | None = None
) -> tuple[RunResult, Record]:
    """`carry_out` into a folder that is held already; ``show`` is told each stage."""
    from windmark.app.run_report import run_report

    start, compiled = job_time(), compiling_seconds()
    clock = Clock(show)
    result = run_project(project, progress=show)
    comparison = truth(result) if truth else None
    outputs.write_results(result, out.place, clock)
    verdict = run_verdict(result)
    with clock("draw report"):
        page = run_report(result, clock, comparison, out.sources())
    put_verdict(page, verdict)
    (out.place / "report.html").write_text(page.html(), encoding="utf-8")
    clock.seconds["whole job"] = job_time() - start
    if compiling_seconds() > compiled:
        clock.seconds["compiling, once"] = compiling_seconds() - compiled
    record = {**outputs.summary(result, clock), "verdict": verdict.record(), "not_drawn": page.failed}
    if comparison is not None:
        record["truth"] = comparison.record()
    console.write_summary(out, record, Path(project.path).resolve().parent)
    out.refused = _nothing(result)
    return result, record


def finish(result: RunResult, record: Record, as_json: bool) -> None:
    """One line per image, where the report is, and the exit code."""
    for path, text in result.notes:
        console.note(path, text)
    folder = result.project.output.folder
    nothing = _nothing(result)
    alone = nothing and len(result.images) == 1  # its verdict says the same
    lines = [] if alone else [image_line(item, result) for item in result.images]
    lines += [merge_line(item) for item in result.merged]
    lines += [f"left out: {said}" for said in result.left_out] + [f"not drawn: {said}" for said in record["not_drawn"]]
    if not (nothing and as_json):  # a refusal brings the record with it: one document
        judged = verdict_lines(Verdict.of_record(record["verdict"]))
        console.answer(record, as_json, [*lines, *judged, f"report: {folder / 'report.html'}"])
    if nothing:
        why = f"no image could be used; {result.failed[0].name}: {result.failed[0].problem}"
        console.refuse(why, as_json, record)


def _nothing(result: RunResult) -> bool:
    """Whether no image could be used."""
    return bool(result.failed) and len(result.failed) == len(result.images)


def image_line(item: ImageResult, result: RunResult) -> str:
    """One image in one line."""
    parts = [said for said in (item.filled, item.said) if said] + ([] if item.radius is None else [item.radius.reason])
    if item.problem:
        return f"{item.name}: {'; '.join(dict.fromkeys([*parts, item.problem]))}"
    answer = item.registered
    if answer is not None:
        rms = f" RMS {answer.rms_px:.3f} px," if len(answer.matching) else ""
        parts.append(
            f"{len(answer.matching)} of {len(item.detections or ())} spots are markers,{rms}"
            f" false-alarm number 10^{answer.log10_nfa:.0f}"
        )
        parts.extend(_together_words(item, answer))
        if answer.excess_px > 0.0:
            parts.append(f"markers {g2(answer.off_table)} {result.project.length_unit} off their table")
        parts.extend(f"unchecked: {u.words}" for u in answer.unchecked if u.what == "radii")
        parts.extend(f"weak {weak.words(result.project.length_unit)}" for weak in answer.weak)
        if answer.deformation is not None:
            bent = answer.deformation
            parts.append(f"model deformed by {g2(100 * bent.largest)} % of its size, up to {bent.largest_px:.1f} px")
    if item.values is not None and result.mesh is not None:
        kind = "values" if item.quantity.name == "grey" else f"{item.quantity.name} ({item.quantity.unit})"
        parts.append(f"{kind} on {int((item.values == item.values).sum())} of {len(item.values)} nodes")
    parts += [said for said in (item.saturated, item.dark, item.dead, item.smoothed) if said]
    parts += [_points_words(merge_outputs.table_summary(table)) for table in item.points]
    return f"{item.name}: " + "; ".join(parts)


def _together_words(item: ImageResult, answer: Registration) -> list[str]:
    """With how many cameras an image was registered; and where its pose rests on these alone, that."""
    if item.instant is None:
        return []
    others = len(item.instant.together.names) - 1
    words = [f"together with {others} other camera{'s' if others > 1 else ''} of the rig"] if others else []
    return [*words, *(f"unchecked: {u.words}" for u in answer.unchecked if u.what == "place in the rig")]


def merge_line(item: MergeResult) -> str:
    """Merged images in one line."""
    record = merge_outputs.merge_summary(item)
    if not record["merged"]:
        return f"{item.folder}: not merged: {record['reason']}"
    parts = [f"{len(record['legend'])} images, values on {record['nodes_with_value']} nodes"]
    if record["gain_estimated"]:
        gains = ", ".join(f"{n} {g['gain']:.4f} ± {g['sigma']:.4f}" for n, g in record["gain"].items()
                          if n != record["reference"])  # fmt: skip
        parts.append(f"gains to {record['reference']}: {gains}")
    seams = record["seams"]
    if seams["nodes"]:
        parts.append(f"seam steps {seams['mean_size']:.2f} sigma on average, {seams['typical']:.2f} typically")
    parts += [f"{name} left out: {why}" for name, why in item.missing.items()]
    parts += [_points_words(table) for table in record["points"]]
    return f"{item.folder}: " + "; ".join(parts)


def _points_words(table: Record) -> str:
    return f"{table['kind']} {table['name']}: {table['with_value']} of {table['points']} have a value"


def demo(folder: Path, seed: int, as_json: bool) -> None:
    """A synthetic test made, run with no start pose, and compared with its truth."""
    from windmark.pipeline.simulate import simulate as write_test
    from windmark.pipeline.truth import compare

    start = job_time()
    with progress() as show, console.result_folder(folder) as out:
        show("render the virtual wind tunnel")
        test = write_test(out.place, seed)
    rendered = job_time() - start
    project = read_project(folder / "project.toml")
    result, record = carry_out(project, lambda done: compare(done, test))
    truth = record["truth"]
    lines = [
        f"a virtual wind-tunnel test was rendered into {folder} ({rendered:.1f} s):"
        f" {len(test.shots)} images, {len(test.markers)} markers, {len(test.mesh.vertices)} grid nodes",
        "the main job, with no start pose (windmark run project.toml):",
        *(f"  {image_line(item, result)}" for item in result.images),
        *(f"  {line}" for line in verdict_lines(Verdict.of_record(record["verdict"]))),
        f"compared with the truth: {truth['verdict']}",
        *(f"  {_truth_line(row)}" for row in truth["images"]),
        f"report: {project.output.folder / 'report.html'}",
    ]
    console.answer(record, as_json, lines)
    if not truth["good"]:
        console.refuse(f"the result does not agree with the truth: {truth['verdict']}", as_json)


def _truth_line(row: Record) -> str:
    if row["pose deg"] is None:
        return f"{row['image']}: not registered"
    return (
        f"{row['image']}: {row['labelled right']} of {row['markers visible']} visible markers labelled,"
        f" {row['labelled wrong']} wrong; pose off by {row['pose deg']:.4f} deg;"
        f" surface placed to {row['place on the surface RMS px']:.3f} px; values to {row['value error median %']:.2f} %"
    )
