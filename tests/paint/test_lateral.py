"""Heat along the surface of layered walls: limits in closed form, and the exact solution of a painted thin skin."""

import numpy as np
import pytest

from windmark.paint import Layer, Wall, flux_operator, lateral_conductance

PAINT, METAL, RESIN = Layer(50e-6, 0.2, 1.6e6), Layer(2e-3, 160.0, 2.4e6), Layer(5e-3, 0.25, 1.7e6)


def along(wall, *times):
    return [lateral_conductance(wall, t) for t in times]


def test_one_layer_as_far_as_a_step_has_gone():
    deep = [2 * 0.25 * np.sqrt(0.25 / 1.7e6 * t / np.pi) for t in (0.1, 4.0)]
    assert along(Wall.semi_infinite(0.25, 1.7e6), 0.1, 4.0) == pytest.approx(deep, rel=1e-9)
    assert along(Wall.of([METAL]), 0.0, 1e-3, 9.0) == pytest.approx([0.0, 2 * 160 * np.sqrt(1e-3 / 15e3 / np.pi), 0.32],
                                                                    rel=1e-5)  # fmt: skip
    assert along(Wall.of([METAL], "isothermal"), 9.0) == pytest.approx([0.16])  # a straight line to the cold back
    halves = Wall((Layer(1e-4, 0.25, 1.7e6), Layer(2e-4, 0.25, 1.7e6), Layer(1.0, 0.25, 1.7e6)))
    assert along(halves, 0.1, 4.0) == pytest.approx(deep, rel=1e-9)


def test_metal_counts_as_far_as_it_is_warm():
    """Below paint it follows with its capacity over the paint's conductance; upon resin it counts at once."""
    capacity = 2e-3 * 2.4e6 + 50e-6 * 1.6e6 / 3
    late = [0.1, 0.5, 2.0]
    expected = 0.32 * (1 - np.exp(-np.array(late) * 0.2 / 50e-6 / capacity))
    assert along(Wall.of([PAINT, METAL]), *late) == pytest.approx(expected, rel=0.06)
    first = 0.2 * 2 * np.sqrt(1.25e-7 * 1e-4 / np.pi)  # in the paint alone
    assert along(Wall.of([PAINT, METAL]), 1e-4, 1e3) == pytest.approx([first, 0.32001])
    assert along(Wall.of([METAL, RESIN]), 0.5) == pytest.approx([0.32], rel=0.01)
    resin = lateral_conductance(Wall.semi_infinite(0.25, 1.7e6), 5.0)
    assert along(Wall.of([RESIN, METAL]), 5.0) == pytest.approx([resin], rel=0.03)  # the heat is not through yet
    assert along(Wall.of([RESIN, METAL]), 1e4) == pytest.approx([0.32 + 0.25 * 5e-3], rel=1e-3)


@pytest.mark.parametrize("length", [0.02, 0.04, 0.4])
def test_what_a_painted_skin_conducts_is_told_where_the_flux_misses_it(length):
    """Flux q cos(2 pi x / length) from the start on into paint on metal: where the one-dimensional flux misses a tenth
    of it the heat along the surface is more than that, and where it misses none it is none."""
    t = np.linspace(0, 2.5, 101)
    wave2, q, wall = (2 * np.pi / length) ** 2, 5000.0, Wall.of([PAINT, METAL])
    capacity = 2e-3 * 2.4e6 + 50e-6 * 1.6e6
    rate = 0.32 * wave2 / capacity
    rise = q / capacity * (1 - np.exp(-rate * t)) / rate + q * 50e-6 / 0.2 * (1 - np.exp(-t / 0.02))
    flux = flux_operator(t, wall, 0.0).weights @ rise
    told = wave2 * rise * [lateral_conductance(wall, x) for x in t]
    late = t > 0.3
    missed = (q - flux)[late]
    assert missed[-1] > 0.1 * q or length == 0.4
    assert (told[late] > missed - 0.02 * q).all()
    assert (told[late] < 0.1 * np.abs(flux[late])).all() == (length == 0.4)
