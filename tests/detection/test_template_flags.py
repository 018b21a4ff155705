"""Flags of template fits, each made on purpose; input that is degenerate or wrong."""

import numpy as np
import pytest

from windmark.detection.template.refine import FrameNoise, refine_template
from windmark.detection.template.result import BORDER, CONTAMINATED, ILL, SATURATED, TOUCHING
from windmark.synth import disc_image

GRID = np.stack(np.meshgrid(np.arange(6), np.arange(6)), axis=-1).reshape(-1, 2)


def scene(*, radius=3.0, blur=0.7, pitch=40, level=200.0, depth=140.0, noise=2.0, seed=0):
    """36 markers on tiles: image and centres."""
    rng = np.random.default_rng(seed)
    image, xy = np.empty((6 * pitch, 6 * pitch)), pitch * GRID + pitch // 2 + rng.uniform(-0.5, 0.5, (36, 2))
    for k, (i, j) in enumerate(GRID):
        image[pitch * j : pitch * (j + 1), pitch * i : pitch * (i + 1)] = disc_image(
            (pitch, pitch), xy[k] - pitch * GRID[k], radius, level=level, depth=depth, blur_px=blur
        )
    return image + rng.normal(0, noise, image.shape), xy


def only(fits, flag, which):
    """The flag is on these markers and on no others; all others have none at all."""
    marked = np.isin(np.arange(len(fits)), which)
    np.testing.assert_array_equal((fits.flags & flag) > 0, marked)
    assert np.mean(fits.flags[~marked] == 0) > 0.95


def test_nothing_special_has_no_flags():
    image, xy = scene()
    fits = refine_template(image, xy, 3.0)
    assert np.mean(fits.flags == 0) > 0.95
    assert fits.converged.all()


def test_touching():
    image, xy = scene()
    light = image.copy()
    rows, cols = slice(0, 40), slice(0, 40)
    light[rows, cols] -= 200.0 - disc_image((40, 40), xy[0] + (7.5, 2.0), 3.0, depth=140.0, blur_px=0.7)
    xy = np.vstack([xy, xy[0] + (7.5, 2.0)])
    fits = refine_template(light, xy, 3.0)
    only(fits, TOUCHING, [0, 36])
    assert np.hypot(*(fits.xy - xy)[[0, 36]].T).max() < 0.1


def test_border():
    image, xy = scene()
    x = int(np.floor(xy[:, 0].min())) - 1  # cuts the first column of markers
    fits = refine_template(image[:, x:], xy - (x, 0), 3.0)
    only(fits, BORDER, np.flatnonzero(GRID[:, 0] == 0))
    assert np.isfinite(fits.cov).all()
    assert np.hypot(*(fits.xy + np.array([x, 0]) - xy).T).max() < 0.5


@pytest.mark.parametrize("polarity", ["dark", "bright"])
def test_saturated(polarity):
    image, xy = scene()
    beside = np.s_[65:68, 60:62]  # marker 7, in its window
    image[beside] = 255.0
    counts = np.clip(np.rint(image if polarity == "dark" else 255.0 - image), 0, 255).astype(np.uint8)
    if polarity == "bright":
        counts[beside] = 255
    fits = refine_template(counts, xy, 3.0, polarity=polarity, photometry="additive")
    only(fits, SATURATED, [7])
    assert np.hypot(*(fits.xy - xy).T).max() < 0.12
    free = refine_template(counts, xy, 3.0, polarity=polarity, photometry="additive", saturation=np.inf)
    assert not (free.flags & SATURATED).any()


@pytest.mark.parametrize("top", [4095, 3900])
def test_a_camera_that_clips_below_the_largest_number_of_its_files(top):
    """Twelve bits in a file of sixteen, and electronics that end before: found as if it had been given."""
    image, xy = scene(level=top - 500.0, depth=-700.0, noise=10.0)
    counts = np.clip(np.rint(image), 0, top).astype(np.uint16)
    options = {"polarity": "bright", "photometry": "additive"}
    fits, told = (refine_template(counts, xy, 3.0, saturation=s, **options) for s in (None, float(top)))
    assert (fits.flags & SATURATED > 0).all()
    np.testing.assert_array_equal(fits.xy, told.xy)
    unseen = refine_template(counts, xy, 3.0, saturation=np.inf, **options)
    assert abs(fits.frame.blur_px - 0.7) < 0.05 < 0.2 < abs(unseen.frame.blur_px - 0.7)  # edges cut off look steep
    assert np.hypot(*(fits.xy - xy).T).mean() < np.hypot(*(unseen.xy - xy).T).mean()


def test_saturated_paint_is_the_paints_level():
    """A white drawing: most of every window is at the largest number."""
    image, xy = scene(level=255.0, depth=255.0, noise=0.0)
    fits = refine_template(np.rint(image).astype(np.uint8), xy, 3.0)
    assert fits.converged.all()
    assert (fits.flags & SATURATED > 0).all()
    assert np.abs(fits.xy - xy).max() < 0.01


@pytest.mark.parametrize("photometry", ["multiplicative", "additive"])
def test_contaminated(photometry):
    """A line through a marker is noticed and its weights bring the centre back."""
    image, xy = scene()
    column = int(np.rint(xy[14, 0])) + 2
    image[84:118, column : column + 2] *= 0.6
    options = {"photometry": photometry}
    fits, plain = (refine_template(image, xy, 3.0, robust=r, **options) for r in (True, False))
    only(fits, CONTAMINATED, [14])
    only(plain, CONTAMINATED, [14])
    robust, least = (np.hypot(*(f.xy - xy)[14]) for f in (fits, plain))
    assert robust < 0.1 < least
    assert fits.chi2[14] > 2.0


@pytest.mark.parametrize("how", ["nan", "mask", "value"])
def test_a_dead_pixel_in_the_disc_is_a_contamination(how):
    image, xy = scene()
    x, y = np.rint(xy[20] + (1.0, 1.0)).astype(int)
    mask = None
    if how == "mask":
        mask = np.ones(image.shape, dtype=bool)
        mask[y, x] = False
    image[y, x] = np.nan if how == "nan" else 250.0
    fits = refine_template(image, xy, 3.0, mask=mask)
    only(fits, CONTAMINATED, [20])
    assert np.hypot(*(fits.xy - xy)[20]) < 0.1


def test_a_dead_pixel_beside_the_disc_does_no_harm():
    image, xy = scene()
    x, y = np.rint(xy[20] + (6.0, 0.0)).astype(int)
    image[y, x] = np.nan
    fits = refine_template(image, xy, 3.0)
    assert fits.flags[20] == 0
    assert np.hypot(*(fits.xy - xy)[20]) < 0.1


def test_ill_conditioned():
    """A speck smaller than what pixels show, and a place where there is nothing."""
    image, xy = scene()
    x, y = np.rint(xy[3]).astype(int)
    image[y - 12 : y + 13, x - 12 : x + 13] = 200.0
    image[y, x] = 60.0
    fits = refine_template(image, xy, 3.0)
    assert fits.flags[3] & ILL
    assert np.mean(fits.flags[np.arange(36) != 3] == 0) > 0.95


# --- degenerate input -------------------------------------------------------------------------


@pytest.mark.parametrize("empty", [[], np.empty((0, 2))])
def test_no_markers(empty):
    fits = refine_template(np.ones((20, 20)), empty, 3.0)
    assert len(fits) == 0
    assert fits.xy.shape == (0, 2)
    assert fits.cov.shape == (0, 2, 2)
    assert fits.frame.noise is None


@pytest.mark.parametrize("what", ["nan", "constant", "outside", "masked"])
def test_where_no_fit_is_possible_the_others_go_on(what):
    """The place comes back as it was given, not converged, flagged, its covariance NaN or useless; no warning."""
    image, xy = scene()
    mask = np.ones(image.shape, dtype=bool)
    start = xy.copy()
    x, y = np.rint(xy[9]).astype(int)
    window = np.s_[y - 19 : y + 20, x - 19 : x + 20]
    if what == "nan":
        image[window] = np.nan
    elif what == "constant":
        image[window] = 100.0
    elif what == "masked":
        mask[window] = False
    else:
        start[9] = (-500.0, 1000.0)
    fits = refine_template(image, start, 3.0, mask=mask)
    assert fits.flags[9] & ILL
    assert not np.isfinite(fits.cov[9]).all() or np.hypot(*(fits.xy - start)[9]) < 3.0
    others = np.arange(36) != 9
    assert fits.converged[others].all()
    assert np.hypot(*(fits.xy - xy)[others].T).max() < 0.15


@pytest.mark.parametrize("image", [np.zeros((40, 40)), np.full((40, 40), np.nan), np.full((40, 40), 255, np.uint8)])
def test_images_without_anything(image):
    fits = refine_template(image, [[20.0, 20.0], [10.0, 12.0]], 3.0)
    assert (fits.flags & ILL > 0).all()
    assert not np.isfinite(fits.correlation).any() or (np.nan_to_num(fits.correlation) < 0.5).all()


def test_one_pixel_and_tiny_images():
    for size in (1, 2, 3, 5):
        fits = refine_template(np.ones((size, size)), [[0.0, 0.0]], 3.0)
        assert fits.flags[0] & ILL


def test_noise_free_markers_are_fitted_to_the_models_error():
    image, xy = scene(noise=0.0)
    fits = refine_template(image, xy + 0.1, 3.0)
    assert fits.converged.all()
    assert np.abs(fits.xy - xy).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32, np.float64])
def test_any_real_type(dtype):
    image, xy = scene(level=120.0, depth=90.0)
    fits = refine_template(np.rint(image).astype(dtype), xy, 3.0)
    assert np.hypot(*(fits.xy - xy).T).max() < 0.15


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"polarity": "grey"}, "polarity"), ({"photometry": "gamma"}, "photometry"), ({"blur_px": -1.0}, "blur_px"),
        ({"blur_px": (1.0, 0.0)}, "blur_px"), ({"mask": np.ones((3, 3), bool)}, "mask"),
        ({"saturation": np.nan}, "saturation"),
    ],
)  # fmt: skip
def test_a_wrong_option_is_named(wrong, named):
    image, xy = scene()
    with pytest.raises(ValueError, match=named):
        refine_template(image, xy, 3.0, **wrong)


@pytest.mark.parametrize(
    ("xy", "radius", "named"),
    [([[1.0, np.nan]], 3.0, "xy"), ([[1.0, 2.0, 3.0]], 3.0, "xy"), ([[9.0, 9.0]], 0.0, "radius_px"),
     ([[9.0, 9.0]], [1.0, 2.0], "radius_px")],
)  # fmt: skip
def test_wrong_places_or_radii_are_named(xy, radius, named):
    with pytest.raises(ValueError, match=named):
        refine_template(np.ones((20, 20)), xy, radius)


def test_frame_noise_of_one_number():
    noise = FrameNoise.white(3.0)
    assert noise.is_white
    np.testing.assert_allclose(noise.variance([10.0, 200.0]), 9.0)
