"""AIAA 2005-5007, section IV.B: the growing and shrinking steps reach the same minimum, at another price."""

import numpy as np
import pytest

from windmark.adjust import PaperOptions, covariance, minimise, minimise_by_steps, pose_problem
from windmark.geometry import Camera, Pose


def test_both_engines_find_the_same_pose(scene):
    s = scene(1)
    problem, start = pose_problem(s.camera, s.start(0.1, 0.4), s.xyz, s.noisy(0.1), s.cov(0.1))
    exact, system, newton = minimise(problem, start)
    found, steps = minimise_by_steps(problem, start)
    assert newton.converged
    assert steps.converged
    # Distance in units of the estimate's sigma.
    delta = (found["pose"] @ exact["pose"].inverse()).log()
    cov = covariance(system, problem.names)
    assert np.abs(delta / np.sqrt(np.diag(cov))).max() < 1e-3
    assert steps.final_cost == pytest.approx(newton.final_cost, rel=1e-9)
    assert steps.final_cost >= newton.final_cost * (1 - 1e-12)
    # Six parameters, three tries: the price of doing without derivatives.
    assert newton.evaluations < 12
    assert 100 < steps.evaluations < 3000


@pytest.mark.slow
def test_both_engines_find_the_same_focal_length():
    # A wide lens close to a deep model: the best case for one parameter at a time.
    rng = np.random.default_rng(0)
    camera, pose = Camera((1280, 800), 900.0), Pose.from_rotvec([0.3, -0.4, 1.1], [0, 0, 3.5])
    xyz = rng.uniform(-1, 1, (20, 3))
    xy = camera.project(pose.apply(xyz))[0] + 0.1 * rng.normal(size=(20, 2))
    cov = np.tile(np.eye(2) * 0.01, (20, 1, 1))
    problem, start = pose_problem(Camera((1280, 800), 918.0), pose, xyz, xy, cov, free=("focal_px",))
    exact, system, newton = minimise(problem, start)
    found, steps = minimise_by_steps(problem, start, PaperOptions(step_tol=1e-8))
    sigma = np.sqrt(covariance(system, problem.names)[6, 6])
    assert steps.converged
    assert found["camera"].focal_px == pytest.approx(exact["camera"].focal_px, abs=0.02 * sigma)
    # Focal length and distance trade against each other: the walk down their valley is slow.
    assert newton.evaluations < 12
    assert steps.evaluations > 300 * newton.evaluations


def test_no_more_than_three_tries_per_parameter_and_pass(scene):
    s = scene(3)
    problem, start = pose_problem(s.camera, s.start(), s.xyz, s.xy)
    report = minimise_by_steps(problem, start, PaperOptions(max_passes=4))[1]
    assert (report.reason, report.iterations) == ("max_iterations", 4)
    assert report.evaluations == 1 + 4 * 6 * 3
    assert report.final_cost < report.initial_cost
    assert report.options["tries"] == 3


def test_it_never_steps_where_there_is_no_prediction(scene):
    s = scene(4)
    problem, start = pose_problem(s.camera, s.pose, s.xyz, s.xy)
    # A first step of twice the distance puts everything behind the camera.
    values, report = minimise_by_steps(problem, start, PaperOptions(initial_step=-2.0, max_passes=30))
    assert np.isfinite(report.final_cost)
    assert np.isfinite(problem.cost(values))
    behind = problem.retract(start, -2 * problem.natural(start)[:, 5])
    assert problem.cost(behind) == np.inf
    with pytest.raises(ValueError, match="start"):
        minimise_by_steps(problem, behind)


@pytest.mark.parametrize("bad", [{"tries": 0}, {"max_passes": 0}, {"grow": 0.9}, {"shrink": 1.5}])
def test_options_are_checked(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        PaperOptions(**bad)


def test_a_single_try_and_a_single_pass_are_allowed(scene):
    s = scene(3)
    problem, start = pose_problem(s.camera, s.start(), s.xyz, s.xy)
    report = minimise_by_steps(problem, start, PaperOptions(tries=1, max_passes=1))[1]
    assert report.evaluations == 1 + 6
