"""Walls in the Laplace domain against transfer matrices and quadrature, in time against transforms that are known."""

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import Layer, Wall
from windmark.paint.walls import CHUNK, _in_time

PAINT, STEEL, FOAM = Layer(2e-4, 0.2, 1.6e6), Layer(5e-3, 16.0, 4.0e6), Layer(1e-3, 0.04, 1e5)
WALLS = [
    Wall(layers, back)
    for layers in ((STEEL,), (PAINT, STEEL), (PAINT, STEEL, FOAM))
    for back in ("adiabatic", "isothermal", "semi-infinite")
]
S = np.array([0.05 + 0.02j, 0.4 + 1.0j, 3.0 - 2.0j])


def surface(wall, s):
    """Flux over temperature at the surface, by 2 x 2 matrices from the back: (T, q) there is what the back allows."""
    last = wall.layers[-1]
    if wall.back == "semi-infinite":
        t, q = 1.0, last.effusivity * np.sqrt(s)
        layers = wall.layers[:-1]
    else:
        t, q = (1.0, 0.0) if wall.back == "adiabatic" else (0.0, 1.0)
        layers = wall.layers
    for layer in layers[::-1]:
        p = np.sqrt(s / layer.diffusivity)
        z, c, sh = layer.conductivity * p, np.cosh(p * layer.thickness), np.sinh(p * layer.thickness)
        t, q = c * t + sh / z * q, z * sh * t + c * q
    return q / t


def profile(wall, s):
    """Depths, weights of a quadrature, and k T'^2 + s c T^2 there for a surface temperature of 1."""
    t, q, depth, out = 1.0, surface(wall, s), 0.0, []
    node, weight = np.polynomial.legendre.leggauss(60)
    for k, layer in enumerate(wall.layers):
        p = np.sqrt(s / layer.diffusivity)
        endless = k == len(wall.layers) - 1 and wall.back == "semi-infinite"
        length = 30 / p.real if endless else layer.thickness
        z = 0.5 * length * (node + 1)
        if endless:
            temperature = t * np.exp(-p * z)
            slope = -p * temperature
        else:
            temperature = t * np.cosh(p * z) - q / (layer.conductivity * p) * np.sinh(p * z)
            slope = t * p * np.sinh(p * z) - q / layer.conductivity * np.cosh(p * z)
        energy = layer.conductivity * slope**2 + s * layer.capacity * temperature**2
        out.append((depth + z, 0.5 * length * weight, energy))
        end = layer.thickness
        t, q = (
            t * np.cosh(p * end) - q / (layer.conductivity * p) * np.sinh(p * end),
            q * np.cosh(p * end) - layer.conductivity * p * t * np.sinh(p * end),
        )
        depth += end
    return [np.concatenate(a) for a in zip(*out, strict=True)]


@pytest.mark.parametrize("wall", WALLS)
def test_admittance_is_that_of_transfer_matrices(wall):
    for s, got in zip(S, wall.admittance(S), strict=True):
        assert got == pytest.approx(surface(wall, s), rel=1e-10)
        depth, weight, energy = profile(wall, s)
        assert got == pytest.approx((weight * energy).sum(), rel=1e-6)  # stationary: it is the energy itself
        assert wall.curved_admittance(np.array([s]))[0] == pytest.approx((weight * depth * energy).sum(), rel=1e-6)


def test_times_and_transforms_that_are_known():
    time = np.geomspace(0.01, 30, CHUNK + 7)
    np.testing.assert_allclose(_in_time(lambda s: 1 / (s + 0.3), time), np.exp(-0.3 * time), rtol=1e-8)
    np.testing.assert_allclose(_in_time(lambda s: 1 / s**2, time), time, rtol=1e-10)
    np.testing.assert_allclose(_in_time(lambda s: s**-1.5, time), 2 * np.sqrt(time / np.pi), rtol=1e-10)


def test_one_material_that_goes_on_has_its_closed_form():
    """The same from the transform, which many layers take."""
    one, time = Wall.semi_infinite(16.0, 4e6), np.array([0.1, 1.0, 7.0])
    np.testing.assert_allclose(one.ramp_response(time), 2 * 8000 * np.sqrt(time / np.pi))
    np.testing.assert_allclose(one.curved_ramp_response(time), 8.0 * time)
    two = Wall((Layer(1e-3, 16.0, 4e6), Layer(np.inf, 16.0, 4e6)))
    np.testing.assert_allclose(two.ramp_response(time), one.ramp_response(time), rtol=1e-8)
    np.testing.assert_allclose(two.curved_ramp_response(time), one.curved_ramp_response(time), rtol=1e-6)


def test_long_after_a_wall_is_warm_or_conducts():
    """Insulated: all of its capacity warms at 1 K/s. Cooled at its back: conductance times the temperature."""
    layers = [Layer(1e-3, 0.5, 1e6), Layer(2e-3, 10.0, 3e6)]
    late = np.array([4000.0, 5000.0])
    insulated, cooled = Wall.of(layers), Wall.of(layers, back="isothermal")
    np.testing.assert_allclose(insulated.ramp_response(late), 1e-3 * 1e6 + 2e-3 * 3e6, rtol=1e-4)
    slope = np.diff(cooled.ramp_response(late))[0] / 1000
    assert slope == pytest.approx(1 / (1e-3 / 0.5 + 2e-3 / 10.0), rel=1e-4)


@pytest.mark.parametrize("curved", [False, True])
def test_weights_of_steps_add_up_to_the_response(curved):
    wall, dt = Wall((PAINT, STEEL), "adiabatic"), 0.02
    weights = wall.step_weights(dt, 50, curved=curved)
    response = (wall.curved_ramp_response if curved else wall.ramp_response)(dt * np.arange(1, 51))
    np.testing.assert_allclose(np.cumsum(weights) * dt, response, rtol=1e-9)


def test_heat_goes_through_one_layer_after_the_other():
    wall = Wall((Layer(1e-3, 1.0, 1e6), Layer(4e-3, 4.0, 1e6)))  # diffusivities 1e-6 and 4e-6
    through = (1e-3 / 1e-3 / 2) ** 2 * np.pi  # when 2 sqrt(a t / pi) is the first one's thickness
    time = np.array([-1.0, 0.0, through / 4, through, 4 * through, 100 * through])
    expected = np.array([0.0, 0.0, 0.5e-3, 1e-3, 1e-3 + 2e-3, 1e-3 + 9 * 2e-3])
    np.testing.assert_allclose(wall.heated_depth(time), expected, atol=1e-12)
    closed = Wall(wall.layers, "adiabatic")
    np.testing.assert_allclose(closed.heated_depth(time), np.minimum(expected, 5e-3), atol=1e-12)


def test_the_fourier_number_adds_the_times_of_the_layers():
    one = Wall.semi_infinite(4.0, 1e6, thickness=4e-3)
    np.testing.assert_allclose(one.fourier_number([1.0, 3.0]), np.array([1.0, 3.0]) * 4e-6 / 4e-3**2)
    halves = Wall((Layer(1e-3, 4.0, 1e6), Layer(3e-3, 4.0, 1e6)))
    np.testing.assert_allclose(halves.fourier_number([1.0, 3.0]), one.fourier_number([1.0, 3.0]))
    assert Wall((PAINT, STEEL), "adiabatic").fourier_number([1.0, 3.0]).tolist() == [0.0, 0.0]
    assert Wall.semi_infinite(4.0, 1e6).fourier_number([5.0]).tolist() == [0.0]  # endless


@pytest.mark.parametrize("wrong", [(0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 0.0), (np.nan, 1.0, 1.0)])
def test_layers_are_of_something(wrong):
    with pytest.raises(UsageError, match="thickness, conductivity and capacity must be above zero"):
        Layer(*wrong)
    assert Layer(2.0, 3.0, 12.0).effusivity == 6.0
    assert Layer(2.0, 3.0, 12.0).diffusivity == 0.25


def test_walls_that_are_none():
    endless = Layer(np.inf, 1.0, 1.0)
    for layers, back, sigma in (((), "adiabatic", 0.0), ((STEEL,), "warm", 0.0), ((STEEL,), "adiabatic", -0.1)):
        with pytest.raises(
            UsageError, match="at least one layer, and back one of semi-infinite, adiabatic, isothermal"
        ):
            Wall(layers, back, sigma)
    for layers, back in (
        ((endless,), "adiabatic"),
        ((endless, STEEL), "semi-infinite"),
        ((PAINT, endless), "isothermal"),
    ):
        with pytest.raises(UsageError, match="finite thickness"):
            Wall(layers, back)
    assert Wall((PAINT, endless)).layers[-1] is endless
