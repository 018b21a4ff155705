"""The adjustment against SciPy, OpenCV and Monte-Carlo runs."""

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from windmark.adjust import refine_pose
from windmark.geometry import Camera, Pose

CAMERA = Camera((1280, 800), 1800.0, aspect=1.01, cx=630.0, cy=410.0, k1=-0.1, k2=0.03, p1=1e-3, p2=-5e-4)
TRUTH = Pose.from_rotvec([0.3, -0.4, 1.1], [0.2, -0.1, 8.0])


def scene(seed, n=20, sigma=0.1):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (n, 3)) * [1, 1, 0.4]
    xy = CAMERA.project(TRUTH.apply(xyz))[0] + sigma * rng.normal(size=(n, 2))
    start = Pose.exp(rng.normal(size=6) * [0.02, 0.02, 0.02, 0.05, 0.05, 0.2]) @ TRUTH
    return rng, xyz, xy, start


def random_cov(rng, n):
    a = rng.normal(size=(n, 2, 2)) * 0.1
    return a @ np.swapaxes(a, 1, 2) + 0.002 * np.eye(2)


def whitened(camera, pose, xyz, xy, cov):
    """Residuals by another way than the engine's: inverse of NumPy's Cholesky factor."""
    residual = camera.project(pose.apply(xyz))[0] - xy
    return np.linalg.solve(np.linalg.cholesky(cov), residual[..., None])[..., 0]


def sigmas(estimate, pose, camera):
    delta = np.r_[(estimate.cam_from_model @ pose.inverse()).log(), estimate.camera.focal_px - camera.focal_px]
    return delta[: len(estimate.cov)] / np.sqrt(np.diag(estimate.cov))


@pytest.mark.parametrize("free", [(), ("focal_px",)])
def test_scipy_least_squares(free):
    rng, xyz, xy, start = scene(1)
    cov = random_cov(rng, len(xyz))
    sigma = {"focal_px": 30.0} if free else {}
    start_camera = CAMERA.with_parameters(CAMERA.parameters() * np.r_[1.01, np.ones(14)]) if free else CAMERA
    estimate = refine_pose(start_camera, start, xyz, xy, cov, free=free, prior_sigma=sigma)

    def unpack(x):
        camera = start_camera
        if free:
            camera = camera.with_parameters(np.r_[start_camera.focal_px + 1000 * x[6], camera.parameters()[1:]])
        return camera, Pose.exp(x[:6]) @ start

    def residuals(x):
        camera, pose = unpack(x)
        prior = [1000 * x[6] / 30.0] if free else []
        return np.r_[whitened(camera, pose, xyz, xy, cov).ravel(), prior]

    oracle = least_squares(residuals, np.zeros(6 + len(free)), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    camera, pose = unpack(oracle.x)
    assert estimate.report.final_cost == pytest.approx(oracle.cost, rel=1e-10)
    np.testing.assert_allclose(sigmas(estimate, pose, camera), 0, atol=1e-3)
    if free:
        inverse = np.linalg.inv(oracle.jac.T @ oracle.jac)
        assert estimate.sigma("focal_px") == pytest.approx(1000 * np.sqrt(inverse[6, 6]), rel=1e-4)


COSTS = {
    "huber": lambda r, c: np.where(r <= c, r**2 / 2, c * r - c**2 / 2),
    "cauchy": lambda r, c: c**2 / 2 * np.log1p((r / c) ** 2),
    "tukey": lambda r, c: c**2 / 6 * (1 - np.where(r < c, 1 - (r / c) ** 2, 0) ** 3),
}


@pytest.mark.parametrize("loss", COSTS)
def test_robust_minimum_against_a_general_minimiser(loss):
    """SciPy's BFGS on the textbook cost, without weights and without a least-squares structure."""
    rng, xyz, xy, start = scene(2)
    xy[:4] += rng.normal(size=(4, 2)) * 3
    cov = random_cov(rng, len(xyz)) + 0.01 * np.eye(2)
    estimate = refine_pose(CAMERA, start, xyz, xy, cov, loss=loss, loss_scale=4.0)
    root = np.linalg.cholesky(estimate.cov)  # BFGS wants round valleys

    def cost(x):
        r = np.linalg.norm(whitened(CAMERA, Pose.exp(root @ x) @ estimate.cam_from_model, xyz, xy, cov), axis=1)
        return float(np.sum(COSTS[loss](r, 4.0)))

    assert estimate.report.final_cost == pytest.approx(cost(np.zeros(6)), rel=1e-12)
    oracle = minimize(cost, np.full(6, 0.5), jac="3-point", method="BFGS", options={"gtol": 1e-5})
    assert estimate.report.final_cost <= oracle.fun * (1 + 1e-10)
    np.testing.assert_allclose(oracle.x, 0, atol=1e-3)


def test_opencv_solve_pnp_refine():
    _, xyz, xy, start = scene(3)
    estimate = refine_pose(CAMERA, start, xyz, xy)
    lens = np.array([CAMERA.k1, CAMERA.k2, CAMERA.p1, CAMERA.p2])
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-15)
    rotvec, translation = cv2.solvePnPRefineLM(
        xyz, xy[:, None], CAMERA.matrix, lens, start.rotvec[:, None].copy(), start.translation[:, None].copy(), criteria
    )
    pose = Pose.from_rotvec(rotvec.ravel(), translation.ravel())
    # Sigmas here are those of 1 px; OpenCV stops a little early, so its cost must not be lower.
    np.testing.assert_allclose(sigmas(estimate, pose, CAMERA), 0, atol=1e-4)
    theirs = 0.5 * np.sum((CAMERA.project(pose.apply(xyz))[0] - xy) ** 2)
    assert estimate.report.final_cost <= theirs * (1 + 1e-12)


def monte_carlo(runs, *, seed, free, loss="none", n=15, sigma=0.15):
    """Normalised errors (runs, 6 + F), squared Mahalanobis lengths and sigma0 of many noisy copies of one scene."""
    rng, xyz, _, _ = scene(seed, n=n)
    clean = CAMERA.project(TRUTH.apply(xyz))[0]
    # Correlated and unequal noise: a wrong whitening would show.
    cov = random_cov(rng, n) * (sigma / 0.1) ** 2
    root = np.linalg.cholesky(cov)
    z, d2, sigma0 = [], [], []
    for _ in range(runs):
        xy = clean + (root @ rng.normal(size=(n, 2, 1)))[..., 0]
        estimate = refine_pose(CAMERA, TRUTH, xyz, xy, cov, free=free, loss=loss)
        delta = np.r_[
            (estimate.cam_from_model @ TRUTH.inverse()).log(),
            [getattr(estimate.camera, name) - getattr(CAMERA, name) for name in free],
        ]
        z.append(delta / np.sqrt(np.diag(estimate.cov)))
        d2.append(delta @ np.linalg.solve(estimate.cov, delta))
        sigma0.append(estimate.sigma0)
    return np.array(z), np.array(d2), np.array(sigma0)


@pytest.mark.slow
def test_covariance_of_pose_and_focal_length_is_what_runs_scatter():
    runs = 600
    z, d2, sigma0 = monte_carlo(runs, seed=11, free=("focal_px",))
    assert ((z.std(axis=0) > 0.92) & (z.std(axis=0) < 1.08)).all(), z.std(axis=0)
    assert (np.abs(z.mean(axis=0)) < 4 / np.sqrt(runs)).all(), z.mean(axis=0)
    assert np.mean(d2) == pytest.approx(7, abs=4 * np.sqrt(2 * 7 / runs))  # the correlations too, not sigmas alone
    assert np.mean(d2 < 14.067) == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / runs))
    assert np.mean(sigma0**2) == pytest.approx(1, abs=4 * np.sqrt(2 / 23 / runs))


@pytest.mark.parametrize("loss", ["huber", "tukey"])
def test_covariance_with_a_robust_loss_on_good_data(loss):
    z, d2, sigma0 = monte_carlo(150, seed=12, free=(), loss=loss, n=30)
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.08)
    assert np.mean(d2) == pytest.approx(6, abs=4 * np.sqrt(2 * 6 / 150))
    assert np.mean(sigma0) == pytest.approx(1, abs=0.03)
