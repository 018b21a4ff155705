"""Patterns that laws may lack, against their words; how large they look; who lost far more than the others."""

import numpy as np
import pytest
from scipy import stats

from windmark.deformation.check import _change
from windmark.deformation.lost import FALSE, QUARTER, _many
from windmark.deformation.misfit import KINDS, MARKERS_PER_DEGREE, MOST_DEGREE, Shapes
from windmark.deformation.parameter import Parameter
from windmark.deformation.patterns import _looks, second_moment
from windmark.errors import UsageError

LEGENDRE = [lambda u: 1 + 0 * u, lambda u: u, lambda u: (3 * u**2 - 1) / 2, lambda u: (5 * u**3 - 3 * u) / 2,
            lambda u: (35 * u**4 - 30 * u**2 + 3) / 8]  # fmt: skip


def plate(count=30, seed=0):
    """Markers on a plate of 400 by 100, turned and shifted."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-1, 1, (count, 3)) * [200.0, 50.0, 1.0]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return flat @ turn.T + [10.0, 20.0, 30.0]


@pytest.mark.parametrize(("count", "degree"), [(30, 4), (60, 4), (20, 3), (10, 1)])
def test_columns_are_bending_twist_camber_sway_stretch_and_shear(count, degree):
    xyz = plate(count)
    shape = Shapes.of("wing", ["wing", "flap"], xyz)
    assert shape.degree == degree
    assert min(count // MARKERS_PER_DEGREE - 1, MOST_DEGREE) == degree
    along, across, up = shape.axes
    u, v = (xyz - xyz.mean(axis=0)) @ along, (xyz - xyz.mean(axis=0)) @ across
    u, v = u / (np.ptp(u) / 2), v / (np.ptp(v) / 2)
    names = np.array(["wing", "flap"] * (count // 2))
    got, column = shape.columns(xyz, names), 0
    terms = [
        ("bending", up, lambda p: p), ("twist", up, lambda p: v * p), ("camber", up, lambda p: v * v * p),
        ("sway in its plane", across, lambda p: p), ("stretch", along, lambda p: p), ("shear", along, lambda p: v * p),
    ]  # fmt: skip
    for kind, direction, of in terms:
        for n in range(2 if kind == "camber" else degree + 1):
            np.testing.assert_allclose(got[..., column], of(LEGENDRE[n](u))[:, None] * direction, atol=1e-9)
            assert shape.kind[column] == kind
            column += 1
    assert column == got.shape[-1] == len(shape.kind)
    np.testing.assert_array_equal(shape.columns(xyz, np.array(["wall"] * count)), 0.0)
    assert set(shape.kind) == set(KINDS)


def test_few_markers_or_a_line_of_them():
    assert Shapes.of("wing", ["wing"], plate(2 * MARKERS_PER_DEGREE - 1)) is None
    line = np.outer(np.linspace(0, 400, 12), [1.0, 0, 0])
    shape = Shapes.of("wing", ["wing"], line)
    assert shape.half[1] == pytest.approx(1e-3 * 200)  # as wide as a thousandth, so that a twist is no division by zero
    assert np.isfinite(shape.columns(line, np.array(["wing"] * 12))).all()


def test_what_is_lacking_is_as_large_as_it_was_found_of_any_course():
    value = np.array([3.0, 4.0, 0.0, 2.0, 0.5])
    expected = np.diag([25 / 3] * 3 + [4.25 / 2] * 2)
    np.testing.assert_allclose(second_moment(value, np.array([3, 2])), expected)


@pytest.mark.parametrize("kind", KINDS)
def test_the_largest_place_of_a_pattern_is_named(kind):
    xyz = plate()
    shape = Shapes.of("wing", ["wing"], xyz)
    along, across, up = shape.axes
    names = np.array([f"m{k}" for k in range(30)])
    v = (xyz - shape.centre) @ across
    direction = {"sway in its plane": across, "stretch": along, "shear": along}.get(kind, up)
    size = np.radians(0.5) * v if kind == "twist" else np.linspace(-1.0, 3.5, 30)
    if kind == "twist":
        arm = np.abs(v) / shape.half[1]
        k = int(np.argmin(np.abs(arm - 0.5)))
        size[k] *= 1.6  # degrees, not millimetres, are compared
        size[np.argmin(arm)] = 1.0  # next to the axis any displacement would be many degrees
        assert 0.3 < arm[k] < 1
        assert _looks(shape, kind, np.outer(size, direction), xyz, names, "mm") == ("wing", f"twist of 0.8 deg at m{k}")
        return
    other = np.outer(np.full(30, 9.0), along if kind not in ("stretch", "shear") else up)  # of another direction
    words = _looks(shape, kind, np.outer(size, direction) + other, xyz, names, "mm")
    assert words == ("wing", f"{kind} of 3.5 mm at m29")
    assert _looks(shape, kind, np.outer(-size, direction), xyz, names, "")[1] == f"{kind} of 3.5 at m29"


def marks(gone, every, others_gone, others):
    bad = np.zeros(every + others, bool)
    bad[:gone] = True
    bad[every : every + others_gone] = True
    return bad, np.arange(every + others) < every


@pytest.mark.parametrize(("every", "others_gone", "others"), [(20, 0, 60), (20, 6, 60), (8, 1, 100), (40, 10, 40)])
def test_a_view_lost_far_more_than_the_others_beyond_chance(every, others_gone, others):
    """As many or more of its marks by the others' share, one counted on top, is no chance; and it is a quarter."""
    usual = (others_gone + 1) / (others + 1)
    for gone in range(every + 1):
        far = gone >= 2 and gone >= QUARTER * every and stats.binom.sf(gone - 1, every, usual) < FALSE
        assert _many(*marks(gone, every, others_gone, others), QUARTER) == far


def test_alone_nobody_lost_more_than_the_others():
    assert not _many(np.ones(20, bool), np.ones(20, bool), QUARTER)
    assert not _many(*marks(1, 2, 0, 500), QUARTER)
    assert _many(*marks(2, 2, 0, 500), QUARTER)


@pytest.mark.parametrize(
    ("parameter", "size", "change"),
    [
        (Parameter("a"), 2.0, 0.5), (Parameter("a", upper=0.2), 2.0, 0.2), (Parameter("a", upper=0.9), 2.0, 0.5),
        (Parameter("a", start=3.0, upper=3.0), 2.0, -0.5), (Parameter("a", start=3.0, lower=2.8, upper=3.0), 2.0, -0.2),
        (Parameter("a", start=-1.0, lower=-1.0), 2.0, 0.5), (Parameter("a", start=5.0, lower=1.0, upper=5.2), 2.0, 0.2),
        (Parameter("a", sigma=7.0), 0.0, 7.0), (Parameter("a"), 0.0, 1.0),
    ],
)  # fmt: skip
def test_changes_move_a_hundredth_of_the_extent_within_the_bounds(parameter, size, change):
    assert _change(parameter, size, 100.0) == pytest.approx(change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "2nd"}, "must be an identifier, got '2nd'"), ({"start": np.nan}, "start must be finite"),
        ({"sigma": 0.0}, "sigma must be > 0, got 0.0"), ({"sigma": np.nan}, "sigma must be > 0"),
        ({"lower": 0.1}, "expected lower <= start <= upper"), ({"upper": -0.1}, "expected lower <= start <= upper"),
        ({"lower": 0.0, "upper": 0.0}, "expected lower"), ({"upper": np.nan}, "expected lower"),
    ],
)  # fmt: skip
def test_parameters_that_contradict_themselves(change, words):
    with pytest.raises(UsageError, match=words):
        Parameter(**({"name": "a"} | change))
    assert Parameter("a", lower=0.0, upper=1.0).upper == 1.0
    assert Parameter("a", lower=-1.0, upper=0.0).lower == -1.0
