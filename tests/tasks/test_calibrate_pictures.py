"""What is said of a picture that contradicts the others of its calibration."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.calibration import Distance, Fixed, Free, Weighted
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet
from windmark.tasks.calibrate import CalibrateSettings, calibrate_matching
from windmark.tasks.calibrate.pictures import MatchedPicture, MatchSettings, _without_labels


@pytest.mark.parametrize(("factor", "words"), [(1.04, "focal length of"), (1.0, "wrong labels, or the markers moved")])
def test_another_focal_length_is_the_reason_where_the_picture_shows_it(factor, words):
    rng = np.random.default_rng(5)
    markers = scenes.wind_tunnel(rng)
    camera, pose = scenes.random_view(rng, markers, fov_deg=(30, 30), tilt_max_deg=40)
    scene = scenes.image_of(rng, markers, camera, pose, hidden=0.1, false=0.1, noise_px=0.05)
    given = replace(camera, focal_px=factor * camera.focal_px)
    picture = MatchedPicture("P20", "camera", camera.size_px, scene.detections)
    said = _without_labels(picture, markers, given, MatchSettings(), 0.0)
    assert said.registration is None
    assert "contradict the other pictures" in said.problem
    assert words in said.problem


def test_what_a_real_lens_leaves_costs_no_picture_its_labels():
    """Spots known to 0.01 px that are 0.1 px off, smoothly over each picture: they match as uncertain as they are."""
    rng = np.random.default_rng(8)
    i, j = np.divmod(np.arange(64), 8)
    xyz = np.stack([i * 50.0, j * 50.0, np.zeros(64)], axis=1) + rng.normal(0, 2.0, (64, 3))
    true, pictures = Camera((1600, 1200), 1500.0, k1=-0.15, k2=0.08), []
    for v in range(10):
        away, roll = rng.uniform([-250, -250, 500], [250, 250, 650]), v * np.pi / 3
        pose = Pose.look_at([175, 175, 0] + away, [175, 175, 0], [np.cos(roll), np.sin(roll), 0])
        xy, valid = true.project(pose.apply(xyz))
        kept = np.flatnonzero(valid & true.in_image(xy))
        wave = 0.14 * np.sin(xy / rng.uniform(150, 400, 2) + rng.uniform(0, 6, 2))
        spots = Detections.make((xy + wave)[kept][rng.permutation(len(kept))], sigma_px=0.01)
        fixed = {int(np.argmin(np.linalg.norm(spots.xy - xy[0] - wave[0], axis=1))): "m00"}
        pictures.append(MatchedPicture(f"v{v}", "camera", true.size_px, spots, f"v{v}", fixed=fixed))
    names = [f"m{k:02d}" for k in range(64)]
    rough = MarkerSet.make(names, xyz + rng.normal(0, 1.0, xyz.shape), normal=np.tile([0, 0, 1.0], (64, 1)))
    done, matched = calibrate_matching(
        pictures, rough, {"camera": Camera(true.size_px, 1700.0)}, CalibrateSettings(Free(), max_sigma0=30.0)
    )
    assert [p.name for p in matched if p.registration is None] == []
    assert done
    assert 0.07 < matched[0].excess_px < 0.15
    assert abs(done.result.cameras["camera"].focal_px - 1500.0) < 5.0


@pytest.mark.parametrize(("settings", "words"), [
    (CalibrateSettings(Fixed(("a", "b", "x"))), "datum names the unknown marker 'x'"),
    (CalibrateSettings(Weighted()), "three markers with a sigma"),
    (CalibrateSettings(Free(), distances=(Distance("a", "x", 5.0, 0.1),)), "distances names the unknown marker 'x'"),
])  # fmt: skip
def test_a_datum_that_cannot_be_is_said_before_a_picture_is_matched(settings, words):
    """There is none: whoever matched first would say so."""
    markers = MarkerSet.make(["a", "b", "c"], np.eye(3))
    with pytest.raises(UsageError, match=words):
        calibrate_matching([], markers, {"cam": Camera((100, 100), 100.0)}, settings)
