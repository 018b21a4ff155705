"""Properties of `detect` that hold whatever the picture shows."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import windmark as wm
from windmark.detection import merit_map

RADIUS = 3.0


def picture(seed, shape=(100, 130), blur=0.8):
    """Blurred ellipses of random size, depth and tilt on a sloping, slightly noisy surface (8-bit integers)."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    image = 140 + rng.uniform(-0.3, 0.3) * x + rng.uniform(-0.3, 0.3) * y + rng.normal(0, 1.2, shape)
    for row in range(15, shape[0] - 10, 24):
        for col in range(15, shape[1] - 10, 24):
            cx, cy = col + rng.uniform(-4, 4), row + rng.uniform(-4, 4)
            a, b, turn = RADIUS * rng.uniform(0.9, 1.1), RADIUS * rng.uniform(0.8, 1.0), rng.uniform(0, np.pi)
            u, v = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn), (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
            r = np.hypot(u / a, v / b)
            image -= rng.uniform(30, 70) / (1 + np.exp((r - 1) * RADIUS / (0.5 * blur)))
    return np.clip(np.round(image), 0, 255)


def sorted_xy(found):
    return found.xy[np.lexsort(np.round(found.xy).T)]


def same(found, want_xy, atol=1e-3):
    got = sorted_xy(found)
    want = want_xy[np.lexsort(np.round(want_xy).T)]
    assert got.shape == want.shape
    np.testing.assert_allclose(got, want, atol=atol)


seeds = st.integers(0, 2**32 - 1)
law = settings(max_examples=12, deadline=None)
ADDITIVE = ({"refine": "bowl"}, {"photometry": "additive"})
NEAR = {"bowl": 1e-3, None: 0.03}  # px; whether a fit counts as contaminated depends a little on the grey levels


@pytest.mark.slow
@law
@given(seeds, st.sampled_from(["flip x", "flip y", "transpose", "half turn"]))
def test_mirrors_and_turns(seed, how):
    image = picture(seed)
    h, w = image.shape
    xy = wm.detect(image, radius_px=RADIUS).xy
    assert len(xy) > 10
    turned, want = {
        "flip x": (image[:, ::-1], [w - 1, 0] + xy * [-1, 1]),
        "flip y": (image[::-1], [0, h - 1] + xy * [1, -1]),
        "transpose": (image.T, xy[:, ::-1]),
        "half turn": (image[::-1, ::-1], [w - 1, h - 1] - xy),
    }[how]
    same(wm.detect(turned, radius_px=RADIUS), want)


@law
@given(seeds, st.integers(0, 40), st.integers(0, 40))
def test_shifts(seed, dx, dy):
    image = picture(seed)
    shifted = np.full((image.shape[0] + 40, image.shape[1] + 40), np.nan)
    shifted[dy : dy + image.shape[0], dx : dx + image.shape[1]] = image
    same(wm.detect(shifted, radius_px=RADIUS), wm.detect(image, radius_px=RADIUS).xy + np.array([dx, dy]))


@law
@given(seeds, st.floats(0.01, 1000))
def test_gain(seed, gain):
    image = picture(seed)
    same(wm.detect(gain * image, radius_px=RADIUS), wm.detect(image, radius_px=RADIUS).xy, atol=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("how", ADDITIVE)
@law
@given(seed=seeds, gain=st.floats(0.01, 1000), offset=st.floats(-1e5, 1e5))
@example(seed=801161, gain=186.73828125, offset=0.0)  # a pixel exactly at half depth: rounding took it out
def test_gain_and_offset(how, seed, gain, offset):
    """Where light adds to the marker's; paint takes a share of the light, so that black must be 0."""
    image = picture(seed)
    before = wm.detect(image, radius_px=RADIUS, **how)
    after = wm.detect(gain * image + offset, radius_px=RADIUS, **how)
    same(after, before.xy, atol=NEAR[how.get("refine")])
    order, want = np.lexsort(np.round(after.xy).T), np.lexsort(np.round(before.xy).T)
    np.testing.assert_allclose(after.depth[order], gain * before.depth[want], rtol=0.03)
    np.testing.assert_allclose(after.merit[order], before.merit[want], atol=2e-3)


@pytest.mark.parametrize("how", ADDITIVE)
@law
@given(seed=seeds)
def test_bright_is_dark_upside_down(how, seed):
    image = np.clip(picture(seed), 1, 254).astype(np.uint8)  # nothing saturated, neither way
    dark = wm.detect(image, radius_px=RADIUS, **how)
    bright = wm.detect(255 - image, radius_px=RADIUS, polarity="bright", **how)
    same(bright, dark.xy, atol=NEAR[how.get("refine")])
    if how.get("refine") == "bowl":  # the template's noise grows with the light, whatever the polarity
        np.testing.assert_allclose(bright.cov, dark.cov, rtol=1e-4)
        np.testing.assert_allclose(bright.depth, dark.depth, rtol=1e-5)


@pytest.mark.parametrize("how", ADDITIVE)
@law
@given(seed=seeds, a=st.floats(-3, 3), b=st.floats(-3, 3))
def test_a_slope_moves_no_centre(how, seed, a, b):
    """The plane is part of the model: light that changes evenly does not move a spot (additive light)."""
    image = picture(seed)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    slope = wm.detect(image + a * x + b * y, radius_px=RADIUS, **how)
    same(slope, wm.detect(image, radius_px=RADIUS, **how).xy, atol=NEAR[how.get("refine")])


@law
@given(seeds)
def test_order_and_bounds(seed):
    found = wm.detect(picture(seed), radius_px=[2.5, RADIUS, 3.6])
    gap = np.hypot(*(found.xy[:, None] - found.xy[None]).transpose(2, 0, 1)) + 99 * np.eye(len(found))
    assert gap.min() > 1.5 * 2.5
    assert (found.merit <= 1.43 * 0.7).all()  # beyond 0.7 the fit decides
    assert (found.depth > 0).all()
    assert (np.linalg.eigvalsh(found.cov) > 0).all()
    few = wm.detect(picture(seed), radius_px=[2.5, RADIUS, 3.6], max_spots=5)
    np.testing.assert_array_equal(few.xy, found.xy[:5])


@pytest.mark.slow
@pytest.mark.parametrize("polarity", ["dark", "bright"])
def test_merit_map_turns_with_the_image(polarity):
    image = picture(1)
    want = merit_map(image, RADIUS, polarity)
    holes = want < 2.0  # where there is none the merit is rounding
    for turned in (merit_map(image.T, RADIUS, polarity).T, merit_map(image[::-1], RADIUS, polarity)[::-1]):
        np.testing.assert_allclose(turned[holes], want[holes], rtol=1e-3)
