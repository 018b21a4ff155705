"""What was rejected and why; masks; dead pixels; the radius that an image prefers."""

import numpy as np
import pytest

import windmark as wm
from windmark.detection import REASONS, estimate_radius, explain, merit_map
from windmark.detection.rejected import FAINT, SHALLOW, SHAPE, SMALL, SURPLUS
from windmark.scene import FLAGS

CONTAMINATED = next(bit for bit, name in FLAGS.items() if name == "contaminated")


@pytest.fixture
def wall(draw):
    """A marker at (30, 30), a tap, a large disc, a faint disc; noise 1.5."""
    rng = np.random.default_rng(0)
    shape = (100, 240)
    image = draw(shape, [(30, 30, 3.0), (70, 30, 1.1), (120, 40, 4.6)], blur=1)
    image += draw(shape, [(160, 30, 3.0)], depth=6) - 100
    return image + rng.normal(0, 1.5, shape)


def at(rejected, x, y):
    """Index of the candidate at a place; there is exactly one."""
    near = np.flatnonzero(np.hypot(rejected.xy[:, 0] - x, rejected.xy[:, 1] - y) < 2.0)
    assert len(near) == 1, f"{len(near)} candidates at ({x}, {y})"
    return int(near[0])


def test_every_reject_has_its_reason(wall):
    found, rejected = explain(wall, radius_px=3.0, refine="bowl")
    np.testing.assert_allclose(found.xy, [[30, 30]], atol=0.1)
    assert rejected.reason[at(rejected, 70, 30)] == SMALL
    assert rejected.reason[at(rejected, 120, 40)] == SHAPE
    assert rejected.reason[at(rejected, 160, 30)] == FAINT
    assert rejected.merit[at(rejected, 120, 40)] > 0.7
    assert rejected.words[at(rejected, 160, 30)] == REASONS[FAINT]
    assert np.hypot(*(rejected.xy - [30, 30]).T).min() > 4.5  # no news of the marker itself


@pytest.mark.parametrize(
    "options", [{"radius_px": 3.0}, {"radius_px": [2, 3, 4.5]}, {"radius_px": 3, "merit_max": 0.4}]
)
def test_explaining_changes_nothing(wall, options):
    found, plain = explain(wall, **options)[0], wm.detect(wall, **options)
    np.testing.assert_array_equal(found.xy, plain.xy)
    np.testing.assert_array_equal(found.cov, plain.cov)


def test_options_that_reject_are_named(wall, scene):
    shallow = explain(wall, radius_px=3.0, min_depth=100.0)[1]
    assert shallow.reason[at(shallow, 30, 30)] == SHALLOW
    image, centres = scene
    found, surplus = explain(image, radius_px=3.0, max_spots=10)
    assert len(found) == 10
    assert (surplus.reason == SURPLUS).sum() == len(centres) - 10
    assert len(explain(np.zeros((50, 50)), radius_px=3.0)[1]) == 0
    with pytest.raises(TypeError, match="radius"):
        explain(image, radius=3.0)


def test_mask(scene):
    """Outside the mask nothing is found, inside everything as without it; what it cuts is left out or flagged."""
    image, _ = scene
    use = np.zeros(image.shape, bool)
    use[:, 60:] = True
    for picture in (image, np.round(image).astype(np.uint8)):
        found, every = wm.detect(picture, radius_px=3.0, mask=use), wm.detect(picture, radius_px=3.0)
        assert found.xy[:, 0].min() > 58
        inside = every.xy[every.xy[:, 0] > 60 + 8]
        nearest = np.hypot(*(found.xy[:, None] - inside).transpose(2, 0, 1)).min(axis=0)
        assert nearest.max() < 0.01  # blur and noise are learnt from fewer markers
        assert len(found) - len(inside) == (found.xy[:, 0] <= 68).sum()
    assert len(wm.detect(image, radius_px=3.0, mask=np.zeros(image.shape))) == 0
    everywhere = wm.detect(image, radius_px=3.0, mask=np.full(image.shape, 255))
    np.testing.assert_array_equal(everywhere.xy, wm.detect(image, radius_px=3.0).xy)
    assert np.isnan(merit_map(image, 3.0, mask=use)[:, :55]).all()
    with pytest.raises(ValueError, match=r"mask .*\(260, 180\)"):
        wm.detect(image, radius_px=3.0, mask=use[1:])


def test_a_mask_next_to_markers_does_not_lower_the_noise(draw):
    """A narrow strip between masked halves: white noise in it is still white noise."""
    image = np.random.default_rng(3).normal(100, 5, (400, 400))
    use = np.zeros(image.shape, bool)
    use[:, 190:215] = True
    assert len(wm.detect(image, radius_px=[2, 3, 5], mask=use)) == 0


def test_dead_pixels_of_integer_images(draw):
    """Hot and dead pixels on the paint are no spots; in a marker they leave it where it is, flagged."""
    rng = np.random.default_rng(2)
    image = draw((80, 140), [(40.3, 40.2, 4.0), (100.4, 39.7, 4.0)], blur=1) + rng.normal(0, 1.5, (80, 140))
    image = np.round(image).astype(np.uint8)
    image[40, 40], image[10, 10], image[70, 20], image[20, 70] = 255, 255, 0, 0
    found = wm.detect(image, radius_px=4.0)
    order = np.argsort(found.xy[:, 0])
    np.testing.assert_allclose(found.xy[order], [[40.3, 40.2], [100.4, 39.7]], atol=0.06)
    assert ((found.flags[order] & CONTAMINATED) > 0).tolist() == [True, False]


def test_the_smallest_discs_are_not_dead_pixels(draw):
    image = draw((60, 100), [(x, 30, 1.3) for x in (20.0, 40.5, 60.3, 80.2)]) + np.random.default_rng(0).normal(
        0, 0.5, (60, 100)
    )
    assert len(wm.detect(image, radius_px=1.4)) == 4


@pytest.mark.parametrize("radius", [2.0, 4.0, 11.0])
def test_the_radius_is_found(radius, draw):
    rng = np.random.default_rng(1)
    step = 7 * radius
    grid = np.stack(np.meshgrid(*2 * [np.arange(step / 2, 6 * step, step)]), axis=-1).reshape(-1, 2)
    size = int(6 * step)
    discs = np.column_stack([grid + rng.uniform(-0.5, 0.5, grid.shape), radius * rng.uniform(0.97, 1.03, len(grid))])
    image = draw((size, size), discs, blur=1) + rng.normal(0, 1.5, (size, size))
    estimate = estimate_radius(image)
    assert estimate
    assert estimate.radius_px == pytest.approx(radius, rel=0.07)
    assert estimate.spots >= 0.85 * len(discs)
    assert f"{estimate.radii_px[0]:.1f}" in estimate.reason
    found = wm.detect(image)
    assert len(found) == len(discs)
    assert not estimate_radius(image, "bright")


def test_a_range_of_radii_is_found(draw):
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(*2 * [np.arange(20, 380, 36.0)]), axis=-1).reshape(-1, 2)
    radii = rng.uniform(2.2, 5.0, len(grid))
    image = draw((400, 400), np.column_stack([grid, radii]), blur=1) + rng.normal(0, 1.5, (400, 400))
    estimate = estimate_radius(image)
    assert len(estimate.radii_px) >= 3
    assert 2.0 < estimate.radii_px[0] < 2.6
    assert 4.5 < estimate.radii_px[-1] < 5.6
    assert len(wm.detect(image)) == len(grid)


def test_no_radius_prevails():
    for image in (np.zeros((40, 40)), np.ones((2, 2)), np.random.default_rng(0).normal(0, 1, (200, 200))):
        estimate = estimate_radius(image)
        assert not estimate
        assert "give the radius" in estimate.reason
        assert len(wm.detect(image)) == 0
