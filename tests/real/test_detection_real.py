"""`detect` on other people's pictures, against their tables: one default setting, only the radius is given."""

import json
from itertools import pairwise

import imageio.v3 as iio
import numpy as np
import pytest
from scipy.spatial import cKDTree

import windmark as wm


def grey(path):
    image = iio.imread(path)
    if image.ndim == 3:
        image = np.round(image[..., :3] @ [0.299, 0.587, 0.114]).astype(np.uint8)
    return image


def score(found, truth, near_px):
    """Markers found, spots that are none of them, RMS distance, rank of the best false spot."""
    distance, index = cKDTree(truth).query(found.xy)
    true = distance < near_px
    first = np.flatnonzero(~true)[0] if not true.all() else len(found)
    return len(set(index[true])), int((~true).sum()), np.sqrt(np.mean(distance[true] ** 2)), first


def project(xyz, rotation, translation, k, distortion):
    """Pinhole with k1, k2, p1, p2, written out: this test reads no camera through the package."""
    x, y, z = rotation @ xyz.T + np.reshape(translation, (3, 1))
    x, y = x / z, y / z
    s = x * x + y * y
    k1, k2, p1, p2 = distortion
    radial = 1 + k1 * s + k2 * s * s
    u = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    v = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    return np.column_stack([k[0, 0] * u + k[0, 2], k[1, 1] * v + k[1, 2]])


def rodrigues(r):
    angle = np.linalg.norm(r)
    x, y, z = np.asarray(r) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.fixture(scope="module")
def nasa(shared_data):
    """Camera 5: image and the projected targets st10 ... st24 that fall into it."""
    folder = shared_data / "nasa-upsp-cam5"
    camera = json.loads((folder / "camera05_35_6.json").read_text())
    k = np.array(camera["uPSP_cameraMatrix"]).reshape(3, 3)
    k[:2, 2] += (640, 400)
    rows = [line.split() for line in (folder / "fml_tc3_volume.tgts").read_text().splitlines()]
    xyz = np.array([[float(v) for v in r[1:4]] for r in rows if len(r) == 12 and r[-1].startswith("st")])
    distortion = np.ravel(camera["distCoeffs"])[:4]
    truth = project(xyz, np.array(camera["rmat"]), camera["tvec"], k, distortion)
    image = grey(folder / "CAM5.png")
    inside = (truth > 3).all(axis=1) & (truth < [1276, 796]).all(axis=1)
    return image, truth[inside]


@pytest.mark.parametrize("radius", [2.5, 2.7, 3.0, 3.2])
def test_nasa_camera_5_all_dots_no_tap(nasa, radius):
    image, truth = nasa
    assert len(truth) == 15
    found, false, rms, first = score(wm.detect(image, radius_px=radius), truth, 4.0)
    assert found == 15
    assert false <= (0 if radius >= 3.0 else 1)
    assert first == 15
    assert rms < 1.2  # the table's floor, see the set's README


def test_nasa_camera_5_with_several_radii_ranks_the_dots_first(nasa):
    image, truth = nasa
    found, false, _, first = score(wm.detect(image, radius_px=[2.0, 2.5, 3.0]), truth, 4.0)
    assert (found, first) == (15, 15)
    assert false <= 9  # taps of radius 1.5


@pytest.mark.parametrize("view", [1, 6, 11, 16, 21])
def test_dbat_sheet(shared_data, view):
    folder = shared_data / "dbat-camcal"
    marks = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    names = {
        int(line.split(",")[0]): line.split("/")[-1].strip()
        for line in (folder / "images.txt").read_text().splitlines()
        if line[0] != "#"
    }
    truth = marks[marks[:, 0] == view][:, 2:4] - 0.5
    found, false, rms, _ = score(
        wm.detect(grey(folder / "images" / names[view]), radius_px=[9, 11, 13.5, 16.5, 20]), truth, 4.0
    )
    assert found == len(truth)
    assert false <= 6  # pieces of the code rings, discs cut by the border
    assert rms < 0.4


@pytest.mark.parametrize("camera", [1, 2, 3])
def test_myptv_bright_dots(shared_data, camera):
    folder = shared_data / "myptv-ridge-3cam"
    truth = np.loadtxt(folder / f"cam{camera}_cal_points")[:, :2]
    spots = wm.detect(grey(folder / f"cam{camera}.tif"), radius_px=[1.2, 1.5, 2.0, 2.5], polarity="bright")
    found, false, rms, _ = score(spots, truth, 2.0)
    assert found >= (475 if camera == 1 else 460)
    assert false <= 12
    assert rms < 0.25


@pytest.mark.parametrize("view", [0, 3])
def test_dot_wall_of_4094(shared_data, view):
    folder = shared_data / "opencsp-dotwall-5view"
    camera = json.loads((folder / "camera.json").read_text())
    pose = json.loads((folder / "derived_view_poses.json").read_text())["views"][view]
    xyz = np.loadtxt(folder / "dots_expected.csv", delimiter=",", skiprows=1)[:, 2:5]
    k = np.array(camera["K"])
    truth = project(xyz, rodrigues(pose["rvec"]), pose["tvec_m"], k, camera["dist_k1_k2_p1_p2"])
    spots = wm.detect(grey(folder / "images" / pose["image"]), radius_px=[1.7, 2.2, 2.8])
    found, false, rms, _ = score(spots, truth, 1.5)
    assert found >= 4090
    assert false <= 20
    assert rms < 0.08


@pytest.mark.parametrize("view", [1, 4])
def test_v_block_of_105_saturated_discs(shared_data, view):
    image = grey(shared_data / "openptv-vblock-4view" / f"cam{view}.tif")
    found = wm.detect(image, radius_px=[3, 4, 5, 9], polarity="bright")
    assert len(found) == 105
    assert (found.flags & 2).astype(bool).mean() > 0.8


@pytest.mark.parametrize(("camera", "radius", "whole"), [(1, 19.0, 63), (3, 28.0, 30)])
def test_piv_plate_moves_as_told(shared_data, camera, radius, whole):
    """Whole discs are found in every position of the plate, and a 1 mm step moves all of them alike."""
    folder = shared_data / "piv-challenge-e-calib" / f"camera{camera}"
    views = [
        wm.detect(grey(folder / f"E_camera_{camera}_z_{k}.tif"), radius_px=radius, polarity="bright") for k in (3, 4, 5)
    ]
    assert all(abs(len(v) - whole) <= 3 for v in views)
    for a, b in pairwise(views):
        distance, index = cKDTree(b.xy).query(a.xy)
        near = distance < 25
        assert near.sum() >= whole - 5
        move = b.xy[index[near]] - a.xy[near]
        design = np.column_stack([np.ones(near.sum()), a.xy[near]])
        rest = move - design @ np.linalg.lstsq(design, move, rcond=None)[0]
        assert np.median(np.abs(rest)) < 0.06


def test_disc_grid_with_cut_discs_and_rings(shared_data):
    """README: 80 to 91 whole discs a view, three of them with a light hole, which are no discs."""
    image = grey(shared_data / "dice-stereo-dots" / "images" / "CalB-sys2-0007_1.jpeg")
    found = wm.detect(image, radius_px=46.0)
    whole = (found.flags & 1) == 0
    assert 74 <= whole.sum() <= 91


def test_swaying_frame_all_28_targets(shared_data):
    folder = shared_data / "frame-sway-1cam"
    start = np.loadtxt(folder / "targets_initial.csv", delimiter=",", skiprows=1, usecols=(1, 2))
    found, false, _, _ = score(wm.detect(grey(folder / "images" / "IMG00001.jpg"), radius_px=[9, 11]), start, 25.0)
    assert found == 28
    assert false <= 3
