"""Units that are mixed and pictures that were exchanged: said in a sentence, never a Cp of hundreds as a result."""

import numpy as np
import pytest

from windmark.paint import NodeField, SternVolmer, TunnelConditions, pressure_map
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp.plausible import (
    LACKING,
    UNCHECKED,
    beside_recovery,
    beyond_calibration,
    beyond_stream,
    lacking,
    mach_of,
    other_unit,
    total_pressure,
    unchecked_level,
)
from windmark.tasks.psp.reduce import _why
from windmark.tasks.psp.taps import Readings, at_taps

STREAM = TunnelConditions(65_900.0, 29_500.0, mach=0.8)
CP = np.linspace(-1.2, 0.9, 500)
"""Of a transonic wing."""


def plate(n=21, size=40.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    return Mesh.make(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), structured_triangles(n, n), "wing")


def readings(xyz, pressure):
    up = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    return Readings(tuple(f"t{k}" for k in range(len(xyz))), xyz, up, pressure, np.full(len(xyz), 20.0))


def test_the_total_pressure_is_that_of_the_mach_number_given_or_not():
    assert total_pressure(STREAM) == pytest.approx(100_455, rel=1e-3)
    assert mach_of(TunnelConditions(65_900.0, 29_522.7)) == pytest.approx(0.8, abs=1e-3)
    assert total_pressure(TunnelConditions(101_325.0, 600.0)) == pytest.approx(101_925, abs=2)


@pytest.mark.parametrize(
    ("factor_p", "factor_q"), [(1, 1e-3), (1, 1e-2), (1e-3, 1e-3), (1e-2, 1e-2), (1 / 6894.76, 1 / 6894.76)]
)
def test_conditions_in_another_unit_are_refused(factor_p, factor_q):
    pressure = 65_900 + 29_500 * CP
    p, q = 65_900 * factor_p, 29_500 * factor_q
    found = beyond_stream(NodeField.make((pressure - p) / q, 0.01 / factor_q), TunnelConditions(p, q))
    assert "units of p_inf, q_inf or p_off are mixed" in found
    assert not beyond_stream(NodeField.make(CP, 0.01), STREAM)


def test_exchanged_pictures_are_refused_and_a_calibration_that_is_off_is_not():
    """Wind-off over wind-on upside down: the suction side shows half as much again as the reference's pressure."""
    inverse = NodeField.make((99_500 * 99_500 / (65_900 + 29_500 * CP) - 65_900) / 29_500, 0.03)
    assert "exchanged" in beyond_stream(inverse, STREAM)
    assert not beyond_stream(NodeField.make(CP + 0.5, 0.02), STREAM)
    slow = TunnelConditions(101_000.0, 500.0)  # 1 % of the pressure is a Cp of 2, and said to be as unsure
    assert not beyond_stream(NodeField.make(CP + 2.0, 2.0), slow)
    few = NodeField.make(np.where(np.arange(500) < 40, 30.0, CP), 0.01)
    assert not beyond_stream(few, STREAM)
    assert not beyond_stream(NodeField.make(np.full(5, np.nan), 0.01), STREAM)


@pytest.mark.parametrize(
    ("change", "words"),
    [(lambda p: p / 100, "0.01 times the pressure"), (lambda p: p - 6e4, "gauge pressures"),
     (lambda p: p / 6894.76, "another unit"), (lambda p: p * 0.02 + 6e4, "change by 0.02")],
)  # fmt: skip
def test_readings_in_another_unit_are_not_fitted_to(change, words):
    """A fit would follow them: offset and slope are free."""
    rng, mesh = np.random.default_rng(5), plate()
    xyz = np.column_stack([rng.uniform(-15, 15, (14, 2)), np.zeros(14)])
    prior = NodeField.make(5.6e4 + 500 * mesh.vertices[:, 0], 20.0, unit="Pa")
    true = 5.6e4 + 500 * xyz[:, 0] + 20 * rng.standard_normal(len(xyz))
    none, remarks = np.zeros(len(prior), bool), []
    got, fit, table = at_taps(mesh, prior, none, readings(xyz, change(true)), "offset-slope", remarks)
    assert fit is None
    assert got is prior
    assert table is not None
    assert len(remarks) == 1
    assert words in remarks[0]
    assert "the pressure is that of the calibration alone" in remarks[0]
    assert at_taps(mesh, prior, none, readings(xyz, true), "offset-slope", [])[1] is not None


def test_a_few_dead_taps_are_no_other_unit():
    prior = np.full(10, 6e4)
    assert not other_unit(np.where(np.arange(10) < 4, 0.0, 6.1e4), prior)
    assert "6 of 10 readings are not above 0" in other_unit(np.where(np.arange(10) < 6, 0.0, 6.1e4), prior)


def test_a_temperature_in_another_unit_is_the_reason():
    law = SternVolmer(np.array([[0.2], [0.8]]), 1e5, 293.15, (2e4, 1.3e5), (278.0, 313.0))
    flags = np.full(3, 7, np.uint8)
    words = _why(flags, NodeField.make(np.full(3, 25.0), 1.0), law)
    assert words.startswith("the wall's temperature is 25 K (median), the paint's calibration is from 278 to 313 K")
    assert "wall" not in _why(flags, NodeField.make(np.full(3, 300.0), 1.0), law)


LAW = SternVolmer(np.array([[0.2, 0.002], [0.8, 0.008]]), 1e5, 293.0, (6e4, 1.3e5), (280.0, 310.0))


def beyond(pressures, warm=293.0):
    at = np.asarray(pressures, dtype=float)
    temperature = NodeField.make(np.broadcast_to(warm, at.shape), 0.1, unit="K")
    ratio = NodeField.make(LAW.ratio(at, temperature.value) / LAW.ratio(1e5, 293.0), 1e-3)
    return beyond_calibration(pressure_map(LAW, ratio, temperature, p_off=1e5, t_off=293.0), temperature, LAW)


def test_pressures_beyond_the_calibration_are_said_with_their_share():
    assert beyond(np.linspace(6.1e4, 1.2e5, 20)) == []
    few = np.r_[np.full(2, 5.8e4), np.linspace(6.1e4, 1.2e5, 38)]
    assert beyond(few) == ["5 % of the nodes lie outside the paint's calibration in pressure (60000 to 130000 Pa)"]
    many = np.r_[np.full(10, 5.8e4), np.full(10, 4.5e4), np.full(20, 9e4), np.nan]
    assert beyond(many) == [
        "the paint's calibration is extrapolated: 50 % of the nodes lie outside it in pressure (60000 to 130000 Pa), "
        "25 % by more than a tenth of its range"
    ]


def test_temperatures_beyond_the_calibration_are_said_too():
    warm = np.where(np.arange(10) < 4, 315.0, 300.0)
    (said,) = beyond(np.full(10, 9e4), warm)
    assert said == ("the paint's calibration is extrapolated: 40 % of the nodes lie outside it in temperature "
                    "(280 to 310 K), 40 % by more than a tenth of its range")  # fmt: skip
    assert beyond(np.full(10, 9e4), warm - 4) == [
        "40 % of the nodes lie outside the paint's calibration in temperature (280 to 310 K)"
    ]


def test_a_level_that_no_tap_checks_is_said_with_what_a_part_of_the_light_makes():
    law = SternVolmer(np.array([[0.2], [0.8]]), 1e5, 293.15, (0.0, 2e5), (280.0, 310.0))
    ratio, wall = NodeField.make(np.full(9, 0.7), 0.001), NodeField.make(np.full(9, 293.15), 0.1)
    said = unchecked_level(law, ratio, wall, 1e5, 293.15, STREAM)
    assert said.startswith(UNCHECKED)
    assert "1 % of the light is 0.03 in Cp" in said  # 0.01 of 0.7 / 0.8 of 1e5 Pa, over q
    assert said.endswith("1 % of p_off 0.024, 1 K of T_off 0")  # 0.7 of 1 % of 1e5 Pa, over q
    warm = SternVolmer(np.array([[0.2, 0.0], [0.8, 0.008]]), 1e5, 293.15, (0.0, 2e5), (280.0, 310.0))
    said = unchecked_level(warm, ratio, wall, 1e5, 293.15, STREAM)
    assert said.endswith("1 K of T_off 0.024")  # 0.008 times 0.7 / 0.8 of 1e5 Pa, over q
    assert "in Cp" not in unchecked_level(law, NodeField.make(np.full(9, np.nan)), wall, 1e5, 293.15, STREAM)


def test_nodes_that_cameras_show_and_that_come_to_no_pressure_are_said():
    law = SternVolmer(np.array([[0.2], [0.8]]), 1e5, 293.15, (0.0, 2e5), (280.0, 310.0))
    ratio = NodeField.make(np.where(np.arange(200) < 100, 0.7, np.nan), 0.001)

    def of(known):
        wall = NodeField.make(np.where(np.arange(200) >= known, 293.15, np.nan), 0.1)
        return lacking(ratio, pressure_map(law, ratio, wall, p_off=1e5, t_off=293.15), wall)

    assert of(0) == of(1) == []
    (some,), (many,) = of(8), of(30)
    assert some.startswith("8 % of the nodes with a ratio have no pressure: nothing says the wall's temperature there")
    assert many.startswith(LACKING)


def test_thermocouples_that_are_not_of_this_stream_are_said():
    stream = TunnelConditions(66_026.0, 29_580.0, mach=0.8, t_0=302.3)  # recovery: 298.7 K

    def said(kelvin, recovery=0.896, spread=1.0, of=stream):
        return beside_recovery(NodeField.make(np.full(9, kelvin), unit="K"), of, recovery, spread)

    assert said(299.5) == said(295.0) == []
    (hot,) = said(304.9)
    assert hot.startswith("thermocouples and recovery contradict each other: the wall is at 304.9 K by readings")
    assert hot.endswith("of its sigmas apart, and hotter than the stream's T0 of 302.3 K")
    (cold,) = said(292.0)
    assert "hotter" not in cold
    assert said(304.9, spread=3.0) == []  # as the user says of a wall that is slow to follow the stream
    assert said(304.9, recovery=None) == []
    assert said(304.9, of=TunnelConditions(66_026.0, 29_580.0, mach=0.8)) == []
