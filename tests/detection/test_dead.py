"""Groups, columns and rows of a sensor that do not measure; and what was painted on the model, which is no such."""

from functools import cache

import numpy as np
import pytest
from scipy.special import ndtr

from windmark.detection import dead_pixels
from windmark.detection.sharpest import sharpness_px
from windmark.synth.degrade import gaussian_blur

H, W = 192, 224


@cache
def light(blur_px=0.7, cut=None):
    """A shaded plate with dots before a dark background; ``cut``: of 5 x 5 parts of a pixel, changed in place."""
    y, x = (np.indices((5 * H, 5 * W)) - 2) / 5
    parts = 900 + 200 * np.sin(x / 50) * np.cos(y / 40)
    parts[np.hypot((x + y / 40) % 32 - 16, (y + x / 30) % 32 - 16) < 3.3] *= 0.2
    parts[(x + y / 30 < 20) | (y - x / 30 < 12)] = 40
    if cut is not None:
        cut(parts)
    return gaussian_blur(parts.reshape(H, 5, W, 5).mean(axis=(1, 3)), blur_px)


def taken(of, seed=1):
    return np.random.default_rng(seed).normal(of, np.sqrt(4 + 0.25 * of))


def stored(levels):
    return np.clip(np.rint(levels), 0, 65535).astype(np.uint16)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("blur_px", [0.45, 0.7, 1.0])
def test_a_sensor_without_defects_has_none(blur_px, seed):
    assert dead_pixels(stored(taken(light(blur_px), seed))) is None


@pytest.mark.parametrize("blur_px", [0.5, 0.7, 1.0])
def test_edges_tell_the_blur(blur_px):
    """Never a larger one."""
    assert 0.75 * blur_px < sharpness_px(taken(light(blur_px)), 10.0) < 1.05 * blur_px


@pytest.mark.parametrize(("rows", "columns", "level"), [(3, 3, 0), (2, 2, 0), (1, 3, 0), (2, 3, 3000), (5, 4, 2500)])
def test_groups(rows, columns, level):
    image = taken(light())
    truth = np.zeros((H, W), bool)
    truth[60 : 60 + rows, 80 : 80 + columns] = truth[120 : 120 + rows, 160 : 160 + columns] = True
    image[truth] = level
    np.testing.assert_array_equal(dead_pixels(stored(image)), truth)


STUCK = (lambda column: 0 * column, lambda column: np.r_[column[:80], 0 * column[80:]], lambda column: 0 * column + 700)
OFF = (lambda column: column + 120, lambda column: column - 200, lambda column: 0.8 * column)


@pytest.mark.parametrize(("change", "wide"), [*((c, w) for c in STUCK for w in (1, 2)), *((c, 1) for c in OFF)])
@pytest.mark.parametrize("turned", [False, True])
def test_columns_and_rows(change, wide, turned):
    image = taken(light()).T.copy() if turned else taken(light())
    for k in range(100, 100 + wide):
        image[:, k] = change(image[:, k])
    found = dead_pixels(stored(image.T if turned else image))
    found = found.T if turned else found
    assert np.flatnonzero(found.any(axis=0)).tolist() == list(range(100, 100 + wide))
    assert found[:, 100].all()


@pytest.mark.parametrize("wide", [2, 5, 7, 10])
@pytest.mark.parametrize("at", range(5))
@pytest.mark.parametrize("level", [100, 1800])
def test_lines_along_a_column_are_paint(wide, at, level):
    """However they lie to it: a fifth of a pixel apart."""

    def drawn(parts):
        parts[:, 5 * 100 + at : 5 * 100 + at + wide] = level
        parts[5 * 90 + at : 5 * 90 + at + wide, 300:700] = level

    assert dead_pixels(stored(taken(light(0.6, drawn)))) is None


def test_grains_specks_and_writing_are_paint():
    rng = np.random.default_rng(6)

    def drawn(parts):
        parts *= np.exp(0.3 * rng.normal(size=parts.shape))
        for _ in range(200):
            y, x = rng.integers(100, 5 * H - 40), rng.integers(120, 5 * W - 40)
            tall, wide = rng.integers(3, 20, 2)
            parts[y : y + tall, x : x + wide] = rng.choice([100, 2500])

    assert dead_pixels(stored(taken(light(0.6, drawn)))) is None


def test_beside_a_level_that_is_clipped_no_light_is_missed():
    """Of a small light, what is beside it may be below black."""
    of = np.zeros((H, W))
    of[60:62, 80:82] = [[12, 0], [11, 9]]
    assert dead_pixels(stored(of)) is None


@pytest.mark.parametrize("seed", range(5))
def test_two_by_two_whose_sides_scatter(seed):
    """The light beside a point is little where it is sharp."""

    def drawn(parts):
        parts[5 * 110 : 5 * 150, 5 * 100 : 5 * 200] = 1000

    image, truth = taken(light(0.6, drawn), seed), np.zeros((H, W), bool)
    for x in (120, 140, 160, 180):
        truth[130:132, x : x + 2] = True
    image[truth] = 0
    np.testing.assert_array_equal(dead_pixels(stored(image)), truth)


def test_a_picture_that_was_enlarged_by_repeating_pixels_has_no_dead_columns():
    def drawn(parts):
        for k in range(60, 200, 20):
            parts[:, 5 * k : 5 * k + 4] = 100

    image = stored(taken(light(0.4, drawn)))
    again = np.floor(np.arange(W * 13 // 10) / 1.3).astype(int)
    assert dead_pixels(image[:, again]) is None


@pytest.mark.parametrize(("noises", "least"), [(15, 0.8), (20, 0.95), (-15, 0.8)])
def test_single_pixels_that_only_the_noise_tells(noises, least):
    """They left the range of their neighbours by less than five times it, which of noise alone is 14 noises."""
    of, image, truth = light(0.7), taken(light(0.7), 5), np.zeros((H, W), bool)
    places = [(y, x) for y in range(8, H - 8, 16) for x in range(16, W - 8, 16)]
    places = [(y, x) for y, x in places if of[y, x] > 400 and np.ptp(of[y - 2 : y + 3, x - 2 : x + 3]) < 40]
    for y, x in places:
        truth[y, x], image[y, x] = True, of[y, x] + noises * np.sqrt(4 + 0.25 * of[y, x])
    found = dead_pixels(stored(image))
    assert len(places) > 40
    assert not (found & ~truth).any()
    assert found[truth].mean() > least


def glints(blur_px, seed):
    """Points of light of 10 to 40 noises, wherever between the pixels they lie, and light falls on whole pixels."""
    rng, out = np.random.default_rng(seed), light(blur_px).copy()
    for y in range(10, H - 10, 12):
        for x in range(10, W - 10, 12):
            along = [ndtr((np.arange(-5, 7) - 0.5 - at) / blur_px) for at in rng.uniform(-0.5, 0.5, 2)]
            spot = np.outer(*(np.diff(a) for a in along))
            out[y - 5 : y + 6, x - 5 : x + 6] += spot / spot.max() * rng.uniform(10, 40) * np.sqrt(4 + 0.25 * out[y, x])
    return out


@pytest.mark.parametrize("blur_px", [0.5, 0.7])
def test_glints_of_so_few_noises_are_light(blur_px):
    """What the optic has imaged lights up what is beside it."""
    for seed in range(4):
        assert dead_pixels(stored(taken(glints(blur_px, seed), seed))) is None
