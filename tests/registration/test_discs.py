"""After acceptance nothing contradicts it: radii in another unit than the places, discs that fit worse than points."""

from dataclasses import replace

import numpy as np
import pytest
import registration_scenes as scenes
import settle_scenes

from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.registration import CAUSES, register, register_rig
from windmark.registration.judge.answer import corrected
from windmark.registration.judge.discs import _grown
from windmark.registration.settle._kernels.state import EXCESS
from windmark.registration.settle.settling import accepted, with_excess
from windmark.registration.task import Limits
from windmark.scene import Detections
from windmark.scene.units import mixed_units

SIGMA = 0.02


@pytest.fixture(scope="module")
def discs():
    """A wing seen at 50 degrees, discs of 6 px as a detector gives them: (spots, markers in mm, camera, pose)."""
    rng = np.random.default_rng(11)
    markers = scenes.wing(np.random.default_rng(5))
    camera = Camera((1280, 1000), 900.0)
    middle = markers.xyz.mean(axis=0)
    towards = np.array([0.0, -np.sin(np.radians(50)), np.cos(np.radians(50))])
    pose = Pose.look_at(middle + 1.2 * towards, middle, [1.0, 0.2, 0.0])
    radius = np.full(len(markers), 6.0 * np.median(pose.apply(markers.xyz)[:, 2]) / camera.focal_px)
    markers = replace(markers, radius=radius, length_unit="mm")
    seen = imaged_ellipse(camera, pose.apply(markers.xyz), pose.rotate(markers.normal), radius)
    kept = camera.in_image(seen.xy)
    spots = Detections.make(
        seen.xy[kept] + rng.normal(0, SIGMA, (kept.sum(), 2)), sigma_px=SIGMA,
        radius_px=np.sqrt(seen.axes_px.prod(axis=1))[kept],
    )  # fmt: skip
    return spots, markers, camera, pose


def test_radii_that_fit_are_taken_without_a_word(discs):
    spots, markers, camera, pose = discs
    found = register(spots, markers, camera)
    assert found.cam_from_model.angle_to(pose) < 1e-3
    assert "radii" not in [u.what for u in found.unchecked]


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1 / 25.4, "times too small for the imaged markers: radii in inch beside places in mm?"),
        (1e-3, "times too small for the imaged markers: radii in m beside places in mm?"),
        (0.1, "times too small for the imaged markers: radii in cm beside places in mm?"),
        (1 / 304.8, "times too small for the imaged markers: radii in ft beside places in mm?"),
        (5.0, "times too large for the imaged markers; another unit, or something else"),
    ],
)
def test_radii_in_another_unit_are_refused_and_the_unit_named(discs, factor, words):
    spots, markers, camera, _ = discs
    said = register(spots, replace(markers, radius=factor * markers.radius), camera)
    assert not said
    assert said.cause == "discs"
    assert CAUSES["discs"]
    assert words in said.reason
    assert "The places fit: they match 24 of 24 markers" in said.reason


def test_the_factor_that_is_named_is_that_of_the_numbers(discs):
    """Of places in inches radii in mm are 25.4 times too large; without a unit of the places the pair is named."""
    spots, markers, camera, _ = discs
    for unit, words in (("in", "radii in mm beside places in inch?"), ("", "radii in mm beside places in inch?")):
        said = register(spots, replace(markers, radius=25.4 * markers.radius, length_unit=unit), camera)
        assert words in said.reason
        assert "25" in said.reason.split(" times too large")[0]


def test_diameters_in_place_of_radii_are_said(discs):
    """Their eccentricity is too small here to show in the residuals."""
    spots, markers, camera, _ = discs
    found = register(spots, replace(markers, radius=2 * markers.radius), camera)
    assert any("diameters in their place?" in u.words for u in found.unchecked if u.what == "radii")


def test_radii_half_as_large_again_are_in_the_sigma_of_the_pose_and_said(discs):
    """They fit as well as the right ones: what they move is made up for by the pose."""
    _, markers, camera, pose = discs
    seen = imaged_ellipse(camera, pose.apply(markers.xyz), pose.rotate(markers.normal), markers.radius)
    spots = Detections.make(seen.xy, sigma_px=0.003, radius_px=np.sqrt(seen.axes_px.prod(axis=1)))
    for factor, words in ((1.0, ()), (1.45, ("times too large",))):
        found = register(spots, replace(markers, radius=factor * markers.radius), camera)
        said = [u.words for u in found.unchecked if u.what == "radii"]
        assert len(said) == len(words)
        assert all(w in s for w, s in zip(words, said, strict=True))
        off = (pose @ found.cam_from_model.inverse()).log()
        assert np.sqrt(off @ np.linalg.solve(found.cov, off)) < 2


def test_spots_without_radii_refuse_discs_that_fit_worse_than_points(discs):
    """Nothing says how large they are imaged, but the eccentricity of the table's discs is not there."""
    spots, markers, camera, _ = discs
    plain = replace(spots, radius_px=np.full(len(spots), np.nan))
    assert register(plain, markers, camera)
    said = register(plain, replace(markers, radius=4 * markers.radius), camera)
    assert said.cause == "discs"
    assert "they fit worse" in said.reason
    assert "are radii and normals right" in said.reason


def test_a_rig_refuses_them_too():
    rig = scenes.rig_scene(528, "B", 2, noise_px=0.02)
    spots, markers, cameras, poses = rig.arguments()
    radii = []
    for view, seen in zip(rig.views, spots, strict=True):
        depth = view.cam_from_model.apply(markers.xyz).mean(axis=0)[2]
        radii.append(replace(seen, radius_px=np.full(len(seen), 0.03 * view.camera.focal_px / depth)))
    small = replace(markers, radius=np.full(len(markers), 0.03 / 25.4))
    said = register_rig(radii, small, cameras, poses)
    assert said.cause == "discs"
    assert "beside places in" in said.reason


@pytest.mark.parametrize(("factor", "refused"), [(1.0, False), (4.0, True)])
def test_an_excess_that_comes_to_rest_elsewhere_says_nothing_of_the_discs(discs, factor, refused):
    """Two that fit alike are 20 nats and more apart where only one of them has an excess."""
    spots, markers, camera, pose = discs
    markers = replace(markers, radius=factor * markers.radius)
    label = np.flatnonzero(camera.in_image(camera.project(pose.apply(markers.xyz))[0]))
    scene = scenes.Scene(spots, markers, camera, pose, label)
    best = settle_scenes.settled(settle_scenes.views_of(scene), scene)
    plain, final = accepted(best), corrected(best)
    final = with_excess(final, final.state.numbers[:, EXCESS] + (5 * SIGMA) ** 2)
    assert plain.score - final.score > 20
    assert bool(_grown(best, final, Limits(-9.0, 60.0, 10.0, 0.05, 0.025, 0.05))) == refused


def test_factors_of_units():
    assert mixed_units(25.4) == ("mm", "in")
    assert mixed_units(1 / 25.4, "in") == ("in", "mm")
    assert mixed_units(2.54, "cm") == ("cm", "in")
    assert mixed_units(12.0, "in") == ("in", "ft")
    assert mixed_units(5.0) is None
    assert mixed_units(25.4, "m") is None
