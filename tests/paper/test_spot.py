"""The paper's study of SPOT's uncertainty (AIAA 2005-5007, section II.C, figures 3 and 4).

Virtual markers are averages over 11 x 11 sub-pixels, blurred by repeated 3 x 3 means; radius within 0.5 px of the
reference radius, centre and viewing angle at random. "Uncertainty" is twice the RMS of one coordinate.
"""

from functools import partial

import numpy as np
import pytest

import windmark as wm

spot = partial(wm.detect, refine="bowl")

SUB = (np.arange(11) - 5) / 11.0


def virtual_marker(rng, n, radius, blur, noise, tilt_max_deg=45.0):
    """One marker of depth 1 in an n x n image: image and centre."""
    x, y = n / 2 + rng.uniform(-0.5, 0.5, 2)
    turn, cos_tilt = rng.uniform(0, np.pi), np.cos(np.radians(rng.uniform(0, tilt_max_deg)))
    near = slice(n // 2 - int(radius) - 3, n // 2 + int(radius) + 4)
    axis = (np.arange(n)[near, None] + SUB).ravel()
    u, v = np.meshgrid(axis - x, axis - y)
    s, t = u * np.cos(turn) + v * np.sin(turn), (v * np.cos(turn) - u * np.sin(turn)) / cos_tilt
    size, image = len(axis) // 11, np.ones((n, n))
    image[near, near] -= (s * s + t * t <= radius * radius).reshape(size, 11, size, 11).mean(axis=(1, 3))
    for _ in range(blur):
        padded = np.pad(image, 1, mode="edge")
        image = sum(padded[i : i + n, j : j + n] for i in range(3) for j in range(3)) / 9.0
    return image + rng.normal(0, noise, (n, n)), (x, y)


def uncertainty(r0, radii, *, blur=1, noise=0.03, count=144, seed=0):
    """2 RMS per coordinate and the share of markers found, over `count` markers with radii from `radii`."""
    rng = np.random.default_rng(seed)
    n, errors = int(5 * r0) + 22, []
    for k in range(count):
        image, centre = virtual_marker(rng, n, radii[k % len(radii)], blur, noise)
        found = spot(image, radius_px=r0, max_spots=1)
        if len(found):
            errors.append(found.xy[0] - centre)
    return 2.0 * np.sqrt(np.mean(np.square(errors))), len(errors) / count


@pytest.mark.parametrize(("r0", "limit"), [(3.0, 0.055), (4.0, 0.045), (5.0, 0.045)])
def test_uncertainty_is_below_a_tenth_of_a_pixel_from_radius_3(r0, limit):
    """The paper promises 0.1 px from r = 3 on with noise and blur; 0.047 px was measured here at r0 = 3."""
    value, found = uncertainty(r0, r0 + np.linspace(-0.5, 0.5, 11))
    assert value < limit < 0.1
    assert found > 0.9


def test_uncertainty_falls_with_the_radius():
    values = [uncertainty(r0, r0 + np.linspace(-0.3, 0.3, 7))[0] for r0 in (2.0, 3.0, 5.0)]
    assert values[0] > values[1] > values[2]


def test_uncertainty_with_a_tenth_noise():
    value, found = uncertainty(3.0, [2.7, 2.9, 3.1], noise=0.1, seed=1)
    assert value < 0.17
    assert found > 0.9


def test_a_reference_radius_that_is_too_small_costs_more_than_one_too_large():
    """Error grows when the real radius is greater than the reference radius, by the paper's advice not the reverse."""
    too_small = uncertainty(2.5, [3.0], noise=0.05, seed=2)[0]
    too_large = uncertainty(3.5, [3.0], noise=0.05, seed=2)[0]
    assert too_small > too_large


def test_merit_07_keeps_radii_of_a_fifth_round_the_reference_and_no_taps():
    """What one reference radius finds of flat markers; where this ends several radii are needed."""
    rng = np.random.default_rng(3)
    share = {}
    for radius in (1.3, 2.4, 3.0, 3.8, 5.0):
        seen = [virtual_marker(rng, 40, radius, 1, 0.02, tilt_max_deg=20)[0] for _ in range(20)]
        share[radius] = np.mean([len(spot(image, radius_px=3.0)) for image in seen])
    assert share[2.4] == share[3.0] == share[3.8] == 1.0
    assert share[1.3] == share[5.0] == 0.0
