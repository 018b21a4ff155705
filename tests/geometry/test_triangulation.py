from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import Camera, DegenerateGeometry, Pose, triangulate, triangulation

CAMERAS = [Camera((2000, 1500), f, k1=-0.15, k2=0.05, p1=1e-3, p2=-5e-4) for f in (2000.0, 2500.0, 3000.0, 2200.0)]
POSES = [Pose.look_at(eye, [0, 0, 0], [0, 0, 1]) for eye in ([3, 0, 1.0], [0, 3, 1], [-3, 0.5, 0.2], [2, 2, 2])]


def scene(n=300, seed=0):
    xyz = np.random.default_rng(seed).uniform(-0.3, 0.3, (n, 3))
    xy = np.stack([c.project(p.apply(xyz))[0] for c, p in zip(CAMERAS, POSES, strict=True)])
    return xyz, xy


def test_exact_images_give_the_points():
    xyz, xy = scene()
    found = triangulate(CAMERAS, POSES, xy)
    np.testing.assert_allclose(found.xyz, xyz, atol=1e-13)
    assert found.valid.all()
    assert found.rms_px.max() < 1e-10
    assert (found.views == 4).all()
    assert found.angle_deg.min() > 90


def test_missing_observations():
    xyz, xy = scene(5)
    xy[2:, 0] = np.nan
    xy[1:, 1] = np.nan
    xy[:, 2] = np.nan
    xy[0, 3, 1] = np.nan
    found = triangulate(CAMERAS, POSES, xy)
    assert found.views.tolist() == [2, 1, 0, 3, 4]
    assert found.reason.tolist() == ["", "fewer than two views", "fewer than two views", "", ""]
    np.testing.assert_allclose(found.xyz[found.valid], xyz[[0, 3, 4]], atol=1e-13)
    for bad in (found.xyz[~found.valid], found.cov[~found.valid], found.rms_px[~found.valid]):
        assert np.isnan(bad).all()


def test_covariance_is_that_of_the_errors():
    """Mahalanobis distance squared is chi-square with three degrees of freedom, also with unequal noise."""
    xyz, xy = scene(2000, 1)
    rng = np.random.default_rng(2)
    root = rng.normal(size=(*xy.shape[:2], 2, 2)) * 0.1
    cov = root @ np.swapaxes(root, -1, -2) + 1e-3 * np.eye(2)
    noise = (np.linalg.cholesky(cov) @ rng.normal(size=(*xy.shape, 1)))[..., 0]
    found = triangulate(CAMERAS, POSES, xy + noise, cov)
    e = found.xyz - xyz
    d2 = np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.cov), e)
    assert d2.mean() == pytest.approx(3.0, abs=4 * np.sqrt(6 / 2000))
    assert np.mean(d2 < 7.815) == pytest.approx(0.95, abs=0.02)
    np.testing.assert_allclose(found.cov, np.swapaxes(found.cov, -1, -2), rtol=1e-9)


def test_without_covariance_it_is_per_square_pixel():
    _, xy = scene(5)
    one = triangulate(CAMERAS, POSES, xy)
    tenth = triangulate(CAMERAS, POSES, xy, 0.01 * np.eye(2))
    np.testing.assert_allclose(0.01 * one.cov, tenth.cov, rtol=1e-6)


def test_it_is_the_minimum_of_the_reprojection_error():
    _, xy = scene(50, 3)
    noisy = xy + np.random.default_rng(4).normal(size=xy.shape)

    def cost(xyz):
        residual = np.stack([c.project(p.apply(xyz))[0] for c, p in zip(CAMERAS, POSES, strict=True)]) - noisy
        return np.sum(residual**2, axis=(0, 2))

    found = triangulate(CAMERAS, POSES, noisy)
    np.testing.assert_allclose(found.rms_px, np.sqrt(cost(found.xyz) / 4), rtol=1e-9)
    for step in 1e-5 * np.vstack([np.eye(3), -np.eye(3)]):
        assert np.all(cost(found.xyz + step) > cost(found.xyz))


def test_one_camera_in_many_places_and_a_batch_of_poses():
    camera = CAMERAS[0]
    xyz, _ = scene(7)
    batch = Pose(np.stack([p.rotation for p in POSES]), np.stack([p.translation for p in POSES]))
    xy = camera.project(batch.apply(xyz))[0]
    found = triangulate(camera, batch, xy)
    np.testing.assert_allclose(found.xyz, xyz, atol=1e-13)


def test_a_single_point():
    xyz, xy = scene(1)
    found = triangulate(CAMERAS, POSES, xy[:, 0], np.stack([0.04 * np.eye(2)] * 4))
    np.testing.assert_allclose(found.xyz, xyz[0], atol=1e-13)
    assert found.cov.shape == (3, 3)
    assert found.valid


# --- what cannot be determined -------------------------------------------------------------------
LONG = Camera((2000, 1500), 2000.0)


def side_by_side(baseline):
    return [Pose(np.eye(3), np.zeros(3)), Pose(np.eye(3), np.array([-baseline, 0, 0]))]


def test_parallel_rays_are_flagged_and_the_others_kept():
    poses = side_by_side(0.5)
    xyz = np.array([[0.1, 0, 10.0], [0, 0, 1e4], [0, 0, 1e9]])
    xy = np.stack([LONG.project(p.apply(xyz))[0] for p in poses])
    xy[1, 2] = xy[0, 2]
    found = triangulate(LONG, poses, xy)
    assert found.reason.tolist() == ["", "", "parallel rays"]
    np.testing.assert_allclose(found.xyz[:2], xyz[:2], rtol=1e-9, atol=1e-9)
    # depth uncertainty of stereo: z^2 / (f b) per pixel of parallax, sqrt(2) for two images
    np.testing.assert_allclose(np.sqrt(found.cov[:2, 2, 2]), np.sqrt(2) * xyz[:2, 2] ** 2 / (2000 * 0.5), rtol=1e-2)
    with pytest.raises(DegenerateGeometry, match="parallel rays") as caught:
        triangulate(LONG, poses, xy[:, 2])
    assert caught.value.weak == ("depth",)


def test_no_baseline_is_flagged():
    poses = [POSES[0], Pose.exp([0.1, 0.05, 0.2, 0, 0, 0]) @ POSES[0]]
    xyz, _ = scene(4)
    xy = np.stack([LONG.project(p.apply(xyz))[0] for p in poses])
    found = triangulate(LONG, poses, xy + np.random.default_rng(0).normal(size=xy.shape))
    assert not found.valid.any()
    assert all(r.startswith("no baseline") for r in found.reason)
    with pytest.raises(DegenerateGeometry, match="no baseline"):
        triangulate(LONG, poses, xy[:, 0])


@pytest.mark.parametrize("excess", [0.2, 5.0, 300.0])
def test_rays_that_diverge_get_no_point(excess):
    poses = side_by_side(0.5)
    xyz = np.array([[0.0, 0.0, 1000.0]])
    xy = np.stack([LONG.project(p.apply(xyz))[0] for p in poses])
    xy[1, 0, 0] += 1.0 + excess  # the parallax was 1 px: now it has the wrong sign
    found = triangulate(LONG, poses, xy)
    assert found.reason[0].startswith("rays diverge")
    assert np.isnan(found.xyz).all()


def test_pixels_outside_the_lens_model_are_named():
    folding = Camera((2000, 1500), 800.0, k1=-0.3)
    poses = side_by_side(0.5)
    xy = np.array([[[1000.0, 750.0], [0.0, 0.0]], [[950.0, 750.0], [0.0, 0.0]]])
    found = triangulate(folding, poses, xy)
    assert found.reason.tolist() == ["", "outside the lens model"]


def test_bad_input_is_named():
    _, xy = scene(4)
    for arguments, word in [
        ((CAMERAS[:3], POSES, xy), "camera"),
        ((CAMERAS, POSES[:3], xy), "poses"),
        ((CAMERAS[:1], POSES[:1], xy[:1]), "at least two views"),
        ((CAMERAS, POSES, xy[..., :1]), "xy must be"),
        ((CAMERAS, POSES, xy, np.eye(3)), "cov must be"),
        ((CAMERAS, POSES, xy, np.zeros((2, 2))), "positive definite"),
        ((CAMERAS, POSES, xy, np.full((4, 4, 2, 2), np.nan)), "positive definite"),
    ]:
        with pytest.raises(ValueError, match=word):
            triangulate(*arguments)


def test_a_point_whose_information_is_singular_stops_no_other(monkeypatch):
    """Far out all rays are parallel to rounding: seen with pictures out of focus, whose false pairs meet nowhere."""
    xyz, xy = scene(5)
    start = triangulation._linear

    def far(*given):
        found = start(*given)
        found[2] = [1e200, 1e200, 1e201]
        return found

    monkeypatch.setattr(triangulation, "_linear", far)
    got = triangulate(CAMERAS[:2], POSES[:2], xy[:2])
    assert not got.valid[2]
    assert got.reason[2]
    others = np.delete(np.arange(len(xyz)), 2)
    np.testing.assert_allclose(got.xyz[others], xyz[others], atol=1e-6)
