"""The Cramer-Rao bound: published factors, what it depends on, an independent computation."""

import numpy as np
import pytest

from windmark.detection.template.crlb import bound_factor, centre_bound, covariance_bound, window_radius
from windmark.synth import disc_image

COLUMNS = [(0, 0.4), (0, 0.7), (0, 1.0), (0, 1.5), (45, 0.7), (45, 1.0), (60, 0.7), (60, 1.0)]  # tilt, blur
FACTORS = {
    2: (0.585, 0.730, 0.922, 1.407, 0.835, 1.111, 1.030, 1.433),
    3: (0.475, 0.592, 0.698, 0.910, 0.651, 0.788, 0.766, 0.959),
    5: (0.353, 0.449, 0.548, 0.659, 0.490, 0.594, 0.568, 0.689),
    8: (0.273, 0.343, 0.410, 0.518, 0.377, 0.449, 0.437, 0.520),
}  # k of "one standard deviation per axis = k noise / depth", computed by other code


@pytest.mark.parametrize("radius", FACTORS)
def test_factors_as_tabulated(radius):
    got = [bound_factor(radius, tilt, blur, samples=32) for tilt, blur in COLUMNS]
    np.testing.assert_allclose(got, FACTORS[radius], rtol=0.004)


@pytest.mark.parametrize("photometry", ["multiplicative", "additive"])
def test_the_same_from_differences_of_drawn_images(photometry):
    """No formula of the template: images of `disc_image`, differences, a plain inverse."""
    axes, angle, blur, size = np.array([4.0, 2.6]), 0.4, 0.8, 41
    slope = (0.02, -0.01) if photometry == "multiplicative" else (0.0, 0.0)
    start = np.array([20.2, 19.7, 4.0, 2.6, 0.4, blur, 60.0, 100.0, *slope])

    def image(p):
        level, fall = p[7], (p[8], p[9])
        if photometry == "additive":  # the disc does not see the slope
            disc = disc_image((size, size), p[:2], p[2:4], p[4], level=0.0, depth=p[6], blur_px=p[5], subpixels=9)
            x, y = np.meshgrid(np.arange(size) - 20.2, np.arange(size) - 19.7)
            return disc + level + fall[0] * x + fall[1] * y
        return disc_image((size, size), p[:2], p[2:4], p[4], level=level, depth=p[6], slope=fall, blur_px=p[5],
                          subpixels=9)  # fmt: skip

    steps = np.array([0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.1, 0.1, 1e-4, 1e-4])
    jac = np.array([(image(start + h) - image(start - h)) / (2 * h.sum()) for h in np.diag(steps)])
    x, y = np.meshgrid(np.arange(size) - 20.2, np.arange(size) - 19.7)
    rows = jac[:, np.hypot(x, y) <= float(window_radius(4.0, blur))]
    scale = np.linalg.norm(rows, axis=1)
    slow = (np.linalg.inv((rows / scale[:, None]) @ (rows / scale[:, None]).T) / np.outer(scale, scale))[:2, :2] * 9.0
    fall = 1.0 - np.dot(slope, (0.2, -0.3)) if photometry == "multiplicative" else 1.0  # light at the pixel's middle
    got = centre_bound(
        axes, angle, blur_px=blur, depth=60.0 * fall, noise=3.0, background=100.0 * fall,
        slope=tuple(np.array(slope) / fall), xy=(0.2, -0.3), photometry=photometry,
    )  # fmt: skip
    np.testing.assert_allclose(got, slow, rtol=2e-3, atol=2e-3 * slow[0, 0])


def test_proportional_to_noise_over_depth():
    one = centre_bound(3.0, blur_px=0.7, depth=10.0, noise=1.0)
    np.testing.assert_allclose(centre_bound(3.0, blur_px=0.7, depth=50.0, noise=2.0), one * 0.4**2, atol=1e-12)


def test_what_is_known_can_only_help_and_by_symmetry_hardly_does():
    free = np.trace(centre_bound([4.0, 2.5], 0.3, blur_px=0.8))
    shape_known = np.trace(centre_bound([4.0, 2.5], 0.3, blur_px=0.8, known=(2, 3, 4, 5, 6)))
    slope_known = np.trace(centre_bound([4.0, 2.5], 0.3, blur_px=0.8, known=(8, 9)))
    assert 0.995 * free < shape_known <= free
    assert 0.80 * free < slope_known < 0.95 * free


def test_a_larger_window_helps_and_one_of_two_radii_may_lose_much():
    small, usual, large = (np.trace(centre_bound(2.0, blur_px=1.5, window_px=w)) for w in (4.0, 9.75, 20.0))
    assert large < usual < small
    assert np.sqrt(small / usual) > 1.2


def test_many_jacobians_at_once():
    jac = np.random.default_rng(0).normal(size=(3, 4, 50))
    got = covariance_bound(jac, 2.0)
    for k in range(3):
        np.testing.assert_allclose(got[k], 4.0 * np.linalg.inv(jac[k] @ jac[k].T))


@pytest.mark.parametrize("wrong", [{"depth": 0.0}, {"noise": 0.0}, {"blur_px": 0.0}, {"window_px": -1.0}])
def test_what_has_no_bound_is_refused(wrong):
    with pytest.raises(ValueError, match="centre_bound"):
        centre_bound(3.0, **{"blur_px": 0.7, **wrong})
    with pytest.raises(ValueError, match="photometry"):
        centre_bound(3.0, blur_px=0.7, photometry="emissive")


def test_unknowns_that_pixels_do_not_tell_apart_have_no_bound():
    rng = np.random.default_rng(2)
    good = rng.normal(size=(3, 40))
    alike = good.copy()
    alike[2] = 5 * alike[0]
    blind = good.copy()
    blind[1] = 0
    got = covariance_bound(np.stack([good, alike, blind]), 0.5)
    np.testing.assert_allclose(got[0], covariance_bound(good, 0.5))
    assert np.isinf(got[1:]).all()
