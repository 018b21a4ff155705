"""The verb `windmark track`: follow a model through images; tables, picture and page in one folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

import windmark
from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn
from windmark.app.progress import progress
from windmark.app.provenance import Provenance
from windmark.app.report import Report, measured
from windmark.app.series_folder import series_folder
from windmark.app.verdict_words import put_verdict, verdict_lines
from windmark.compiling import job_time
from windmark.errors import g3
from windmark.geometry import Camera
from windmark.io.errors import noted
from windmark.pipeline.focal_series import focal_series
from windmark.pipeline.grid import curved_by
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.misfits import with_misfits
from windmark.pipeline.same_run import made_with, with_all
from windmark.pipeline.track_files import FollowOptions, first_state
from windmark.pipeline.track_results import POV, PoseRow, match_columns, pose_columns, sequence_summary
from windmark.pipeline.track_series import Series, follow_series
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.focal import cov_with_focal, focal_unchecked, with_focal
from windmark.pipeline.verdict.track import track_verdict
from windmark.registration import Motion
from windmark.scene import MarkerSet

Record = dict[str, Any]

WORDS = {
    "cold": "registered without help",
    "tracked": "from the prediction",
    "reacquired": "searched for and found again",
    "lost": "no pose",
}
MODEL_ROLES = ("model", "primary", "secondary")
"""What moves with the model, where no roles are given."""


@dataclass(frozen=True)
class Wishes:
    """Files of `windmark track`, its length unit and the roles that take part."""

    images: list[Path]
    markers: Path
    camera: Path
    unit: str
    roles: list[str] | None
    prior: Path | None
    frames: Path | None
    mask: Path | None
    output: Path
    grid: Path | None = None


def follow_files(wishes: Wishes, options: Record, change: tuple[float, float], go_on: str, as_json: bool) -> None:
    """Follow the images in the given order and write everything into the output folder, whole or not at all.

    ``options`` go to `FollowOptions`; ``change`` is that of the motion, in degrees and percent. What was stopped on the
    way is gone on with (``go_on`` "resume") or brought to its end with what it has ("finish").
    """
    unit, lengths = wishes.unit, Lengths(wishes.unit)
    roles = tuple(wishes.roles) if wishes.roles else MODEL_ROLES
    markers, camera = lengths.markers(wishes.markers, roles), console.read_lens(wishes.camera)
    read: set[str] = set()
    if wishes.grid is not None:
        with noted() as read:
            markers, said = curved_by(markers, wishes.grid, lengths)
        if said:
            console.note(wishes.grid, said)
    prior = None if wishes.prior is None else lengths.camera(wishes.prior).cam_from_model
    console.notes(lengths)
    if wishes.prior is not None and prior is None:
        raise io.FileError(wishes.prior, "has no pose; expected one, as --prior")
    mask = None if wishes.mask is None else io.read_mask(wishes.mask, camera.size_px[::-1])
    motion = Motion(float(np.radians(change[0])), change[1] / 100)
    how = FollowOptions(**options, motion=motion, prior=prior, mask=mask)
    images = io.pictures(wishes.images)
    notes = console.recordings(images)
    instants = stamped_instants(images) if wishes.frames is None else read_instants(wishes.frames, images)
    start, made = job_time(), _made_with(wishes, options, change, map(Path, read))
    with progress(len(images)) as show, series_folder(wishes.output, go_on) as (out, go_on):
        series = follow_series(
            out.place, images, markers, camera, options=how, instants=instants, made=made, go_on=go_on,
            say=lambda row: show(f"{row.name}: {row.status}"),
        )  # fmt: skip
        show("write")
        series.rows = with_misfits(series.rows)
        rows, last = series.rows, series.last
        record = {
            **sequence_summary(rows, camera, unit), "seconds": job_time() - start, "folder": wishes.output,
            "polarity": series.polarity, "notes": notes,
        }  # fmt: skip
        focal, first = focal_series(rows, markers, camera), first_state(images, how) if last is None else None
        verdict = track_verdict(rows, unit, first, markers.name.tolist(), focal)
        record["unchecked"] += [
            {"what": u.what, "words": u.words} for u in focal_unchecked(rows, focal, markers, camera, unit)
        ]  # fmt: skip
        if last is not None:
            series.last = last[0], cov_with_focal(last[1], rows, focal, markers, camera)
        series.rows = with_focal(rows, focal)
        record["verdict"] = verdict.record()
        page = _write(out, wishes, series, markers, camera, record, images)
        out.refused = last is None
    if last is None:
        console.refuse(verdict.reason, as_json, record, verdict.next_step)
    auto = series.polarity == "bright" and how.polarity == "auto"
    decided = ["bright markers: dark spots gave no pose"] if auto else []
    missing = not_drawn(page.failed)
    console.answer(record, as_json, [
        *_lines(rows), *decided, *verdict_lines(verdict), *missing, f"report: {wishes.output / 'report.html'}",
    ])  # fmt: skip


def _made_with(wishes: Wishes, options: Record, change: tuple[float, float], read: Iterable[Path]) -> Record:
    """See `pipeline.same_run.made_with`; the images are looked at one by one, ``read`` are the files of the grid."""
    words = {key: f"--{key.removesuffix('_px').removesuffix('_s').replace('_', '-')}" for key in options}
    asked = {words[key]: value for key, value in options.items()}
    asked |= {"--unit": wishes.unit, "--roles": wishes.roles, "--change-deg": change[0], "--change-percent": change[1]}
    files = {"--markers": wishes.markers, "--camera": wishes.camera, "--prior": wishes.prior, "--frames": wishes.frames,
             "--mask": wishes.mask, "--grid": wishes.grid}  # fmt: skip
    named = [(key, path) for key, path in files.items() if path is not None]
    return made_with("track", asked, with_all(named, read, wishes.markers))


def stamped_instants(images: list[io.PictureFile]) -> list[float] | None:
    """The instants by a recording's own time stamps, in frames: dropped frames leave gaps. None without stamps."""
    times = io.times_of(images)
    if times is None or len(times) < 3:
        return None
    step = float(np.median(np.diff(times)))
    return [(t - times[0]) / step for t in times]


def read_instants(path: Path, images: list[io.PictureFile]) -> list[float]:
    """The instants of the images from a table ``image,frame``; the number of a frame need not be whole."""
    table = io.read_table(path, required=("image", "frame"), known=("image", "frame"))
    known = dict(zip(table.text("image"), table.numbers("frame").tolist(), strict=True))
    for image in images:
        if image.name not in known and image.stem not in known:
            raise io.FileError(path, f"has no line for {image.name}; expected one for every image")
    return [known.get(image.name, known.get(image.stem, np.nan)) for image in images]


def _write(
    out: io.ResultFolder, wishes: Wishes, series: Series, markers: MarkerSet, camera: Camera, record: Record,
    images: Sequence[io.PictureFile],
) -> Report:  # fmt: skip
    """Tables, picture, page and figures; what could not be drawn goes into the record, too."""
    place, unit = out.place, wishes.unit
    io.write_table(place / "poses.csv", pose_columns(series.rows))
    io.write_table(place / "matches.csv", match_columns(series.rows, markers))
    if series.last is not None:  # a start for the images that come later
        io.write_camera(place / "camera.json", camera, series.last[0], unit=unit, pose_cov=series.last[1])
    page = _page(series.rows, record, markers, camera, unit, place, images)
    put_verdict(page, Verdict.of_record(record["verdict"]))
    page.provenance(Provenance.of_verb(out))
    (place / "report.html").write_text(page.html(), encoding="utf-8")
    record["not_drawn"] = page.failed
    console.write_summary(out, record, wishes.markers.resolve().parent)
    return page


def _page(
    rows: list[PoseRow], record: Record, markers: MarkerSet, camera: Camera, unit: str, place: Path,
    images: Sequence[io.PictureFile],
) -> Report:  # fmt: skip
    from windmark.app.track_pictures import motion_picture
    from windmark.app.track_scene import track_scene

    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    report = Report("A model followed through images", f"windmark {windmark.__version__}, {when}, length unit: {unit}")
    report.table(
        ["status", "images", "meaning"], [[key, record[key], words] for key, words in WORDS.items()]
    )  # fmt: skip
    report.text(
        f"Median: {record['median_matched']:.0f} markers matched, RMS {g3(record['median_rms_px'])} px (2-D), "
        f"{1e3 * record['median_seconds']:.0f} ms per image, reading included. In {record['guided']} images the "
        "markers were looked for near their predicted places only."
    )
    if record["unchecked"]:
        report.listed("The images cannot tell:", (u["words"] for u in record["unchecked"]), "soft")
    for note in record["notes"]:
        report.text(note, "soft")
    for row in rows:
        if row.status == "lost":
            report.text(f"{row.name}: {row.reason}", "bad")
    report.heading("Motion")
    drawn = report.drawing(
        "picture of the motion", lambda: motion_picture(rows, unit),
        "Point of view (AIAA 2005-5007, Fig. 5) against the frame, less that of the first pose; bands: 1 sigma",
    )  # fmt: skip
    if drawn is not None:
        (place / "motion.png").write_bytes(drawn)
    report.heading("In 3D")
    report.scene("3D view", lambda: track_scene(rows, markers, camera, unit), "The model's markers, and the camera in "
                 "each image, in the model's frame. Under the cursor: names, places, residuals.")  # fmt: skip
    _pictures(report, rows, markers, images)
    report.heading("Every image")
    columns = ["frame", "image", "status", "matched", "expected", "RMS px", *_headings(unit), "time ms", "reason"]
    report.table(columns, [_row(row) for row in rows], scroll=True)
    report.heading("Files beside this report")
    report.table(["file", "content"], [
        ["poses.csv", "point of view of every image with its 1 sigma, station of the camera, status"],
        ["matches.csv", "which spot is which marker in every image, residual"],
        ["camera.json", "camera with the pose of the last good image"],
        ["motion.png, summary.json", "the picture above, the figures above"],
    ])  # fmt: skip
    return report


def _pictures(report: Report, rows: list[PoseRow], markers: MarkerSet, images: Sequence[io.PictureFile]) -> None:
    """The first image with a pose, and the one with the largest residuals."""
    from windmark.app.marked_photo import SERIES, marked_photo

    good = [k for k, row in enumerate(rows) if row.cam_from_model is not None]
    if not good:
        return
    report.heading("Pictures")
    shown = {max(good, key=lambda k: rows[k].rms_px): "the largest residuals", good[0]: "the first pose"}
    for k, what in shown.items():
        row = rows[k]
        with report.part(f"picture of {row.name}"):
            marker, columns = row.matches
            names = [str(n) for n in markers.name[marker]]
            report.raw(marked_photo(io.read_grey(images[k]), columns[:, :2], columns[:, 2:], names,
                                    f"{row.name}: {what}.", SERIES))  # fmt: skip


def _headings(unit: str) -> list[str]:
    return [name.replace("_deg", " °") if "deg" in name else f"{name} {unit}" for name in POV]


def _row(row: PoseRow) -> list[Any]:
    pov = [measured(value, sigma)[0] for value, sigma in zip(row.pov, row.sigma, strict=True)]
    return [
        row.index, row.name, row.status, row.matched, row.expected, row.rms_px, *pov,
        1e3 * row.seconds, row.reason,
    ]  # fmt: skip


def _lines(rows: list[PoseRow]) -> list[str]:
    """Counts, and one line for every image that was not simply tracked."""
    count: Callable[[str], int] = [row.status for row in rows].count
    said = [f"{count(key)} {words}" for key, words in WORDS.items() if count(key)]
    lines = [f"{len(rows)} image{'s' * (len(rows) != 1)}: {', '.join(said)}"]
    lines.extend(f"  {row.name}: {row.status}: {row.reason}" for row in rows if row.reason)
    good = [row for row in rows if row.cam_from_model is not None]
    if good:
        rms, matched = (float(np.median([getattr(row, key) for row in good])) for key in ("rms_px", "matched"))
        ms = 1e3 * float(np.median([row.seconds for row in rows]))
        lines.append(f"median: {matched:.0f} markers, RMS {rms:.3f} px, {ms:.0f} ms per image")
    return lines
