"""Built-in laws by name, as project files ask for them."""

import numpy as np
import pytest

from windmark.deformation import LawError, Parameter, check_law, function_law, with_parameters
from windmark.deformation.laws import CATALOG, Beam, Powers, Splines, make_law

POINTS = np.random.default_rng(1).uniform([100, 80, 0], [400, 590, 30], (20, 3))
TABLE = (POINTS[:12], np.random.default_rng(2).normal(size=(12, 3, 2)))
AXIS = {"root": [100, 72, 5], "tip": [360.0, 600, 42]}


def made(kind, options):
    return make_law(kind, options, unit="mm", points=POINTS, table=TABLE)


@pytest.mark.parametrize("kind", CATALOG)
def test_every_example_makes_a_sound_law(kind):
    entry = CATALOG[kind]
    law = made(kind, entry.example)
    assert check_law(law, POINTS, name=kind) == ()
    assert all(p.unit in ("mm", "deg", "") for p in law.parameters)
    assert entry.line
    assert all(o.meaning and o.expected for o in entry.options)


def test_options_reach_the_law():
    law = made("beam", {**AXIS, "section": [0, 1, 0], "bend": [2, 4], "twist": [1], "sway": [2]})
    assert law == Beam(
        (100, 72, 5), (360, 600, 42), bend=Powers((2, 4)), twist=Powers((1,)), sway=Powers((2,)), section=(0, 1, 0),
        unit="mm",
    )  # fmt: skip
    assert [p.name for p in made("modal_beam", {**AXIS, "bend": 3, "twist": 0}).parameters] == [
        "bend_1", "bend_2", "bend_3",
    ]  # fmt: skip
    spline = made("spline_beam", {**AXIS, "bend": [0.5, 1], "twist": []})
    assert spline.bend == Splines((0.5, 1.0), clamped=True)
    assert [(p.name, p.unit) for p in spline.parameters] == [("bend_50", "mm"), ("bend_100", "mm")]
    assert made("smooth", {"amplitude": 3, "reach": 200}).amplitude == 3.0
    assert [p.unit for p in made("modes", {"table": "m.csv", "amplitude_unit": "m"}).parameters] == ["m", "m"]


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("bean", {}, "law 'bean': expected one of rigid, hinge, sting, beam"),
        ("hinge", {"start": [0, 0, 0]}, "law hinge: option end is missing"),
        ("hinge", {"start": [0, 0, 0], "end": [0, 0, 0]}, "end - start has no length"),
        ("beam", {**AXIS, "rot": 1}, "law beam: has no option rot; it has root, tip, up, section, bend, twist, sway"),
        ("beam", {"root": [0, 0], "tip": [1, 0, 0]}, r"option root: expected three numbers x, y, z, got \[0, 0\]"),
        ("beam", {"root": "0 0 0", "tip": [1, 0, 0]}, "option root: expected three numbers"),
        ("beam", {**AXIS, "root": [0, True, 0]}, "option root: expected three numbers"),
        ("beam", {**AXIS, "root": [0, float("nan"), 0]}, "option root: expected three numbers"),
        ("beam", {**AXIS, "bend": 2}, "option bend: expected a list of whole numbers, got 2"),
        ("beam", {**AXIS, "bend": [1.5]}, "option bend: expected a list of whole numbers"),
        ("beam", {**AXIS, "bend": [2, 2]}, "distinct"),
        ("beam", {**AXIS, "bend": [], "twist": []}, "nothing could move"),
        ("modal_beam", {**AXIS, "bend": -1}, "option bend: expected a whole number, got -1"),
        ("modal_beam", {**AXIS, "bend": 0, "twist": 0}, "not both 0"),
        ("spline_beam", {**AXIS, "bend": [0.5, 0.2]}, "increase strictly"),
        ("sting", {"root": [1, 0, 0], "end": [0, 0, 0], "load": "wind"}, "load must be one of force, moment"),
        ("sting", {"root": [1, 0, 0], "end": [0, 0, 0], "load": 3}, "option load: expected force or moment, got 3"),
        ("smooth", {"amplitude": [1, 2], "reach": 1}, "option amplitude: expected a number or three"),
        ("smooth", {"amplitude": 1, "reach": 0}, "law smooth: reach must be > 0"),
    ],
)  # fmt: skip
def test_wrong_options_are_named(kind, options, words):
    with pytest.raises(LawError, match=words):
        made(kind, options)


def test_what_is_not_an_option_must_be_handed_in():
    with pytest.raises(LawError, match=r"table m\.csv"):
        make_law("modes", {"table": "m.csv"}, unit="mm")
    with pytest.raises(LawError, match="no markers"):
        make_law("smooth", {"amplitude": 1.0, "reach": 1.0}, unit="mm")


def test_parameters_are_set_from_outside():
    law = with_parameters(made("beam", AXIS), {"bend_2": {"sigma": 20, "start": 1.5}, "twist_1": {"lower": -3.0}})
    known = {p.name: p for p in law.parameters}
    assert known["bend_2"] == Parameter("bend_2", "mm", start=1.5, sigma=20)
    assert known["twist_1"].lower == -3.0
    assert known["bend_3"] == Parameter("bend_3", "mm")
    q = np.array([3.0, 0, 1, 0])
    np.testing.assert_array_equal(law.bind(POINTS).place(q), made("beam", AXIS).bind(POINTS).place(q))


def test_steps_of_a_function_follow_its_parameters():
    law = with_parameters(function_law(lambda xyz, tip: xyz + tip), {"tip": {"sigma": 20.0}})
    np.testing.assert_allclose(law.bind(POINTS).steps, 20e-4)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"tip": {}}, "parameter tip: the law has bend_2, bend_3, twist_1, twist_2"),
        ({"bend_2": {"sd": 1}}, "has no setting sd; expected some of start, sigma, lower, upper"),
        ({"bend_2": {"sigma": "1"}}, "sigma: expected a number, got '1'"),
        ({"bend_2": {"sigma": 0}}, "bend_2: sigma must be > 0"),
        ({"bend_2": {"lower": 1.0}}, "lower <= start <= upper"),
        ({"bend_2": 3}, "bend_2: expected some of"),
    ],
)
def test_wrong_settings_are_named(settings, words):
    with pytest.raises(LawError, match=words):
        with_parameters(made("beam", AXIS), settings)
