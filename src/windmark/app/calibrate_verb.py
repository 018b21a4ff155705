"""The verb `windmark calibrate`: read, match where there are pictures, calibrate, write one folder, say it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import console
from windmark.calibration import NotCalibrated
from windmark.calibration.quality import Comparison, SplitHalf, compare
from windmark.geometry import Camera
from windmark.pipeline.calibrate import (
    Calibrated,
    CalibrateSettings,
    MatchedPicture,
    MatchOptions,
    calibrate_marks,
    calibrate_pictures,
    from_table,
    read_known,
    record,
    write_calibration,
)
from windmark.pipeline.calibrate.marks import start_camera, with_focal
from windmark.pipeline.clock import Clock
from windmark.scene import MarkerSet

Record = dict[str, Any]
TABLES = (".csv", ".txt")


@dataclass(frozen=True)
class Files:
    """What is read and written.

    Parameters
    ----------
    inputs : one table of matches, or pictures
    markers, roles : the table of rough coordinates, and the roles wanted (empty: all painted markers)
    cameras : start values by name; empty where nothing is known
    size_px, focal_px : of a camera of which nothing else is known
    unit : length unit of the markers
    sigma_px : of marks whose table has none
    against : folder of another calibration of the same markers
    output : folder of the results
    """

    inputs: tuple[Path, ...]
    markers: Path
    roles: tuple[str, ...]
    cameras: Mapping[str, Camera]
    size_px: tuple[int, int] | None
    focal_px: float | None
    unit: str
    sigma_px: float
    against: Path | None
    output: Path


def calibrate(files: Files, settings: CalibrateSettings, match: MatchOptions, as_json: bool) -> None:
    """Calibrate and write everything into a folder, whole or not at all."""
    if files.cameras and (files.focal_px is not None or files.size_px is not None):
        raise ValueError("--camera has size and focal length: leave --size and --focal out")
    if files.unit not in io.LENGTH_UNITS:
        raise ValueError(f"--unit must be one of {', '.join(io.LENGTH_UNITS)}, got {files.unit!r}")
    markers = io.read_markers(files.markers, **({"roles": files.roles} if files.roles else {}))
    known = None if files.against is None else read_known(files.against)
    with console.progress() as show:
        clock = Clock(show)
        done, matched = _solve(files, markers, settings, match, clock)
        if isinstance(done, NotCalibrated):
            console.refuse(_why(done), as_json, _refusal(done, matched))
            return
        against = None if known is None else compare(known, done.result)
        files.output.parent.mkdir(parents=True, exist_ok=True)
        with io.atomic_folder(files.output) as place:
            with clock("write"):
                write_calibration(done, place, files.unit, matched)
            content = record(done, files.unit, matched=matched, against=against)
            from windmark.app.calibrate_report import calibration_report

            with clock("draw report"):
                page = calibration_report(done, files.unit, matched, against, str(files.against or ""), clock)
            (place / "report.html").write_text(page, encoding="utf-8")
            io.write_json(place / "summary.json", {**content, "seconds": clock.seconds})
    console.answer({**content, "folder": files.output}, as_json, _lines(done, matched, against, files))


def _solve(
    files: Files, markers: MarkerSet, settings: CalibrateSettings, match: MatchOptions, clock: Clock
) -> tuple[Calibrated | NotCalibrated, tuple[MatchedPicture, ...] | None]:
    """From matches, or from pictures."""
    tables = [p for p in files.inputs if p.suffix.lower() in TABLES]
    if not tables:
        if files.size_px is not None:
            raise ValueError("--size is for a table of matches; pictures have their own size")
        cameras: dict[str, Camera | None] = dict(files.cameras) or {"camera": None}
        return calibrate_pictures(files.inputs, markers, cameras, match, settings, clock, files.focal_px)
    if len(files.inputs) > 1:
        raise ValueError(f"expected one table of matches or several pictures, got {len(files.inputs)} files with "
                         f"{tables[0].name} among them")  # fmt: skip
    if match != MatchOptions(seed=match.seed):
        raise ValueError("--radius, --label, --channel and the like are for pictures; a table of matches has its names")
    given = dict(files.cameras)
    if not given:
        if files.size_px is None:
            raise ValueError("the size of the pictures is needed with a table of matches: --size WIDTHxHEIGHT, or a "
                             "camera with --camera")  # fmt: skip
        given = {"camera": start_camera(files.size_px, files.focal_px)}
    table = io.read_matches(tables[0])
    if not len(table):
        raise io.FileError(tables[0], "the table has no rows; expected matched marks")
    marks = from_table(table, markers, given, sigma_px=files.sigma_px)
    if not files.cameras and files.focal_px is None:
        with clock("focal length from nothing"):
            marks = with_focal(marks, settings.seed)
    return calibrate_marks(marks, settings, clock), None


def _why(no: NotCalibrated) -> str:
    """The refusal in words: reason, what is not determined, what could not take part."""
    parts = [f"not calibrated: {no.reason}"]
    if no.weak and not all(w in no.reason for w in no.weak):
        parts.append(f"not determined: {', '.join(no.weak)}")
    if no.dropped:
        some = list(no.dropped.items())[:8]
        rest = len(no.dropped) - len(some)
        parts.append("could not take part: " + "; ".join(f"{n} ({why})" for n, why in some)
                     + (f"; and {rest} more" if rest else ""))  # fmt: skip
    return ". ".join(parts)


def _refusal(no: NotCalibrated, matched: tuple[MatchedPicture, ...] | None) -> Record:
    pictures = None if matched is None else [
        {"image": m.name, "spots": len(m.detections), "matched": m.count, "problem": m.problem} for m in matched
    ]  # fmt: skip
    return {"calibrated": False, "reason": no.reason, "cause": no.cause, "weak": list(no.weak),
            "dropped": dict(no.dropped), "sigma0": no.sigma0, "pictures": pictures}  # fmt: skip


def _lines(
    done: Calibrated, matched: tuple[MatchedPicture, ...] | None, against: Comparison | None, files: Files
) -> list[str]:
    """The calibration in a few lines."""
    result = done.result
    lines = []
    if matched is not None:
        good = sum(m.registration is not None for m in matched)
        lines.append(f"{good} of {len(matched)} pictures matched, {sum(m.count for m in matched)} marks;"
                     f" residuals beyond the detector's noise: {matched[0].excess_px:.3f} px")  # fmt: skip
        lines += [f"  skipped {m.name}: {m.problem}" for m in matched if m.problem]
    lines.append(f"{len(result.views)} views, {len(result.markers)} markers, {int(result.used.sum())} marks, "
                 f"{int((~result.used).sum())} left out as gross errors; sigma0 {result.sigma0:.3f}, "
                 f"RMS {result.rms_px:.3f} px")  # fmt: skip
    for name, camera in result.cameras.items():
        sigma = {p: result.sigma(name, p) for p in ("focal_px", "cx", "cy")}
        lines.append(f"{name}: focal length {camera.focal_px:.2f} ({sigma['focal_px']:.2g}) px, principal point "
                     f"{camera.cx:.2f} ({sigma['cx']:.2g}), {camera.cy:.2f} ({sigma['cy']:.2g}) px")  # fmt: skip
    rms = (result.markers.sigma**2).mean(axis=0) ** 0.5
    lines.append(f"markers, 1 sigma: {rms[0]:.2g}, {rms[1]:.2g}, {rms[2]:.2g} {files.unit} along x, y, z")
    if isinstance(done.halves, SplitHalf):
        half = done.halves.comparison
        lines.append(f"two halves of the pictures differ by {half.rms:.2g} {files.unit}, {half.ratio:.2f} times "
                     "what the"
                     " covariances say")  # fmt: skip
    else:
        lines.append(f"no check by halves: {done.halves.reason}")
    if against is not None:
        lines.append(f"against {files.against}: {len(against.name)} markers differ by {against.rms:.2g} "
                     f"{files.unit} RMS,"
                     f" {against.ratio:.2f} times what the covariances say")  # fmt: skip
    lines += [f"suspect: {name} lost most of its marks" for name in result.suspect]
    lines += [f"swapped: {a} and {b} in {view}" for a, b, view in result.swapped]
    lines += [f"left out: {name}: {why}" for name, why in result.dropped.items()]
    return [*lines, f"report: {files.output / 'report.html'}"]
