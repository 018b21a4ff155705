"""The report of a calibration: what came out, how sure it is, what does not fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial

import numpy as np

import windmark
from windmark import io
from windmark.app import calibrate_pictures as drawn
from windmark.app import space_pictures as space
from windmark.app.lens_pictures import residual_map_picture
from windmark.app.lens_report import NAMES, put_correction, put_distortion, put_parameters
from windmark.app.network_scene import network_scene
from windmark.app.pictures import png
from windmark.app.report import Report, measured, measured_rows
from windmark.app.wording import power_of_ten
from windmark.calibration import Calibration, NotCalibrated, undistort
from windmark.calibration.lens_choice import lens_words
from windmark.calibration.quality import Comparison, SplitHalf, residual_map
from windmark.calibration.snooping import critical
from windmark.errors import g3
from windmark.pipeline.calibrate import Calibrated, MatchOptions, Picture
from windmark.pipeline.calibrate.outputs import STRONG, correlations, datum_words, pose_columns, sigma_rms, views_seen
from windmark.pipeline.calibrate.read import read_image
from windmark.pipeline.clock import Clock
from windmark.tasks.calibrate.rig import beside

WORST = 25
OPTIMISTIC = 1.3
"""Ratio of halves above which the covariances are called optimistic."""

FILES = (
    ("camera.json (camera-NAME.json for several)", "interior parameters with their covariance"),
    ("markers.csv", "coordinates with sigma: a marker table for every other verb"),
    ("markers-covariance.csv", "3 x 3 covariance of each marker; --against of another calibration reads it"),
    ("rig.json", "of a rig: the pose of each camera in the first one's frame, with covariance"),
    ("poses.csv, poses.json", "station and direction of each view with sigma; the whole covariances"),
    ("views/NAME.json", "camera with the pose of that view: resect, detect --camera and others take it"),
    ("residuals.csv", "every mark: residual, test value, used or left out"),
    ("matches.csv", "from pictures: the matched marks; calibrate takes it instead of the pictures"),
)


@dataclass(frozen=True)
class Shown:
    """What a report shows beside the calibration itself.

    Parameters
    ----------
    unit : length unit
    pictures, paths : what became of each picture, and the files by name; None from a table of matches
    match : how the pictures are read
    against, other : comparison with another set of pictures, and where that is from
    """

    unit: str
    pictures: Sequence[Picture] | None
    paths: Mapping[str, io.PictureFile] | None
    match: MatchOptions
    against: Comparison | None
    other: str


def calibration_report(done: Calibrated, shown: Shown, clock: Clock) -> Report:
    """The whole report, what could not be drawn in its ``failed``."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    unit, result = shown.unit, done.result
    report = Report("Calibration", f"windmark {windmark.__version__}, {when}, length unit: {unit}")
    _overview(report, done, unit, shown.pictures)
    report.heading("Datum")
    for words in datum_words(result):
        report.text(words)
    for name in result.cameras:
        add_camera(report, result, name)
        if shown.paths is not None:
            with report.part(f"{name}: the lens undone in a picture"):
                _corrected(report, result, name, shown.paths, shown.match)
    _rig(report, result, unit)
    _halves(report, done.halves, unit)
    if shown.against is not None:
        _against(report, shown.against, unit, shown.other)
    add_errors(report, result)
    if shown.pictures is not None:
        _matched(report, shown.pictures)
    add_space(report, result, unit)
    report.closing(FILES, result.options, clock.seconds)
    return report


def _overview(report: Report, done: Calibrated, unit: str, pictures: Sequence[Picture] | None) -> None:
    result = done.result
    of = "" if pictures is None else f" of {len(pictures)}"
    sigma = sigma_rms(result.markers)
    rows: list[tuple[str, object]] = [
        ("views", f"{len(result.views)}{of}"), ("markers", len(result.markers)), ("marks", len(result.observations)),
        ("left out as gross errors", int((~result.used).sum())), ("redundancy", result.redundancy),
        ("sigma0 (1: residuals as large as the marks' sigmas say)", result.sigma0),
        ("RMS length of the residuals, px", result.rms_px),
        *((f"markers, RMS of 1 sigma along {axis}, {unit}", float(s)) for axis, s in zip("xyz", sigma, strict=True)),
    ]  # fmt: skip
    if isinstance(done.halves, SplitHalf):
        rows.append(("two halves of the pictures, difference / sigma", done.halves.ratio))
    rows.append(("adjustment", result.report.words))
    report.table(["", "value"], rows)
    if len(done.lenses) > 1:
        report.text(f"{lens_words(done.lenses).capitalize()}.")
    for sentence in result.warnings:
        report.text(f"{sentence}.", "bad")
    if done.unchecked:
        report.text(f"The marks cannot tell: {done.unchecked}.", "soft")
    if result.unchecked:
        report.text(f"The known markers cannot tell: {result.unchecked}.", "soft")


def add_camera(report: Report, result: Calibration, name: str) -> None:
    """Parameters of a camera with their uncertainty, and what the lens and its model do over the image."""
    camera = result.cameras[name]
    report.heading(f"Camera {name}" if len(result.cameras) > 1 else "Camera")
    put_parameters(report, camera)
    strong = correlations(result, name)
    if strong:
        pairs = ", ".join(f"{a} with {b} ({r:+z.3f})" for a, b, r in strong)
        report.text(f"Correlated beyond {STRONG:g}: {pairs}. Use the whole covariance of the camera's file, "
                    "never one of "
                    "these sigmas alone.")  # fmt: skip
    put_distortion(report, camera, f"{name}: picture of the distortion")
    with report.part(f"{name}: map of the residuals"):
        seen = residual_map(result, name)
        report.picture(png(residual_map_picture(seen), dpi=88), "What the lens model misses.")
        report.text(f"The cell means are {seen.excess:.2f} times what the scatter within the cells gives; 1 where the "
                    "lens model misses nothing.", "soft")  # fmt: skip
    add_residuals(report, result, name)
    if camera.cov is not None:
        report.drawing(
            f"{name}: picture of the projection's sigma", lambda: drawn.projection_sigma_picture(result, name),
            "What the covariance of the interior parameters means in the image; a turn of the whole camera is left out."
            " Beyond the marks it grows fast.", dpi=88,
        )  # fmt: skip


def add_residuals(report: Report, result: Calibration, name: str) -> None:
    """The residuals of a camera."""
    report.drawing(f"{name}: picture of the residuals", lambda: drawn.residual_vectors_picture(result, name),
                   "Every residual at its place.", dpi=88)  # fmt: skip


def _corrected(
    report: Report, result: Calibration, name: str, paths: Mapping[str, io.PictureFile], match: MatchOptions
) -> None:
    """The picture of a camera with the most marks: as taken, lens undone, distortion magnified."""
    camera, views = result.cameras[name], [v.name for v in result.views]
    count = np.bincount(result.observations.view[result.used], minlength=len(views))
    best = max((n for n, v in enumerate(result.views) if v.camera == name), key=lambda n: count[n])
    image = read_image(paths[views[best]], match)[0]
    put_correction(report, views[best], image, camera, undistort(image, camera))


def _rig(report: Report, result: Calibration, unit: str) -> None:
    others = beside(result)
    if not others:
        return
    report.heading("The cameras of the rig to each other")
    first = next(iter(result.cam_from_rig))
    report.table(
        ["camera", f"from {first}, {unit}", "1 sigma", "turned by, deg", "1 sigma"],
        [(b.camera, *measured(b.distance, b.distance_sigma), *measured(b.angle_deg, b.angle_sigma_deg))
         for b in others],
    )


def _halves(report: Report, halves: SplitHalf | NotCalibrated, unit: str) -> None:
    report.heading("Half of the pictures against the other half")
    if isinstance(halves, NotCalibrated):
        report.text(f"Not done: {halves.reason}", "soft")
        return
    found = halves.comparison
    words = "The cameras' parameters" if found is None else f"{len(found.name)} markers"
    words += f" differ by {'' if found is None else f'{g3(found.rms)} {unit} RMS, '}{halves.ratio:.2f} times what the"
    words += " covariances"
    optimistic = halves.ratio > OPTIMISTIC
    report.text(words + (" say: the sigmas in this report are too small by about this factor, as they are where "
                         "the lens "
                         "model misses something, or the model moved." if optimistic else " say."),
                "bad" if optimistic else "good")  # fmt: skip
    rows = [
        (name, NAMES.get(p, p), *measured(float(d), float(s)), float(abs(d) / s) if s > 0 else None)
        for name, change in halves.change.items()
        for p, (d, s) in change.items()
    ]
    report.table(["camera", "parameter", "change", "1 sigma of it", "|change| / sigma"], rows)


def _against(report: Report, found: Comparison, unit: str, other: str) -> None:
    report.heading("Against another set of pictures")
    report.text(f"The same markers from {other}, fitted to these (turn, shift, scale): {len(found.name)} "
                "markers differ by "
                f"{g3(found.rms)} {unit} RMS, {found.ratio:.2f} times what both covariances say.",
                "good" if found.ratio < OPTIMISTIC else "bad")  # fmt: skip
    report.drawing("picture of the difference of the two sets",
                   lambda: drawn.comparison_picture(found, unit, "Difference of the two sets"),
                   "The paper's cross-check (AIAA 2005-5007, section IV.D).", dpi=88)  # fmt: skip


def add_errors(report: Report, result: Calibration) -> None:
    """Marks that were left out, test values of all, and what did not take part."""
    report.heading("Gross errors")
    bad = np.flatnonzero(~result.used)
    report.text(f"{len(bad)} of {len(result.used)} marks were left out: their residual, predicted from all others, is "
                f"beyond the limit of {critical(len(result.test)):.1f} in units of its own variance.")  # fmt: skip
    for a, b, view in result.swapped:
        report.text(f"{a} and {b} are exchanged in {view}.", "bad")
    worst = bad[np.argsort(-result.test[bad], kind="stable")][:WORST]
    if len(worst):
        obs = result.observations
        report.table(
            ["image", "marker", "x px", "y px", "dx px", "dy px", "test"],
            [
                (result.views[obs.view[o]].name, str(result.markers.name[obs.point[o]]),
                 *(f"{v:z.2f}" for v in (*obs.xy[o], *result.residuals[o])), float(result.test[o]))
                for o in worst
            ],
            scroll=True,
        )  # fmt: skip
    report.drawing("picture of the test values", lambda: drawn.tests_picture(result), "Test values of all marks.",
                   dpi=88)  # fmt: skip
    if result.dropped:
        report.heading("What did not take part", 3)
        report.table(["view or marker", "why"], list(result.dropped.items()), scroll=True)


def _beyond(excess_px: float) -> str:
    """What the residuals say of the detector's noise."""
    if excess_px < 0.0005:
        return "The residuals are the detector's own noise."
    return (f"The residuals ask for {excess_px:.3f} px (1 sigma per coordinate) beyond the detector's own noise; it "
            "was added to all marks.")  # fmt: skip


def _matched(report: Report, matched: Sequence[Picture]) -> None:
    report.heading("Matching of the pictures")
    good = sum(m.count > 0 for m in matched)
    report.text(f"{good} of {len(matched)} pictures matched. Round: the first one in which a picture was certain; from "
                "the second on, camera and markers are those of the calibration of the round before. All are matched "
                f"again in each. {_beyond(matched[0].excess_px)}")  # fmt: skip
    report.table(
        ["picture", "spots", "matched", "RMS px", "false-alarm number", "round", "why not"],
        [
            (m.name, len(m.detections), m.count, m.rms_px, None if m.log10_nfa is None else power_of_ten(m.log10_nfa),
             m.round or None, m.problem)
            for m in matched
        ],
    )  # fmt: skip


def add_space(report: Report, result: Calibration, unit: str) -> None:
    """Stations and markers with their uncertainty, as pictures and tables."""
    report.heading("Stations and markers")
    report.scene("3D view", lambda: network_scene(result, unit), "Stations with their views, markers with their 95 % "
                 "error ellipsoids.")  # fmt: skip
    for what, draw, caption in (
        ("picture of the stations along each axis", space.stations_picture,
         "Where the pictures were taken from, along each axis."),
        ("picture of the markers' sigma", space.markers_picture, "How sure the markers are."),
    ):
        if draw is not space.markers_picture or result.marker_cov.any():
            report.drawing(what, partial(draw, result, unit), caption, dpi=88)
    table, seen = result.markers, views_seen(result)
    digits = measured_rows(table.xyz, table.sigma)
    report.table(
        ["marker", f"x, {unit}", "y", "z", f"sigma x, {unit}", "sigma y", "sigma z", "views"],
        [
            (str(table.name[k]), *digits[k], int(seen[k])) for k in range(len(table))
        ],
        scroll=True,
    )  # fmt: skip
    columns = pose_columns(result)
    keys = [k for k in columns if k not in ("camera", "frame") or len(set(columns[k].tolist())) > 1]
    names = {**{a: f"{a}, {unit}" for a in "xyz"}, **{f"sigma_{a}": f"sigma {a}" for a in "xyz"},
             **{f"sigma_cam_{a}_deg": f"sigma r{a}, deg" for a in "xyz"}, "left_out": "left out",
             "rms_px": "RMS px", "focal_change": "focal change, %",
             **{f"principal_shift_{a}_px": f"shift c{a}, px" for a in "xy"}}  # fmt: skip
    own = ("focal_change", "principal_shift_x_px", "principal_shift_y_px")
    keys = [k for k in keys if k not in (*own, "frame", "rx_deg", "ry_deg", "rz_deg")
            or (k in own and columns[k].any())]  # fmt: skip
    station = measured_rows(*(np.stack([columns[f"{of}{a}"] for a in "xyz"], axis=1) for of in ("", "sigma_")))
    said = dict(zip([*"xyz", *(f"sigma_{a}" for a in "xyz")], zip(*station, strict=True), strict=True))
    said |= {k: [measured(v, v)[1] for v in columns[k]] for k in keys if k.startswith("sigma_cam_")}
    said |= {"focal_change": [f"{100 * v:+.2f}" for v in columns["focal_change"]]}
    said |= {k: [f"{v:+.1f}" for v in columns[k]] for k in own[1:]}
    rows = zip(*(said.get(k, columns[k].tolist()) for k in keys), strict=True)
    report.table([names.get(k, k) for k in keys], rows, scroll=True)
    report.text("Sigma of x, y, z: of the station in the model's frame; of rx, ry, rz: of a turn about the "
                "camera's own "
                "axes.", "soft")  # fmt: skip
