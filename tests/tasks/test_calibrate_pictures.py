"""What is said of a picture that contradicts the others of its calibration."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.calibration import Distance, Fixed, Free, Weighted
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet
from windmark.tasks.calibrate import CalibrateSettings, calibrate_matching
from windmark.tasks.calibrate.pictures import EVERY, MatchedPicture, MatchSettings, _with_doubts, _without_labels


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


def refocused_sheet(seed, count=7, shift_px=5.0):
    """Hand-taken pictures of a nearly regular sheet, focused anew for each: focal length and principal point move."""
    rng = np.random.default_rng(seed)
    i, j = np.divmod(np.arange(64), 8)
    xyz = np.stack([i * 50.0, j * 50.0, np.zeros(64)], axis=1) + rng.normal(0, 0.25, (64, 3))
    pictures, labelled = [], 0
    for v in range(count):
        focal, middle = 1500.0 * (1 + rng.normal(0, 0.0025)), rng.normal(0, 1.0, 2) * shift_px
        camera = Camera((1600, 1200), focal, cx=799.5 + middle[0], cy=599.5 + middle[1], k1=-0.15, k2=0.08)
        away, roll = rng.uniform([-250, -250, 500], [250, 250, 650]), v * np.pi / 3
        pose = Pose.look_at(np.array([175, 175, 0]) + away, [175, 175, 0], [np.cos(roll), np.sin(roll), 0])
        xy, valid = camera.project(pose.apply(xyz))
        kept = rng.permutation(np.flatnonzero(valid & camera.in_image(xy)))
        spots = Detections.make(xy[kept] + rng.normal(0, 0.03, (len(kept), 2)), sigma_px=0.03)
        told = 0 in kept and labelled < 4
        labelled += told
        fixed = {int(np.flatnonzero(kept == 0)[0]): "m00"} if told else {}
        pictures.append((kept, MatchedPicture(f"v{v}", "camera", camera.size_px, spots, f"v{v}", fixed=fixed)))
    rough = xyz + rng.normal(0, 2.0, xyz.shape)
    names = [f"m{k:02d}" for k in range(64)]
    return pictures, MarkerSet.make(names, rough, normal=np.tile([0, 0, 1.0], (64, 1)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [8, 11])
def test_focusing_anew_costs_no_picture_its_labels(seed):
    made, rough = refocused_sheet(seed)
    start, settings = {"camera": Camera((1600, 1200), 1700.0)}, CalibrateSettings(Free(), max_sigma0=30.0)
    _, matched = calibrate_matching([p for _, p in made], rough, start, settings)
    assert [(p.name, p.problem) for p in matched if p.registration is None] == []
    for (kept, _), picture in zip(made, matched, strict=True):
        pairs = picture.registration.matching
        assert (kept[pairs.detection] == pairs.marker).all()


@cache
def refocused(seed):
    """The markers, the settings with a focal length for every picture, and what came of them."""
    made, rough = refocused_sheet(seed, shift_px=0.0)
    settings = CalibrateSettings(Free(), free_focal=EVERY, prior_sigma={"focus": 0.003})
    start = {"camera": Camera((1600, 1200), 1700.0)}
    return rough, settings, *calibrate_matching([p for _, p in made], rough, start, settings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [8, 9])
def test_a_focal_length_of_its_own_for_every_picture(seed):
    """Known to 0.3 %, they are found, and the camera's is their mean; without, the residuals say so."""
    _, _, done, _ = refocused(seed)
    assert done
    assert 0.9 < done.result.sigma0 < 1.1
    focal = done.result.cameras["camera"].focal_px
    assert abs(focal - 1500.0) < 4 * done.result.sigma("camera", "focal_px")
    assert 0.001 < np.std(done.result.focal_change) < 0.005


def away(result):
    """Of the focal length from the true one, in its sigmas."""
    return abs(result.cameras["camera"].focal_px - 1500.0) / result.sigma("camera", "focal_px")


@pytest.mark.slow
def test_a_principal_point_of_its_own_for_every_picture():
    """A lens that sags: without, the pictures are said to differ; with, the residuals are the noise."""
    made, rough = refocused_sheet(12, count=9)
    start, focus = {"camera": Camera((1600, 1200), 1700.0)}, {"free_focal": EVERY, "prior_sigma": {"focus": 0.003}}
    plain, _ = calibrate_matching([p for _, p in made], rough, start, CalibrateSettings(Free(), **focus))
    assert any(d.cause == "principal" for d in plain.result.doubts)
    assert plain.result.sigma0 > 1.15
    assert away(plain.result) > 4
    both = {**focus, "free_principal": EVERY, "prior_sigma": {"focus": 0.003, "principal": 5.0}}
    done, _ = calibrate_matching([p for _, p in made], rough, start, CalibrateSettings(Free(), **both))
    assert 0.9 < done.result.sigma0 < 1.1
    assert done.result.doubts == ()
    assert away(done.result) < 2
    assert 2.0 < np.std(done.result.principal_shift) < 5.0
    assert done.halves  # which have such principal points, too


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


@pytest.mark.slow
def test_labels_that_contradict_the_pictures_without_are_said():
    """Names that all are turned fit as well: which side is right is not for the majority to say."""
    rough, settings, done, matched = refocused(9)
    assert not any("labels" in w for w in done.result.warnings)
    lost = "fixed labels contradict the spots: 63 of 63 markers in view are matched without them"
    pictures = [replace(p, registration=None, problem=lost, cause="labels") if p.fixed else p for p in matched]
    said = _with_doubts((done, tuple(pictures)), rough, settings)[0].result.warnings[0]
    names = [p.name for p in matched if p.fixed]
    listed = ", ".join(names)
    assert said == f"the labels in {listed} contradict the pictures without: if they are right, all names are wrong"
