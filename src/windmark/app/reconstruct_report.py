"""The report of a reconstruction: which pictures and markers came out, how sure they are, what does not fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import windmark
from windmark import io
from windmark.app.calibrate_report import add_camera, add_errors, add_residuals, add_space
from windmark.app.epipolar_pictures import pair_picture, views_picture
from windmark.app.marked_photo import SERIES, marked_photo
from windmark.app.report import Report
from windmark.pipeline.calibrate import MatchOptions, Picture
from windmark.pipeline.calibrate.outputs import datum_words, sigma_rms
from windmark.pipeline.calibrate.read import read_image
from windmark.pipeline.clock import Clock
from windmark.pipeline.reconstruct.outputs import (
    marks_of,
    network,
    picture_records,
    primary_residuals,
    primary_sigma_words,
)  # fmt: skip
from windmark.scene import MarkerSet
from windmark.tasks.reconstruct import Reconstruction
from windmark.tasks.reconstruct.free import sigma_words
from windmark.tasks.reconstruct.pair import PairLines

HOW = {
    "given": "given",
    "labels": "from its labels",
    "pair": "one of the two that were matched first",
    "register": "registered to the points known so far",
    "neighbour": "matched with a neighbour that had a pose",
}
"""How a picture got its pose, in words."""

FILES = (
    ("markers.csv", "names, coordinates, 1 sigma, role (primary, secondary): a marker table for every other verb"),
    ("markers-covariance.csv", "3 x 3 covariance of each marker"),
    ("camera.json (camera-NAME.json for several)", "interior parameters"),
    ("views/NAME.json", "camera with the pose of that picture: resect, detect --camera and others take it"),
    ("poses.csv, poses.json", "station and direction of each picture with sigma; the whole covariances"),
    ("residuals.csv", "every mark: picture, name, place, residual, test value, used or left out"),
    ("matches.csv", "which spot is which marker in every picture; calibrate takes it instead of pictures"),
    ("open.csv", "of two pictures: spots with several possible partners, which stayed open"),
    ("pair.png", "with --pair: two pictures with their epipolar lines"),
    ("summary.json", "the figures of this report"),
)


@dataclass(frozen=True)
class Shown:
    """What a report shows beside the reconstruction itself.

    Parameters
    ----------
    unit : length unit
    primary : the table of primary markers
    pictures, paths : the pictures with their spots, and the files by name
    match : how the pictures are read
    pair : the two pictures with epipolar lines; None where not asked for
    """

    unit: str
    primary: MarkerSet
    pictures: Sequence[Picture]
    paths: Mapping[str, io.PictureFile]
    match: MatchOptions
    pair: PairLines | None


def reconstruction_report(result: Reconstruction, shown: Shown, clock: Clock, place: Path) -> Report:
    """The whole report, what could not be drawn in its ``failed``; the picture of a pair goes into ``place``, too."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    done, unit = network(result), shown.unit
    report = Report("Reconstruction", f"windmark {windmark.__version__}, {when}, length unit: {unit}")
    _overview(report, result, shown)
    _pictures(report, result, shown)
    _primaries(report, result, shown)
    with report.part("picture of the spots and their markers"):
        _tracks(report, result, shown)
    if shown.pair is not None:
        _pair(report, shown.pair, shown, place)
    add_space(report, done, unit)
    for name in done.cameras:
        if result.options["free"]:
            add_camera(report, done, name)
        else:
            report.heading(f"Residuals of camera {name}" if len(done.cameras) > 1 else "Residuals")
            add_residuals(report, done, name)
    add_errors(report, done)
    report.closing(FILES, result.options, clock.seconds)
    return report


def _overview(report: Report, result: Reconstruction, shown: Shown) -> None:
    done, unit, known = result.calibration, shown.unit, primary_residuals(result, shown.primary)
    rows: list[tuple[str, object]] = [
        ("pictures used", f"{len(shown.pictures) - len(result.dropped)} of {len(shown.pictures)}"),
        ("markers", len(result.markers)), ("of them primary", len(known.name)), ("marks", len(done.observations)),
        ("left out as gross errors", int((~done.used).sum())),
        ("of them linked all the same (no other marker is near)", int((result.linked & ~done.used).sum())),
        ("redundancy", done.redundancy),
        ("sigma0 (1: residuals as large as the marks' sigmas say)", done.sigma0),
        ("RMS length of the residuals, px", result.rms_px),
        *((f"markers, RMS of 1 sigma along {axis}, {unit}", float(s))
          for axis, s in zip("xyz", sigma_rms(result.markers), strict=True)),
    ]  # fmt: skip
    known_normals = result.normal_sigma_deg[np.isfinite(result.normal_sigma_deg)]
    if len(known_normals):
        rows.append(("markers with a normal from their ellipses", len(known_normals)))
        rows.append(("median of 1 sigma of these normals, degrees", float(np.median(known_normals))))
    report.table(["", "value"], rows)
    for sentence in result.warnings:
        report.text(f"{sentence}.", "bad")
    if result.unchecked:
        report.text(f"The pictures cannot tell: {result.unchecked}.", "soft")
    if done.unchecked:
        report.text(f"The known markers cannot tell: {done.unchecked}.", "soft")


def _pictures(report: Report, result: Reconstruction, shown: Shown) -> None:
    report.heading("Pictures")
    report.table(
        ["picture", "spots", "markers", "its first pose", "why not"],
        [
            (p["image"], p["spots"], p["markers"] or None, HOW.get(p["pose"]), p["problem"] or None)
            for p in picture_records(shown.pictures, result)
        ],
        scroll=len(shown.pictures) > 15,
    )  # fmt: skip
    report.drawing("picture of the markers' views", lambda: views_picture(result.count),
                   "Markers by the number of pictures that they are seen in.", dpi=88)  # fmt: skip


def _primaries(report: Report, result: Reconstruction, shown: Shown) -> None:
    known, unit = primary_residuals(result, shown.primary), shown.unit
    if result.frame:
        report.heading("Frame")
        report.text(f"{result.frame[0].upper()}{result.frame[1:]}; {sigma_words(result.frame)}.")
        if result.free_scale:
            report.text("length_unit: free. No length here has a unit: a known distance (--distance) gives one.", "bad")
    if any(len(s) for s in result.open_spots.values()):
        report.text("Spots with several possible partners, or one that could be chance, stay open (open.csv): "
                    + ", ".join(f"{n} {len(s)}" for n, s in result.open_spots.items()) + ".")  # fmt: skip
    if not len(shown.primary):
        return
    report.heading("Primary markers")
    for words in () if result.frame else datum_words(result.calibration):
        report.text(words)
    for words in primary_sigma_words(shown.primary, unit):
        report.text(words[0].upper() + words[1:] + ".")
    head = ["marker", f"dx, {unit}", "dy", "dz", "distance"]
    head += ["1 sigma x of the table", "y", "z"] if np.isfinite(known.sigma).any() else []
    rows = [
        (name, *(f"{v:+z.4f}" for v in d), f"{np.linalg.norm(d):.4f}", *map(float, s))
        for name, d, s in zip(known.name, known.difference, known.sigma, strict=True)
    ]
    report.table(head, [row[: len(head)] for row in rows])
    report.text(f"Reconstructed less given coordinates, {unit}.", "soft")
    for name in known.missing:
        report.text(f"{name} was not recognised: {result.unrecognised[name]}.", "bad")


def _tracks(report: Report, result: Reconstruction, shown: Shown) -> None:
    """The picture with the most markers, each with its name."""
    count = marks_of(result)
    best = max(count, key=lambda name: count[name])
    k = next(k for k, v in enumerate(result.views) if v.name == best)
    view, mine = result.views[k], result.tracks.view == k
    camera, pose, spots = result.cameras[view.camera], view.cam_from_model, shown.pictures[k].detections
    assert pose is not None
    xy = camera.project(pose.apply(result.markers.xyz))[0]
    marker = result.tracks.track[mine]
    other = np.setdiff1d(np.flatnonzero(camera.in_image(xy)), marker)
    names = result.markers.name
    image = read_image(shown.paths[best], shown.match)[0]
    at = spots.xy[result.tracks.detection[mine]]
    report.heading("Which spot is which marker")
    report.raw(marked_photo(
        image, at, xy[marker] - at, names[marker].tolist(),
        f"{best}, the picture with the most markers. Diamonds: markers that other pictures have; here they are hidden, "
        "or were not found.", SERIES, missing=(xy[other], names[other].tolist()),
    ))  # fmt: skip


def _pair(report: Report, pair: PairLines, shown: Shown, place: Path) -> None:
    def draw() -> Figure:
        return pair_picture(pair, *(read_image(shown.paths[side.name], shown.match)[0] for side in (pair.a, pair.b)))

    report.heading("Epipolar lines of two pictures")
    drawn = report.drawing(
        "picture of the epipolar lines", draw,
        f"{pair.a.name} and {pair.b.name} (AIAA 2005-5007, Fig. 12). Each marker is on the line of its spot in the "
        "other picture; lines bend as the lens does.",
    )  # fmt: skip
    if drawn is not None:
        (place / "pair.png").write_bytes(drawn)
