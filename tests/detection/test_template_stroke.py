"""Lines across markers: fitted with the disc, so that they do not move its centre."""

import numpy as np
import pytest

from windmark.detection.template._kernels.stroke import stroke
from windmark.detection.template.disc_model import shape_matrix
from windmark.detection.template.doubt import larger
from windmark.detection.template.refine import refine_template
from windmark.detection.template.result import CONTAMINATED
from windmark.detection.template.stroke import _centred, _Window

GRID = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2)
PITCH, SUB, BLUR = 40, 9, 0.8


def crossed(seed, *, lines, photometry="multiplicative", radius=3.5, noise=3.0, kind="line"):
    """40 markers; the first `lines` have a line of 1 to 2.5 px across or a blot on the rim.

    Image, centres; all drawn on sub-pixels.
    """
    from scipy.special import ndtr

    rng = np.random.default_rng(seed)
    image, xy = np.empty((5 * PITCH, 8 * PITCH)), PITCH * GRID + PITCH // 2 + rng.uniform(-0.5, 0.5, (40, 2))
    fine = (np.arange(SUB * PITCH) + 0.5) / SUB - 0.5
    d = fine - np.arange(PITCH)[:, None]
    weight = (ndtr((d + 0.5) / BLUR) - ndtr((d - 0.5) / BLUR)) / SUB
    weight /= weight.sum(axis=1, keepdims=True)
    for k, (i, j) in enumerate(GRID):
        x, y = np.meshgrid(fine - (xy[k, 0] - PITCH * i), fine - (xy[k, 1] - PITCH * j))
        matrix = shape_matrix(radius * np.array([1.0, rng.uniform(0.6, 1.0)]), rng.uniform(0, np.pi))
        inside = (np.linalg.solve(matrix, np.stack([x, y]).reshape(2, -1)) ** 2).sum(0).reshape(x.shape) <= 1.0
        turn, offset, wide = rng.uniform(0, np.pi), rng.uniform(-0.8, 0.8) * radius, rng.uniform(0.5, 1.25)
        strength = rng.uniform(0.2, 0.6) if k < lines else 0.0
        along = np.cos(turn) * x + np.sin(turn) * y - offset
        if kind == "line":
            on = np.abs(along) < wide
        elif kind == "shadow":
            on = np.clip(0.5 + along / wide, 0.0, 1.0)
        else:
            rim = matrix @ [np.cos(turn), np.sin(turn)]
            on = np.hypot(x - rim[0], y - rim[1]) < 0.3 * radius
        if photometry == "multiplicative":
            paint = 200.0 * (1.0 - 0.7 * inside) * (1.0 - strength * on)
        else:
            paint = 100.0 + 100.0 * inside + 60.0 * strength * on
        image[PITCH * j : PITCH * (j + 1), PITCH * i : PITCH * (i + 1)] = weight @ paint @ weight.T
    return image + rng.normal(0, noise, image.shape), xy


@pytest.mark.parametrize("photometry", ["multiplicative", "additive"])
def test_centres_of_crossed_markers_are_as_good_as_their_covariance(photometry):
    """Weights alone leave 0.1 to 0.2 px; all of them are flagged, and the covariance says how good they are."""
    error, z, plain_error = [], [], []
    polarity = "dark" if photometry == "multiplicative" else "bright"
    for seed in range(3):
        image, xy = crossed(seed, lines=8, photometry=photometry)
        options = {"photometry": photometry, "polarity": polarity}
        fits, plain = (refine_template(image, xy[::-1], 3.2, robust=r, **options) for r in (True, False))
        found = (fits.flags[::-1] & CONTAMINATED > 0)[:8]
        assert found.mean() > 0.6
        e = (fits.xy[::-1] - xy)[:8][found]
        error += np.hypot(*e.T).tolist()
        z += (e / np.sqrt(fits.cov[::-1][:8][found][:, [0, 1], [0, 1]])).ravel().tolist()
        plain_error += np.hypot(*(plain.xy[::-1] - xy)[:8][found].T).tolist()
    assert np.median(error) < 0.06
    assert np.median(error) < 0.5 * np.median(plain_error)
    assert 0.4 < 1.4826 * np.median(np.abs(z)) < 1.6


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("power", [-110, 100])
def test_the_unit_of_the_grey_levels_does_not_matter(power):
    """Squares of 1e-30 are nothing in floats of 32 bits, and those of 1e30 have no end."""
    image, xy = crossed(1, lines=8)
    plain, other = (refine_template(part, xy, 3.2, robust=True) for part in (image, np.ldexp(image, power)))
    assert plain.crossed.any()
    np.testing.assert_allclose(other.xy, plain.xy, atol=1e-6)


def test_markers_without_line_are_left_alone():
    image, xy = crossed(9, lines=0)
    robust, plain = (refine_template(image, xy, 3.2, robust=r) for r in (True, False))
    clean = plain.flags == 0
    assert clean.mean() > 0.9
    np.testing.assert_array_equal(robust.xy[clean], plain.xy[clean])


@pytest.mark.slow
def test_what_is_not_fitted_as_a_line_is_not_trusted():
    """A blot on the rim pulls the centre as a whole: least squares' covariance makes it 2 to 4 sigma."""
    z = []
    for seed in range(30, 34):
        image, xy = crossed(seed, lines=8, kind="blot", radius=5.0)
        fits = refine_template(image, xy[::-1], 4.6)
        blotted = ((fits.flags & CONTAMINATED > 0) & ~fits.crossed)[::-1]
        assert blotted[8:].mean() < 0.1
        e = (fits.xy[::-1] - xy)[:8][blotted[:8]]
        z += (e / np.sqrt(fits.cov[::-1][:8][blotted[:8]][:, [0, 1], [0, 1]])).ravel().tolist()
    assert len(z) > 20
    assert 0.1 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_the_larger_of_two_covariances_is_so_in_every_direction():
    rng = np.random.default_rng(5)
    a, b = (m @ np.swapaxes(m, 1, 2) for m in rng.normal(size=(2, 50, 2, 2)))
    both = larger(a, b)
    for one in (a, b):
        assert (np.linalg.eigvalsh(both - one) > -1e-9).all()
    np.testing.assert_allclose(larger(a, 0.5 * a), a, rtol=1e-9)
    np.testing.assert_allclose(larger(a, 2.0 * a), 2.0 * a, rtol=1e-9)
    assert np.isnan(larger(np.full((1, 2, 2), np.nan), b[:1])).all()


@pytest.mark.slow
def test_the_centre_of_a_disc_half_in_shadow_is_as_good_as_its_covariance():
    """Least squares takes the shadow for a slope of the light: 0.1 to 1 px off."""
    error, z, plain_error = [], [], []
    for seed in range(50, 53):
        image, xy = crossed(seed, lines=8, kind="shadow", radius=4.5)
        fits, plain = (refine_template(image, xy[::-1], 4.2, robust=r) for r in (True, False))
        found = fits.crossed[::-1][:8]
        assert found.mean() > 0.6
        assert not fits.crossed[::-1][8:].any()
        e = (fits.xy[::-1] - xy)[:8][found]
        error += np.hypot(*e.T).tolist()
        z += (e / np.sqrt(fits.cov[::-1][:8][found][:, [0, 1], [0, 1]])).ravel().tolist()
        plain_error += np.hypot(*(plain.xy[::-1] - xy)[:8][found].T).tolist()
    assert np.median(error) < 0.05 < 0.3 * np.median(plain_error)
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.3


@pytest.mark.parametrize("edge", [False, True])
@pytest.mark.parametrize("multiplicative", [True, False])
def test_derivatives_are_differences(multiplicative, edge):
    """Of the fourteen unknowns; the kernel's derivatives by the slope are right to a per cent."""
    rng = np.random.default_rng(2)
    window = _Window(rng.normal(100, 1, (25, 25)), np.ones((25, 25)), 0.8, 0.1, 2.0, 60.0, multiplicative)
    v = np.array([0.2, -0.1, 3.0, 0.3, 2.5, 0.8, 60.0, 100.0, 0.01, -0.005, 0.7, 1.2, 0.4, np.log(0.9)])
    _, jac = window.model(v, edge)
    steps = np.array([1e-3] * 6 + [0.1, 0.1, 1e-5, 1e-5] + [1e-4] * 4)
    for k, h in enumerate(steps):
        high, low = (window.model(v + s * h * np.eye(14)[k], edge)[0] for s in (1, -1))
        slack = 0.02 if k < 10 else 2e-4
        assert np.abs(jac[k] - (high - low) / (2 * h)).max() < slack * np.abs(jac[k]).max() + 1e-6, k


def test_a_wide_stroke_takes_away_all_and_its_rims_are_blurred():
    image, turned = np.empty((2, 41, 41))
    for direction, out in ((0.0, image), (np.pi / 2, turned)):
        parts = np.empty((4, 41, 41))
        stroke(False, direction, 3.0, np.log(8.0), 0.5, parts)
        out[:] = parts[0]
    assert image[20, 23] == pytest.approx(1.0)
    assert image[20, 31] == pytest.approx(0.5, abs=0.01)
    assert image[20, 5] < 1e-6
    np.testing.assert_allclose(turned, image.T, atol=1e-12)


def test_the_discs_own_centre_comes_back():
    """On a slope the kernel's centre is (blur^2 + 1/12) slope off."""

    class Paint:
        multiplicative = True

    v = np.array([0.0, 0.0, 3.0, 0.0, 3.0, 0.8, 60.0, 100.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    params, cov = _centred(v, np.eye(14), Paint())
    assert params[0] == pytest.approx((0.64 + 1 / 12) * 0.02)
    assert cov.shape == (10, 10)
