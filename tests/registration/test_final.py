"""The last refinement: eccentricity of discs, and the lens with a free focal length."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.geometry import Camera, Pose
from windmark.registration import register
from windmark.scene import Detections

RADIUS_PX = 8.0


def centroid_of_disc(camera, pose, center, normal, radius):
    """Area centroid of an imaged disc: a polygon of 4000 corners."""
    a = np.cross(normal, [0.3, 0.5, 0.8])
    a /= np.linalg.norm(a)
    turn = 2 * np.pi * np.arange(4000)[:, None] / 4000
    outline = camera.project(pose.apply(center + radius * (np.cos(turn) * a + np.sin(turn) * np.cross(normal, a))))[0]
    origin = outline.mean(axis=0)
    (x, y), (x1, y1) = (outline - origin).T, np.roll(outline - origin, -1, axis=0).T
    cross = x * y1 - x1 * y
    return origin + np.array([((x + x1) * cross).sum(), ((y + y1) * cross).sum()]) / (3 * cross.sum())


@pytest.fixture(scope="module", params=[0.0, -0.08], ids=["pinhole", "curved"])
def large_discs(request):
    """A wing seen at 60 degrees through a wide-angle lens, discs of 8 px, no noise: (spots, markers, camera, pose)."""
    markers = scenes.wing(np.random.default_rng(5))
    camera = Camera((1280, 1000), 640.0, k1=request.param)
    middle = markers.xyz.mean(axis=0)
    towards = np.array([0.0, -np.sin(np.radians(60)), np.cos(np.radians(60))])
    pose = Pose.look_at(middle + 0.9 * towards, middle, [1.0, 0.2, 0.0])
    radius = RADIUS_PX * pose.apply(markers.xyz)[:, 2] / camera.focal_px
    markers = replace(markers, radius=radius)
    xy = np.array([
        centroid_of_disc(camera, pose, *of) for of in zip(markers.xyz, markers.normal, radius, strict=True)
    ])  # fmt: skip
    return Detections.make(xy[camera.in_image(xy)], sigma_px=0.01), markers, camera, pose


def bias_px(found, markers, camera, pose):
    """Root mean square displacement of the markers between the pose found and the true one."""
    moved = camera.project(found.cam_from_model.apply(markers.xyz))[0] - camera.project(pose.apply(markers.xyz))[0]
    return float(np.sqrt((moved**2).sum(axis=1).mean()))


def test_pose_and_residuals_are_free_of_the_eccentricity(large_discs):
    spots, markers, camera, pose = large_discs
    plain = register(spots, replace(markers, radius=np.full(len(markers), np.nan)), camera)
    corrected = register(spots, markers, camera)
    assert bias_px(plain, markers, camera, pose) > 0.03
    assert bias_px(corrected, markers, camera, pose) < 1e-4
    assert plain.rms_px > 0.005
    assert corrected.rms_px < 1e-4
    np.testing.assert_allclose(corrected.cov, plain.cov, rtol=0.2, atol=0.05 * np.abs(plain.cov).max())


def test_only_markers_with_normal_and_radius_are_corrected(large_discs):
    spots, markers, camera, _ = large_discs
    radius = markers.radius.copy()
    radius[::2] = np.nan
    half = register(spots, replace(markers, radius=radius), camera)
    expected = camera.project(half.cam_from_model.apply(markers.xyz[half.matching.marker]))[0]
    plain = expected - spots.xy[half.matching.detection]
    same = np.isclose(half.residuals, plain, atol=1e-9).all(axis=1)
    np.testing.assert_array_equal(same, np.isnan(radius[half.matching.marker]))


def test_free_focal_length_with_discs(large_discs):
    spots, markers, camera, _ = large_discs
    given = replace(camera, focal_px=1.1 * camera.focal_px)
    plain = register(spots, replace(markers, radius=np.full(len(markers), np.nan)), given, free_focal=True)
    corrected = register(spots, markers, given, free_focal=True)
    error = [abs(found.camera.focal_px / camera.focal_px - 1) for found in (plain, corrected)]
    assert error[1] < 1e-7
    assert error[0] > 5e-6


# --- focal length and lens -------------------------------------------------------------------


def curved(seed, k1):
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(40, 60))
    camera = replace(camera, k1=k1)
    return scenes.image_of(rng, markers, camera, pose, hidden=0.25, false=0.25)


@pytest.mark.slow
def test_focal_sigma_is_the_scatter_under_a_strong_lens():
    """k1 as it is, the focal length wrong by up to 20 %: z-std of 60 focal lengths is 1 within three of its sigma."""
    z = []
    for seed in range(60):
        scene = curved(81_000 + seed, -0.25 if seed % 2 else 0.2)
        factor = np.exp(np.random.default_rng(seed).uniform(-0.18, 0.18))
        given = replace(scene.camera, focal_px=factor * scene.camera.focal_px)
        found = register(scene.detections, scene.markers, given, free_focal=True, max_time_s=30.0)
        if not found:  # too frontal
            assert found.cause == "focal"
            continue
        assert found.camera.k1 == scene.camera.k1
        z.append((found.camera.focal_px - scene.camera.focal_px) / np.sqrt(found.cov[6, 6]))
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=3 / np.sqrt(120))
    assert len(z) > 54


@pytest.mark.slow
def test_an_uncertain_lens_widens_the_focal_length_as_its_covariance_says():
    """k1 off by its own sigma of 5 %: told so, the focal length keeps its promise; taken as exact, it does not."""
    z = {True: [], False: []}
    for seed in range(24):
        scene = curved(82_000 + seed, -0.25)
        sigma = 0.05 * 0.25
        off = replace(scene.camera, k1=scene.camera.k1 + np.random.default_rng(seed).normal(0, sigma))
        cov = np.zeros((11, 11))
        cov[4, 4] = sigma**2
        for told in z:
            given = replace(off, cov=cov if told else None)
            found = register(scene.detections, scene.markers, given, free_focal=True, max_time_s=30.0)
            if not found:
                continue
            z[told].append((found.camera.focal_px - scene.camera.focal_px) / np.sqrt(found.cov[6, 6]))
            assert (found.camera.k1 != off.k1) == told
            assert (found.camera.cov[4, 4] > 0) == told
    rms = {told: float(np.sqrt(np.mean(np.square(values)))) for told, values in z.items()}
    assert 0.7 < rms[True] < 1.3
    assert rms[False] > 1.4


def test_without_lens_and_discs_nothing_else_changes():
    scene = scenes.scene(83, "B")
    found = register(scene.detections, scene.markers, scene.camera)
    assert found.camera == scene.camera
    free = register(scene.detections, scene.markers, scene.camera, free_focal=True)
    assert free.camera.cov[0, 0] == pytest.approx(free.cov[6, 6])
