"""A rig whose lengths are not the table's, places a little off, and errors of the table that all cameras see."""

import re

import numpy as np
import pytest

import windmark as wm
from windmark.registration import register
from windmark.scene import Detections, MarkerSet

CAMERA = wm.Camera((1600, 1200), 1700.0)


def rig(count: int, base: float = 0.5) -> list[wm.Pose]:
    """Cameras side by side, 1.6 before the model, in the frame of none of them."""
    eyes = [[base * (c - 0.5 * (count - 1)), 0.02 * c, -1.6] for c in range(count)]
    return [wm.Pose.look_at(eye, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for eye in eyes]


def seen_by(seed: int, places: list[wm.Pose], sigma: float = 0.0) -> tuple[list[Detections], MarkerSet, wm.Pose]:
    """Spots of 50 markers in each camera, the table with errors of 1 ``sigma``, and where the model is in the rig."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (50, 3)) * [0.5, 0.35, 0.15]
    there = wm.Pose.exp(rng.normal(0, [0.08, 0.08, 0.08, 0.2, 0.2, 0.2])[[3, 4, 5, 0, 1, 2]])
    spots = []
    for place in places:
        xy, valid = CAMERA.project((place @ there).apply(xyz))
        seen = xy[valid & CAMERA.in_image(xy)]
        spots.append(Detections.make(seen + rng.normal(0, 0.1, seen.shape), sigma_px=0.1))
    known = np.full((50, 3), sigma) if sigma else None
    table = MarkerSet.make([f"m{i}" for i in range(50)], xyz + rng.normal(0, 1, (50, 3)) * sigma, sigma=known)
    return spots, table, there


def scaled(places: list[wm.Pose], factor: float) -> list[wm.Pose]:
    return [wm.Pose(p.rotation, factor * p.translation) for p in places]


def distance2(result: wm.RigRegistration, there: wm.Pose) -> float:
    error = (result.rig_from_model @ there.inverse()).log()
    return float(error @ np.linalg.solve(result.cov, error))


@pytest.mark.parametrize(("factor", "change"), [(1.01, "smaller"), (0.97, "larger")])
@pytest.mark.parametrize("seed", [0, 1])
def test_lengths_of_a_rig_that_are_not_those_of_the_table_are_named(factor, change, seed):
    """With three cameras some were left without a pair, and the pose of one alone was taken without a word."""
    places = rig(3)
    spots, table, _ = seen_by(seed, places)
    found = register(spots, table, [CAMERA] * 3, cam_from_rig=scaled(places, factor))
    assert not found
    assert found.cause == "wrong_camera"
    assert "lengths of cam_from_rig are not those of the table" in found.reason
    told = re.search(rf"if they were (\S+) % {change}", found.reason)
    assert told is not None, found.reason
    assert float(told[1]) == pytest.approx(100 * abs(1 / factor - 1), rel=0.05)


def test_a_rig_in_another_unit_is_named_with_both():
    places = rig(3)
    spots, table, _ = seen_by(2, places)
    found = register(spots, table, [CAMERA] * 3, cam_from_rig=scaled(places, 25.4))
    assert not found
    assert "the table in inch, the rig in mm?" in found.reason


@pytest.mark.parametrize("count", [2, 3])
def test_a_right_rig_is_not_doubted(count):
    places = rig(count)
    for seed in range(3):
        spots, table, there = seen_by(seed, places)
        found = register(spots, table, [CAMERA] * count, cam_from_rig=places)
        assert found, found.reason
        assert distance2(found, there) < 27  # 1e-4 by chance
        assert not any("lengths" in u.words for u in found.unchecked)


def test_what_an_exact_place_would_do_unnoticed_is_said_unless_its_covariance_is_given():
    """The second camera is off its place by 0.1 mm of 1.6 m, which does not show, and the pose is wrong."""
    places = rig(2)
    spots, table, there = seen_by(6, [places[0], wm.Pose.exp([0, 0, 0, 1e-4, 0, 0]) @ places[1]])
    found = register(spots, table, [CAMERA] * 2, cam_from_rig=places)
    assert distance2(found, there) > 27
    said = [u for u in found.unchecked if u.what == "place in the rig"]
    assert [u.camera for u in said] == [1]
    assert "would go unnoticed here, and the pose be off by up to" in said[0].words
    known = np.diag([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4]) ** 2
    found = register(spots, table, [CAMERA] * 2, cam_from_rig=places, rig_cov=[None, known])
    assert distance2(found, there) < 27
    assert not any("a place that is taken as exact" in u.words for u in found.unchecked)


def test_errors_of_the_table_do_not_become_less_by_more_cameras():
    """Four cameras beside each other see the same errors: they know the pose hardly better than one."""
    places = rig(4, base=0.004)
    there = places[0].inverse()
    four = [place @ there for place in places]  # in the frame of the first
    spots, table, _ = seen_by(7, places, sigma=1e-3)
    alone = register(spots[0], table, CAMERA, max_deformation=0.0)
    found = register(spots, table, [CAMERA] * 4, cam_from_rig=four, max_deformation=0.0)
    ratio = np.diag(found.cov) / np.diag(alone.cov)
    assert (ratio > 0.9).all()  # 0.25 as if the errors were independent
    assert (ratio < 1.5).all()


@pytest.mark.slow
@pytest.mark.parametrize(("sigma", "stated"), [(5e-4, True), (2e-4, False)])
def test_the_sigma_of_a_rig_covers_errors_of_the_table(sigma, stated):
    """Also those that the table does not state, as far as they are seen in the residuals."""
    places, squares = rig(4), []
    for seed in range(40):
        spots, table, there = seen_by(100 + seed, places, sigma)
        table = table if stated else MarkerSet.make(table.name.tolist(), table.xyz)
        found = register(spots, table, [CAMERA] * 4, cam_from_rig=places)
        assert found, found.reason
        squares.append(distance2(found, there) / 6)
    assert np.mean(squares) < 1.35  # three sigma of the mean of 40; 2.8 before
