"""The verb `windmark calibrate`: read, match where there are pictures, calibrate, write one folder, say it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.calibrate_options import TABLES
from windmark.app.progress import progress
from windmark.app.provenance import Provenance
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.calibration import NotCalibrated, Weighted
from windmark.calibration.lens_choice import lens_words
from windmark.calibration.quality import Comparison, SplitHalf, compare
from windmark.errors import UsageError, g2, plus_minus
from windmark.geometry import Camera
from windmark.pipeline.alike import left_out
from windmark.pipeline.calibrate import (
    Board,
    Calibrated,
    CalibrateSettings,
    MatchOptions,
    Picture,
    calibrate_board,
    calibrate_marks,
    calibrate_pictures,
    from_table,
    read_known,
    record,
    write_calibration,
)
from windmark.pipeline.clock import Clock
from windmark.pipeline.grid import curved_by
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.network import calibrate_verdict
from windmark.scene import MarkerCovariance, MarkerSet
from windmark.tasks.calibrate.lens import in_lens, with_lens
from windmark.tasks.calibrate.marks import start_camera, with_focal
from windmark.tasks.calibrate.rig import Beside, beside
from windmark.tasks.calibrate.run import check_asked

Record = dict[str, Any]
Pictures = Sequence[Picture] | None


@dataclass(frozen=True)
class Files:
    """What is read and written.

    Parameters
    ----------
    inputs : one table of matches, or pictures
    markers, board, roles : the table of rough coordinates, or a board of dots instead; and the roles wanted of the
        table (empty: all painted markers)
    cameras : start values by name; empty where nothing is known
    patterns : camera -> pattern of its images' names, for several cameras
    size_px, focal_px : of cameras of which nothing else is known
    unit : length unit of the markers
    sigma_px : of marks whose table has none
    against : folder of another calibration of the same markers
    output : folder of the results
    control_cov : table of the joint covariance of known markers
    grid : the surface that the markers lie on
    """

    inputs: tuple[io.PictureFile, ...]
    markers: Path | None
    board: Board | None
    roles: tuple[str, ...]
    cameras: Mapping[str, Camera]
    patterns: Mapping[str, str]
    size_px: tuple[int, int] | None
    focal_px: float | None
    unit: str
    sigma_px: float
    against: Path | None
    output: Path
    control_cov: Path | None = None
    grid: Path | None = None

    def __post_init__(self) -> None:
        if self.cameras and (self.focal_px is not None or self.size_px is not None):
            raise UsageError("--camera has size and focal length: leave --size and --focal out")
        Lengths(self.unit)
        if (self.markers is None) == (self.board is None):
            raise UsageError("expected either --markers with rough coordinates, or --board with the pitch of a board")
        if self.grid is not None and self.markers is None:
            raise UsageError("--grid is the surface of a model's markers: a board is flat")
        if self.patterns and self.cameras and set(self.patterns) != set(self.cameras):
            raise UsageError(f"--images-of is for the cameras {', '.join(self.patterns)}, --camera for "
                             f"{', '.join(self.cameras)}; expected the same")  # fmt: skip

    @property
    def lengths(self) -> Lengths:
        """What reads the tables: their lengths are in the unit given."""
        return Lengths(self.unit)

    @property
    def start(self) -> dict[str, Camera | None]:
        """Start values of every camera, None where nothing is known."""
        return dict(self.cameras) or dict.fromkeys(self.patterns) or {"camera": None}


def run(files: Files, settings: CalibrateSettings, match: MatchOptions, as_json: bool) -> None:
    """Calibrate and write everything into a folder, whole or not at all."""
    known = None if files.against is None else read_known(files.against, files.lengths)
    with progress() as show, console.result_folder(files.output) as out:
        clock = Clock(show)
        done, pictures = _solve(files, settings, match, clock)
        if isinstance(done, NotCalibrated):
            verdict = calibrate_verdict(done, files.unit, pictures)
            console.refuse(_why(done), as_json, {**_refusal(done, pictures), "verdict": verdict.record()},
                           verdict.next_step)  # fmt: skip
            return
        against = None if known is None else compare(known, done.result)
        content = _write(out, files, done, pictures, against, match, clock)
    console.answer({**content, "folder": files.output}, as_json, [
        *_lines(done, pictures, against, files), *verdict_lines(Verdict.of_record(content["verdict"])),
        *not_drawn(content["not_drawn"]),
        f"report: {files.output / 'report.html'}",
    ])  # fmt: skip


def _write(
    out: io.ResultFolder,
    files: Files,
    done: Calibrated,
    pictures: Pictures,
    against: Comparison | None,
    match: MatchOptions,
    clock: Clock,
) -> Record:
    """The folder; what its summary holds."""
    from windmark.app.calibrate_report import Shown, calibration_report

    place = out.place
    with clock("write"):
        write_calibration(done, place, files.unit, pictures)
    content = record(done, files.unit, matched=pictures, against=against)
    with clock("draw report"):
        paths = None if pictures is None else dict(zip([p.name for p in pictures], files.inputs, strict=True))
        shown = Shown(files.unit, pictures, paths, match, against, str(files.against or ""))
        page = calibration_report(done, shown, clock)
    verdict = calibrate_verdict(done, files.unit, pictures)
    put_verdict(page, verdict)
    content["verdict"] = verdict.record()
    page.provenance(Provenance(out.sources()))
    (place / "report.html").write_text(page.html(), encoding="utf-8")
    content["not_drawn"] = page.failed
    console.write_summary(out, {**content, "seconds": clock.seconds})
    return content


def _solve(
    files: Files, settings: CalibrateSettings, match: MatchOptions, clock: Clock
) -> tuple[Calibrated | NotCalibrated, Pictures]:
    """From matches, from pictures, or from pictures of a board."""
    tables = [p for p in files.inputs if isinstance(p, Path) and p.suffix.lower() in TABLES]
    if len(files.inputs) > 1 and tables:
        raise UsageError(f"expected one table of matches or several pictures, got {len(files.inputs)} files with "
                         f"{tables[0].name} among them")  # fmt: skip
    if not tables and files.size_px is not None:
        raise UsageError("--size is for a table of matches; pictures have their own size")
    if files.board is not None:
        _refuse_with_board(files, match, tables)
        return calibrate_board(files.inputs, files.board, files.start, match, settings, clock, files.focal_px,
                               files.patterns)  # fmt: skip
    assert files.markers is not None
    lengths = files.lengths
    markers = lengths.markers(files.markers, **({"roles": files.roles} if files.roles else {}))
    if files.grid is not None:
        markers, said = curved_by(markers, files.grid, lengths)
        if said:
            console.note(files.grid, said)
    if files.control_cov is not None:
        settings = _known_together(settings, lengths.covariance(files.control_cov, markers))
    check_asked(markers, settings)  # before pictures are searched
    if not tables:
        return calibrate_pictures(files.inputs, markers, files.start, match, settings, clock, files.focal_px,
                                  files.patterns)  # fmt: skip
    if match != MatchOptions(seed=match.seed):
        raise UsageError("--radius, --label, --channel and the like are for pictures; a table of matches has its names")
    return _from_table(files, tables[0], markers, settings, clock), None


def _known_together(settings: CalibrateSettings, known: MarkerCovariance) -> CalibrateSettings:
    if not isinstance(settings.datum, Weighted):
        raise UsageError("--control-cov is for --datum weighted: what is held or free has no sigma of its own")
    return replace(settings, datum=replace(settings.datum, covariance=known))


def _refuse_with_board(files: Files, match: MatchOptions, tables: list[Path]) -> None:
    if tables:
        raise UsageError(f"--board is for pictures, got the table {tables[0].name}")
    if match.labels or match.tolerance_px is not None or files.roles or files.control_cov is not None:
        raise UsageError("--label, --labels, --tolerance-px, --roles and --control-cov are for --markers; a board "
                         "has none")  # fmt: skip


def _from_table(
    files: Files, path: Path, markers: MarkerSet, settings: CalibrateSettings, clock: Clock
) -> Calibrated | NotCalibrated:
    """From matches."""
    given = dict(files.cameras)
    if not given:
        if files.size_px is None:
            raise UsageError("the size of the pictures is needed with a table of matches: --size WIDTHxHEIGHT, or a "
                             "camera with --camera")  # fmt: skip
        given = {name: start_camera(files.size_px, files.focal_px) for name in files.start}
    given = in_lens(given, files.start, settings.lens)
    table = io.read_matches(path)
    if not len(table):
        raise io.FileError(path, "the table has no rows; expected matched marks")
    marks = from_table(table, markers, given, sigma_px=files.sigma_px, patterns=files.patterns)
    if not files.cameras and files.focal_px is None:
        with clock("focal length from nothing"):
            marks = with_focal(marks, settings.seed)
    with clock("lens"):
        marks, lenses = with_lens(marks, settings, files.start, focal_known=files.focal_px is not None)
    return calibrate_marks(marks, settings, clock, lenses)


def _why(no: NotCalibrated) -> str:
    """The refusal in words: reason, what is not determined, what could not take part."""
    parts = [f"not calibrated: {no.reason}"]
    if no.weak and not all(w in no.reason for w in no.weak):
        parts.append(f"not determined: {', '.join(no.weak)}")
    return ". ".join([*parts, *left_out(no.dropped, no.reason)])


def _refusal(no: NotCalibrated, matched: Pictures) -> Record:
    pictures = None if matched is None else [
        {"image": m.name, "spots": len(m.detections), "matched": m.count, "problem": m.problem} for m in matched
    ]  # fmt: skip
    return {"calibrated": False, "reason": no.reason, "cause": no.cause, "weak": list(no.weak),
            "dropped": dict(no.dropped), "sigma0": no.sigma0, "pictures": pictures}  # fmt: skip


def _lines(done: Calibrated, matched: Pictures, against: Comparison | None, files: Files) -> list[str]:
    """The calibration in a few lines."""
    result = done.result
    lines = []
    if matched is not None:
        good = sum(m.count > 0 for m in matched)
        lines.append(f"{good} of {len(matched)} pictures matched, {sum(m.count for m in matched)} marks;"
                     f" residuals beyond the detector's noise: {matched[0].excess_px:.3f} px")  # fmt: skip
        lines += [f"  skipped {m.name}: {m.problem}" for m in matched if m.problem]
    lines.append(f"{len(result.views)} views, {len(result.markers)} markers, {int(result.used.sum())} marks, "
                 f"{int((~result.used).sum())} left out as gross errors; sigma0 {result.sigma0:.3f}, "
                 f"RMS {result.rms_px:.3f} px")  # fmt: skip
    for name, camera in result.cameras.items():
        sigma = {p: result.sigma(name, p) for p in ("focal_px", "cx", "cy")}
        focal, *point = (plus_minus(getattr(camera, p), s) for p, s in sigma.items())
        lines.append(f"{name}: focal length {focal} px, principal point {', '.join(point)} px (1 sigma)")
    if len(done.lenses) > 1:
        lines.append(lens_words(done.lenses))
    rms = (result.markers.sigma**2).mean(axis=0) ** 0.5
    lines.append(f"markers, 1 sigma: {g2(rms[0])}, {g2(rms[1])}, {g2(rms[2])} {files.unit} along x, y, z")
    lines += [_beside_line(b, files.unit) for b in beside(result)]
    lines.append(_halves_line(done.halves, files.unit))
    if against is not None:
        lines.append(f"against {files.against}: {len(against.name)} markers differ by {g2(against.rms)} "
                     f"{files.unit} RMS,"
                     f" {against.ratio:.2f} times what the covariances say")  # fmt: skip
    lines += [f"warning: {sentence}" for sentence in result.warnings]
    lines += [f"unchecked: {done.unchecked}"] if done.unchecked else []
    lines += [f"swapped: {a} and {b} in {view}" for a, b, view in result.swapped]
    lines += [f"left out: {name}: {why}" for name, why in result.dropped.items()]
    return lines


def _beside_line(one: Beside, unit: str) -> str:
    return (f"{one.camera} in the rig: {plus_minus(one.distance, one.distance_sigma)} {unit} and "
            f"{plus_minus(one.angle_deg, one.angle_sigma_deg)} deg from the first camera (1 sigma)")  # fmt: skip


def _halves_line(halves: SplitHalf | NotCalibrated, unit: str) -> str:
    if isinstance(halves, NotCalibrated):
        return f"no check by halves, for half of the pictures is too few: {halves.reason}"
    found = halves.comparison
    by = "in the cameras' parameters " if found is None else f"by {g2(found.rms)} {unit}, "
    return f"two halves of the pictures differ {by}{halves.ratio:.2f} times what the covariances say"
