"""What is said of a picture that contradicts the others of its calibration."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.calibration import Distance, Fixed, Free, Weighted
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.scene import MarkerSet
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
    said = _without_labels(picture, markers, given, MatchSettings())
    assert said.registration is None
    assert "contradict the other pictures" in said.problem
    assert words in said.problem


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
