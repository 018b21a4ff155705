import numpy as np
import pytest

from windmark.adjust import CameraBlock, Loss, PoseBlock, Prior, Problem, Reprojection, pose_problem
from windmark.adjust.terms import whitener
from windmark.geometry import PARAMETERS, Camera, Pose


def numeric_jacobian(term, block, key, values, h):
    columns = []
    for k in range(len(block.names)):
        step = np.zeros(len(block.names))
        step[k] = h[k]
        plus = term.residual({**values, key: block.retract(values[key], step)})
        minus = term.residual({**values, key: block.retract(values[key], -step)})
        columns.append((plus - minus) / (2 * h[k]))
    return np.stack(columns, axis=-1)


def random_cov(rng, n):
    a = rng.normal(size=(n, 2, 2)) * 0.2
    return a @ np.swapaxes(a, 1, 2) + 0.01 * np.eye(2)


def test_reprojection_jacobian_against_differences(scene):
    s = scene(1, n=15, tilt_x=0.02, tilt_y=-0.03, k3=0.01)
    cov = random_cov(s.rng, 15)
    camera_block, pose_block = CameraBlock(PARAMETERS[:11]), PoseBlock(s.xyz.mean(axis=0))
    term = Reprojection("camera", "pose", s.xyz, s.noisy(1.0), whitener(cov, 15), free_camera=camera_block.columns)
    values = {"camera": s.camera, "pose": s.pose}
    linearised = term.linearise(values)
    np.testing.assert_array_equal(linearised.residual, term.residual(values))
    # The lens terms are linear in their parameters, so a large step costs no accuracy and saves it from rounding.
    camera_steps = np.array([1.0, 1e-3, 1.0, 1.0, 1e-2, 1e-1, 1e-3, 1e-3, 1.0, 1e-5, 1e-5])
    steps = {"pose": np.full(6, 1e-6), "camera": camera_steps}
    for key, block in (("pose", pose_block), ("camera", camera_block)):
        numeric = numeric_jacobian(term, block, key, values, steps[key])
        scale = np.abs(numeric).max(axis=(0, 1))
        np.testing.assert_allclose(linearised.jacobian[key] / scale, numeric / scale, atol=3e-7)


def test_residual_is_projected_minus_detected_in_sigma(scene):
    s = scene(2)
    term = Reprojection("camera", "pose", s.xyz, s.xy - [0.3, -0.1], whitener(s.cov(0.1), 20))
    residual = term.residual({"camera": s.camera, "pose": s.pose})
    np.testing.assert_allclose(residual, np.tile([3.0, -1.0], (20, 1)), atol=1e-9)


def test_whitener_is_the_inverse_square_root():
    cov = random_cov(np.random.default_rng(5), 30)
    w = whitener(cov, 30)
    np.testing.assert_allclose(w @ cov @ np.swapaxes(w, 1, 2), np.tile(np.eye(2), (30, 1, 1)), atol=1e-9)


@pytest.mark.parametrize(
    "bad",
    [[[1, 2], [2, 1]], [[1, 0.1], [0.2, 1]], [[0, 0], [0, 0]], [[-1, 0], [0, -1]], [[np.nan, 0], [0, 1]]],
)
def test_bad_covariances_are_named_with_their_index(bad):
    cov = np.tile(np.eye(2), (4, 1, 1))
    cov[2] = bad
    with pytest.raises(ValueError, match=r"cov: .*observation 2"):
        whitener(cov, 4)
    with pytest.raises(ValueError, match=r"cov: expected \(5, 2, 2\)"):
        whitener(cov, 5)


@pytest.mark.parametrize("behind", [True, False])
def test_no_prediction_behind_the_camera_or_beyond_the_fold(behind):
    camera = Camera((1280, 800), 800.0, k1=-0.3)
    point = np.array([[0.0, 0.0, -1.0 if behind else 1.0], [0.0, 0.0, 2.0]])
    if not behind:
        point[0, 0] = 1.2  # the radius at which r (1 - 0.3 r^2) turns is 1.054
    term = Reprojection("camera", "pose", point, np.zeros((2, 2)))
    values = {"camera": camera, "pose": Pose.identity()}
    assert term.residual(values) is None
    assert term.linearise(values) is None
    problem = Problem({"pose": PoseBlock(np.zeros(3))}, [term])
    assert problem.cost(values) == np.inf
    assert problem.linearise(values) is None


def test_prior_rows(scene):
    s = scene(3)
    block = CameraBlock(("focal_px", "k1"))
    prior = Prior("camera", block, s.camera, {"k1": 0.01})
    moved = block.retract(s.camera, np.array([30.0, 0.02]))
    linearised = prior.linearise({"camera": moved})
    np.testing.assert_allclose(linearised.residual, [[2.0]])
    np.testing.assert_allclose(linearised.jacobian["camera"], [[[0.0, 100.0]]])
    with pytest.raises(ValueError, match="prior_sigma: 'cx' is not free"):
        Prior("camera", block, s.camera, {"cx": 1.0})
    with pytest.raises(ValueError, match="prior_sigma: k1 must be finite and > 0, got 0"):
        Prior("camera", block, s.camera, {"k1": 0.0})


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy", "tukey"])
def test_problem_gradient_is_the_derivative_of_the_cost(scene, loss):
    s = scene(4)
    problem, values = pose_problem(
        s.camera,
        s.start(0.002, 0.002),
        s.xyz,
        s.noisy(0.5),
        random_cov(s.rng, 20),
        free=("focal_px", "k1"),
        loss=Loss.make(loss),
        prior_sigma={"focal_px": 1.0, "rotation_y": 0.001},
    )
    values = problem.retract(values, np.r_[1e-3, -1e-3, 1e-3, 1e-3, 2e-3, 1e-3, 0.5, 1e-4])
    system = problem.linearise(values)
    assert system.cost == pytest.approx(problem.cost(values), rel=1e-14)
    basis = problem.natural(values)
    h = 1e-7
    numeric = [
        (problem.cost(problem.retract(values, h * b)) - problem.cost(problem.retract(values, -h * b))) / (2 * h)
        for b in basis.T
    ]
    np.testing.assert_allclose(system.gradient, numeric, atol=1e-6 * np.abs(system.gradient).max())


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(("part", "good"), [(1e-11, True), (1e-7, False)])
def test_covariances_are_symmetric_to_a_part_of_their_own_size(size, part, good):
    """Rounding of large numbers is no asymmetry, and one of small numbers is none the less."""
    cov = size * np.array([[[2.0, 0.5], [0.5 + part, 1.0]]])
    if good:
        w = whitener(cov, 1)[0]
        np.testing.assert_allclose(w @ cov[0] @ w.T, np.eye(2), atol=1e-9)
    else:
        with pytest.raises(ValueError, match="symmetric"):
            whitener(cov, 1)
