import numpy as np
import pytest

from windmark.adjust import POSE_PARAMETERS, refine_pose
from windmark.geometry import Camera, DegenerateGeometry, Pose


def error(estimate, truth):
    return (estimate.cam_from_model @ truth.inverse()).log()


def test_exact_data_give_the_exact_pose_and_camera(scene):
    s = scene(0)
    estimate = refine_pose(s.camera, s.start(0.5, 1.5), s.xyz, s.xy, free=())
    np.testing.assert_allclose(error(estimate, s.pose), 0, atol=1e-9)
    assert estimate.camera is s.camera
    assert estimate.rms_px < 1e-7
    assert estimate.names == POSE_PARAMETERS
    assert estimate.cov.shape == (6, 6)
    start = s.camera.with_parameters(s.camera.parameters() * [1.2, 1.02, 1, 1, 0.5, *np.ones(10)])
    free = ("k1", "focal_px", "aspect")
    # The engine stops within 1e-6 sigma of the minimum: exact data may claim to be so.
    estimate = refine_pose(start, s.start(0.3, 1.0), s.xyz, s.xy, s.cov(1e-3), free=free)
    np.testing.assert_allclose(estimate.camera.parameters(), s.camera.parameters(), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(error(estimate, s.pose), 0, atol=1e-8)
    assert estimate.names == POSE_PARAMETERS + free
    assert estimate.sigma("aspect") == np.sqrt(estimate.cov[8, 8])
    with pytest.raises(ValueError, match="sigma: name must be one of rotation_x"):
        estimate.sigma("cx")


def test_residuals_rms_and_report(scene):
    s = scene(1)
    xy = s.noisy(0.3)
    estimate = refine_pose(s.camera, s.start(), s.xyz, xy, s.cov(0.3), max_iterations=40)
    projected = s.camera.project(estimate.cam_from_model.apply(s.xyz))[0]
    np.testing.assert_allclose(estimate.residuals_px, projected - xy, atol=1e-12)
    assert estimate.rms_px == pytest.approx(np.sqrt(np.mean(np.sum((projected - xy) ** 2, axis=1))))
    assert estimate.sigma0 == pytest.approx(np.sqrt(np.sum((estimate.residuals_px / 0.3) ** 2) / (40 - 6)))
    assert (estimate.weights == 1).all()
    report = estimate.report
    assert report.converged
    assert report.final_cost == pytest.approx(0.5 * np.sum((estimate.residuals_px / 0.3) ** 2))
    assert report.final_cost < report.initial_cost
    assert report.options["max_iterations"] == 40
    assert (report.options["loss"], report.options["free"], report.options["prior_sigma"]) == ("none", (), {})


def test_the_covariance_scales_with_that_of_the_observations(scene):
    s = scene(2)
    one, ten = (refine_pose(s.camera, s.start(), s.xyz, s.xy, s.cov(c)) for c in (0.1, 1.0))
    unit = refine_pose(s.camera, s.start(), s.xyz, s.xy)
    np.testing.assert_allclose(ten.cov, 100 * one.cov, rtol=1e-6, atol=1e-16)
    np.testing.assert_allclose(unit.cov, ten.cov, rtol=1e-6, atol=1e-14)


def test_observations_are_weighted_by_their_covariance(scene):
    s = scene(3, n=10)
    xy = s.xy.copy()
    xy[0] += [30.0, 0.0]
    # The first point is 30 px off in x only, and its covariance says that x is not to be trusted.
    cov = s.cov(0.1)
    cov[0] = [[1e8, 0], [0, 0.01]]
    estimate = refine_pose(s.camera, s.start(), s.xyz, xy, cov)
    np.testing.assert_allclose(error(estimate, s.pose), 0, atol=1e-6)
    assert np.abs(error(refine_pose(s.camera, s.start(), s.xyz, xy, s.cov(0.1)), s.pose)).max() > 1e-3


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
def test_robust_losses_survive_outliers(scene, loss):
    s = scene(4, n=30)
    xy = s.noisy(0.1)
    clean = refine_pose(s.camera, s.start(), s.xyz[8:], xy[8:], s.cov(0.1)[8:])
    spoiled = xy.copy()
    spoiled[:8] += s.rng.normal(size=(8, 2)) * 15
    plain = refine_pose(s.camera, s.start(), s.xyz, spoiled, s.cov(0.1))
    robust = refine_pose(s.camera, s.start(0.2, 0.5), s.xyz, spoiled, s.cov(0.1), loss=loss)
    assert robust.report.converged

    def distance(estimate):
        return np.sqrt(error(estimate, s.pose) @ np.linalg.solve(clean.cov, error(estimate, s.pose)))

    limit = {"huber": 12, "cauchy": 6, "tukey": 5}[loss]
    assert distance(robust) < limit < distance(plain) / 5
    assert robust.weights[:8].max() < 0.2 < np.median(robust.weights[8:])
    assert robust.rms_px > 5  # of all residuals: the outliers are shown, not hidden
    if loss == "tukey":
        # The outliers count for nothing: what is left is the fit of the good points.
        assert (robust.weights[:8] == 0).all()
        assert distance(robust) == pytest.approx(distance(clean), abs=1.5)
        assert 0.8 < robust.sigma0 < 1.2
        assert np.linalg.det(robust.cov) == pytest.approx(np.linalg.det(clean.cov / 0.95), rel=0.7)


def test_a_tight_loss_scale_and_a_wide_one(scene):
    s = scene(5, n=30)
    xy = s.noisy(0.1)
    xy[0] += 2.0
    wide = refine_pose(s.camera, s.start(), s.xyz, xy, s.cov(0.1), loss="huber", loss_scale=1e6)
    plain = refine_pose(s.camera, s.start(), s.xyz, xy, s.cov(0.1))
    np.testing.assert_allclose(wide.cam_from_model.translation, plain.cam_from_model.translation, atol=1e-7)
    np.testing.assert_allclose(wide.cov, plain.cov, rtol=1e-6, atol=1e-18)
    assert wide.sigma0 == pytest.approx(plain.sigma0)
    assert refine_pose(s.camera, s.start(), s.xyz, xy, s.cov(0.1), loss="huber").sigma0 < plain.sigma0 / 1.5


def test_a_prior_on_the_focal_length(scene):
    s = scene(6, n=12, size=(1, 1, 0.05))
    xy = s.noisy(0.2)
    start = s.camera.with_parameters(s.camera.parameters() * np.r_[1.01, np.ones(14)])
    args = (start, s.start(0.05, 0.1), s.xyz, xy, s.cov(0.2))
    free = refine_pose(*args, free=("focal_px",))
    prior = refine_pose(*args, free=("focal_px",), prior_sigma={"focal_px": 0.5 * free.sigma("focal_px")})
    # Two independent Gaussians about the two values: the posterior is their weighted mean.
    variance = free.cov[6, 6]
    assert prior.cov[6, 6] == pytest.approx(variance / 5, rel=0.05)
    mean = (free.camera.focal_px + 4 * start.focal_px) / 5
    assert prior.camera.focal_px == pytest.approx(mean, abs=0.05 * np.sqrt(variance))
    tight = refine_pose(*args, free=("focal_px",), prior_sigma={"focal_px": 1e-6}, loss="tukey")
    assert tight.camera.focal_px == pytest.approx(start.focal_px, abs=1e-6)
    assert tight.sigma("focal_px") == pytest.approx(1e-6, rel=1e-3)  # the loss must not touch the prior


def test_priors_on_the_pose_stand_in_for_missing_points(scene):
    s = scene(7, n=2)
    with pytest.raises(DegenerateGeometry, match="2 points, at least 3 are needed"):
        refine_pose(s.camera, s.pose, s.xyz, s.xy)
    sigma = {"rotation_x": 1e-3, "rotation_y": 1e-3, "rotation_z": 1e-3}
    start = Pose.exp([0, 0, 0, 0.1, 0.1, -0.2]) @ s.pose
    estimate = refine_pose(s.camera, start, s.xyz, s.xy, prior_sigma=sigma)
    assert estimate.report.converged
    np.testing.assert_allclose(estimate.cam_from_model.translation, s.pose.translation, atol=1e-6)
    assert estimate.sigma("rotation_z") <= 1e-3


def test_priors_must_be_free(scene):
    s = scene(8)
    with pytest.raises(ValueError, match="prior_sigma: focal_px not free; free are rotation_x"):
        refine_pose(s.camera, s.pose, s.xyz, s.xy, prior_sigma={"focal_px": 20.0})


def test_minimal_sample_has_no_redundancy(scene):
    s = scene(9, n=3)
    estimate = refine_pose(s.camera, s.start(0.01, 0.05), s.xyz, s.xy, s.cov(0.05))
    assert np.isnan(estimate.sigma0)
    np.testing.assert_allclose(estimate.residuals_px, 0, atol=1e-7)


def test_covariance_of_the_camera_is_kept_for_what_is_fixed(scene):
    s = scene(10)
    given = np.diag(np.arange(1.0, 16.0))
    given[0, 1] = given[1, 0] = 0.5
    camera = s.camera.with_parameters(s.camera.parameters(), cov=given)
    assert refine_pose(camera, s.start(), s.xyz, s.xy).camera.cov is given
    estimate = refine_pose(camera, s.start(), s.xyz, s.xy, free=("k1", "focal_px"))
    np.testing.assert_allclose(np.diag(estimate.camera.cov)[[1, 2, 3, 5]], [2, 3, 4, 6])
    np.testing.assert_array_equal(estimate.camera.cov[np.ix_([4, 0], [4, 0])], estimate.cov[6:, 6:])
    assert estimate.camera.cov[0, 1] == 0


# --- what cannot be solved is named ---------------------------------------------------------------
PLANE = np.c_[np.random.default_rng(0).uniform(-1, 1, (30, 2)), np.zeros(30)]
CAMERA = Camera((1280, 800), 1800.0)


def solve(xyz, pose, sigma=0.1, seed=0, **options):
    rng = np.random.default_rng(seed)
    xy = CAMERA.project(pose.apply(xyz))[0] + sigma * rng.normal(size=(len(xyz), 2))
    return refine_pose(CAMERA, pose, xyz, xy, np.tile(np.eye(2) * sigma**2, (len(xyz), 1, 1)), **options)


@pytest.mark.parametrize("sigma", [1e-6, 1e-3, 0.1, 1.0])
def test_focal_length_on_a_frontal_plane(sigma):
    with pytest.raises(DegenerateGeometry, match="plane seen frontally") as caught:
        solve(PLANE, Pose.from_rotvec([0, 0, 0.3], [0, 0, 8.0]), sigma, free=("focal_px",))
    assert set(caught.value.weak) == {"focal_px", "translation_z"}


def test_the_same_plane_tilted_or_with_known_focal_length():
    frontal = Pose.from_rotvec([0, 0, 0.3], [0, 0, 8.0])
    assert solve(PLANE, frontal).report.converged
    tilted = solve(PLANE, Pose.from_rotvec([0.5, 0, 0], [0, 0, 8.0]), free=("focal_px",))
    assert tilted.sigma("focal_px") < 0.01 * 1800
    prior = solve(PLANE, frontal, free=("focal_px",), prior_sigma={"focal_px": 36.0})
    assert prior.sigma("focal_px") == pytest.approx(36.0, rel=0.01)


@pytest.mark.parametrize(("direction", "weak"), [((1, 0, 0), {"rotation_x"}), ((0, 1, 0), {"rotation_y"})])
def test_collinear_points(direction, weak):
    line = np.linspace(-1, 1, 8)[:, None] * np.array(direction)
    with pytest.raises(DegenerateGeometry, match="on one line") as caught:
        solve(line, Pose.from_rotvec([0, 0, 0], [0.1, 0, 8.0]))
    assert set(caught.value.weak) == weak


@pytest.mark.parametrize("n", [0, 1, 2])
def test_too_few_points(n):
    with pytest.raises(DegenerateGeometry, match=f"{n} points, at least 3 are needed") as caught:
        solve(PLANE[:n], Pose.from_rotvec([0.2, 0, 0], [0, 0, 8.0]))
    assert len(caught.value.weak) >= 2


def test_coinciding_points_and_points_all_in_doubt(scene):
    with pytest.raises(DegenerateGeometry, match="coincide"):
        solve(np.tile(PLANE[:1], (5, 1)), Pose.from_rotvec([0.2, 0, 0], [0, 0, 8.0]))
    s = scene(11, n=5)
    wild = s.rng.uniform(0, 800, (5, 2))
    with pytest.raises(DegenerateGeometry, match="robust loss leaves"):
        refine_pose(s.camera, s.pose, s.xyz, wild, s.cov(0.01), loss="tukey")


def test_distortion_that_a_small_part_of_the_image_cannot_show():
    small = 0.1 * np.random.default_rng(1).uniform(-1, 1, (20, 3))
    pose = Pose.from_rotvec([0.2, 0.1, 0], [0, 0, 8.0])
    assert solve(small, pose).report.converged
    with pytest.raises(DegenerateGeometry) as caught:
        solve(small, pose, free=("k1",))
    assert caught.value.weak == ("k1",)


# --- bad input ------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"xyz": np.zeros((20, 2))}, r"xyz: expected \(N, 3\), got \(20, 2\)"),
        ({"xyz": np.full((20, 3), np.nan)}, "xyz: must be finite, row 0"),
        ({"xy": np.zeros((19, 2))}, r"xy: expected \(20, 2\)"),
        ({"xy": np.full((20, 2), np.inf)}, "xy: must be finite"),
        ({"cov": np.eye(2)}, r"cov: expected \(20, 2, 2\)"),
        ({"free": ("focal",)}, "free: expected distinct camera parameters"),
        ({"loss": "lorentz"}, "loss must be one of"),
        ({"loss_scale": 3.0}, "loss_scale has no meaning"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"prior_sigma": {"rotation_x": -1.0}}, "rotation_x must be finite and > 0"),
        ({"cam_from_model": Pose.from_rotvec([0, 0, 0], [0, 0, -8.0])}, "20 of 20 points behind the camera"),
        ({"cam_from_model": Pose(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))}, "single pose"),
    ],
)
def test_bad_input_is_named(scene, change, message):
    s = scene(12)
    good = {"camera": s.camera, "cam_from_model": s.pose, "xyz": s.xyz, "xy": s.xy}
    with pytest.raises(ValueError, match=message):
        refine_pose(**(good | change))


def test_iterations_used_up_are_said(scene):
    s = scene(13)
    estimate = refine_pose(s.camera, s.start(0.8, 2.0), s.xyz, s.xy, max_iterations=2)
    assert (estimate.report.reason, estimate.report.converged) == ("max_iterations", False)
