"""`plot` of spots, registrations and calibrations: what is drawn lies where the numbers say."""

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.quiver import Quiver

from windmark.geometry import Camera, Pose
from windmark.registration import register
from windmark.scene import Detections, MarkerSet, plots

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def _closed():
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


def one_of(ax, kind):
    found = [c for c in ax.collections if isinstance(c, kind)]
    assert len(found) == 1
    return found[0]


def test_spots_are_ellipses_where_they_are_known_and_crosses_elsewhere():
    spots = Detections.make(
        [[10.0, 20.0], [30.0, 40.0], [50.0, 60.0]], radius_px=[np.nan, 4.0, np.nan],
        axes_px=[[3.0, 2.0], [np.nan, np.nan], [np.nan, np.nan]], angle=[np.pi / 6, np.nan, np.nan],
    )  # fmt: skip
    image = np.arange(80 * 70, dtype=float).reshape(80, 70)
    ax = spots.plot(image)
    drawn = one_of(ax, EllipseCollection)
    np.testing.assert_allclose(drawn.get_offsets(), spots.xy[:2])
    np.testing.assert_allclose(drawn.get_widths(), [6.0, 8.0])
    np.testing.assert_allclose(drawn.get_heights(), [4.0, 8.0])
    np.testing.assert_allclose(drawn.get_angles(), [30.0, 0.0])
    np.testing.assert_allclose(ax.lines[0].get_xydata(), spots.xy[2:])
    assert ax.get_images()[0].get_extent() == [-0.5, 69.5, 79.5, -0.5]  # the centre of the top left pixel is (0, 0)
    bottom, top = spots.take([]).plot().get_ylim()
    assert bottom != top
    bottom, top = spots.plot().get_ylim()
    assert bottom > 60 > 20 > top  # y points down, also without a picture


@pytest.mark.parametrize("scale", [1e-4, 0.03, 0.2, 7.0])
def test_arrows_are_enlarged_by_a_round_factor_to_less_than_a_twentieth(scale):
    rng = np.random.default_rng(1)
    xy, steps = rng.uniform(0, 1000, (40, 2)), scale * rng.normal(size=(40, 2))
    ax = plots.pixel_axes(None, None, xy)
    plots.arrows(ax, xy, steps)
    drawn = one_of(ax, Quiver)
    factor = drawn.U[0] / steps[0, 0]
    np.testing.assert_allclose(np.column_stack([drawn.U, drawn.V]), factor * steps)
    assert f"x {factor:g}," in ax.get_title()
    assert float(f"{factor:e}"[0]) in {1.0, 2.0, 5.0}
    assert 0.02 < factor * np.hypot(*steps.T).max() / 1000 < 0.052


def test_no_arrows_without_residuals():
    ax = plots.pixel_axes(None, None, [[1.0, 2.0]])
    plots.arrows(ax, [[1.0, 2.0]], [[0.0, 0.0]])
    assert not ax.collections


def test_a_registration_shows_matches_names_and_what_was_left():
    rng, camera = np.random.default_rng(2), Camera((640, 512), 1200.0)
    xyz = np.column_stack([rng.uniform(-200, 200, (20, 2)), rng.uniform(0, 60, 20)])
    markers = MarkerSet.make([f"m{k}" for k in range(20)], xyz, length_unit="mm")
    xy, _ = camera.project(Pose.look_at([200.0, 300.0, 1200.0], [0.0, 0.0, 30.0], [0.0, 1.0, 0.0]).apply(xyz))
    spots = Detections.make(np.vstack([xy + rng.normal(0, 0.1, xy.shape), [[30.0, 40.0]]]), sigma_px=0.1)
    answer = register(spots, markers, camera)
    assert answer
    ax = answer.plot(spots, markers)
    others, matched = (line.get_xydata() for line in ax.lines)
    np.testing.assert_allclose(others, [[30.0, 40.0]])
    np.testing.assert_allclose(matched, spots.xy[answer.matching.detection])
    assert [t.get_text() for t in ax.texts] == [f"m{k}" for k in answer.matching.marker]
    drawn = one_of(ax, Quiver)
    np.testing.assert_allclose(drawn.U / drawn.U[0], answer.residuals[:, 0] / answer.residuals[0, 0])


def clim(image):
    return plots.pixel_axes(None, image, np.zeros((0, 2))).get_images()[0].get_clim()


def test_grey_levels_are_shown_without_the_outermost_hundredths():
    levels = np.arange(10_000.0).reshape(100, 100)
    levels[0, 0], levels[-1, -1], levels[3, 3] = -1e9, 1e9, np.nan
    low, high = clim(levels)
    assert low == pytest.approx(100, abs=2)
    assert high == pytest.approx(9900, abs=2)
    low, high = clim(np.full((9, 9), 7.0))
    assert low == 7.0 < high  # an even picture is dark, and no error


def test_places_without_a_picture_have_room_around_them():
    places = np.array([[100.0, 400.0], [300.0, 250.0], [200.0, 300.0]])
    ax = plots.pixel_axes(None, None, places)
    left, right = ax.get_xlim()
    bottom, top = ax.get_ylim()
    room = [100 - left, right - 300, bottom - 400, 250 - top]
    assert room[0] > 0
    np.testing.assert_allclose(room, room[0])
    assert plots.pixel_axes(ax, None, np.zeros((0, 2))) is ax


@pytest.mark.parametrize("places", [[[1.0, 2, 3], [5, 2.5, 3], [3, 2, 4]], [[7e5, 8, 9]], [[-1e4, 0, 0], [1e4, 1, 1]]])
def test_axes_in_space_have_one_scale_and_everything_in_the_middle(places):
    xyz = np.array(places)
    ax = plots.space_axes(None, xyz)
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    width = np.diff(limits, axis=1).ravel()
    np.testing.assert_allclose(width, width[0])
    np.testing.assert_allclose(limits.mean(axis=1), (xyz.min(axis=0) + xyz.max(axis=0)) / 2, atol=1e-9)
    longest = np.ptp(xyz, axis=0).max() or 1.0
    assert (limits[:, 0] < xyz.min(axis=0)).all()
    assert (limits[:, 1] > xyz.max(axis=0)).all()
    assert longest < width[0] < 1.3 * longest
    assert plots.space_axes(ax, np.zeros((0, 3))) is ax


@pytest.mark.parametrize("scale", [1e-6, 0.04, 30.0])
def test_arrows_in_space_go_where_the_displacements_point(scale):
    xyz = np.random.default_rng(4).uniform(0, 100, (12, 3))
    steps = scale * np.random.default_rng(5).normal(size=(12, 3))
    ax = plots.space_axes(None, xyz)
    plots.space_arrows(ax, xyz, steps)
    np.testing.assert_allclose(np.array(ax.lines[0].get_data_3d()).T, xyz)
    tip, foot = np.array(ax.collections[0]._segments3d[:12]).swapaxes(0, 1)
    np.testing.assert_allclose(foot, xyz)
    drawn = tip - foot
    factor = drawn[0, 0] / steps[0, 0]
    np.testing.assert_allclose(drawn, factor * steps, atol=1e-9)
    assert f"x {factor:g}," in ax.get_title()
    part = np.linalg.norm(drawn, axis=1).max() / np.ptp(ax.get_xlim())
    assert 2 / 5 * 2 * plots.LONGEST < part <= 2 * plots.LONGEST * (1 + 1e-9)


def test_no_arrows_in_space_without_displacements():
    ax = plots.space_axes(None, np.eye(3))
    plots.space_arrows(ax, np.eye(3), np.zeros((3, 3)))
    plots.space_arrows(ax, np.zeros((0, 3)), np.zeros((0, 3)))
    assert not ax.collections
    assert ax.get_title() == ""


def test_round_lengths_are_the_largest_of_one_two_five_that_fit():
    every = [float(f"{m}e{p}") for p in range(-8, 9) for m in (1, 2, 5)]
    for value in every:
        assert plots.round_length(value) == pytest.approx(value, rel=1e-12)
        # Just below, its logarithm may be rounded to that of the next power of ten.
        assert 0.4 * value * (1 - 1e-9) < plots.round_length(np.nextafter(value, 0)) < value * (1 + 1e-9)
    for value in 10 ** np.random.default_rng(6).uniform(-7, 7, 300):
        assert plots.round_length(value) == pytest.approx(max(v for v in every if v <= value), rel=1e-12)
