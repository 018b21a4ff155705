"""Camera parameters held by their own covariance."""

import numpy as np
import pytest

from windmark.adjust import refine_pose
from windmark.geometry import Camera, Pose

TRUE = Camera((1200, 900), 1000.0, k1=-0.25, k2=0.05)


def view(seed, noise=0.1):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (40, 3)) * [1.0, 0.8, 0.6]
    pose = Pose.from_rotvec([0.3, -0.2, 0.5], [0.0, 0.1, 3.0])
    return (
        pose,
        xyz,
        TRUE.project(pose.apply(xyz))[0] + rng.normal(0, noise, (40, 2)),
        0.01 * np.eye(2)[None].repeat(40, 0),
    )


def lens_cov(sigma1=0.01, sigma2=0.02, correlation=-0.9):
    cov = np.zeros((11, 11))
    cov[4, 4], cov[5, 5] = sigma1**2, sigma2**2
    cov[4, 5] = cov[5, 4] = correlation * sigma1 * sigma2
    return cov


@pytest.mark.slow
def test_focal_length_scatters_as_the_joint_covariance_says():
    """The start's lens is drawn from its covariance, the spots from theirs; 150 focal lengths, two-sided."""
    root = np.linalg.cholesky(lens_cov()[4:6, 4:6])
    z = []
    for seed in range(150):
        pose, xyz, xy, cov = view(seed)
        off = root @ np.random.default_rng(1000 + seed).normal(size=2)
        start = Camera(TRUE.size_px, 1000.0, k1=TRUE.k1 + off[0], k2=TRUE.k2 + off[1])
        got = refine_pose(start, pose, xyz, xy, cov, free=("focal_px", "k1", "k2"), camera_cov=lens_cov())
        z.append((got.camera.focal_px - 1000.0) / got.sigma("focal_px"))
    assert np.std(z) == pytest.approx(1.0, abs=3 / np.sqrt(300))


def test_a_tight_prior_is_a_fixed_lens_and_a_wide_one_none():
    pose, xyz, xy, cov = view(7)
    fixed = refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px",))
    tight = refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px", "k1", "k2"), camera_cov=lens_cov(1e-7, 1e-7))
    assert tight.camera.focal_px == pytest.approx(fixed.camera.focal_px, rel=1e-8)
    assert tight.sigma("focal_px") == pytest.approx(fixed.sigma("focal_px"), rel=1e-4)
    free = refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px", "k1", "k2"))
    wide = refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px", "k1", "k2"), camera_cov=lens_cov(1e3, 1e3, 0.0))
    assert wide.camera.focal_px == pytest.approx(free.camera.focal_px, rel=1e-6)
    assert wide.sigma("focal_px") == pytest.approx(free.sigma("focal_px"), rel=1e-4)
    assert free.sigma("focal_px") > 1.1 * fixed.sigma("focal_px")  # what the lens, taken as exact, seemed to tell


def test_parameters_without_variance_or_not_free_are_left_alone():
    pose, xyz, xy, cov = view(8)
    plain = refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px",))
    same = refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px",), camera_cov=lens_cov())
    assert same.camera.focal_px == plain.camera.focal_px


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"camera_cov": np.eye(3)}, r"camera_cov must be \(15, 15\), .* got \(3, 3\)"),
        ({"camera_cov": lens_cov(correlation=1.5)}, "positive definite in k1, k2"),
        ({"camera_cov": lens_cov(), "prior_sigma": {"k1": 0.1}}, "k1 is held by prior_sigma, too"),
    ],
)
def test_wrong_covariances_are_named(options, words):
    pose, xyz, xy, cov = view(9)
    with pytest.raises(ValueError, match=words):
        refine_pose(TRUE, pose, xyz, xy, cov, free=("focal_px", "k1", "k2"), **options)
