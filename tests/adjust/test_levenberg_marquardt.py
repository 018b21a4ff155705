"""The driver on problems that are no cameras: it must not know the difference."""

import numpy as np
import pytest

from windmark.adjust import REASONS, NormalEquations, SolveOptions, SolveReport, minimise, pose_problem
from windmark.geometry import Camera, Pose


class Curve:
    """r(x) with a derivative; `allowed` marks where the model has a prediction."""

    def __init__(self, residual, jacobian, allowed=lambda x: True):
        self.residual, self.jacobian, self.allowed = residual, jacobian, allowed
        self.tried = []

    def linearise(self, x):
        self.tried.append(x)
        if not self.allowed(x):
            return None
        r, j = self.residual(x), self.jacobian(x)
        return NormalEquations(0.5 * float(r @ r), j.T @ r, j.T @ j, np.eye(len(x)))

    def retract(self, x, delta):
        return x + delta


def rosenbrock(allowed=lambda x: True):
    return Curve(
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
        lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
        allowed,
    )


def test_rosenbrock():
    x, system, report = minimise(rosenbrock(), np.array([-1.2, 1.0]))
    np.testing.assert_allclose(x, [1, 1], atol=1e-6)
    assert report.converged
    assert system.cost == report.final_cost < 1e-12
    assert report.initial_cost == pytest.approx(12.1)
    assert report.evaluations == report.iterations + 1


def test_the_last_matrix_is_not_factored(monkeypatch):
    """Where the step before was short and undamped, its matrix tells that the minimum is reached."""
    solve, dampings = NormalEquations.solve, []
    monkeypatch.setattr(
        NormalEquations, "solve", lambda self, damping: dampings.append(damping) or solve(self, damping)
    )
    curve = Curve(lambda x: np.array([x[0] - 1, 0.01 * x[0] ** 2]), lambda x: np.array([[1.0], [0.02 * x[0]]]))
    minimum = minimise(curve, np.array([2.0]), SolveOptions(gradient_tol=1e-12))[0]
    dampings.clear()
    x, system, report = minimise(curve, minimum + 5e-5, SolveOptions(initial_damping=1e-8))
    assert dampings == [0.0] * report.iterations
    assert report.reason == "converged_gradient"
    assert np.abs(x - minimum).max() < 1e-7
    assert system.decrement(system) == pytest.approx(np.sqrt(2 * solve(system, 0.0).decrease), abs=1e-9)


def test_a_forbidden_region_is_never_entered_and_never_gives_nan():
    curve = rosenbrock(lambda x: x[1] > 0.5 * x[0] ** 2 - 0.2)
    x, _, report = minimise(curve, np.array([-1.2, 1.0]))
    assert any(not curve.allowed(t) for t in curve.tried)  # the test would not test anything otherwise
    np.testing.assert_allclose(x, [1, 1], atol=1e-6)
    assert report.converged


def test_start_in_the_forbidden_region_is_refused():
    with pytest.raises(ValueError, match="start"):
        minimise(rosenbrock(lambda x: False), np.zeros(2))


def test_every_reason_can_happen_and_is_explained():
    start = np.array([-1.2, 1.0])
    found = {}
    for options in (
        SolveOptions(),
        SolveOptions(max_iterations=3),
        SolveOptions(gradient_tol=0.0, step_tol=1e-6, cost_tol=0.0),
    ):
        report = minimise(rosenbrock(), start, options)[2]
        found[report.reason] = report.converged
    # A cost that cannot reach zero ends by the cost.
    offset = Curve(lambda x: np.array([x[0] - 1, x[0] + 1 + x[0] ** 2]), lambda x: np.array([[1.0], [1 + 2 * x[0]]]))
    report = minimise(offset, np.array([2.0]), SolveOptions(gradient_tol=0.0, step_tol=0.0, cost_tol=1e-6))[2]
    found[report.reason] = report.converged
    # A derivative of the wrong sign promises a decrease that never comes.
    wrong = Curve(lambda x: x - 3, lambda x: -np.eye(1))
    report = minimise(wrong, np.array([0.0]))[2]
    found[report.reason] = report.converged
    assert found == {
        "converged_gradient": True,
        "max_iterations": False,
        "converged_step": True,
        "converged_cost": True,
        "stalled": False,
    }
    assert set(found) == set(REASONS)


def test_a_parameter_without_influence_does_not_stop_the_others():
    curve = Curve(lambda x: np.array([x[0] - 2.0]), lambda x: np.array([[1.0, 0.0]]))
    x, _, report = minimise(curve, np.array([0.0, 7.0]))
    assert report.converged
    np.testing.assert_allclose(x, [2.0, 7.0], atol=1e-6)


def test_cost_never_rises(scene):
    s = scene(1)

    class Watched:
        costs = []  # noqa: RUF012

        def __init__(self, problem):
            self.problem = problem

        def linearise(self, values):
            return self.problem.linearise(values)

        def retract(self, values, delta):
            self.costs.append(self.problem.cost(values))  # a step starts from the accepted point
            return self.problem.retract(values, delta)

    problem, values = pose_problem(s.camera, s.start(1.2, 2.0), s.xyz, s.noisy(0.1), s.cov(0.1))
    watched = Watched(problem)
    _, system, report = minimise(watched, values)
    assert report.converged
    assert len(watched.costs) > 4
    assert (np.diff([*watched.costs, system.cost]) <= 0).all()


def test_steps_through_the_camera_plane_are_rejected():
    camera = Camera((1280, 800), 1000.0)
    xyz = np.random.default_rng(0).uniform(-1, 1, (12, 3))
    truth = Pose.from_rotvec([0.1, 0.2, 0.3], [0, 0, 2.2])
    xy = camera.project(truth.apply(xyz))[0]
    # The start is so far that the first Newton step carries points behind the camera.
    start = Pose.from_rotvec([0.1, 0.2, 0.3], [0.5, -0.5, 60.0])
    problem, values = pose_problem(camera, start, xyz, xy)
    rejected = []

    class Counted:
        def linearise(self, v):
            system = problem.linearise(v)
            rejected.append(system is None)
            return system

        retract = staticmethod(problem.retract)

    found, _, report = minimise(Counted(), values)
    assert any(rejected)
    assert report.converged
    np.testing.assert_allclose(found["pose"].translation, truth.translation, atol=1e-8)


def test_report_and_options_refuse_nonsense():
    with pytest.raises(ValueError, match="max_iterations: expected at least 1"):
        SolveOptions(max_iterations=0)
    with pytest.raises(ValueError, match="reason must be among"):
        SolveReport("done", True, 1, 1, 1.0, 1.0)
