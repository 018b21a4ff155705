"""The verb `detect`."""

import numpy as np
import pytest
from scipy import ndimage

import windmark as wm
from windmark.scene import FLAGS

BIT = {name: bit for bit, name in FLAGS.items()}


def has(found, name):
    return (found.flags & BIT[name]) > 0


def test_finds_all_and_only_the_markers(scene):
    image, centres = scene
    found = wm.detect(image, radius_px=3.0)
    distance = np.hypot(*(found.xy[:, None] - centres[None]).transpose(2, 0, 1))
    assert len(found) == len(centres)
    assert sorted(distance.argmin(axis=1)) == list(range(len(centres)))
    assert np.sqrt(np.mean(distance.min(axis=1) ** 2)) < 0.06
    assert (found.flags == 0).all()
    assert (found.merit < 0.45).all()
    np.testing.assert_allclose(found.depth, 60, atol=8)


def test_several_radii_each_marker_once(draw):
    discs = [(20.3, 20.1, 2.0), (50.6, 22.2, 3.1), (24.5, 60.4, 4.6), (70.2, 64.8, 7.2), (100.3, 30.3, 12.1)]
    image = draw((100, 140), discs, blur=1) + np.random.default_rng(0).normal(0, 1, (100, 140))
    found = wm.detect(image, radius_px=[2, 3, 4.5, 7, 12])
    order = np.argsort(found.radius_px)
    assert len(found) == len(discs)
    np.testing.assert_allclose(found.xy[order], [d[:2] for d in discs], atol=0.1)
    np.testing.assert_allclose(found.radius_px[order], [d[2] for d in discs], rtol=0.06)


def test_one_radius_leaves_other_sizes(draw):
    image = draw((60, 120), [(20, 30, 1.2), (50, 30, 3.0), (90, 30, 6.0)]) + np.random.default_rng(0).normal(
        0, 1, (60, 120)
    )
    found = wm.detect(image, radius_px=3.0)
    np.testing.assert_allclose(found.xy, [[50, 30]], atol=0.1)


def test_best_first(draw):
    image = draw((40, 160), [(20, 20, 3.0)], depth=20) + draw((40, 160), [(60, 20, 3.0)], depth=80)
    image += draw((40, 160), [(100, 20, 3.0)], depth=40) + np.random.default_rng(0).normal(0, 1, image.shape)
    found = wm.detect(image, radius_px=3.0)
    assert np.round(found.xy[:, 0]).tolist() == [60, 100, 20]
    assert np.round(wm.detect(image, radius_px=3.0, max_spots=2).xy[:, 0]).tolist() == [60, 100]
    assert np.round(wm.detect(image, radius_px=3.0, min_depth=30.0).xy[:, 0]).tolist() == [60, 100]
    assert len(wm.detect(image, radius_px=3.0, max_spots=0)) == 0
    assert len(wm.detect(image, radius_px=3.0, merit_max=0.01)) == 0


@pytest.mark.slow
def test_a_marker_is_where_it_is_in_every_type(scene):
    image, _ = scene
    levels = np.round(image)
    want = wm.detect(levels, radius_px=3.0)
    for other in (
        levels.astype(np.uint8),
        levels.astype(np.uint16) * 16,
        levels.astype(np.float32),
        levels.astype(np.int64),
    ):
        got = wm.detect(other, radius_px=3.0)
        np.testing.assert_allclose(got.xy, want.xy, atol=1e-4)
        np.testing.assert_allclose(got.cov, want.cov, rtol=1e-3)


@pytest.mark.parametrize("refine", ["bowl", "template"])
def test_black_on_white_at_the_ends_of_the_scale(draw, refine):
    """Saturated paper may be brighter than it looks: the template leaves it open."""
    image = np.clip(np.round(draw((60, 60), [(30.3, 29.8, 4.0)], background=255, depth=255)), 0, 255).astype(np.uint8)
    for picture, polarity in ((image, "dark"), (255 - image, "bright")):
        found = wm.detect(picture, radius_px=4.0, polarity=polarity, refine=refine)
        np.testing.assert_allclose(found.xy, [[30.3, 29.8]], atol=0.03)
        assert has(found, "saturated").all()
        assert 252 < found.depth[0] < (258 if refine == "bowl" else 320)
    assert len(wm.detect(image, radius_px=4.0, polarity="bright", refine=refine)) == 0


def test_border(draw):
    """A whole disc near the border is found unflagged; a cut one is flagged as long as most of it is seen."""
    rng = np.random.default_rng(0)
    discs = [(4.2, 30.3, 3.0), (56.1, 55.7, 3.0), (30.2, 2.1, 3.0), (30.0, 59.9, 3.0)]
    image = draw((60, 60), discs) + rng.normal(0, 1, (60, 60))
    found = wm.detect(image, radius_px=3.0)
    order = np.argsort(found.xy[:, 0])
    np.testing.assert_allclose(found.xy[order], [discs[0][:2], discs[2][:2], discs[1][:2]], atol=0.12)
    assert has(found, "border")[order].tolist() == [False, True, False]


def test_dead_pixels(draw):
    image = draw((60, 100), [(30.3, 30.1, 4.0), (70.2, 29.6, 4.0)]) + np.random.default_rng(0).normal(0, 1, (60, 100))
    image[29, 31] = np.nan
    image[:10] = np.nan
    image[50, 50] = np.inf
    found = wm.detect(image, radius_px=4.0)
    order = np.argsort(found.xy[:, 0])
    np.testing.assert_allclose(found.xy[order], [[30.3, 30.1], [70.2, 29.6]], atol=0.05)
    assert has(found, "contaminated")[order].tolist() == [True, False]


def test_neighbours(draw):
    image = draw((60, 120), [(30, 30, 4.0), (40.5, 30, 4.0), (90, 30, 4.0)]) + np.random.default_rng(0).normal(
        0, 1, (60, 120)
    )
    found = wm.detect(image, radius_px=4.0)
    order = np.argsort(found.xy[:, 0])
    np.testing.assert_allclose(found.xy[order], [[30, 30], [40.5, 30], [90, 30]], atol=0.3)
    assert has(found, "touching")[order].tolist() == [True, True, False]


@pytest.mark.parametrize("r0", [3.0, 5.0])
def test_noise_of_a_tenth_of_the_depth_costs_no_marker(r0, draw):
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.arange(25, 300, 40.0), np.arange(25, 300, 40.0)), axis=-1).reshape(-1, 2)
    discs = np.column_stack([grid + rng.uniform(-5, 5, grid.shape), r0 * rng.uniform(0.9, 1.05, len(grid))])
    found = wm.detect(draw((300, 300), discs, blur=1) + rng.normal(0, 6, (300, 300)), radius_px=r0)
    assert len(found) == len(discs)
    assert np.hypot(*(found.xy[:, None] - discs[None, :, :2]).transpose(2, 0, 1)).min(axis=1).max() < 0.5


def noise_like(kind):
    rng = np.random.default_rng(11)
    y, x = np.mgrid[:400, :400]
    size = (400, 400)
    return {
        "white": lambda: rng.normal(100, 5, size),
        "8 bit": lambda: np.round(rng.normal(100, 0.5, size)).astype(np.uint8),
        "photons": lambda: rng.poisson(4, size).astype(np.uint16),
        "blurred": lambda: ndimage.gaussian_filter(rng.normal(100, 20, size), 0.7),
        "ramp": lambda: (0.1 * x + 0.07 * y).astype(np.uint8),
        "step": lambda: np.where(x + 0.3 * y > 200, 40.0, 160.0) + rng.normal(0, 2, size),
        "corners": lambda: np.where((x // 50 + y // 50) % 2, 40.0, 160.0) + rng.normal(0, 2, size),
        "lines": lambda: 100 - 60 * (np.abs((x + 0.37 * y) % 40 - 20) < 1.5) + rng.normal(0, 2, size),
        "specks": lambda: np.where(rng.random(size) < 0.002, 10, 200).astype(np.uint8),
        "heavy tails": lambda: rng.laplace(0, 5, size),
    }[kind]()


@pytest.mark.parametrize("polarity", ["dark", "bright"])
@pytest.mark.parametrize(
    "kind", ["white", "8 bit", "photons", "blurred", "ramp", "step", "corners", "lines", "specks", "heavy tails"]
)
def test_no_marker_no_spot(kind, polarity):
    assert len(wm.detect(noise_like(kind), radius_px=[2, 3, 5, 9], polarity=polarity)) == 0


def test_rings_and_small_taps_are_no_markers(draw):
    """What a tunnel wall shows beside its dots: ring fittings, pressure taps, scratches."""
    rng = np.random.default_rng(0)
    image = draw((100, 200), [(30, 30, 2.8)], blur=1)
    image += draw((100, 200), [(70, 30, 6.0)], depth=60) - draw((100, 200), [(70, 30, 4.8)], depth=60)
    image += draw((100, 200), [(110, 30, 1.0), (150, 60, 1.2)], depth=90)
    image += draw((100, 200), [(60, 75, 20.0, 0.8, 0.3)]) - 300 + rng.normal(0, 1.5, (100, 200))
    found = wm.detect(image, radius_px=3.0)
    np.testing.assert_allclose(found.xy, [[30, 30]], atol=0.1)


@pytest.mark.parametrize(
    "image", [np.full((50, 50), 7, np.uint8), np.full((50, 50), np.nan), np.zeros((2, 2)), np.eye(5), np.ones((1, 1))]
)
def test_empty_images_have_no_spots(image):
    found = wm.detect(image, radius_px=[3.0, 8.0])
    assert len(found) == 0
    assert found.cov.shape == (0, 2, 2)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"radius_px": 0.5}, "radius_px"),
        ({"radius_px": []}, "radius_px"),
        ({"radius_px": [3, np.nan]}, "radius_px"),
        ({"radius_px": "large"}, "radius_px"),
        ({"polarity": "black"}, "dark, bright"),
        ({"merit_max": 0}, "merit_max"),
        ({"refine": "centroid"}, "refine must be one of .*bowl"),
        ({"max_spots": -1}, "max_spots"),
        ({"min_depth": np.nan}, "min_depth"),
        ({"min_quality": -1}, "min_quality"),
    ],
)
def test_wrong_options_are_named(options, word):
    with pytest.raises(ValueError, match=word):
        wm.detect(np.zeros((20, 20)), **{"radius_px": 3.0, **options})
