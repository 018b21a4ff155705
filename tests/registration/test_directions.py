"""Weak directions are named, and only they."""

import json

import numpy as np
import pytest
import registration_scenes as scenes

from windmark import io
from windmark.adjust import refine_pose
from windmark.geometry import Camera, Pose
from windmark.pipeline.outputs import registration_summary
from windmark.registration import register
from windmark.registration.directions import WEAK, weak_directions
from windmark.scene import MarkerSet


def seen(xyz, focal, distance, free=(), tilt_deg=0.0):
    """Pose and covariance of points seen from a distance, about the z axis."""
    camera = Camera((1280, 1000), focal)
    pose = Pose.from_rotvec([np.pi + np.radians(tilt_deg), 0, 0], [0, 0, distance])
    xy = camera.project(pose.apply(xyz))[0]
    got = refine_pose(camera, pose, xyz, xy, np.tile(0.04 * np.eye(2), (len(xyz), 1, 1)), free=free)
    return pose, focal, got.cov


def cube(n=60):
    return np.random.default_rng(0).uniform(-1, 1, (n, 3))


def test_a_wide_view_of_a_body_has_none():
    pose, focal, cov = seen(cube(), 900.0, 5.0)
    assert weak_directions(pose, focal, cov, cube()) == ()


def test_a_long_lens_does_not_tell_the_distance():
    pose, focal, cov = seen(cube(), 20_000.0, 100.0)
    (weak,) = weak_directions(pose, focal, cov, cube())
    assert weak.motions == ("along the viewing direction",)
    assert weak.sigma[0] == pytest.approx(np.sqrt(cov[5, 5]), rel=1e-3)
    assert weak.relative[0] == pytest.approx(weak.sigma[0] / 100, rel=0.02)
    # About distance over the root mean square radius across the view.
    assert weak.ratio == pytest.approx(100 / np.sqrt(2 / 3), rel=0.2)
    assert weak.words("mm").startswith("along the viewing direction: ")
    assert "mm (1 sigma)" in weak.words("mm")
    assert "% of the distance" in weak.words("mm")


def test_flat_markers_seen_frontally_do_not_tell_their_tilt():
    flat = cube() * [1, 1, 0]
    pose, focal, cov = seen(flat, 8_000.0, 40.0)
    names = [weak.motions[0] for weak in weak_directions(pose, focal, cov, flat)]
    assert {"rotation about image x", "rotation about image y"} <= set(names)
    tilt = weak_directions(pose, focal, cov, flat)[0]
    assert tilt.sigma[0] == pytest.approx(np.sqrt(max(cov[0, 0], cov[1, 1])), rel=0.3)
    assert "deg (1 sigma)" in tilt.words()


def test_focal_length_and_distance_go_together():
    pose, focal, cov = seen(cube(), 3_000.0, 15.0, free=("focal_px",))
    weak = weak_directions(pose, focal, cov, cube())[0]
    assert set(weak.motions) == {"along the viewing direction", "focal length"}
    assert " together with " in weak.words()


def test_steps_are_one_sigma_and_the_ratio_is_that_of_the_principal_axes():
    pose, focal, cov = seen(cube(), 20_000.0, 100.0)
    weak = weak_directions(pose, focal, cov, cube())[0]
    assert weak.step @ np.linalg.solve(cov, weak.step) == pytest.approx(1.0)
    assert weak.ratio > WEAK


def test_neither_the_length_unit_nor_the_frame_matters():
    xyz = cube()
    pose, focal, cov = seen(xyz, 20_000.0, 100.0, tilt_deg=20)
    weak = weak_directions(pose, focal, cov, xyz)
    unit = np.diag([1, 1, 1, 1e3, 1e3, 1e3])
    large = weak_directions(Pose(pose.rotation, 1e3 * pose.translation), focal, unit @ cov @ unit, 1e3 * xyz)
    assert [w.motions for w in large] == [w.motions for w in weak]
    assert large[0].ratio == pytest.approx(weak[0].ratio)
    assert large[0].sigma[0] == pytest.approx(1e3 * weak[0].sigma[0])


def test_registrations_and_refusals_carry_them():
    rng = np.random.default_rng(3)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(10, 10))
    image = scenes.image_of(rng, markers, camera, pose)
    found = register(image.detections, markers, camera)
    assert found.weak[0].motions[0] == "along the viewing direction"

    g = np.stack(np.meshgrid(np.arange(6) * 1.0, np.arange(4) * 1.0, [0.0]), axis=-1).reshape(-1, 3)
    g[:, :2] += rng.normal(0, 0.1, (24, 2))
    flat = MarkerSet.make([f"g{k}" for k in range(24)], g, normal=np.tile([0.0, 0, 1], (24, 1)))
    camera, pose = scenes.random_view(rng, flat, fov_deg=(20, 20), tilt_max_deg=2)
    refused = register(scenes.image_of(rng, flat, camera, pose).detections, flat, camera, free_focal=True)
    assert refused.cause == "focal"
    assert "focal length" in refused.weak[0].motions


def test_results_say_them_in_figures_and_words():
    rng = np.random.default_rng(3)
    markers = scenes.wing_and_body(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(10, 10))
    found = register(scenes.image_of(rng, markers, camera, pose).detections, markers, camera)
    record = json.loads(io.to_json(registration_summary(found, markers.name, None, "mm")))["weak"][0]
    assert record["motions"] == ["along the viewing direction"]
    assert record["words"].endswith("% of the distance")
    assert f"{found.weak[0].sigma[0]:.2g} mm" in record["words"]
    assert len(record["step"]) == 6
