"""The radius that an image prefers: not that of dust, of specks in cut-off black, or of one large fitting."""

from itertools import pairwise

import numpy as np
import pytest

from windmark.detection import estimate_radius, radius
from windmark.synth import marker_scene


def share(estimate, radius):
    """Whether a radius is found by searching with the estimate's."""
    return any(0.8 < radius / r < 1.25 for r in estimate.radii_px)


@pytest.mark.parametrize("seed", range(41, 47))
def test_scenes_of_all_kinds_and_sizes(seed):
    rng = np.random.default_rng(seed)
    low = float(np.exp(rng.uniform(np.log(1.8), np.log(9))))
    kind = ("clean", "cluttered", "infrared")[seed % 3]
    size = {} if kind == "infrared" else {"size_px": (900, 900)}
    scene = marker_scene(seed, kind, radius_px=(low, 1.4 * low), max_tilt_deg=40, **size)
    got = estimate_radius(scene.image, scene.polarity)
    assert got.spots >= 0.8 * len(scene.xy)
    for q in (0.1, 0.5, 0.9):
        assert share(got, np.quantile(scene.radius_px, q) * np.cos(np.radians(20)) ** 0.5)


def test_specks_of_one_grey_level_in_cut_off_black_do_not_speak(draw):
    """Where a camera has cut off black there is no noise, and any speck is perfect: 300 of them beside 12 discs."""
    rng = np.random.default_rng(1)
    centres = 40.0 + 60.0 * np.stack(np.meshgrid(np.arange(4), np.arange(3)), -1).reshape(-1, 2)
    light = draw((220, 300), np.column_stack([centres, np.full(12, 9.0)]), blur=1) + rng.normal(0, 3, (220, 300))
    image = np.zeros((220, 800))
    image[:, :300] = light
    image[:, 300:] = 255
    for x, y in np.column_stack([rng.uniform(310, 790, 300), rng.uniform(5, 215, 300)]).astype(int):
        image[y : y + 2, x : x + 2] = 254
    got = estimate_radius(np.clip(np.round(image), 0, 255).astype(np.uint8))
    assert share(got, 9.0)
    assert got.spots == 12


def test_saturated_discs_count(draw):
    """Bright discs cut off at white know their size."""
    rng = np.random.default_rng(2)
    centres = 30.0 + 40.0 * np.stack(np.meshgrid(np.arange(4), np.arange(4)), -1).reshape(-1, 2)
    image = 350.0 - draw((190, 190), np.column_stack([centres, np.full(16, 5.0)]), background=340, depth=330)
    image = np.clip(np.round(image + rng.normal(0, 1, image.shape)), 0, 255).astype(np.uint8)
    got = estimate_radius(image, "bright")
    assert share(got, 5.0)
    assert got.spots == 16


def test_a_rival_is_named(draw):
    rng = np.random.default_rng(3)
    at = 40.0 + 50.0 * np.stack(np.meshgrid(np.arange(6), np.arange(6)), -1).reshape(-1, 2)
    radius = np.where(np.arange(36) < 5, 10.0, 3.0)
    image = draw((330, 330), np.column_stack([at, radius]), blur=1) + rng.normal(0, 1, (330, 330))
    got = estimate_radius(image)
    assert share(got, 10.0) != share(got, 3.0)
    assert "much speaks for" in got.reason


@pytest.mark.parametrize("side", [5, 12, 100, 480, 4000])
def test_the_radii_that_are_tried_leave_no_size_between_them(side):
    """Each measures half to twice its own size; the last one reaches the largest that the picture can show."""
    radii = radius.trials(side)
    assert radii[0] == radius.SMALLEST_PX
    assert all(0 < b / a <= 2 for a, b in pairwise(radii))
    largest = min(radius.LARGEST_PX, side / radius.SHARE_OF_SIDE)
    assert 2 * radii[-1] >= largest
    assert radii[-1] <= max(2 * largest, 2 * radius.SMALLEST_PX)


@pytest.mark.parametrize(
    ("low", "high", "mode"), [(5.0, 5.5, 5.2), (4.0, 9.0, 5.0), (2.0, 30.0, 3.0), (0.7, 0.8, 0.75)]
)
def test_the_radii_of_a_search_cover_the_sizes(low, high, mode):
    """One finds 0.8 to 1.2 of its own, and rather too large than too small."""
    found = radius.search_radii(low, high, mode)
    for size in np.geomspace(max(low, 1.0), max(high, 1.0), 50):
        assert any(0.75 * r <= size <= 1.25 * r for r in found), size
    assert list(found) == sorted(set(found))
    assert found[-1] >= 0.95 * high
    assert min(found) >= 1.0
    assert (len(found) == 1) == (high / mode < 1.15 and low / mode > 0.85)


def test_a_size_ends_at_the_foot_of_its_peak():
    at = np.linspace(0.0, 3.0, 301)

    def peaks(*of):
        return sum(h * np.exp(-0.5 * ((at - m) / 0.12) ** 2) for m, h in of)

    first, last = radius._foot(at, alone := peaks((1.5, 1.0)), 150)
    for end in (first, last):  # where a tenth of the peak is left
        assert alone[round(100 * end)] == pytest.approx(0.1, abs=0.03)
    density = peaks((1.0, 1.0), (1.5, 0.9))
    first, last = radius._foot(at, density, 100)
    assert last == pytest.approx(1.25, abs=0.02)  # the valley between two sizes
    shallow = peaks((1.0, 1.0), (1.25, 0.9))
    assert radius._foot(at, shallow, int(shallow.argmax()))[1] > 1.3  # no valley: one size
    assert radius._foot(at, np.ones(301), 150) == (-np.inf, np.inf)
