"""Draw the guide's pictures with windmark itself: ``python docs/make_pictures.py`` (a minute)."""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from PIL import Image

import windmark as wm
from windmark import calibration, detection
from windmark.app import (
    epipolar_pictures,
    laws_examples,
    laws_pictures,
    lens_pictures,
    markers_pictures,
    merge_pictures,
    pictures,
    space_pictures,
    study_pictures,
)
from windmark.app.detect_pictures import explained_picture, merit_picture
from windmark.app.figures import alignment_figure, matching_figure, surface_figure, wireframe_figure
from windmark.app.pov_pictures import pov_picture
from windmark.app.pov_verb import Viewpoint
from windmark.deformation.laws import CATALOG
from windmark.geometry import imaged_ellipse
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.simulate import simulate
from windmark.pipeline.simulate_cameras import simulate_cameras
from windmark.pipeline.study import StudySettings, examples, run_study
from windmark.synth import disc_image, marker_scene, marker_sheet
from windmark.tasks.marker_check import CheckSettings, check_markers
from windmark.tasks.predictions import from_camera, look
from windmark.tasks.reconstruct.pair import pair_lines

HERE = Path(__file__).parent / "pictures"
SHADES = 32  # of each colour: camera noise in all 256 would take three times the bytes


def main() -> None:
    """Save all pictures."""
    HERE.mkdir(exist_ok=True)
    for part in (
        job_pictures,
        alignment_2d_pictures,
        detection_pictures,
        faint_pictures,
        lens_pictures_drawn,
        marker_study_pictures,
        marker_check_pictures,
        board_pictures,
        calibration_pictures,
        pair_pictures,
        deformation_pictures,
        paint_pictures,
        infrared_pictures,
        law_pictures,
        merged_pictures,
    ):
        for name, figure in part().items():
            (HERE / f"{name}.png").write_bytes(_small(pictures.png(figure, dpi=80)))


def alignment_2d_pictures() -> dict[str, Figure]:
    """A bent wing put back by its markers alone: what ``align`` without a camera draws."""
    from windmark.app.align_pictures import ratio_picture
    from windmark.pipeline.align2d import AlignSettings, align_files, read_reference
    from windmark.pipeline.align2d.outputs import ratios
    from windmark.pipeline.simulate_deforming import simulate_deforming

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        simulate_deforming(folder, seed=1, frames=4)
        settings = AlignSettings()
        reference = read_reference(folder / "images" / "cam1-0000.tif", settings)
        item = next(align_files([folder / "images" / "cam1-0003.tif"], reference, settings))
    assert item.alignment is not None, item.problem
    before, after = ratios(item, reference) or (reference.image, reference.image)
    return {
        "align-2d-ratio": ratio_picture(before, after, item.alignment, item.name),
    }


def deformation_pictures() -> dict[str, Figure]:
    """A bending wing before two cameras, and what its deformation does to pressures mapped onto it."""
    sys.path[:0] = [str(HERE.parents[1] / part) for part in ("benchmarks", "tests/deformation")]
    import deformation_paint
    from windmark.app.deform_curves import span_picture
    from windmark.app.deform_report import surface_figure as deformed_figure
    from windmark.pipeline.deform import load, read_deform_project, run_sequence
    from windmark.pipeline.simulate_deforming import simulate_deforming

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        simulate_deforming(folder, 1, 9)
        loaded = load(read_deform_project(folder / "deform.toml", folder / "out"))
        (folder / "out").mkdir()
        sequence = run_sequence(loaded, folder / "out")
    assert loaded.stations is not None
    deformed = deformed_figure(loaded, sequence)
    assert deformed is not None
    return {
        "deform-span": span_picture(sequence.good, loaded.stations.eta, "mm"), "deform-surface": deformed,
        "deform-paint": deformation_paint.picture(deformation_paint.mapped()),
    }  # fmt: skip


def paint_pictures() -> dict[str, Figure]:
    """A painted polar: Cp on the wing, a section with its taps, the paint's calibration."""
    from windmark.app.paint_pictures import pressure_picture
    from windmark.app.psp_pictures import cp_map, section_picture
    from windmark.pipeline.psp import load_psp, read_psp_project, reduced, run_psp
    from windmark.pipeline.psp.cell import calibrate_paint, read_cell
    from windmark.pipeline.psp.outputs import FIELDS
    from windmark.pipeline.simulate_psp import simulate_psp

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate_psp(folder, 1, 3)
        test = load_psp(read_psp_project(folder / "psp.toml"))
        out = folder / "out"
        out.mkdir()
        records = reduced(run_psp(test, out, threads=2))
        cell = read_cell(folder / "paint-cell.csv")
        mesh, fields = wm.io.read_nodes_netcdf(out / records[-1].name / FIELDS)[:2]
    pose = test.deforming.test.stations[0].cam_from_tunnel
    title = f"Cp at {records[-1].alpha_deg:g}° incidence"
    cp = np.asarray(fields["cp"], dtype=float)
    return {
        "psp-cp": cp_map(mesh, cp, title, "Cp", direction=pose.rotation[2], up=-pose.rotation[1]),
        "psp-section": section_picture(records, "eta55"),
        "paint-calibrate": pressure_picture(cell, calibrate_paint(cell, p_ref_Pa=1e5, t_ref_K=293.15)),
    }  # fmt: skip


def infrared_pictures() -> dict[str, Figure]:
    """A wing that heats up: heat flux on it, and histories at points."""
    from windmark.app.infrared_report import histories_of
    from windmark.app.psp_pictures import cp_map
    from windmark.pipeline.infrared import load_infrared, read_infrared_project, run_infrared
    from windmark.pipeline.infrared.outputs import FRAMES
    from windmark.pipeline.simulate_infrared import simulate_infrared

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate_infrared(folder, 1, 30)
        run = load_infrared(read_infrared_project(folder / "infrared.toml"))
        out = folder / "out"
        out.mkdir()
        result = run_infrared(run, out)
        last = result.records[-1]
        mesh, fields = wm.io.read_nodes_netcdf(out / FRAMES / f"{last.key}.nc")[:2]
    pose = run.deforming.test.stations[0].cam_from_tunnel
    flux = np.asarray(fields["heat_flux"], dtype=float)
    title = f"Heat flux after {last.time_s:.2f} s"
    return {
        "infrared-flux": cp_map(mesh, flux, title, "heat flux, W/m²", direction=pose.rotation[2], up=-pose.rotation[1]),
        "infrared-histories": histories_of(result, run.points[0]),
    }  # fmt: skip


def merged_pictures() -> dict[str, Figure]:
    """Four cameras round the wing, merged."""
    with tempfile.TemporaryDirectory() as place:
        simulate_cameras(Path(place), 3, 4)
        result = run_project(read_project(Path(place) / "project.toml"))
    (group,) = result.merged
    merged = group.merged
    assert merged is not None
    return {
        "merged-source": merge_pictures.source_figure(merged),
        "merged-seams": merge_pictures.seams_figure(merged, "mm"),
        "merged-top": pictures.view_picture(group.views[0].view, "mm"),
        "merged-line": merge_pictures.line_figure(group.points[1], "mm"),
    }  # fmt: skip


def law_pictures() -> dict[str, Figure]:
    """What ``windmark laws --pictures`` draws."""
    return {f"law-{kind}": laws_pictures.law_picture(kind, laws_examples.example(kind)) for kind in CATALOG}


def calibration_pictures() -> dict[str, Figure]:
    """A plate of 60 markers with relief, calibrated from 16 virtual pictures."""
    rng = np.random.default_rng(4)
    camera = wm.Camera((2048, 1536), 2300.0, 1.0005, 1030.0, 761.0, k1=-0.08, k2=0.05)
    xyz = rng.uniform(-1, 1, (60, 3)) * [345, 200, 40]
    names = [f"M{k:02d}" for k in range(60)]
    views, view, point, xy = [], [], [], []
    for v, around in enumerate(np.linspace(0, 2 * np.pi, 16, endpoint=False)):
        up = 0.75 if v % 2 else 0.35
        eye = 1350 * np.array([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)])
        roll = v * np.pi / 2
        pose = wm.Pose.look_at(eye, rng.normal(0, 20, 3), np.array([np.cos(roll), np.sin(roll), 0.2]))
        seen = camera.project(pose.apply(xyz))[0]
        inside = np.flatnonzero(camera.in_image(seen) & (rng.random(60) < 0.85))
        views.append(wm.View(f"P{v:02d}"))
        view.append(np.full(len(inside), v))
        point.append(inside)
        xy.append(seen[inside] + rng.normal(0, 0.1, (len(inside), 2)))
    marks = np.concatenate(xy)
    observations = wm.Observations(
        np.concatenate(view), np.concatenate(point), marks, np.full((len(marks), 1, 1), 0.1**2) * np.eye(2)
    )
    rough = wm.MarkerSet.make(names, xyz + rng.normal(0, 4, xyz.shape))
    start = {"camera": wm.Camera((2048, 1536), 2048.0)}
    result = wm.self_calibrate(observations, rough, start, views, datum=wm.Free())
    assert isinstance(result, wm.Calibration)
    return {
        "calibration-stations": space_pictures.stations_picture(result, "mm"),
        "calibration-markers": space_pictures.markers_picture(result, "mm"),
    }


def pair_pictures() -> dict[str, Figure]:
    """Unknown markers on a plate with relief, six of them known: what ``reconstruct --pair`` draws."""
    rng = np.random.default_rng(8)
    camera = wm.Camera((800, 600), 880.0, 1.0, 404.0, 297.0, k1=-0.2)
    xyz = rng.uniform(-1, 1, (48, 3)) * [330, 220, 60]
    images = []
    for v in range(7):
        eye = np.array([220.0 * (v - 3), 120.0 * (-1) ** v - 150, 980.0 + 60 * (v % 3)])
        pose = wm.Pose.look_at(eye, rng.normal(0, 15, 3), np.array([0.15 * (v - 3), 1.0, 0.0]))
        images.append(_dots(rng, camera, pose, xyz[rng.random(len(xyz)) > 0.1]))
    spots = [wm.detect(image, radius_px=4) for image in images]
    known = wm.MarkerSet.make([f"P{k}" for k in range(6)], xyz[_far_apart(xyz, 6)])
    views = [wm.View(f"IMG{v:02d}") for v in range(7)]
    result = wm.reconstruct(spots, camera, known, views=views)
    assert isinstance(result, wm.Reconstruction), result.reason
    lines = pair_lines(result, "IMG02", "IMG04", spots[2].xy, spots[4].xy)
    return {"epipolar-pair": epipolar_pictures.pair_picture(lines, images[2], images[4])}


def _far_apart(xyz: np.ndarray, count: int) -> list[int]:
    """Markers each of which is as far as can be from those before it."""
    chosen = [int(np.linalg.norm(xyz, axis=1).argmax())]
    while len(chosen) < count:
        chosen.append(int(np.linalg.norm(xyz[:, None] - xyz[chosen], axis=2).min(axis=1).argmax()))
    return chosen


def _dots(rng: np.random.Generator, camera: wm.Camera, pose: wm.Pose, xyz: np.ndarray) -> np.ndarray:
    """Dark discs that face +z on light paint, as the camera sees them."""
    seen = imaged_ellipse(camera, pose.apply(xyz), np.tile(pose.rotation[:, 2], (len(xyz), 1)), 4.5)
    y, x = np.mgrid[: camera.size_px[1], : camera.size_px[0]]
    image = 150 + 0.08 * x - 0.05 * y
    half = 14
    for xy, axes, angle in zip(seen.xy, seen.axes_px, seen.angle, strict=True):
        first = np.rint(xy).astype(int) - half
        if min(*first, *(np.array(camera.size_px) - first - 2 * half - 1)) < 0:
            continue
        disc = disc_image((2 * half + 1,) * 2, xy - first, axes, float(angle), level=1.0, depth=0.8, blur_px=0.7)
        image[first[1] : first[1] + 2 * half + 1, first[0] : first[0] + 2 * half + 1] *= disc
    return np.clip(np.rint(image + rng.normal(0, 2.0, image.shape)), 0, 255).astype(np.uint8)


def job_pictures() -> dict[str, Figure]:
    """The main job on the virtual wind tunnel."""
    with tempfile.TemporaryDirectory() as folder:
        simulate(Path(folder), seed=1)
        result = run_project(read_project(Path(folder) / "project.toml"))
        markers = wm.read_markers(Path(folder) / "markers.csv")
        keep = (Path(folder) / "project.toml").read_text().replace("[align]", '[align]\nbackground = "keep"')
        (Path(folder) / "keep.toml").write_text(keep)
        kept = run_project(read_project(Path(folder) / "keep.toml")).images[-1]
    before, item = result.images[0], result.images[-1]
    drawn = {
        "matching": matching_figure(item, result.markers),
        "wireframe": wireframe_figure(item, result.mesh),
        "surface": surface_figure(item, result.mesh),
        "view-top": pictures.view_picture(item.views[0], "mm"),
        "section": pictures.section_picture(item.sections[0], "mm"),
        "alignment": alignment_figure(item, result),
        "align-keep": kept_figure(kept),
        "pov": pov_figure(before, result),
        "guided": guided_figure(item, before, markers),
    }
    return {name: figure for name, figure in drawn.items() if figure is not None}


def kept_figure(item: ImageResult) -> Figure:
    """An aligned image in which what stands still is kept; blank pixels pink."""
    assert item.aligned is not None
    figure, axes = pictures.image_axes(item.aligned)
    axes.set_facecolor("#ff80ab")
    axes.set_title(f"{item.name} aligned, walls kept; blank: the model hides the wall in this image")
    return figure


def pov_figure(item: ImageResult, result: RunResult) -> Figure:
    """What ``windmark pov --picture`` draws of a registered camera."""
    answer = item.registered
    assert answer is not None
    assert result.markers is not None
    pose, camera = answer.cam_from_model, answer.camera
    sigma = pose.pov_sigma(answer.cov[:6, :6])
    view = Viewpoint(f"{item.name}/camera.json", camera, pose, "mm", sigma)
    return pov_picture(view, result.mesh, result.markers.xyz[result.markers.role != "wall"])


def guided_figure(item: ImageResult, before: ImageResult, markers: wm.MarkerSet) -> Figure:
    """What ``--camera --markers --picture`` draws: markers looked for where the pose of the image before shows them."""
    assert item.image is not None
    assert before.registered is not None
    expected = from_camera(before.registered.camera, before.registered.cam_from_model, markers)
    got = look(item.image, expected)
    names, found = np.array(expected.name), got.found
    return pictures.matching_picture(
        item.image, got.detections, np.arange(found.sum()), names[found].tolist(), expected.xy[found],
        expected.xy[~found], names[~found].tolist(), item.name, guided=True,
    )  # fmt: skip


def detection_pictures() -> dict[str, Figure]:
    """Markers among clutter: what ``--explain --picture`` and ``--merit-map`` draw."""
    scene, radii = marker_scene(1, "cluttered", size_px=(640, 400), markers=24), (2.5, 3.5, 5.0)
    found, rejected = detection.explain(scene.image, radius_px=radii)
    merit = np.fmin.reduce([detection.merit_map(scene.image, r) for r in radii])
    words = ", ".join(f"{r:g}" for r in radii)
    return {
        "detect-explain": explained_picture(scene.image, found, rejected, "cluttered.tif"),
        "detect-merit": merit_picture(merit, 0.7, f"cluttered.tif: best merit over the radii {words} px"),
    }


def faint_pictures() -> dict[str, Figure]:
    """The same markers 20 and 3 times as deep as the noise; the faint ones with and without the frame before."""

    def frame(noise: float) -> tuple[np.ndarray, np.ndarray]:
        image, truth = marker_sheet(
            np.random.default_rng(5), radius_px=3.0, grid=(6, 6), pitch_px=34, max_tilt_deg=45.0, blur_passes=1,
            noise=noise, level=120.0, depth=24.0,
        )  # fmt: skip
        return np.clip(np.rint(image), 0, 255).astype(np.uint8), truth.xy

    (clear, true_xy), (faint, _) = frame(1 / 20), frame(1 / 3)
    before = wm.detect(clear, radius_px=3)
    alone = wm.detect(faint, radius_px=3)
    near = detection.detect_at(faint, before.xy, axes_px=before.axes_px, angle=before.angle).detections
    figure = Figure(figsize=(pictures.WIDTH_IN, 3.9), layout="constrained")
    shown = (
        (clear, before, "depth 20 times the noise, detect"), (faint, alone, "depth 3 times the noise, detect"),
        (faint, near, "the same, --near the first"),
    )  # fmt: skip
    for axes, (image, spots, words) in zip(figure.subplots(1, 3), shown, strict=True):
        axes.imshow(pictures.stretched(image), cmap="gray", interpolation="nearest")
        pictures.draw_spots(axes, spots)
        axes.set(title=f"{words}: {len(spots)} of {len(true_xy)}", xlabel="x, px", ylabel="y, px")
        axes.title.set_fontsize(9.5)
    return {"detect-near": figure}


def lens_pictures_drawn() -> dict[str, Figure]:
    """What the lens does, on the virtual wind tunnel with a strong one: the paper's Fig. 9."""
    camera = wm.Camera((960, 768), 1500.0, 1.0, 484.0, 377.0, k1=-0.28, k2=0.12, p1=1e-3, p2=-6e-4)
    test = wm.synth.wind_tunnel(1, size_px=camera.size_px, nodes=20_000)
    shot = wm.synth.wind_tunnel(
        1, size_px=camera.size_px, stations=[(camera, test.cam_from_tunnel["cam1"])], nodes=20_000
    ).shot()
    shown = calibration.undistort(shot.image, camera), calibration.magnify_distortion(shot.image, camera, 3)
    return {
        "undistort": lens_pictures.correction_picture(shot.image, camera, *shown, 3),
        "distortion": lens_pictures.distortion_picture(camera),
    }


def marker_study_pictures() -> dict[str, Figure]:
    """What ``windmark study`` draws by default: the paper's Figures 3 and 4."""
    settings = StudySettings()
    return {
        "study-markers": study_pictures.sheets_picture(*examples(settings), settings),
        "study-error": study_pictures.curves_picture(run_study(settings)),
    }


def marker_check_pictures() -> dict[str, Figure]:
    """What ``windmark markers check plate.csv --unit mm --view-from 0,90 --within 50`` draws for a regular plate."""
    xyz = np.stack(np.meshgrid(np.arange(6) * 50.0, np.arange(4) * 50.0, [0.0]), axis=-1).reshape(-1, 3)
    plate = wm.MarkerSet.make(
        [f"P{i + 1:02d}" for i in range(len(xyz))], xyz, normal=np.tile([0.0, 0.0, 1.0], (len(xyz), 1)), radius=3.0
    )
    check = check_markers(plate, "mm", settings=CheckSettings(view_from=(0, 90), within_deg=50))
    print("\n".join(check.lines()))
    return {
        "markers-directions": markers_pictures.directions_picture(check),
        "markers-layout": markers_pictures.layout_picture(check),
    }


def board_pictures() -> dict[str, Figure]:
    """A tilted dot board among other spots, some dots missing; the lattice that `find_board` lays through it."""
    marks = ((2, 2), (8, 2), (2, 5))
    image = board_image(np.random.default_rng(3), (13, 9), marks)
    spots = wm.detect(image)
    view = calibration.find_board(spots, marks=marks, mark_spots="large", size_px=(800, 530))
    assert isinstance(view, calibration.BoardView)
    figure, axes = pictures.image_axes(image)
    other = np.ones(len(spots), dtype=bool)
    other[view.spot] = False
    pictures.draw_spots(axes, spots, other, colour="tab:orange")
    place = {(int(c), int(r)): xy for c, r, xy in zip(view.column, view.row, view.xy(spots), strict=True)}
    for (c, r), xy in place.items():
        for step, colour in (((1, 0), "tab:red"), ((0, 1), "tab:blue")):
            if (c + step[0], r + step[1]) in place:
                axes.plot(*zip(xy, place[c + step[0], r + step[1]], strict=True), color=colour, lw=1.3)
        if (c, r) in marks or (c + r) % 4 == 0:
            bold = "bold" if (c, r) in marks else "normal"
            axes.annotate(
                f"{c}, {r}",
                xy,
                (9, 8),
                textcoords="offset points",
                fontsize=8.5,
                weight=bold,
                color="darkgreen",
                path_effects=[withStroke(linewidth=2.5, foreground="white")],
            )
    axes.set_title(
        f"{len(view)} of {len(spots)} spots are dots of the board: column, row; {len(marks)} larger dots fix the origin"
    )
    return {"board": figure}


def board_image(rng: np.random.Generator, size: tuple[int, int], marks: tuple[tuple[int, int], ...]) -> np.ndarray:
    """Grey picture of a white board with black dots before a grey wall with other dots, 4 x 4 sub-pixels."""
    columns, rows = size
    camera = wm.Camera((800, 530), 750.0, k1=-0.18)
    pose = wm.Pose.from_rotvec([0.0, 0.0, 0.15], np.zeros(3))
    lean = wm.Pose.from_rotvec([0.55, -0.45, 0.0], np.array([0.2, 0.1, 13.5]))
    board = lean @ pose
    step = (np.arange(4) + 0.5) / 4 - 0.5
    x, y = (np.arange(n)[:, None] + step for n in camera.size_px)
    rays = camera.unproject(np.stack(np.meshgrid(x.ravel(), y.ravel()), axis=-1))
    # Where each ray meets the board: column and row, (0, 0) is the first dot.
    normal, away = board.rotation[:, 2], board.translation
    at = (rays * (away @ normal / (rays @ normal))[..., None] - away) @ board.rotation[:, :2] + (np.array(size) - 1) / 2
    cell = np.rint(at)
    inside = ((cell >= 0) & (cell < [columns, rows])).all(axis=-1)
    paper = (np.abs(at - (np.array(size) - 1) / 2) < np.array(size) / 2 + 0.4).all(axis=-1)
    radius, there = np.full(size, 0.2), rng.random(size) > 0.12
    for mark in marks:
        radius[mark], there[mark] = 0.3, True
    i, j = np.where(inside[..., None], cell, 0).astype(int).transpose(2, 0, 1)
    dot = inside & there[i, j] & (np.hypot(*(at - cell).transpose(2, 0, 1)) < radius[i, j])
    light = np.where(paper, 205.0, 120.0) * np.where(dot, 0.2, 1.0)
    for place, r in zip(rng.uniform(0, camera.size_px, (30, 2)), rng.uniform(3, 8, 30), strict=True):
        light[np.hypot(x.ravel()[None] - place[0], y.ravel()[:, None] - place[1]) < r] *= 0.45
    grey = light.reshape(530, 4, 800, 4).mean(axis=(1, 3)) * np.linspace(0.8, 1.1, 800)
    return np.clip(np.rint(grey + rng.normal(0, 2.0, grey.shape)), 0, 255).astype(np.uint8)


def _small(data: bytes) -> bytes:
    """The picture in fewer shades."""
    shades = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")) * ((SHADES - 1) / 255)
    stream = io.BytesIO()
    Image.fromarray(np.rint(np.rint(shades) * (255 / (SHADES - 1))).astype(np.uint8)).save(stream, "png", optimize=True)
    return stream.getvalue()


if __name__ == "__main__":
    main()
