"""Built-in laws: derivatives, mechanics, and agreement with independent calculations."""

import numpy as np
import pytest
from scipy.integrate import quad

from windmark.deformation.laws import (
    CATALOG,
    Beam,
    CantileverModes,
    Powers,
    Smooth,
    Splines,
    Sting,
    TabulatedModes,
    TorsionModes,
    make_law,
)
from windmark.geometry.rotations import exp_so3

RNG = np.random.default_rng(5)
XYZ = RNG.uniform([100, 20, 0], [400, 590, 30], (25, 3))
MODES = XYZ[:15], RNG.normal(size=(15, 3, 3))
LENGTH = 500.0
STRAIGHT = {"root": (0, 0, 0), "tip": (0, LENGTH, 0)}


@pytest.mark.parametrize("kind", CATALOG)
def test_at_rest_nothing_moves_and_derivatives_are_right(kind):
    law = make_law(kind, CATALOG[kind].example, unit="mm", points=XYZ, table=MODES)
    bound, k = law.bind(XYZ), len(law.parameters)
    np.testing.assert_allclose(bound.place(np.zeros(k)), XYZ, atol=1e-9)
    for q in (np.zeros(k), RNG.uniform(-8, 8, k)):
        place, by_q = bound.linearise(q)
        np.testing.assert_allclose(place, bound.place(q), atol=1e-12)
        h = 1e-2 * np.eye(k)  # fourth order
        near = [(8 * (bound.place(q + s) - bound.place(q - s)) - bound.place(q + 2 * s) + bound.place(q - 2 * s)) / 0.12
                for s in h]  # fmt: skip
        np.testing.assert_allclose(by_q, np.stack(near, axis=-1), atol=1e-7 * np.abs(by_q).max())


@pytest.mark.parametrize(
    "shapes",
    [
        {"bend": Powers((2, 3)), "sway": Powers((2,))},
        {"bend": CantileverModes(2), "sway": Powers((3,))},
        {"bend": Splines((0.25, 0.5, 0.75, 1.0), clamped=True), "sway": Splines((0.5, 1.0), clamped=True)},
    ],
    ids=["powers", "modes", "splines"],
)
def test_the_axis_bends_without_stretching(shapes):
    """Tip bending of 5 %: lengths along the axis are kept, and places agree with an integration of the curve."""
    beam = Beam(**STRAIGHT, twist=Powers(()), **shapes)
    s = np.linspace(0, LENGTH, 801)
    w = 0.05 * LENGTH * np.clip(RNG.uniform(0.4, 1.0, len(beam.parameters)), 0, 1)
    if isinstance(shapes["bend"], Splines):
        w[:4] = 0.05 * LENGTH * np.array([0.08, 0.28, 0.6, 1.0])
        w[4:] = 0.02 * LENGTH * np.array([0.3, 1.0])
    place = beam.bind(np.stack([0 * s, s, 0 * s], axis=1)).place(w)
    chord = np.linalg.norm(np.diff(place, axis=0), axis=1).sum()
    assert abs(chord - LENGTH) < 1e-6 * LENGTH + 1e-7 * LENGTH  # the chords themselves are 5e-8 shorter

    bends, sways = len(shapes["bend"].names), len(shapes["sway"].names)

    def along(e):
        slopes = (shapes["bend"].slope(np.array(e)) @ w[:bends], shapes["sway"].slope(np.array(e)) @ w[bends:])
        assert sways == len(w) - bends
        return np.sqrt(1 - sum((v / LENGTH) ** 2 for v in slopes))

    for end in (0.3, 0.77, 1.0):
        expected = (
            LENGTH * quad(along, 0, end, epsabs=1e-12, limit=200, points=[v for v in (0.25, 0.5, 0.75) if v < end])[0]
        )
        got = beam.bind(np.array([[0, end * LENGTH, 0]])).place(w)[0]
        assert abs(got[1] - expected) < 1e-6 * LENGTH
        # axis x up: along y and up z the sway goes along x
        np.testing.assert_allclose(
            got[[2, 0]],
            [shapes["bend"].value(np.array(end)) @ w[:bends], shapes["sway"].value(np.array(end)) @ w[bends:]],
        )


def test_sections_keep_their_shape_and_lean_with_the_axis():
    beam = Beam(root=(100, 72, 5), tip=(350, 600, 42), section=(0, 1, 0), sway=Powers((2,)))
    section = np.stack([RNG.uniform(150, 300, 9), np.full(9, 400.0), RNG.uniform(-10, 40, 9)], axis=1)
    q = np.array([25.0, 5, 2, -1, 10])
    place = beam.bind(section).place(q)

    def apart(points):
        return np.linalg.norm(points[:, None] - points[None], axis=2)

    np.testing.assert_allclose(apart(place), apart(section), atol=1e-10)
    straight = Beam(**STRAIGHT, bend=Powers((2,)), twist=Powers(()))
    top = straight.bind(np.array([[0, LENGTH, 0.0], [0, LENGTH, 20.0]])).place(np.array([30.0]))
    lean = np.arcsin(2 * 30.0 / LENGTH)
    np.testing.assert_allclose(top[1] - top[0], [0, -20 * np.sin(lean), 20 * np.cos(lean)], atol=1e-10)


def slow_bent(beam, point, q):
    """One point of a beam by rotation matrices; the kernel's twin."""
    axis, length, up, side, section = beam.frame()
    many = np.cumsum([len(beam.bend.names), len(beam.twist.names)])
    bend, twist, sway = np.split(q, many)
    e = max((point - beam.root) @ section / (axis @ section) / length, 0.0)
    foot = beam.root + e * length * axis

    def along(station):
        """Cosine between the axis and its direction."""
        slopes = [b.slope(np.array(station)) @ p / length for b, p in ((beam.bend, bend), (beam.sway, sway))]
        return np.sqrt(1 - slopes[0] ** 2 - slopes[1] ** 2), slopes

    shorter = length * quad(lambda s: 1 - along(s)[0], 0, e, epsabs=1e-13)[0]
    c, slopes = along(e)
    direction = c * axis + slopes[0] * up + slopes[1] * side
    turn = np.cross(axis, direction)
    size = np.linalg.norm(turn)
    lean = exp_so3(turn / size * np.arctan2(size, c)) if size > 0 else np.eye(3)
    own = exp_so3(np.radians(beam.twist.value(np.array(e)) @ twist) * section)
    moved = (beam.bend.value(np.array(e)) @ bend) * up + (beam.sway.value(np.array(e)) @ sway) * side - shorter * axis
    return foot + moved + lean @ own @ (point - foot)


@pytest.mark.parametrize("sway", [(), (2, 3)])
def test_the_kernel_is_its_twin(sway):
    beam = Beam(root=(100, 72, 5), tip=(350, 600, 42), up=(0.1, 0, 1), section=(0, 1, 0), sway=Powers(sway))
    points = np.vstack([XYZ, [[90.0, -20, 3]]])
    for size in (0.0, 0.3, 1.0):
        q = size * np.array([40.0, -9, 3, -2, 6, 4])[: 4 + len(sway)]
        np.testing.assert_allclose(beam.bind(points).place(q), [slow_bent(beam, p, q) for p in points], atol=1e-9)


def test_slopes_that_no_beam_can_take_stay_finite():
    place, by_q = Beam(**STRAIGHT).bind(XYZ).linearise(np.array([4000.0, 0, 1, 1]))
    assert np.isfinite(place).all()
    assert np.isfinite(by_q).all()


def test_twist_is_about_the_axis_by_the_right_hand_rule_and_linear_in_the_station():
    beam = Beam(**STRAIGHT, bend=Powers(()), twist=Powers((1,)))
    for e in (0.5, 1.0):
        out = beam.bind(np.array([[10.0, e * LENGTH, 0]])).place(np.array([6.0]))[0]
        angle = np.radians(6 * e)
        np.testing.assert_allclose(out, [10 * np.cos(angle), e * LENGTH, -10 * np.sin(angle)], atol=1e-12)


def test_inboard_of_the_root_nothing_moves():
    inside = np.array([[5.0, -30, 2], [7, 0, -3]])
    np.testing.assert_allclose(Beam(**STRAIGHT).bind(inside).place(np.array([20.0, 5, 3, 1])), inside, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"root": (0, 0, 0), "tip": (0, 0, 0)}, "tip - root has no length"),
        ({**STRAIGHT, "up": (0, 2, 0)}, "up, which must not lie along the axis"),
        ({**STRAIGHT, "section": (1, 0, 0)}, "section: .* right angles"),
        ({**STRAIGHT, "tip": (0, np.nan, 0)}, "tip: expected three finite numbers"),
    ],
)
def test_beams_that_cannot_be(options, words):
    with pytest.raises(ValueError, match=words):
        Beam(**options)


def test_cantilever_modes_satisfy_the_beam_s_equation_and_ends():
    modes, h = CantileverModes(4), 1e-3
    assert np.allclose(modes.value(np.array(0.0)), 0, atol=1e-12)
    assert np.allclose(modes.slope(np.array(0.0)), 0, atol=1e-12)
    assert np.allclose(modes.value(np.array(1.0)), 1)
    # At the free end neither moment nor shear: second and third derivative vanish.
    slope = modes.slope(1 - h * np.arange(5))
    second = (25 * slope[0] - 48 * slope[1] + 36 * slope[2] - 16 * slope[3] + 3 * slope[4]) / (12 * h)
    third = (35 * slope[0] - 104 * slope[1] + 114 * slope[2] - 56 * slope[3] + 11 * slope[4]) / (12 * h**2)
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349])
    assert np.all(np.abs(second) < 1e-5 * roots**2)
    assert np.all(np.abs(third) < 1e-3 * roots**3)
    # w'''' = root^4 w inside.
    s = modes.slope(0.4 + h * 5 * np.arange(-3, 4))
    fourth = (s[0] - 8 * s[1] + 13 * s[2] - 13 * s[4] + 8 * s[5] - s[6]) / (8 * (5 * h) ** 3)
    np.testing.assert_allclose(fourth, roots**4 * modes.value(np.array(0.4)), rtol=1e-4, atol=1e-4 * roots[-1] ** 4)
    many = CantileverModes(40).value(np.linspace(0, 1, 2001))
    assert 0.99 < np.abs(many).max() < 1.001  # high modes are no difference of large numbers
    torsion = TorsionModes(3)
    assert np.allclose(torsion.value(np.array(1.0)), 1)
    assert np.allclose(torsion.value(np.array(0.0)), 0)
    assert np.allclose(torsion.slope(np.array(1.0)), 0, atol=1e-12)


@pytest.mark.parametrize("basis", [Powers((1, 2, 4)), CantileverModes(3), TorsionModes(3), Splines((0.3, 1.0), True)])
def test_slopes_are_derivatives(basis):
    e = np.array([[0.05, 0.2, 0.6], [0.29, 0.9, 1.0]])
    assert basis.value(e).shape == (2, 3, len(basis.names))
    h = 1e-5
    np.testing.assert_allclose(basis.slope(e), (basis.value(e + h) - basis.value(e - h)) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("clamped", [True, False])
def test_splines_pass_through_their_stations(clamped):
    stations = (0.2, 0.55, 1.0)
    splines = Splines(stations, clamped)
    np.testing.assert_allclose(splines.value(np.array(stations)), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(splines.value(np.array(0.0)), 0, atol=1e-12)
    assert np.allclose(splines.slope(np.array(0.0)), 0, atol=1e-12) is clamped
    assert splines.names == ("20", "55", "100")
    with pytest.raises(ValueError, match="increase strictly"):
        Splines((), clamped)


@pytest.mark.parametrize(("load", "slope", "back"), [("force", 1.5, 0.6), ("moment", 2.0, 2 / 3)])
def test_the_sting_s_end_is_where_a_cantilever_s_is(load, slope, back):
    """Against an integration of the inextensible cantilever's deflection."""
    sting = Sting((600, 0, 0), (100, 0, 0), load=load)
    w = 12.0
    ends = sting.bind(np.array([[100.0, 0, 0], [90, 0, 0], [100, 0, 5]])).place(np.array([w, 0, 0]))

    def rate(e):  # slope of the deflection at e = s / length
        return w / 500 * (1.5 * (2 * e - e * e) if load == "force" else 2 * e)

    shorter = 500 * quad(lambda e: 1 - np.sqrt(1 - rate(e) ** 2), 0, 1)[0]
    np.testing.assert_allclose(ends[0], [100 + shorter, 0, w], atol=2e-4)
    assert shorter == pytest.approx(back * w**2 / 500, rel=2e-3)
    lean = np.arctan(slope * w / 500)
    np.testing.assert_allclose(ends[1] - ends[0], 10 * np.array([-np.cos(lean), 0, np.sin(lean)]), atol=1e-12)
    np.testing.assert_allclose(ends[2] - ends[0], 5 * np.array([np.sin(lean), 0, np.cos(lean)]), atol=1e-12)
    # A sting along -x, up z: the side is axis x up = +y; the roll is about the axis.
    side = sting.bind(np.array([[100.0, 0, 0]])).place(np.array([0, w, 0]))[0]
    np.testing.assert_allclose(side[1:], [w, 0], atol=1e-12)
    rolled = sting.bind(np.array([[100.0, 3, 0]])).place(np.array([0, 0, 90.0]))[0]
    np.testing.assert_allclose(rolled, [100, 0, -3], atol=1e-12)


def test_the_prior_of_smooth_is_its_kernel():
    points = RNG.uniform(0, 300, (40, 3))
    law = Smooth(points, (0.0, 2.0, 5.0), 150.0)
    shape = law.bind(points).linearise(np.zeros(len(law.parameters)))[1]
    sigma = np.array([p.sigma for p in law.parameters])
    kernel = np.exp(-0.5 * ((points[:, None] - points[None]) ** 2).sum(-1) / 150.0**2)
    for axis, size in enumerate((0.0, 2.0, 5.0)):
        prior = (shape[:, axis] * sigma**2) @ shape[:, axis].T
        np.testing.assert_allclose(prior, size**2 * kernel, atol=1e-4 * max(size**2, 1))
    far = law.bind(points + 5000.0).linearise(np.zeros(len(law.parameters)))[1]
    assert np.abs(far).max() < 1e-12


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"points": np.zeros((0, 3))}, r"points must be \(M, 3\)"),
        ({"reach": 0.0}, "reach must be > 0"),
        ({"amplitude": (0, 0, 0)}, "amplitude must be >= 0 and not 0 along every axis"),
        ({"amplitude": (1, -1, 0)}, "amplitude must be >= 0"),
    ],
)
def test_smooth_that_cannot_be(options, words):
    with pytest.raises(ValueError, match=words):
        Smooth(**{"points": XYZ, "amplitude": 1.0, "reach": 100.0, **options})


@pytest.mark.parametrize("flat", [0, 1, 2], ids=["in space", "in a plane", "on a line"])
def test_tabulated_modes_are_kept_at_their_nodes(flat):
    nodes, shapes = XYZ.copy(), RNG.normal(size=(25, 3, 2))
    if flat:
        nodes = nodes * [1, 1, 0] @ np.linalg.qr(RNG.normal(size=(3, 3)))[0] + 100
    if flat == 2:
        nodes = np.linspace(0, 1, 25)[:, None] * [300.0, 400, 20]
    law = TabulatedModes(nodes, shapes, unit="m")
    by_q = law.bind(nodes).linearise(np.zeros(2))[1]
    np.testing.assert_allclose(by_q, shapes, atol=1e-6)
    assert [(p.name, p.unit) for p in law.parameters] == [("mode_1", "m"), ("mode_2", "m")]
    beside = law.bind(nodes + 3.0).linearise(np.zeros(2))[1]
    assert np.isfinite(beside).all()
    assert np.abs(beside).max() < 20


def test_a_linear_mode_stays_linear_between_and_beyond_the_nodes():
    slope = RNG.normal(size=(3, 3))
    law = TabulatedModes(XYZ, (XYZ @ slope)[..., None])
    other = RNG.uniform(-100, 700, (10, 3))
    np.testing.assert_allclose(law.bind(other).linearise(np.zeros(1))[1][..., 0], other @ slope, atol=1e-6)


@pytest.mark.parametrize(
    ("nodes", "shapes", "words"),
    [
        (XYZ[:3], np.zeros((3, 3, 1)), r"nodes must be \(M >= 4, 3\)"),
        (XYZ, np.zeros((25, 3)), r"shapes must be \(25, 3, k\)"),
        (XYZ, np.zeros((25, 3, 0)), r"shapes must be \(25, 3, k\)"),
        (XYZ, np.full((25, 3, 1), np.nan), "finite"),
        (np.ones((5, 3)), np.zeros((5, 3, 1)), "distinct places"),
        (np.vstack([XYZ, XYZ[:1]]), np.zeros((26, 3, 1)), "distinct places"),
    ],
)
def test_tables_that_cannot_be(nodes, shapes, words):
    with pytest.raises(ValueError, match=words):
        TabulatedModes(nodes, shapes)
