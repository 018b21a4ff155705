"""Real pictures for the matcher: windmark's own spots, the table of markers, and where each marker really is.

The data lie beside the checkout (`../shared/data`), with a README in every set. Where a set has no interior parameters
they are fitted to its published labels. Truth is published labels, or the published pose.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from _real_truth import photomodeler_points
from windmark.detection import detect
from windmark.geometry import Camera, Pose
from windmark.io import read_camera, read_grey, read_image, read_markers
from windmark.registration import pose_from_labels
from windmark.scene import Detections, MarkerSet

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
Array = NDArray[np.float64]
PITCH_CM = 1.5
"""Of either level of the PIV plate; the other level is half a pitch to the side and two pitches of 1 mm lower."""
ROUGH_MM = 4.0
"""Error (1 sigma per coordinate) of the rough coordinates of the DBAT sheet."""


@dataclass(frozen=True)
class RealCase:
    """A picture's spots, and where every marker is in it (NaN: not known) to within ``gate_px``, one or (N,)."""

    name: str
    detections: Detections
    markers: MarkerSet
    camera: Camera
    true_xy: Array
    gate_px: float | Array
    options: dict[str, Any] = field(default_factory=dict)


def turned(pose: Pose, xyz: Array, angle_deg: tuple[float, float, float], scale: float = 1.0) -> Pose:
    """A pose turned about the markers' centre, and so many times as far away."""
    turn = Pose.from_rotvec(np.radians(angle_deg), np.zeros(3)).rotation @ pose.rotation
    centre = xyz.mean(axis=0)
    return Pose(turn, scale * pose.apply(centre) - turn @ centre)


def shuffled(spots: Detections) -> Detections:
    """The spots in random order: the detector's order of quality is lost."""
    return spots.take(np.random.default_rng(0).permutation(len(spots)))


def nasa() -> Iterator[RealCase]:
    """Camera 5: 15 dots in view; usual limits of the detector, and loose ones that let hundreds of false spots in."""
    folder = DATA / "nasa-upsp-cam5"
    camera, pose = read_camera(folder / "camera05_35_6.json")
    assert pose is not None
    markers = read_markers(folder / "fml_tc3_volume.tgts")
    markers = markers.take(np.char.startswith(markers.name, "st"))
    image = read_image(folder / "CAM5.png")
    true = camera.project(pose.apply(markers.xyz))[0]
    for merit in (0.7, 1.0, 1.3, 1.6):
        spots = detect(image, radius_px=3.0, merit_max=merit)
        yield RealCase(f"NASA camera 5, merit {merit}", spots, markers, camera, true, 4.0)
    radii = (1.0, 1.3, 1.7, 2.2, 3.0)
    loose: dict[str, Any] = {"refine": "bowl", "min_quality": 0.0}
    for merit in (0.7, 1.0, 1.6):
        spots = detect(image, radius_px=radii, merit_max=merit, **loose)
        for options in ({}, {"max_time_s": 2.0}):
            word = f"{merit}, no other limit{', 2 s' if options else ''}"
            yield RealCase(f"NASA camera 5, merit {word}", spots, markers, camera, true, 4.0, options)
            yield RealCase("    in random order", shuffled(spots), markers, camera, true, 4.0, options)


def ridge() -> Iterator[RealCase]:
    """MyPTV's block: 480 equal dots in rows of one pitch; interior parameters fitted to the view's labels."""
    folder = DATA / "myptv-ridge-3cam"
    for view in (1, 2, 3):
        table = np.loadtxt(folder / f"cam{view}_cal_points")
        xy, xyz = table[:, :2], table[:, 2:]
        fit = pose_from_labels(xy, xyz, Camera((1024, 1024), 3000.0), free=("focal_px", "k1", "cx", "cy", "p1", "p2"))
        markers = MarkerSet.make([f"d{i}" for i in range(len(xyz))], xyz)
        spots = detect(read_image(folder / f"cam{view}.tif"), radius_px=(1.2, 1.5, 2.0, 2.6), polarity="bright")
        near = turned(fit.cam_from_model, xyz, (3.0, -3.0, 5.0))
        for options in ({}, {"max_time_s": 1.0}, {"prior": near}):
            word = ", 1 s" if "max_time_s" in options else ", prior" if options else ""
            yield RealCase(f"MyPTV ridge {view}{word}", spots, markers, fit.camera, xy, 3.0, options)


def plate_table(beyond: int) -> MarkerSet:
    """The discs of both levels of the PIV plate in cm that camera 1 sees whole, and so many rows beyond on every side.

    The square and the triangle stand between the discs, at no place of a disc.
    """
    names, xyz = [], []
    for level, shift, z, last in (("a", 0.0, 0.0, 5), ("b", 0.5, -0.3, 4)):
        places = range(-1 - beyond, last + beyond)
        names += [f"{level}{i},{j}" for i in places for j in places]
        xyz += [(PITCH_CM * (i + shift), PITCH_CM * (j + shift), z) for i in places for j in places]
    return MarkerSet.make(names, xyz, normal=np.tile([0.0, 0.0, 1.0], (len(xyz), 1)))


def plate() -> Iterator[RealCase]:
    """The PIV challenge's two-level plate at seven depths before two cameras, which are fitted to the labels of all.

    The table is that of the discs in view of camera 1, or a plate three rows larger on every side as the real one is.
    Truth is the plate as the fitted camera sees it, and holds for the discs of both levels.
    """
    folder = DATA / "piv-challenge-e-calib"
    for number, radius in ((1, 19.0), (3, 27.0)):
        labels = [plate_labels(number, position) for position in range(1, 8)]
        raised = np.concatenate([xyz + np.array([0, 0, 0.1 * (n - 3)]) for n, (_, xyz) in enumerate(labels)])
        xy = np.concatenate([xy for xy, _ in labels])
        fit = pose_from_labels(xy, raised, Camera((1024, 1024), 6000.0), free=("focal_px", "k1"))
        for position in range(1, 8):
            shift = Pose(np.eye(3), np.array([0.0, 0.0, 0.1 * (position - 4)]))
            pose = fit.cam_from_model @ shift
            image = read_image(folder / f"camera{number}" / f"E_camera_{number}_z_{position}.tif")
            spots = detect(image, radius_px=radius, polarity="bright")
            cut, whole = plate_table(0), plate_table(3)
            near = turned(pose, cut.xyz, (3.0, -3.0, 5.0))
            fixed = _labelled_spot(spots, whole, fit.camera.project(pose.apply(whole.xyz))[0])
            rows: tuple[tuple[str, MarkerSet, dict[str, Any]], ...] = (
                ("seen discs", cut, {}), ("plate", whole, {}), ("plate, prior", whole, {"prior": near}),
                ("plate, a label", whole, {"fixed": fixed}),
                ("plate, both", whole, {"prior": near, "fixed": fixed}),
            )  # fmt: skip
            for word, table, options in rows:
                true = fit.camera.project(pose.apply(table.xyz))[0]
                yield RealCase(f"PIV-E {number}, z {position}, {word}", spots, table, fit.camera, true, 6.0, options)


def _labelled_spot(spots: Detections, markers: MarkerSet, true: Array) -> dict[int, str]:
    """The label of the spot nearest to the picture's middle."""
    spot = int(np.linalg.norm(spots.xy - 512, axis=1).argmin())
    return {spot: str(markers.name[np.linalg.norm(true - spots.xy[spot], axis=1).argmin()])}


def plate_labels(camera: int, position: int) -> tuple[Array, Array]:
    """Published labels of one position: (K, 2) px and (K, 3) cm in the plate's own frame."""
    path = DATA / "piv-challenge-e-calib" / f"camera{camera}" / f"img_{position - 1}.xml"
    rows = [element.text.split() for element in ElementTree.parse(path).iter("PointCoord") if element.text]
    table = np.array(rows, dtype=float)
    return table[:, 3:5] - 1.0, table[:, :3] - [0.0, 0.0, 0.1 * (position - 4)]


def wall() -> Iterator[RealCase]:
    """OpenCSP's 4094 equal dots: published camera and poses; a prior 11 degrees and 10 % off, and none."""
    folder = DATA / "opencsp-dotwall-5view"
    given = json.loads((folder / "camera.json").read_text())
    k, (k1, k2, p1, p2) = np.array(given["K"]), given["dist_k1_k2_p1_p2"]
    camera = Camera(
        tuple(given["image_size_wh"]), k[0, 0], aspect=k[1, 1] / k[0, 0], cx=k[0, 2], cy=k[1, 2],
        k1=k1, k2=k2, p1=p1, p2=p2,
    )  # fmt: skip
    table = np.loadtxt(folder / "dots_expected.csv", delimiter=",", skiprows=1)
    xyz = table[:, 2:]
    markers = MarkerSet.make([f"{i:.0f},{j:.0f}" for i, j in table[:, :2]], xyz)
    for view in json.loads((folder / "derived_view_poses.json").read_text())["views"]:
        pose = Pose.from_rotvec(np.array(view["rvec"]), np.array(view["tvec_m"]))
        spots = detect(read_grey(folder / "images" / view["image"]), radius_px=(1.7, 2.2, 2.9))
        true = camera.project(pose.apply(xyz))[0]
        near = turned(pose, xyz, (6.0, -6.0, 7.0), 1.1)
        for options in ({"prior": near}, {"prior": near, "max_time_s": 10.0}, {"max_time_s": 10.0}):
            word = ("prior" if "prior" in options else "no prior") + (", 10 s" if "max_time_s" in options else "")
            yield RealCase(f"CSP wall {view['image'][-6:-4]}, {word}", spots, markers, camera, true, 1.5, options)


def sheet() -> Iterator[RealCase]:
    """DBAT's sheet: a regular 10 x 10 grid with rough coordinates, a focal length 10 % off and no lens model."""
    folder = DATA / "dbat-camcal"
    points = photomodeler_points(folder / "photomodeler_3dpts.txt")
    names, exact = [str(i) for i in sorted(points)], 1e3 * np.array([points[i] for i in sorted(points)])
    rough = exact + np.random.default_rng(1).normal(0, ROUGH_MM, exact.shape)
    markers = MarkerSet.make(names, rough, sigma=ROUGH_MM, normal=np.tile([0.0, 0.0, 1.0], (len(exact), 1)))
    marks = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    focal = 7.457 / 7.25301 * 2272
    lensless = Camera((2272, 1704), 1.1 * focal)
    for number, path in enumerate(sorted((folder / "images").iterdir()), start=1):
        true, known = _sheet_truth(marks[marks[:, 0] == number], names, exact, focal)
        gate = np.where(known, 3.0, 15.0)
        spots = detect(read_grey(path, channel="green"), radius_px=(10.0, 13.0, 17.5, 23.0))
        loose: dict[str, Any] = {"free_focal": True, "tolerance_px": 25.0, "max_focal_sigma": 0.15, "max_time_s": 1.0}
        fit = pose_from_labels(true, exact, Camera((2272, 1704), focal), free=("focal_px", "k1", "k2"))
        near = turned(fit.cam_from_model, exact, (10.0, -10.0, 14.0))
        label = {int(np.linalg.norm(spots.xy - true[names.index("1001")], axis=1).argmin()): "1001"}
        for word, more in (("", {}), (", prior", {"prior": near}), (", a label", {"fixed": label})):
            name = f"DBAT {path.stem[-2:]}, +-{ROUGH_MM:g} mm{word}"
            yield RealCase(name, spots, markers, lensless, true, gate, {**loose, **more})
        known_lens = replace(fit.camera, cov=None)
        table = MarkerSet.make(names, exact, sigma=0.2, normal=markers.normal)
        yield RealCase(f"DBAT {path.stem[-2:]}, exact table, lens", spots, table, known_lens, true, gate)


def _sheet_truth(mine: Array, names: list[str], xyz: Array, focal: float) -> tuple[Array, NDArray[np.bool_]]:
    """(N, 2) published marks, projected discs where the list has none, and which are published."""
    true = np.full((len(names), 2), np.nan)
    true[[names.index(f"{k:.0f}") for k in mine[:, 1]]] = mine[:, 2:4] - 0.5
    known = np.isfinite(true[:, 0])
    fit = pose_from_labels(true[known], xyz[known], Camera((2272, 1704), focal), free=("focal_px", "k1", "k2"))
    true[~known] = fit.camera.project(fit.cam_from_model.apply(xyz[~known]))[0]
    return true, known
