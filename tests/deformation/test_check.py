"""What is found out about a law before it is trusted."""

import itertools

import numpy as np
import pytest

from windmark.deformation import LawError, check_law, function_law

XYZ = np.random.default_rng(0).uniform(0, 100, (30, 3))


def checked(function, **units):
    return check_law(function_law(function, units), XYZ, name="wing", source="own.py:3")


def up(xyz, size):
    return xyz + np.array([0, 0, 1]) * np.asarray(size)


def test_a_sound_law_has_no_remarks():
    assert (
        checked(lambda xyz, tip, twist: up(xyz, (tip * xyz[:, 1] ** 2 / 1e4 + np.sin(twist) * xyz[:, 0])[:, None]))
        == ()
    )


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda xyz, tip: up(xyz, np.sign(tip)), "own.py:3: law wing: is not continuous in tip near 0"),
        (lambda xyz, tip: up(xyz, np.heaviside(tip, 0.0) + tip), "is not continuous in tip"),
        (lambda xyz, tip: up(xyz, tip).astype(np.float32), r"numbers of 16 digits \(float64\), got float32"),
        (lambda xyz, tip: xyz[:, 2] + tip, r"must return \(30, 3\), like its points, got \(30,\)"),
        (lambda xyz, tip: up(xyz, tip)[: 29 if tip > 0.1 else 30], r"must return \(30, 3\), .* got \(29, 3\)"),
        (lambda xyz, tip: up(xyz, np.nan), r"returns \[.*nan\] for the point \[.*\] at its start values"),
        (lambda xyz, tip: xyz + (np.inf if abs(tip) > 0.1 else tip), "returns .*inf.* with tip ="),
        (lambda xyz, tip: up(xyz, np.nan if tip else tip), r"the point \[.*\] by finite numbers when tip .* from 0$"),
    ],
)  # fmt: skip
def test_broken_laws_are_refused(function, words):
    with pytest.raises(LawError, match=words):
        checked(function)


@pytest.mark.parametrize(
    "function",
    [
        lambda xyz, tip: up(xyz, tip * (xyz[:, 1] / xyz[:, 1].max())[:, None] ** 2),
        lambda xyz, tip: up(xyz, tip * (xyz[:, 0] - xyz[:, 0].mean())[:, None]),
        lambda xyz, tip: up(xyz, tip * len(xyz)),
    ],
)
def test_a_law_that_scales_itself_by_the_points_it_is_given(function):
    """It is fitted on markers and used on nodes, where the largest y is another one."""
    with pytest.raises(LawError, match=r"with tip = .* another place, by [0-9.]+, when other points are not given"):
        checked(function)


def test_a_law_that_changes_from_call_to_call():
    calls = itertools.count()
    with pytest.raises(LawError, match="called again"):
        checked(lambda xyz, tip: up(xyz, tip + next(calls)))


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda xyz, tip, fin: up(xyz, tip), "parameter fin moves none of the 30 points"),
        (lambda xyz, tip: up(xyz, tip + 1.0), "moves points by up to 1 at its start values"),
        (lambda xyz, tip: up(xyz, tip**2), "parameter tip has no effect close to its start 0"),
        (lambda xyz, tip: up(xyz, np.round(tip)), "parameter tip has no effect close to its start 0"),
    ],
)
def test_remarks(function, words):
    (remark,) = checked(function)
    assert remark == f"own.py:3: law wing: {words}" or remark.startswith(f"own.py:3: law wing: {words}")


def test_bounds_are_kept():
    def rooted(xyz, tip):
        assert 0 <= tip <= 1
        return up(xyz, tip * np.sqrt(tip + 0.1))

    assert checked(rooted, tip={"lower": 0.0, "upper": 1.0}) == ()
    assert checked(rooted, tip={"lower": 0.0, "upper": 1.0, "start": 1.0})[0].endswith("at its start values")


@pytest.mark.parametrize(
    ("function", "where"),
    [
        (lambda xyz, tip: up(xyz, tip + 3 * np.maximum(tip - 0.1, 0)), "0.1"),
        (lambda xyz, tip: up(xyz, np.minimum(tip, 0.15)), "0.15"),
        (lambda xyz, tip: up(xyz, tip + np.sqrt(np.abs(tip))), "0"),
        (lambda xyz, tip: up(xyz, np.where(xyz[:, :1] > 50, np.maximum(tip - 0.1, 0), tip)), "0.1"),
    ],
)
def test_a_kink_is_no_jump(function, where):
    """A stop, a slack, the foot of a root: continuous, with another slope on its other side, and said to be that."""
    (remark,) = checked(function)
    assert f"its slope in tip changes near {where}, close to its start 0" in remark


@pytest.mark.parametrize(("jump", "at"), [(0.2, 0.07), (-0.1, 0.13), (-0.4, 0.02)])
def test_a_jump_is_found_beside_a_slope(jump, at):
    """Also one against the slope, where a half without it moves more."""
    with pytest.raises(LawError, match=f"is not continuous in tip near {at}"):
        checked(lambda xyz, tip: up(xyz, tip + jump * (tip > at)))
