"""Real images with truth that does not come from windmark's detector, one function per set.

The data lie beside the checkout (`../shared/data`); every set's README there says what it is. All positions are
0-based pixels. ``true`` are the discs that have to be found, ``other`` what may be found without being false (discs cut
by the border, discs with a hole, discs the published table leaves out).
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
from numpy.typing import NDArray

from _real_views import DATA, RealSet, View
from _real_water import cavity, ridge, vblock
from _reference import blobs, fit_disc, label_lattice, soft_centroid
from windmark.io import frames, read_camera, read_grey, read_markers

Array = NDArray[np.float64]


def nasa(folder: Path) -> Iterator[View]:
    """The targets projected with the published pose, then the dark dot there, measured by a plain ellipse fit."""
    image = read_grey(folder / "CAM5.png")
    camera, pose = read_camera(folder / "camera05_35_6.json")
    markers = read_markers(folder / "fml_tc3_volume.tgts")
    xy, valid = camera.project(pose.apply(markers.xyz))
    xy = xy[valid & (xy > 0).all(axis=1) & (xy < np.array(image.shape[::-1]) - 1).all(axis=1)]
    true = []
    for p in xy:
        x, y = np.rint(p).astype(int)
        patch = cv2.GaussianBlur(image[y - 5 : y + 6, max(x - 5, 0) : x + 6], (0, 0), 1.2)
        dy, dx = np.unravel_index(int(patch.argmin()), patch.shape)
        true.append(fit_disc(image, np.array([max(x - 5, 0) + dx, y - 5 + dy], dtype=float), 3.0)[0])
    cut = np.array([[1278.5, 231.5]])  # half a dot at the right border
    yield View("CAM5", image, "dark", np.array(true), cut, 1.5, 3.0)


def dice(folder: Path) -> Iterator[View]:
    """Dark regions of half the paper's light on one lattice; those with a hole or cut by the border are other."""
    for path in sorted((folder / "images").iterdir()):
        image = read_grey(path)
        small = cv2.medianBlur(cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA), 5)
        paper = cv2.GaussianBlur(cv2.dilate(small, np.ones((41, 41), np.uint8)), (0, 0), 15)
        dark = cv2.GaussianBlur(image, (0, 0), 1.5) < 0.5 * cv2.resize(paper, image.shape[::-1])
        found = blobs(dark, 100, 20_000)
        whole = found.take((found.roundness > 0.97) & ~found.border & (found.area > 1500))
        if (label_lattice(whole.xy)[:, 0] == -9999).any():
            raise ValueError(f"{path.name}: a region is not on the lattice of discs")
        ring = whole.holes > 0
        if ring.sum() != 3 or not 80 <= len(whole.xy) <= 91:
            raise ValueError(
                f"{path.name}: {len(whole.xy)} whole discs, {ring.sum()} with a hole; expected 80-91 and 3"
            )
        radius = float(np.sqrt(np.median(whole.area) / np.pi))
        true = np.array([soft_centroid(image, p, radius, "dark") for p in whole.xy[~ring]])
        other = np.concatenate([whole.xy[ring], found.xy[found.border]])
        yield View(path.stem, image, "dark", true, other, 10.0, 46.0)


def dbat(folder: Path) -> Iterator[View]:
    """The 2074 published marks less half a pixel; discs that the table leaves out are found through a bundle.

    In the green channel: the lens puts the colours in different places (red 0.7 px further out per 1000 px, see
    `centres_real`), and the published marks agree with green.
    """
    marks = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    size = (2272, 1704)
    points = photomodeler_points(folder / "photomodeler_3dpts.txt")
    for image_id, path in enumerate(sorted((folder / "images").iterdir()), start=1):
        mine = marks[marks[:, 0] == image_id]
        true = mine[:, 2:4] - 0.5
        named = {int(k): p for k, p in zip(mine[:, 1], true, strict=True)}
        other = _unpublished(points, named, size)
        yield View(path.stem, read_grey(path, channel="green"), "dark", true, other, 3.0, 15.0)


def photomodeler_points(path: Path) -> dict[int, Array]:
    with path.open(encoding="latin-1", newline="") as file:
        rows = [row for row in csv.reader(file) if row and row[0].strip().isdigit()]
    return {int(row[0]): np.array(row[3:6], dtype=float) for row in rows}


def _unpublished(points: dict[int, Array], named: dict[int, Array], size: tuple[int, int]) -> Array:
    """Where the sheet's other discs are in a view: a camera of known focal length fitted to the published marks."""
    both = [k for k in named if k in points]
    xyz, xy = np.array([points[k] for k in both]), np.array([named[k] for k in both])
    focal = 7.457 / 7.25301 * size[0]
    start = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_FOCAL_LENGTH | cv2.CALIB_FIX_PRINCIPAL_POINT
    _, k, lens, turn, shift = cv2.calibrateCamera(
        [xyz.astype(np.float32)], [xy.astype(np.float32)], size, start, None, flags=flags | cv2.CALIB_FIX_K3
    )
    rest = [p for i, p in points.items() if i not in named]
    if not rest:
        return np.zeros((0, 2))
    seen = cv2.projectPoints(np.array(rest), turn[0], shift[0], k, lens)[0].reshape(-1, 2)
    return seen[((seen > -30) & (seen < np.array(size) + 30)).all(axis=1)]


def dotwall(folder: Path) -> Iterator[View]:
    """The published dots projected with the published camera; two of the 64 x 64 places are not in the table: other."""
    camera = json.loads((folder / "camera.json").read_text())
    poses = json.loads((folder / "derived_view_poses.json").read_text())["views"]
    table = np.loadtxt(folder / "dots_expected.csv", delimiter=",", skiprows=1)
    by_index = {(int(i), int(j)): xyz for i, j, *xyz in table}
    i, j = table[:, 0].astype(int), table[:, 1].astype(int)
    places = [(a, b) for a in range(i.min(), i.max() + 1) for b in range(j.min(), j.max() + 1)]
    empty = np.array([_neighbours_say(by_index, *p) for p in places if p not in by_index]).reshape(-1, 3)
    for pose in poses:
        parts = (
            np.array(pose["rvec"]),
            np.array(pose["tvec_m"]),
            np.array(camera["K"]),
            np.array(camera["dist_k1_k2_p1_p2"]),
        )
        true = cv2.projectPoints(np.ascontiguousarray(table[:, 2:]), *parts)[0].reshape(-1, 2)
        other = cv2.projectPoints(empty, *parts)[0].reshape(-1, 2)
        yield View(Path(pose["image"]).stem, read_grey(folder / "images" / pose["image"]), "dark", true, other, 1.5)


def _neighbours_say(dots: dict[tuple[int, int], list[float]], a: int, b: int) -> Array:
    """Where a dot that the table leaves out must be: straight on from two dots of its row or column, or between two."""
    for one, two in (
        ((a + 1, b), (a + 2, b)),
        ((a - 1, b), (a - 2, b)),
        ((a, b + 1), (a, b + 2)),
        ((a, b - 1), (a, b - 2)),
    ):
        if one in dots and two in dots:
            return 2 * np.array(dots[one]) - np.array(dots[two])
    raise ValueError(f"dot ({a}, {b}) has no two neighbours in a row")


def piv_plate(folder: Path) -> Iterator[View]:
    """Bright regions that are ellipses (the square and the triangle are not), of both levels of the plate."""
    for camera, radius in ((1, 18.8), (3, 27.0)):
        for z in range(1, 8):
            image = read_grey(folder / f"camera{camera}" / f"E_camera_{camera}_z_{z}.tif")
            smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 2)
            bright = smooth > 0.25 * np.percentile(smooth, 97.5)
            found = blobs(bright, 200, 5000)
            disc = (found.roundness > 0.975) & ~found.border
            true = np.array([soft_centroid(image, p, radius, "bright") for p in found.xy[disc]])
            _check_listed(folder / f"camera{camera}" / f"img_{z - 1}.xml", true, found.xy[found.border])
            yield View(f"camera {camera}, z {z}", image, "bright", true, found.xy[found.border], 6.0, radius)


def _check_listed(path: Path, *found: Array) -> None:
    """Every disc of the published list must be among the regions."""
    rows = [element.text.split() for element in ElementTree.parse(path).iter("PointCoord")]
    listed = np.array(rows, dtype=float)[:, 3:5] - 1
    gap = np.hypot(*(listed[:, None] - np.concatenate(found)).transpose(2, 0, 1)).min(axis=1)
    if gap.max() > 4:
        raise ValueError(f"{path}: a listed disc was not found, {gap.max():.1f} px from the next")


def sway(folder: Path) -> Iterator[View]:
    """Twenty-eight discs on white tags: best correlation with a drawn tag near the start position, then a centroid."""
    start = np.genfromtxt(folder / "targets_initial.csv", delimiter=",", skip_header=1, usecols=(1, 2))
    y, x = np.mgrid[-20:21, -20:21]
    tag = np.where(np.hypot(x, y) < 9.5, 0.0, 1.0).astype(np.float32)
    for name in ("IMG00001", "IMG00056", "IMG00066", "IMG00076", "IMG00086", "IMG00095"):
        image = read_grey(folder / "images" / f"{name}.jpg")
        score = cv2.matchTemplate(image.astype(np.float32), cv2.GaussianBlur(tag, (0, 0), 1.5), cv2.TM_CCOEFF_NORMED)
        score = np.pad(score, 20, constant_values=-1)
        true = []
        for p in start:
            cx, cy = np.rint(p).astype(int)
            x0, y0 = max(cx - 70, 0), max(cy - 25, 0)
            window = score[y0 : cy + 26, x0 : cx + 71]
            row, column = np.unravel_index(int(window.argmax()), window.shape)
            true.append(soft_centroid(image, np.array([x0 + column, y0 + row], dtype=float), 9.5, "dark"))
        yield View(name, image, "dark", np.array(true), gate_px=4.0)


def tilted(folder: Path) -> Iterator[View]:
    """The labelled dots of a board at 60 to 70 deg; its other dots, through the labels' homography, are other.

    The labels' origin is not stated: against thresholded regions they are off by 0.97, 0.89 px, so they are 1-based.
    """
    table = np.loadtxt(folder / "cam2.txt", delimiter=",")
    image, labels, places = read_grey(folder / "C002.tif"), table[:, :2] - 1, table[:, 2:4]
    wide = np.stack(np.meshgrid(np.arange(-18.0, 19), np.arange(-12.0, 13)), axis=-1).reshape(-1, 2)
    rest = wide[np.hypot(*(wide[:, None] - places).transpose(2, 0, 1)).min(axis=1) > 0.5]
    other = cv2.perspectiveTransform(rest[None], cv2.findHomography(places, labels)[0])[0]
    yield View("C002", image, "dark", labels, other, 4.0, 8.0)


def chart(folder: Path) -> Iterator[View]:
    """Two frames of a test chart of lines and crosses: no discs."""
    for k, image in enumerate(frames(folder / "12bitMRAW.cih")):
        yield View(f"frame {k}", np.asarray(image), "dark", np.zeros((0, 2)))


__all__ = ["DATA", "SETS", "RealSet", "View"]

SETS = {
    "NASA camera 5": RealSet("nasa-upsp-cam5", (3.0,), "table projected, plain ellipse fit", nasa, 1),
    "DICe discs": RealSet("dice-stereo-dots", (46.0,), "regions on one lattice, soft centroid", dice, 4),
    "DBAT sheet": RealSet("dbat-camcal", (10.0, 13.0, 17.5, 23.0), "published marks - 0.5 px, green channel", dbat, 3),
    "CSP dot wall": RealSet("opencsp-dotwall-5view", (1.7, 2.2, 2.9), "published dots projected", dotwall, 2),
    "PIV-E plate": RealSet("piv-challenge-e-calib", (19.0, 27.0), "round regions, soft centroid", piv_plate, 4),
    "V-block": RealSet("openptv-vblock-4view", (2.7, 3.5, 4.5, 9.0), "regions, centroid", vblock, 4),
    "MyPTV ridge": RealSet("myptv-ridge-3cam", (1.2, 1.5, 2.0, 2.6), "published labelled points", ridge, 3),
    "LPT tilted": RealSet("openlpt-tilted", (8.5,), "published labels", tilted, 1),
    "PTV cavity": RealSet("openptv-cavity", (5.0,), "table, camera, bent to fit", cavity, 1),
    "Photron chart": RealSet("photron-mraw", (5.0,), "no discs", chart, 1),
    "Frame sway": RealSet("frame-sway-1cam", (10.0,), "correlation, soft centroid", sway, 2),
}
