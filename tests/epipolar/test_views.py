"""Views and spots as the kernels see them, against what a pinhole, plane geometry and counting say."""

import numpy as np
import pytest

from windmark.epipolar.views import NEIGHBOURS, SPAN, ideal_spots, local_density, raster, stations
from windmark.geometry import Camera, Pose
from windmark.scene import Detections

CAMERA = Camera((640, 480), 800.0, 1.25, 300.0, 250.0)
EYES = np.array([[0.0, 0, 0], [100, 0, 0], [400, 0, 0], [0, 150, 0]])
TARGET = np.array([30.0, 20.0, 1000.0])


def looking(eyes=EYES, at=TARGET):
    poses = [Pose.look_at(eye, at, [0.0, -1.0, 0.0]) for eye in eyes]
    return Pose(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))


def made(depth_range=None, about=None, poses=None, camera=CAMERA):
    poses = looking() if poses is None else poses
    views = len(poses.rotation)
    return stations((camera,) * views, poses, np.zeros((views, 6, 6)), depth_range, about)


def test_borders_are_the_outer_edges_of_the_outermost_pixels():
    stand, _ = made()
    low = [(-0.5 - 300) / 800, (-0.5 - 250) / (800 * 1.25)]
    high = [(639.5 - 300) / 800, (479.5 - 250) / (800 * 1.25)]
    np.testing.assert_allclose(stand.low, [low] * 4)
    np.testing.assert_allclose(stand.high, [high] * 4)
    two = stations((CAMERA, Camera((640, 480), 400.0)), looking(EYES[:2]), np.zeros((2, 6, 6)), None, None)[0]
    assert two.high[1, 0] > two.high[0, 0]  # each view has its own camera's


def test_borders_of_a_lens_are_met_at_the_middle_of_the_edges():
    """Where the corners are imaged farther out than a pinhole's, the edges' middles see farthest."""
    camera = Camera((640, 480), 800.0, k1=0.4)
    stand, _ = made(camera=camera)
    low = camera.unproject([[-0.5, camera.cy], [camera.cx, -0.5]])
    high = camera.unproject([[639.5, camera.cy], [camera.cx, 479.5]])
    np.testing.assert_allclose(stand.low, np.tile([low[0, 0], low[1, 1]], (4, 1)), rtol=1e-3)
    np.testing.assert_allclose(stand.high, np.tile([high[0, 0], high[1, 1]], (4, 1)), rtol=1e-3)


def test_depths_are_those_where_the_lines_of_sight_meet_and_span_to_both_sides():
    stand, depth = made()
    np.testing.assert_allclose(depth, np.linalg.norm(EYES - TARGET, axis=1), rtol=0.02)
    np.testing.assert_allclose(stand.near * SPAN, depth)
    np.testing.assert_allclose(stand.far / SPAN, depth)
    # Side by side and parallel they meet nowhere: some ten times their base ahead.
    aside = Pose(np.tile(np.eye(3), (2, 1, 1)), np.array([[-50.0, 0, 0], [50.0, 0, 0]]))
    np.testing.assert_allclose(made(poses=aside)[1], 500.0, rtol=1e-6)
    # Turned away from each other they meet behind the cameras, where nobody looks.
    apart = looking(np.array([[-50.0, 0, 0], [50, 0, 0]]), TARGET)
    turned = Pose(
        apart.rotation[::-1].copy(), -np.einsum("vij,vj->vi", apart.rotation[::-1], [[-50.0, 0, 0], [50, 0, 0]])
    )
    assert (made(poses=turned)[1] > 0).all()


@pytest.mark.parametrize(
    ("given", "expected"),
    [((900.0, 1500.0), None), ((10.0, 20.0), 15.0), ((3000.0, 4000.0), 3500.0), ((3000.0, np.inf), 6000.0)],
)
def test_a_given_range_holds_for_every_view(given, expected):
    stand, depth = made(depth_range=given)
    assert (stand.near == given[0]).all()
    assert (stand.far == given[1]).all()
    np.testing.assert_allclose(depth, made()[1] if expected is None else expected)


def test_points_that_are_known_bound_the_depths_by_their_extent():
    about = TARGET + np.array([[-60.0, 0, 0], [60, 0, 0], [0, 30, 10]])
    stand, depth = made(about=about)
    middle = about.mean(axis=0)
    np.testing.assert_allclose(depth, (looking().rotation @ middle + looking().translation)[:, 2])
    np.testing.assert_allclose(stand.near, depth - 120.0)
    np.testing.assert_allclose(stand.far, depth + 120.0)
    wide = made(about=TARGET + np.array([[-2000.0, 0, 0], [2000, 0, 0]]))[0]
    assert (wide.near > 0).all()  # however far they reach, in front of the camera


def test_the_nearest_views_are_those_that_look_the_same_way():
    stand, _ = made()
    np.testing.assert_array_equal(stand.order[:, 0], range(4))
    towards = (TARGET - EYES) / np.linalg.norm(TARGET - EYES, axis=1, keepdims=True)
    for view, order in enumerate(stand.order):
        angle = np.arccos(np.clip(towards[order] @ towards[view], -1, 1))
        assert (np.diff(angle) >= -1e-9).all()
    np.testing.assert_array_equal(np.sort(stand.order, axis=1), [range(4)] * 4)


def test_ideal_spots_are_rays_with_the_covariance_of_a_small_step():
    lens = Camera((640, 480), 800.0, 1.1, 310.0, 250.0, k1=-0.2, p1=1e-3)
    rng = np.random.default_rng(2)
    cameras, detections = (lens, CAMERA), []
    for _ in cameras:
        root = rng.normal(size=(5, 2, 2)) * 0.1
        detections.append(Detections.make(rng.uniform(50, 400, (5, 2)), cov=root @ root.transpose(0, 2, 1)))
    xy, cov = ideal_spots(detections, cameras)
    for k, (camera, spots) in enumerate(zip(cameras, detections, strict=True)):
        mine = slice(5 * k, 5 * k + 5)
        np.testing.assert_allclose(xy[mine], camera.unproject(spots.xy)[:, :2])
        step = 1e-3
        j = np.stack([
            (camera.unproject(spots.xy + d)[:, :2] - camera.unproject(spots.xy - d)[:, :2]) / (2 * step)
            for d in step * np.eye(2)
        ], axis=2)  # fmt: skip
        full = j @ spots.cov @ j.transpose(0, 2, 1)
        np.testing.assert_allclose(cov[mine], full[:, [0, 0, 1], [0, 1, 1]], rtol=1e-5)


@pytest.mark.parametrize("counts", [[30, 0, 7], [1, 2, 3], [0, 0], [200]])
def test_every_spot_is_in_its_own_cell_of_the_raster(counts):
    rng = np.random.default_rng(3)
    count = np.array(counts)
    xy = rng.uniform(-1, 1, (count.sum(), 2)) * [1.0, 0.3]
    cov = rng.uniform(1, 2, (len(xy), 3))
    spots = raster(xy, cov, count, np.ones(len(xy), bool))
    assert spots.start.tolist() == [0, *np.cumsum(count)]
    assert sorted(spots.member.tolist()) == list(range(len(xy)))
    assert len(spots.first) == spots.shape.prod(axis=1).sum() + 1
    assert (spots.first[0], spots.first[-1]) == (0, len(xy))
    for cell in range(len(spots.first) - 1):
        for s in spots.member[spots.first[cell] : spots.first[cell + 1]]:
            v = spots.views[s]
            row, column = divmod(cell - spots.base[v], spots.shape[v, 0])
            assert 0 <= row < spots.shape[v, 1]
            low = spots.origin[v] + spots.cell[v] * np.array([column, row])
            assert (xy[s] >= low - 1e-12).all()
            assert (xy[s] <= low + spots.cell[v] * (1 + 1e-9)).all()
    for v in np.flatnonzero(count):
        mine = spots.views == v
        assert spots.crowd[v] == spots.density[mine].max()
        assert spots.widest[v] == cov[mine][:, [0, 2]].max()
        if count[v] > 5:
            assert 0.5 < spots.shape[v].prod() / count[v] < 3  # about one spot in each cell


def test_density_is_that_of_the_free_spots_around():
    x, y = np.meshgrid(np.arange(40.0), np.arange(30.0))
    xy = np.stack([x.ravel(), y.ravel()], axis=1) * 0.1
    inner = ((xy > 0.5) & (xy < xy.max(axis=0) - 0.5)).all(axis=1)
    every = np.ones(len(xy), bool)
    area = 4.0 * 3.0
    np.testing.assert_allclose(local_density(xy, every, area)[inner], 100, rtol=0.35)
    half = (np.arange(len(xy)) % 2) == 0
    np.testing.assert_allclose(local_density(xy, half, area)[inner].mean(), 50, rtol=0.35)
    few = np.arange(len(xy)) < NEIGHBOURS
    np.testing.assert_allclose(local_density(xy, few, area), NEIGHBOURS / area)
    np.testing.assert_allclose(local_density(xy, ~every, area), 1 / area)
    some = np.arange(len(xy)) < 60  # far from all of them it is what the whole area has at least
    assert local_density(xy, some, area).min() == 60 / area
    twice = np.repeat(xy[:3], 12, axis=0)
    assert np.isfinite(local_density(twice, np.ones(36, bool), area)).all()
