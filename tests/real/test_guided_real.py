"""Markers near predictions on a real frame: dots faded until `detect` loses them, and dots on a darkened block."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.detection import detect, detect_at
from windmark.detection.template.disc_model import patch_model
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.io import read_camera, read_grey, read_markers


@pytest.fixture(scope="module")
def frame(shared_data):
    """NASA's camera 5: image, and what is found near the projected table (about 1 px off)."""
    folder = shared_data / "nasa-upsp-cam5"
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    image = read_grey(folder / "CAM5.png")
    camera, pose = read_camera(folder / "camera05_35_6.json")
    markers = read_markers(folder / "fml_tc3_volume.tgts", roles=("model", "wall", "primary", "secondary"))
    return image, predicted(camera, pose, markers)


def predicted(camera: Camera, pose: Pose, markers):
    """Ellipses of the table's targets in the image."""
    seen = imaged_ellipse(camera, pose.apply(markers.xyz), pose.rotate(markers.normal), markers.radius)
    inside = camera.in_image(seen.xy)
    return seen.xy[inside], seen.axes_px[inside], seen.angle[inside]


def faded(image, found, share, rng):
    """The frame with its dots mixed with their surroundings (plane and permuted residuals of a ring)."""
    out, (y, x) = image.astype(float), np.mgrid[: image.shape[0], : image.shape[1]]
    for (cx, cy), (major, _) in zip(found.xy, found.axes_px, strict=True):
        away = np.hypot(x - cx, y - cy)
        dot, ring = away < major + 2.5, (away >= major + 2.5) & (away < major + 6)
        plane = np.column_stack([np.ones(ring.sum()), x[ring] - cx, y[ring] - cy])
        light = np.linalg.lstsq(plane, out[ring], rcond=None)[0]
        noise = rng.permutation(np.resize(out[ring] - plane @ light, dot.sum()))
        paint = light[0] + light[1] * (x[dot] - cx) + light[2] * (y[dot] - cy) + noise
        out[dot] = share * out[dot] + (1 - share) * paint
    return np.clip(np.round(out), 0, 255).astype(np.uint8)


def test_all_fifteen_near_the_projected_table(frame):
    image, (xy, axes, angle) = frame
    got = detect_at(image, xy, axes_px=axes, angle=angle)
    assert len(got) == 15
    assert got.found.all()
    blind = detect(image, radius_px=3.0, refine="template")
    assert np.hypot(*(got.xy[:, None] - blind.xy).transpose(2, 0, 1)).min(axis=1).max() < 0.25


def test_dots_faded_to_a_seventh_are_found_where_detect_misses_some(frame):
    image, (xy, axes, angle) = frame
    whole = detect_at(image, xy, axes_px=axes, angle=angle, fit_shape=True)
    rng = np.random.default_rng(0)
    pale = faded(image, whole, 0.15, rng)
    hits = 0
    for _ in range(4):
        near = whole.xy + rng.uniform(-2.5, 2.5, whole.xy.shape)
        got = detect_at(pale, near, axes_px=whole.axes_px, angle=whole.angle, frame=whole.frame)
        away = np.hypot(*(got.xy - whole.xy).T)[got.found]
        assert away.max() < 1.0
        hits += len(away)
    assert hits >= 0.85 * 4 * 15
    blind = detect(pale, radius_px=3.0)
    assert (np.hypot(*(whole.xy[:, None] - blind.xy).transpose(2, 0, 1)).min(axis=1) < 1).sum() < 15


def test_dots_of_four_grey_levels_on_a_block_darkened_to_twelve(frame):
    """The paint's own texture at 30 % of its light; every second place has a dot 3.6 grey levels deep."""
    image, _ = frame
    rng = np.random.default_rng(1)
    block = 0.3 * image[640:760, 0:200].astype(float)
    block *= 12.0 / block.mean()
    places = np.stack(np.meshgrid(np.arange(20, 190, 20.0), np.arange(20, 110, 20.0)), -1).reshape(-1, 2)
    places += rng.uniform(-2, 2, places.shape)
    there = np.arange(len(places)) % 2 == 0
    for x, y in places[there]:
        cols, rows = np.arange(int(x) - 9, int(x) + 10), np.arange(int(y) - 9, int(y) + 10)
        shape = [x, y, 2.7, 0.0, 2.7, 0.6, 3.6 / 12.0, 1.0, 0.0, 0.0]
        block[np.ix_(rows, cols)] *= patch_model(cols, rows, shape)[0]
    dark = np.clip(np.round(block), 0, 255).astype(np.uint8)
    got = detect_at(dark, places + rng.uniform(-2.5, 2.5, places.shape), radius_px=2.7, blur_px=0.6)
    right = got.found & there & (np.hypot(*(got.xy - places).T) < 1.0)
    assert right.sum() >= 0.9 * there.sum()
    assert (got.found & ~right).sum() <= 1


def test_random_places_without_a_dot_are_refused(frame):
    """Edges of the plate, stains, specks, texture: at most 3 of 1000 pass."""
    image, (xy, axes, angle) = frame
    known = detect_at(image, xy, axes_px=axes, angle=angle).frame
    rng = np.random.default_rng(2)
    places = rng.uniform([10, 10], [1270, 790], (1100, 2))
    places = places[np.hypot(*(places[:, None] - xy).transpose(2, 0, 1)).min(axis=1) > 15][:1000]
    got = detect_at(image, places, radius_px=3.0, frame=known)
    assert got.found.sum() <= 3
