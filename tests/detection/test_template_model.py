"""The image of a disc: against supersampling, derivatives against differences, the kernel against its readable twin."""

import numpy as np
import pytest

from windmark.detection.template._kernels.model import SHAPE, disc_sums, evaluate, points_needed
from windmark.detection.template._kernels.state import shape_of
from windmark.detection.template.disc_model import UNKNOWNS, disc, patch_model, shape_matrix
from windmark.detection.template.result import ellipses

HALF = 12
LATTICE = np.arange(-HALF, HALF + 1.0)
CASES = [  # axes, angle, blur, centre
    ((3.0, 3.0), 0.0, 0.7, (0.3, -0.2)),
    ((2.0, 1.0), 0.9, 0.5, (-0.45, 0.1)),
    ((5.0, 2.5), -0.6, 1.2, (0.0, 0.5)),
    ((1.0, 1.0), 0.0, 0.4, (0.21, 0.37)),
    ((6.5, 5.0), 1.4, 0.9, (-0.3, -0.3)),
]


def unknowns(axes, angle, blur, centre, slope=(0.0, 0.0), depth=0.7, background=1.0):
    shape = shape_matrix(axes, angle)
    return np.array([*centre, shape[0, 0], shape[0, 1], shape[1, 1], blur, depth, background, *slope])


def supersampled(p, sub=25):
    """Light times paint on sub-pixels inside or outside the ellipse, blurred by a plain sum over a Gaussian kernel."""
    from scipy.special import ndtr

    fine = (np.arange(sub * LATTICE.size) + 0.5) / sub - 0.5 - HALF
    x, y = np.meshgrid(fine, fine)
    matrix = np.array([[p[2], p[3]], [p[3], p[4]]])
    q = np.linalg.solve(matrix, np.stack([x - p[0], y - p[1]]).reshape(2, -1))
    rho = np.sqrt((q**2).sum(0)).reshape(x.shape)
    gradient = np.linalg.solve(matrix, q / np.maximum(rho.ravel(), 1e-9)).reshape(2, *x.shape)
    cover = np.clip(0.5 + (1.0 - rho) / np.hypot(*gradient) * sub / np.abs(gradient / np.hypot(*gradient)).sum(0), 0, 1)
    loss = p[6] * cover * (1.0 + p[8] * x + p[9] * y)
    d = fine - LATTICE[:, None]
    weight = (ndtr((d + 0.5) / p[5]) - ndtr((d - 0.5) / p[5])) / sub
    light = 1.0 + p[8] * LATTICE[None, :] + p[9] * LATTICE[:, None]
    return p[7] * light - weight @ loss @ weight.T


@pytest.mark.parametrize("case", CASES)
def test_disc_as_supersampled(case):
    p = unknowns(*case)
    image, _ = patch_model(LATTICE, LATTICE, p)
    assert np.abs(image - supersampled(p)).max() < 1e-4


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("slope", [(0.05, 0.0), (-0.03, 0.04)])
def test_light_that_falls_off_as_supersampled(case, slope):
    """The coupling of light and blur is right but for the box's higher moments: below 1e-3 of the depth."""
    p = unknowns(*case, slope=slope)
    image, _ = patch_model(LATTICE, LATTICE, p)
    assert np.abs(image - supersampled(p)).max() < 1e-3
    plain = p[7] * (light := 1 + slope[0] * LATTICE + slope[1] * LATTICE[:, None]) - p[6] * light * disc(
        LATTICE, LATTICE, p
    )[0]  # fmt: skip
    assert np.abs(image - supersampled(p)).max() < 0.25 * np.abs(plain - supersampled(p)).max()


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("photometry", ["multiplicative", "additive"])
def test_derivatives_are_differences(case, photometry):
    p = unknowns(*case, slope=(0.02, -0.03))
    _, jac = patch_model(LATTICE, LATTICE, p, photometry=photometry)
    for k, name in enumerate(UNKNOWNS):
        h = 1e-5 * np.eye(10)[k]
        plus, minus = (patch_model(LATTICE, LATTICE, p + s * h, photometry=photometry, points=120)[0] for s in (1, -1))
        np.testing.assert_allclose(jac[k], (plus - minus) / 2e-5, atol=2e-7, err_msg=name)


def uncoupled(p):
    """The kernel's centre c' from the disc's: c = c' + (blur^2 + 1/12) slope / light(c')."""
    q = p.copy()
    for _ in range(50):
        q[:2] = p[:2] - (p[5] ** 2 + 1 / 12) * p[8:] / (1 + p[8:] @ q[:2])
    return q


def centred(q):
    """The other way round."""
    p = q.copy()
    p[:2] += (q[5] ** 2 + 1 / 12) * q[8:] / (1 + q[8:] @ q[:2])
    return p


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.03, -0.02)])
@pytest.mark.parametrize("multiplicative", [1.0, 0.0])
def test_the_kernel_is_its_twin(case, slope, multiplicative):
    """Residuals to 1e-4 of the depth; on slopes 5e-4, as the kernel leaves out what is quadratic in the slope."""
    p = unknowns(*case, slope=slope)
    photometry = "multiplicative" if multiplicative else "additive"
    image, jac = patch_model(LATTICE, LATTICE, p, photometry=photometry)
    q = p.copy()
    if multiplicative:
        q = uncoupled(p)
        chain = np.array([centred(q + h) - centred(q - h) for h in 1e-6 * np.eye(10)]) / 2e-6
        jac = np.tensordot(chain, jac, axes=1)
    size = LATTICE.size
    got_jac, got_res, table = np.zeros((10, size, size)), np.zeros((size, size)), np.zeros((8, size + 6))
    patch, weight = np.zeros((size, size)), np.ones((size, size))
    cost = evaluate(patch, weight, q, points_needed(q), True, 0.0, multiplicative, table, got_jac, got_res)
    sloping = 1.0 if any(slope) and multiplicative else 0.0
    assert np.abs(-got_res - image).max() < 1e-4 + 4e-4 * sloping
    assert cost == pytest.approx((got_res**2).sum())
    for k in range(10):
        assert np.abs(got_jac[k] - jac[k]).max() < (3e-4 + 0.01 * sloping) * max(1.0, np.abs(jac[k]).max()), UNKNOWNS[k]


def test_weights_leave_pixels_out_and_tukeys_cost_is_bounded():
    p = unknowns(*CASES[0])
    size, rng = LATTICE.size, np.random.default_rng(1)
    patch = patch_model(LATTICE, LATTICE, p)[0] + rng.normal(0, 0.01, (size, size))
    weight = (rng.uniform(size=(size, size)) < 0.8).astype(float)
    patch[weight == 0] = 1e6
    patch[3, 3], weight[3, 3] = 5.0, 1.0
    jac, res, table = np.zeros((10, size, size)), np.zeros((size, size)), np.zeros((8, size + 6))
    cut = 1.0 / (4.685 * 0.01) ** 2
    cost = evaluate(patch, weight, p, points_needed(p), True, cut, 1.0, table, jac, res)
    assert (res[weight == 0] == 0).all()
    assert (jac[:, weight == 0] == 0).all()
    assert res[3, 3] == 0
    assert 1 / (3 * cut) < cost < 1 / (3 * cut) + (weight.sum() * 0.012**2)


def test_a_patch_that_the_disc_leaves_on_any_side():
    """Sums over the outline also hold where part of it, or all of it, lies outside the patch."""
    size = LATTICE.size
    table = np.zeros((8, size + 6))
    for centre in ((-13.0, 0.0), (13.0, 1.0), (0.0, -12.5), (2.0, 12.0), (-30.0, 0.0), (0.0, 40.0), (11.0, -11.0)):
        p = unknowns((3.0, 2.0), 0.4, 0.7, centre)
        g = np.zeros((10, size, size))
        disc_sums(p, 200, SHAPE, table, g)
        image, derivatives = disc(LATTICE, LATTICE, p)
        assert np.abs(g[6] - image).max() < 1e-4
        assert np.abs(g[:6] - derivatives).max() < 4e-4


def test_state_and_model_parameters():
    """Moments and volume against the ellipse, and their derivatives against differences."""
    shape, blur, depth = shape_matrix([3.0, 1.5], 0.5), 0.8, 40.0
    moments = shape @ shape / 4 + blur**2 * np.eye(2)
    volume = depth * np.linalg.det(shape)
    u = np.array([0.1, 0.2, moments[0, 0], moments[0, 1], moments[1, 1], blur**2, volume, 100.0, 0.0, 0.0])
    p, t = np.zeros(10), np.zeros((5, 5))
    shape_of(u, p, t)
    np.testing.assert_allclose(p[2:7], [shape[0, 0], shape[0, 1], shape[1, 1], blur, depth])
    for k in range(5):
        low, high, scratch = np.zeros(10), np.zeros(10), np.zeros((5, 5))
        h = 1e-6 * np.eye(10)[2 + k]
        shape_of(u - h, low, scratch)
        shape_of(u + h, high, scratch)
        np.testing.assert_allclose(t[:, k], (high - low)[2:7] / 2e-6, rtol=1e-5, atol=1e-6)


def test_ellipses_from_their_matrices():
    axes, angle = np.array([[4.0, 2.0], [3.0, 2.9], [2.0, 1.0]]), np.array([0.3, -1.2, 1.5])
    shape = shape_matrix(axes, angle)
    got_axes, got_angle = ellipses(np.column_stack([shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]]))
    np.testing.assert_allclose(got_axes, axes)
    np.testing.assert_allclose(got_angle, angle)


def test_unknown_photometry_is_named():
    with pytest.raises(ValueError, match="photometry must be"):
        patch_model(LATTICE, LATTICE, unknowns(*CASES[0]), photometry="reflective")
