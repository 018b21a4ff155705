"""The covariance where one minimum is not all there is: curved within its sigma, tilted otherwise, a label apart."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import settle_scenes as settling
from registration_scenes import image_of, scene
from test_one_pair import boom

from windmark.geometry import Camera, Pose
from windmark.registration import register
from windmark.registration.judge.answer import curvature
from windmark.registration.judge.twins import elsewhere, near_ones, twin_of
from windmark.registration.settle.settling import with_freedom

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import _attack_judge as judge
import _attack_scenes as attacks


def answered(path):
    trial = attacks.trial(path)
    answer = register(trial.detections, trial.markers, trial.camera, **trial.options)
    return answer, judge.judged(path.split("/")[0], trial, answer, 0.0)


def by_differences(best, model):
    """The same by second differences of all projections, one sigma either way, in the parameters of the result."""
    marker = best.pairs()[1]
    xyz, weight = model.xyz[marker], 1 / np.sqrt(best.state.spread[0, marker, 0])

    def seen(delta):
        places = (Pose.exp(delta) @ best.cam_from_model()).apply(xyz)
        return (best.camera().project(places)[0] * weight[:, None]).ravel()

    lower = np.linalg.cholesky(best.cov)
    slope = np.stack([(seen(1e-3 * a) - seen(-1e-3 * a)) / 2e-3 for a in lower.T], axis=1)
    out = np.zeros((6, 6))
    for a in lower.T:
        for b in lower.T:
            second = 0.25 * (seen(a + b) - seen(a - b) - seen(b - a) + seen(-a - b))
            moved = lower @ np.linalg.lstsq(slope, second, rcond=None)[0]
            out += 0.5 * np.outer(moved, moved)
    return out


@pytest.mark.parametrize("shown", [boom(1), scene(3, "A", hidden=0.5)], ids=["boom", "wing"])
def test_the_second_order_is_that_of_differences(shown):
    _, best = settling.best_of(shown)
    change = best.to_model()
    found = change @ curvature(best)[:6, :6] @ change.T
    expected = by_differences(best, shown.markers)
    back = np.linalg.inv(np.linalg.cholesky(best.cov))
    found, expected = back @ found @ back.T, back @ expected @ back.T
    np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max())


def test_the_second_order_is_little_where_markers_are_spread():
    _, best = settling.best_of(scene(5, "B"))
    assert np.trace(np.linalg.solve(best.unit_cov[:6, :6], curvature(best)[:6, :6])) < 0.01


@pytest.mark.parametrize("seed", [22000031, 22000061])
def test_the_sigma_of_a_row_alone_covers(seed):
    """A row that waves a little: by the first order alone these poses are 5.2 and 6.8 sigma off."""
    answer, outcome = answered(f"one-pair/stray spot{', relief' if seed == 22000061 else ' only'}/{seed}")
    assert answer
    assert outcome.sigmas < 2.0


def test_a_tilt_the_other_way_that_fits_as_well_is_said():
    """Eight markers, nearly flat: the search had only the wrong one of two tilts, 70 degrees apart."""
    answer, _ = answered("one-pair/eight left/22000040")
    assert answer.cause == "ambiguous"
    assert "same labels" in answer.reason


def test_a_tilt_within_the_sigma_of_a_loose_pose_is_said():
    answer, _ = answered("one-pair/flat, false/13000015")
    assert answer.cause == "ambiguous"


def test_flat_markers_far_away_have_two_tilts_and_a_model_with_depth_has_one():
    rng, flat = np.random.default_rng(4), scene(2, "A").markers
    markers = replace(flat, xyz=flat.xyz * [1.0, 1.0, 0.0], normal=np.tile([0.0, 0.0, 1.0], (len(flat), 1)))
    centre, far = markers.xyz.mean(axis=0), 200 * np.ptp(markers.xyz, axis=0).max()
    pose = Pose.look_at(centre + far * np.array([0.3, 0.0, 0.95]), centre, [0, 1, 0])
    _, best = settling.best_of(image_of(rng, markers, Camera((1280, 1000), 140000.0), pose))
    twin = twin_of(best)
    assert twin is not None
    assert twin.count == best.count
    assert best.rig_from_model.angle_to(twin.rig_from_model) > np.radians(20)
    assert abs(best.lead_over(twin)) < 5
    assert not elsewhere(best, twin)  # every marker is where it was, within the tolerance
    assert twin_of(settling.best_of(scene(5, "B"))[1]) is None


def test_a_solution_beside_itself_has_nothing_near():
    _, best = settling.best_of(scene(3, "A"))
    again = with_freedom(best.views, best)
    assert again is not None
    assert near_ones(best, [best, again], 10.0) == ()


def test_spots_beside_a_row_are_tried_as_those_of_all_other_markers():
    """Both of two were four places farther along: 17 nats worse than the truth, which the search had not found."""
    answer, outcome = answered("one-pair/oblique, two left/22000094")
    assert outcome.kind != "WRONG"
    assert answer.cause == "ambiguous"  # the other tilt is 3 degrees away
