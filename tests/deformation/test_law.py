"""Parameters, functions as laws, numerical derivatives."""

import numpy as np
import pytest

import windmark as wm
from windmark.deformation import FunctionLaw, LawError, Linear, Numeric, Parameter, function_law, law

XYZ = np.random.default_rng(0).normal(size=(7, 3))


def test_a_function_becomes_a_law():
    @law(tip="mm", twist={"unit": "deg", "sigma": 2.0})
    def wing(xyz, tip, twist=1.5, *, span=600.0):
        return xyz + tip * np.array([0, 0, 1]) + twist * span * np.array([1e-3, 0, 0])

    assert isinstance(wing, FunctionLaw)
    assert wing.name == "wing"
    assert wing.parameters == (Parameter("tip", "mm"), Parameter("twist", "deg", start=1.5, sigma=2.0))
    assert wing.settings == {"span": 600.0}
    assert "test_law.py:" in wing.source
    np.testing.assert_allclose(wing(XYZ, 2.0, 1.0), XYZ + np.array([0.6, 0, 2]))
    np.testing.assert_allclose(wing.bind(XYZ).place(np.array([2.0, 1.0])), XYZ + np.array([0.6, 0, 2]))
    other = wing.with_options({"span": 100.0})
    assert other.settings == {"span": 100.0}
    np.testing.assert_allclose(other.bind(XYZ).place(np.array([2.0, 1.0])), XYZ + np.array([0.1, 0, 2]))
    with pytest.raises(LawError, match="law wing: has no option chord; it has span"):
        wing.with_options({"chord": 1.0})


def test_a_law_that_writes_into_its_points_harms_nobody():
    @law()
    def careless(xyz, tip):
        xyz[:, 2] += tip
        return xyz

    before = XYZ.copy()
    bound = careless.bind(XYZ)
    np.testing.assert_array_equal(bound.place(np.array([1.0])), bound.place(np.array([1.0])))
    np.testing.assert_array_equal(XYZ, before)


@pytest.mark.parametrize(
    ("function", "units", "words"),
    [
        (lambda xyz, *q: xyz, {}, r"\*args and \*\*kwargs have no names"),
        (lambda xyz, **q: xyz, {}, r"\*args and \*\*kwargs have no names"),
        (lambda xyz: xyz, {}, "has no parameter; expected def"),
        (lambda xyz, tip: xyz, {"tap": "mm"}, "has no parameter tap; it has tip"),
        (lambda xyz, tip, *, span: xyz, {}, "option span needs a default"),
        (lambda xyz, tip: xyz, {"tip": {"sgma": 1}}, "parameter tip: .*sgma"),
        (lambda xyz, tip: xyz, {"tip": {"sigma": -1}}, "parameter tip: .*sigma must be > 0, got -1"),
        (lambda xyz, tip=2.0: xyz, {"tip": {"upper": 1}}, "lower <= start <= upper"),
        (max, {}, "expected a function written in Python|has no parameter"),
    ],
)
def test_functions_that_are_no_laws(function, units, words):
    with pytest.raises(LawError, match=words):
        function_law(function, units)


def test_parameters_that_contradict_themselves():
    for numbers, words in (
        ({"name": "a b"}, "identifier"),
        ({"start": np.nan}, "finite"),
        ({"sigma": 0}, "sigma"),
        ({"lower": 1.0, "upper": 1.0, "start": 1.0}, "lower <= start <= upper"),
    ):
        with pytest.raises(ValueError, match=words):
            Parameter(**{"name": "tip", **numbers})


def test_numerical_derivatives_are_exact_enough():
    rate = np.array([0.3, -0.02])
    bound = Numeric(lambda q: XYZ * np.sin(rate @ q) + q[0] ** 3, np.array([1e-4, 1e-4]))
    q = np.array([0.7, 11.0])
    place, by_q = bound.linearise(q)
    np.testing.assert_array_equal(place, bound.place(q))
    expected = XYZ[..., None] * np.cos(rate @ q) * rate + np.array([3 * q[0] ** 2, 0])
    np.testing.assert_allclose(by_q, expected, atol=1e-7)


def test_derivatives_do_not_leave_the_bounds():
    """A root that has no value below its bound."""

    @law(tip={"lower": 0.0, "upper": 2.0, "start": 1.0})
    def rooted(xyz, tip):
        assert 0 <= tip <= 2
        return xyz + tip**1.5 * np.sqrt(2 - tip + 1)

    for tip in (0.0, 1.0, 2.0):
        by_q = rooted.bind(XYZ).linearise(np.array([tip]))[1]
        expected = 1.5 * tip**0.5 * np.sqrt(3 - tip) - tip**1.5 / (2 * np.sqrt(3 - tip))
        np.testing.assert_allclose(by_q, expected, atol=0.02 if tip in (0.0, 2.0) else 1e-7)


def test_linear():
    shapes = np.random.default_rng(1).normal(size=(7, 3, 2))
    place, by_q = Linear(XYZ, shapes).linearise(np.array([2.0, -1.0]))
    np.testing.assert_allclose(place, XYZ + 2 * shapes[..., 0] - shapes[..., 1])
    assert by_q is shapes


def test_where_a_law_ends_one_side_tells_its_derivative():
    """sqrt(1 - q) has no value beyond q = 1; at its end, and a step before it, it has a slope towards lower q."""
    function = function_law(lambda xyz, q: xyz + np.emath.sqrt(1 - q).real + (np.nan if q > 0.5 else 0.0), {})
    bound, step = function.bind(XYZ), function.parameters[0].step
    for at in (0.5, 0.5 - 0.1 * step):
        slope = bound.linearise(np.array([at]))[1]
        assert slope == pytest.approx(np.full((*XYZ.shape, 1), -0.5 / np.sqrt(0.5)), rel=1e-3)


def test_a_law_with_numbers_at_its_start_only_is_refused_by_name():
    """It gave a fault of the eigenvalues."""
    broken = function_law(lambda xyz, tip: xyz + np.array([0, 0, 1]) * (np.nan if tip else 0.0), {})
    x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], volume="wing")
    camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([300, 200, 700], [40, 200, 0], [0, 1, 0])
    xy, _ = camera.project(pose.apply(markers.xyz))
    seen = wm.Observations(np.zeros(24, dtype=int), np.arange(24), xy, np.tile(0.01 * np.eye(2), (24, 1, 1)))
    view = wm.View("cam1", cam_from_model=pose)
    state = wm.identify(seen, markers, [wm.Volume("wing", broken)], camera, [view], free_motion=False)
    assert not state
    assert state.weak == ("wing.tip",)
    assert "no numbers for a small change of wing.tip" in state.reason
