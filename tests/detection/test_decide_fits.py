"""What the fits decide: markers of one paint are kept in any light, other things go, each with its reason."""

import numpy as np
import pytest

import windmark as wm
from windmark.detection import explain
from windmark.detection.family import relative_contrast
from windmark.detection.quantile import weighted_quantile
from windmark.detection.rejected import LARGE, MISFIT, OTHER, PALE, PART, SHAPE, SMALL

COLUMNS, ROWS = np.arange(30, 330, 50.0), np.arange(30, 200, 50.0)
MARKERS = np.stack(np.meshgrid(COLUMNS, ROWS), axis=-1).reshape(-1, 2)
SHAPE_PX = (210, 330)


def paint(draw, discs, contrast):
    """Transmission of a surface with discs of some contrast."""
    return draw(SHAPE_PX, discs, blur=1, background=1.0, depth=contrast)


@pytest.fixture
def surface(draw):
    rng = np.random.default_rng(1)
    tilt = rng.uniform(0.55, 1.0, len(MARKERS))
    radius, turn = rng.uniform(2.6, 4.0, len(MARKERS)), rng.uniform(0, np.pi, len(MARKERS))
    jitter = MARKERS + rng.uniform(-0.5, 0.5, MARKERS.shape)
    return jitter, paint(draw, np.column_stack([jitter, radius, radius * tilt, turn]), 0.7)


def taken(image, places, **options):
    found, rejected = explain(image, radius_px=(2.5, 3.5), **options)
    away = np.hypot(*(places[:, None] - found.xy).transpose(2, 0, 1)).min(axis=1)
    return away < 0.3, found, rejected


def reasons_at(rejected, places):
    return [set(rejected.reason[np.hypot(*(rejected.xy - p).T) < 4.0].tolist()) for p in places]


def test_markers_in_falling_light_and_in_haze_are_kept(surface):
    """A third of the light at one end, and there a black level that halves the contrast: still all markers."""
    places, transmission = surface
    x = np.arange(SHAPE_PX[1])[None, :]
    light = 150.0 * (1.0 - 0.65 * x / SHAPE_PX[1])
    haze = 40.0 * x / SHAPE_PX[1]
    image = light * transmission + haze + np.random.default_rng(2).normal(0, 1.0, SHAPE_PX)
    there, found, _ = taken(image, places)
    assert there.all()
    assert len(found) == len(places)


@pytest.mark.parametrize(("share", "marker"), [(0.68, True), (0.53, False)])
def test_worn_markers_are_markers_down_to_three_fifths_of_the_contrast(surface, draw, share, marker):
    """Five discs of the markers' shape but paler than all round them: worn paint, and below that a stain."""
    places, transmission = surface
    between = MARKERS.reshape(len(ROWS), len(COLUMNS), 2)[:-1, :-1].reshape(-1, 2) + 25.0
    worn = between[[0, 3, 7, 10, 14]]
    other = paint(draw, np.column_stack([worn, np.full(5, 3.3)]), share * 0.7)
    image = 150.0 * transmission * other + np.random.default_rng(5).normal(0, 0.5, SHAPE_PX)
    there, _, rejected = taken(image, worn)
    assert there.tolist() == [marker] * 5
    if not marker:
        assert all(PALE in r for r in reasons_at(rejected, worn))
    assert taken(image, places)[0].all()


def test_stains_specks_and_strokes_are_not(surface, draw):
    """Between the markers: pale stains, specks, strokes and squares; their reasons are what they lack."""
    places, transmission = surface
    between = MARKERS.reshape(len(ROWS), len(COLUMNS), 2)[:-1, :-1].reshape(-1, 2) + 25.0
    stains, specks, strokes = between[0:5], between[5:10], between[10:15]
    y, x = np.mgrid[: SHAPE_PX[0], : SHAPE_PX[1]]
    other = paint(draw, np.column_stack([stains, np.full(5, 3.2)]), 0.3)
    other *= paint(draw, np.column_stack([specks, np.full(5, 1.4)]), 0.7)
    for p in strokes:
        other *= 1.0 - 0.5 * ((abs(x - p[0]) <= 5) & (abs(y - p[1]) <= 1))
    image = 150.0 * transmission * other + np.random.default_rng(3).normal(0, 1.0, SHAPE_PX)
    there, found, rejected = taken(image, places)
    assert there.all()
    assert len(found) == len(places)
    assert all(PALE in r for r in reasons_at(rejected, stains))
    assert all(SMALL in r for r in reasons_at(rejected, specks))
    assert all(r & {PART, MISFIT, SHAPE, LARGE, PALE, OTHER} for r in reasons_at(rejected, strokes))


def test_markers_that_lines_cross_are_kept(surface):
    places, transmission = surface
    y, x = np.mgrid[: SHAPE_PX[0], : SHAPE_PX[1]]
    image = 150.0 * transmission
    for k, p in enumerate(places[::6]):
        turn = 0.7 * k
        image = image * (1.0 - 0.3 * (abs((y - p[1]) * np.cos(turn) - (x - p[0]) * np.sin(turn) - 1.0) <= 0.7))
    image = image + np.random.default_rng(4).normal(0, 1.0, SHAPE_PX)
    there, _, _ = taken(image, places)
    assert there.sum() >= len(places) - 1
    assert there[::6].sum() >= 3


def test_an_image_without_its_zero_is_additive(surface):
    """A subtracted background leaves paint darker than no light: the template must not believe in shares of it."""
    places, transmission = surface
    image = 150.0 * (transmission - 1.0) + np.random.default_rng(5).normal(0, 1.0, SHAPE_PX)
    there, found, _ = taken(image, places)
    assert there.all()
    np.testing.assert_allclose(found.depth, 105.0, rtol=0.15)


def test_a_limit_of_the_merit_is_kept_to(surface):
    places, transmission = surface
    image = 150.0 * transmission + np.random.default_rng(6).normal(0, 1.0, SHAPE_PX)
    every = wm.detect(image, radius_px=(2.5, 3.5)).merit
    limit = float(np.median(every))
    strict = wm.detect(image, radius_px=(2.5, 3.5), merit_max=limit)
    assert (strict.merit <= limit + 0.01).all()  # the limit is on what is left without noise, here 1 grey level
    assert 0 < len(strict) < len(places)


def test_weighted_quantile_is_the_plain_one_for_equal_weights():
    values = np.random.default_rng(7).normal(size=(4, 101))
    middle = weighted_quantile(values, np.ones_like(values), 0.5)
    np.testing.assert_array_equal(middle, np.median(values, axis=1))
    assert weighted_quantile(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.1, 5.0]), 0.5) == 3.0


def test_contrast_is_compared_with_all_or_with_those_near_whichever_is_kinder():
    xy = np.column_stack([np.arange(40) * 10.0, np.zeros(40)])
    contrast = np.where(np.arange(40) < 20, 0.8, 0.4)
    share = relative_contrast(xy, contrast, np.ones(40, bool), np.ones(40))
    assert share.min() >= 1.0
    lone = relative_contrast(xy, np.where(np.arange(40) == 5, 0.3, 0.8), np.arange(40) != 5, np.ones(40))
    assert lone[5] == pytest.approx(0.3 / 0.8)


def test_specks_beside_markers_of_a_pixel_are_told_by_what_they_add(draw):
    """Bright points of radius 1.3, whose size and contrast are one number: specks of a quarter of it are none."""
    rng = np.random.default_rng(11)
    places = MARKERS + rng.uniform(-0.5, 0.5, MARKERS.shape)
    specks = places[::4] + np.array([9.0, 6.0])
    light = draw(SHAPE_PX, np.column_stack([places, np.full(len(places), 1.3)]), blur=1, background=0.0, depth=-180.0)
    light += draw(SHAPE_PX, np.column_stack([specks, np.full(len(specks), 1.0)]), blur=1, background=0.0, depth=-45.0)
    image = 10.0 + light + rng.normal(0, 0.5, SHAPE_PX)
    found = wm.detect(image, radius_px=(1.3, 1.8), polarity="bright")
    away = np.hypot(*(found.xy[:, None] - places).transpose(2, 0, 1))
    assert (away.min(axis=0) < 0.5).all()
    assert len(found) == len(places)


@pytest.mark.parametrize(
    ("length", "ratio", "contrast", "marker"),
    [(1.0, 0.33, 0.7, True), (0.8, 0.32, 0.7, False), (1.28, 0.32, 0.7, False), (1.0, 0.33, 0.5, False),
     (1.0, 0.2, 0.7, False)],
    ids=["a disc at 71 deg", "shorter", "longer", "paler", "narrower"],
)  # fmt: skip
def test_a_disc_at_a_grazing_angle_has_the_length_and_contrast_of_the_others(draw, length, ratio, contrast, marker):
    """Three narrow ellipses among 21 discs: markers if they are what the others would be at that angle."""
    rng = np.random.default_rng(6)
    jitter, turn = MARKERS + rng.uniform(-0.5, 0.5, MARKERS.shape), rng.uniform(0, np.pi, len(MARKERS))
    narrow, rest = np.array([2, 12, 21]), np.setdiff1d(np.arange(len(MARKERS)), [2, 12, 21])
    tilt = rng.uniform(0.85, 1.0, len(rest))
    transmission = paint(draw, np.column_stack([jitter[rest], np.full(len(rest), 5.0), 5.0 * tilt, turn[rest]]), 0.7)
    shape = np.tile([5.0 * length, 5.0 * length * ratio], (3, 1))
    transmission *= paint(draw, np.column_stack([jitter[narrow], shape, turn[narrow]]), contrast)
    image = 150.0 * transmission + rng.normal(0, 2.0, SHAPE_PX)
    found, _ = explain(image, radius_px=5.0)
    near = np.hypot(*(jitter[:, None] - found.xy).transpose(2, 0, 1)).min(axis=1) < 1.0
    assert near[rest].all()
    assert near[narrow].tolist() == [marker] * len(narrow)


def test_faint_discs_are_found_where_the_noise_is_known_to_be_white(draw):
    """A quarter of the discs at 66 to 70 deg, 8 to 11 sigma of the matched filter: 135 of all 144, 127 from 10 on."""
    count = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        jitter, turn = MARKERS + rng.uniform(-0.5, 0.5, MARKERS.shape), rng.uniform(0, np.pi, len(MARKERS))
        ratio = np.where(np.arange(len(MARKERS)) % 4 == 1, rng.uniform(0.35, 0.4, len(MARKERS)), 1.0)
        transmission = paint(draw, np.column_stack([jitter, np.full(len(MARKERS), 2.0), 2.0 * ratio, turn]), 0.7)
        found = wm.detect(150.0 * transmission + 9.0 * rng.normal(0, 1.0, SHAPE_PX), radius_px=2.0)
        assert (np.hypot(*(jitter[:, None] - found.xy).transpose(2, 0, 1)).min(axis=0) < 1.5).all()
        count += len(found)
    assert count >= 132
