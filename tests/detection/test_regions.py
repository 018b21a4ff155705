"""Candidates by their region below half depth: place, size, tilt and correlation, whatever radius was searched for."""

import numpy as np
import pytest

from windmark.detection._kernels.regions import COLUMNS, OPEN, WHOLE, disc_match, regions
from windmark.detection.image import prepare
from windmark.detection.look import look_for, measured_regions, trial_radii

NOISE = 1.0
COLUMN = {name: k for k, name in enumerate(COLUMNS)}


def at(image, x, y, radius=4.0):
    """The row of one starting pixel."""
    return regions(image.astype(np.float32), np.array([[float(x), float(y)]]), radius, np.array([NOISE]))[0]


@pytest.mark.parametrize("searched", [2.5, 4.0, 6.0])
def test_place_size_and_tilt_do_not_depend_on_the_radius_searched_for(draw, searched):
    rng = np.random.default_rng(0)
    image = draw((60, 60), [(30.3, 29.6, 6.0, 2.6, 0.5)], blur=1) + rng.normal(0, NOISE, (60, 60))
    row = at(image, 30, 30, searched)
    shape = np.array([[row[COLUMN["xx"]], row[COLUMN["xy"]]], [row[COLUMN["xy"]], row[COLUMN["yy"]]]])
    low, high = np.linalg.eigvalsh(shape)
    assert row[COLUMN["state"]] == WHOLE
    np.testing.assert_allclose(row[:2], [30.3, 29.6], atol=0.15)
    assert high == pytest.approx(6.0, rel=0.1)
    assert low == pytest.approx(2.6, rel=0.15)
    assert row[COLUMN["depth"]] == pytest.approx(60.0, rel=0.15)
    assert row[COLUMN["rho2"]] > 0.9


def test_correlation_and_depth_are_those_of_least_squares():
    """The slow twin: columns 1, x, y and the soft disc by `numpy.linalg.lstsq`."""
    image = np.random.default_rng(1).normal(100, 5, (40, 40)).astype(np.float32)
    image[14:24, 15:24] -= 30
    x, y, a, b = 19.4, 18.7, 5.0, 3.5
    out = np.empty(4)
    disc_match(image, x, y, np.array([a, 0.0, b]), out)
    rows, cols = np.mgrid[:40, :40].astype(float)
    u, v = cols - x, rows - y
    r = np.hypot(u / a, v / b)
    use = r <= 2.0
    gradient = np.hypot(u / a**2, v / b**2)[use] / np.maximum(r[use], 1e-12)
    t = np.clip(0.5 - 0.5 * (r[use] - 1.0) / np.maximum(gradient, 1e-12), 0.0, 1.0)
    # the kernel's edge is 2 px wide across: half a unit per pixel
    plane = np.column_stack([np.ones(use.sum()), u[use], v[use]])
    left = [w - plane @ np.linalg.lstsq(plane, w, rcond=None)[0] for w in (image[use].astype(float), t)]
    rho = -(left[0] @ left[1]) / np.sqrt((left[0] @ left[0]) * (left[1] @ left[1]))
    assert out[1] == pytest.approx(rho**2, rel=1e-3)
    assert out[0] == pytest.approx(-(left[0] @ left[1]) / (left[1] @ left[1]), rel=1e-3)


def test_what_runs_on_is_open(draw):
    image = draw((60, 60), [(30.0, 30.0, 4.0)])
    image[29:32] = 40.0
    assert at(image, 30, 30)[COLUMN["state"]] == OPEN
    assert np.isnan(at(np.full((60, 60), 7.0), 30, 30)[0])


def test_a_square_fills_less_of_its_ellipse_than_a_disc(draw):
    square = np.full((60, 60), 100.0)
    square[22:37, 23:38] = 40.0
    assert at(square, 30, 29, 8.0)[COLUMN["fill"]] == pytest.approx(np.pi / 3.0 / 1.0971, abs=0.012)
    assert at(draw((60, 60), [(30.0, 30.0, 8.0)]), 30, 30, 8.0)[COLUMN["fill"]] > 0.98


def test_few_radii_measure_many():
    assert trial_radii([2.0, 2.5, 3.0, 3.5, 5.0, 9.0]) == [3.0, 5.0, 9.0]
    assert trial_radii([4.0]) == [4.0]


def test_correlated_noise_is_known_as_such():
    """The filter's scatter over that of white noise of the same strength."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(2)
    white = prepare(rng.normal(100, 5, (512, 512)), 1.0)
    texture = gaussian_filter(rng.normal(0, 1, (512, 512)), 1.5)
    image = prepare(100 + 5 * texture / texture.std(), 1.0)
    assert np.median(measured_regions(white, 3.0).tails) < 1.3
    assert 2.5 < np.median(measured_regions(image, 3.0).tails) < 5.0


def test_discs_side_by_side_at_a_grazing_angle_are_two(draw):
    rng = np.random.default_rng(3)
    discs = [(40.0, 40.0, 10.0, 3.6, np.pi / 2), (51.0, 40.0, 10.0, 3.6, np.pi / 2)]
    image = prepare(draw((80, 90), discs, blur=1) + rng.normal(0, NOISE, (80, 90)), 1.0)
    spots, _ = look_for(image, [10.0], 1.0)
    near = np.hypot(*(spots.xy[:, None] - np.array(discs)[:, :2]).transpose(2, 0, 1)).min(axis=0)
    assert (near < 0.5).all()


def test_the_noise_of_boxes_is_that_of_the_surface_between_dense_markers(draw):
    """White noise has tail 1; markers in every third box of a row are not counted as noise."""
    rng = np.random.default_rng(3)
    places = np.stack(np.meshgrid(np.arange(24, 500, 34.0), np.arange(24, 500, 34.0)), axis=-1).reshape(-1, 2)
    image = draw((512, 512), np.column_stack([places, np.full(len(places), 5.0)]), blur=1, depth=12.0)
    image = image + rng.normal(0, 4.0, image.shape)
    here = measured_regions(prepare(image, 1.0), 4.0)
    assert len(here.spots.xy) > 100
    assert here.tails.max() < 1.3
