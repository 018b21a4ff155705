"""Infrared: radiance against tables, temperature by draws, heat flux against closed forms and finite differences."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import UsageError
from windmark.paint import (
    Layer,
    NodeField,
    PlanckBand,
    PolynomialRadiance,
    Wall,
    dielectric_emissivity,
    heat_flux,
    lateral_conduction,
    surface_temperature,
)

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import plate

LWIR = PlanckBand(8.0, 12.0)
MACOR = Wall.semi_infinite(1.46, 2.0e6)


def test_radiance_in_bands():
    """The whole spectrum is Stefan's law over pi; 26.3 % of it at 300 K lie in 8 to 12 micrometres (table of F)."""
    edges = (1, 5, 15, 50, 200, 3000)
    whole = sum(PlanckBand(a, b).radiance(300.0) for a, b in pairwise(edges))
    stefan = 5.670374419e-8 * 300**4 / np.pi
    assert whole == pytest.approx(stefan, rel=3e-4)
    assert LWIR.radiance(300.0) / stefan == pytest.approx(0.4036 - 0.1403, abs=2e-3)


@pytest.mark.parametrize("law", [LWIR, PlanckBand(3.0, 5.0), PolynomialRadiance([10.0, 0.5, 0.02], (250.0, 500.0))])
def test_radiance_and_temperature_are_inverse_and_the_slope_is_right(law):
    t = np.linspace(251, 499, 500)
    np.testing.assert_allclose(law.temperature(law.radiance(t)), t, rtol=2e-6)
    np.testing.assert_allclose(law.slope(t), (law.radiance(t + 0.01) - law.radiance(t - 0.01)) / 0.02, rtol=1e-6)
    assert np.isnan(law.temperature([0.0, -1.0, 1e12])).all()


def test_emissivity_falls_off_at_grazing_angles_only():
    e = dielectric_emissivity([0.0, 30.0, 60.0, 80.0, 90.0], 0.95)
    assert e[0] == pytest.approx(0.95)
    assert e[1] == pytest.approx(0.95, abs=0.003)
    assert 0.87 < e[2] < 0.93
    assert e[3] < 0.7
    assert e[4] == pytest.approx(0, abs=1e-12)


def test_surface_temperature_has_the_errors_that_draws_show():
    true, e, around = np.array([290.0, 320.0, 380.0]), np.array([0.95, 0.9, 0.8]), 293.0
    tau, window = 0.9, 295.0

    def seen(t, e, around):
        return tau * (e * LWIR.radiance(t) + (1 - e) * LWIR.radiance(around)) + (1 - tau) * LWIR.radiance(window)

    def answer(signal, e=e, around=around):
        return surface_temperature(
            signal, LWIR, emissivity=e, emissivity_sigma=0.01, surroundings=around, surroundings_sigma=2.0,
            transmission=tau, window_temperature=window)  # fmt: skip

    got, flags = answer(NodeField.make(seen(true, e, around), 0.05))
    np.testing.assert_allclose(got.value, true, rtol=1e-6)
    assert not flags.any()
    rng = np.random.default_rng(0)
    draws = np.array([
        answer(NodeField.make(seen(true, e, around) + 0.05 * rng.normal(size=3)), e * (1 + 0.01 * rng.normal()),
               around + 2 * rng.normal())[0].value for _ in range(3000)])  # fmt: skip
    cov = got.modes @ got.modes.T + np.diag(got.white)
    scale = np.outer(got.sigma, got.sigma)
    np.testing.assert_allclose(np.cov(draws.T) / scale, cov / scale, atol=0.1)


def test_signals_that_are_none():
    got, flags = surface_temperature(NodeField.make([np.nan, 1.0, 1e9]), LWIR, emissivity=0.5, surroundings=300.0)
    assert np.isnan(got.value).all()
    assert flags.tolist() == [8 | 4, 4, 2]
    with pytest.raises(UsageError, match="window_temperature"):
        surface_temperature(NodeField.make([1.0]), LWIR, emissivity=0.9, surroundings=300.0, transmission=0.9)
    with pytest.raises(UsageError, match="emissivity"):
        surface_temperature(NodeField.make([1.0]), LWIR, emissivity=1.2, surroundings=300.0)


def test_step_and_ramp_of_the_flux():
    """T = 2 q sqrt(t / pi) / e for a step, 2/3 of that for a ramp; 0.15 % off after 20 samples, 0.01 % after 100."""
    e, dt = MACOR.layers[0].effusivity, 0.01
    t = dt * np.arange(401)
    step = heat_flux([2e4 / e * np.sqrt(t / np.pi)], dt, MACOR, initial=0.0).flux[0] / 1e4
    assert abs(step[20] - 1) < 0.0016
    assert abs(step[100] - 1) < 0.00015
    ramp = heat_flux([4e4 / (3 * e) * t**1.5 / np.sqrt(np.pi)], dt, MACOR).flux[0] / 1e4
    np.testing.assert_allclose(ramp[20:], t[20:], rtol=1.6e-3)
    np.testing.assert_allclose(ramp[100:], t[100:], rtol=1.5e-4)


def test_the_sum_of_cook_and_felderman():
    """The formula as they wrote it, sample by sample."""
    rng = np.random.default_rng(1)
    t = np.concatenate([[0.0], np.cumsum(rng.normal(size=60))])
    time = 0.02 * np.arange(61)
    q = [0.0]
    for n in range(1, 61):
        i = np.arange(1, n + 1)
        q.append(2 * MACOR.layers[0].effusivity / np.sqrt(np.pi) * np.sum(
            (t[i] - t[i - 1]) / (np.sqrt(time[n] - time[i]) + np.sqrt(time[n] - time[i - 1]))))  # fmt: skip
    np.testing.assert_allclose(heat_flux([t], 0.02, MACOR).flux[0], q, rtol=1e-12, atol=1e-6)


@pytest.mark.parametrize("correlation", [(1.0,), (1.0, 0.6, 0.3)])
@pytest.mark.parametrize("initial", [None, 300.0])
def test_sigma_of_the_flux_is_that_of_draws(correlation, initial):
    rng = np.random.default_rng(2)
    c = sum(r * (np.eye(80, k=k) + (np.eye(80, k=-k) if k else 0)) for k, r in enumerate(correlation))
    noise = rng.normal(size=(6000, 80)) @ np.linalg.cholesky(c).T
    start = None if initial is None else 300 + 0.05 * rng.normal(size=6000)
    got = heat_flux(300 + 0.1 * noise, 0.01, MACOR, sigma=0.1, correlation=correlation, initial=start,
                    initial_sigma=0.05 if initial else 0.0)  # fmt: skip
    np.testing.assert_allclose(got.flux.std(axis=0)[1:], got.noise_sigma[0, 1:], rtol=0.05)


def finite_differences(layers, back, q, dt, steps, cells=400, fine=4):
    """Surface temperature of a wall under flux q(t), by Crank-Nicolson on a fine grid."""
    from scipy.linalg import solve_banded

    depth = np.concatenate([np.full(cells, la.thickness / cells) for la in layers])
    k = np.concatenate([np.full(cells, la.conductivity) for la in layers])
    c = np.concatenate([np.full(cells, la.capacity) for la in layers])
    between = 1 / (0.5 * depth[:-1] / k[:-1] + 0.5 * depth[1:] / k[1:])
    end = 2 * k[-1] / depth[-1] if back == "isothermal" else 0.0
    diagonal = np.concatenate([[0.0], between]) + np.append(between, end)
    store, h, t, out = c * depth, dt / fine, np.zeros(len(k)), []
    bands = np.zeros((3, len(k)))
    bands[0, 1:], bands[1], bands[2, :-1] = -0.5 * between, store / h + 0.5 * diagonal, -0.5 * between
    for n in range(steps * fine + 1):
        if n % fine == 0:
            out.append(t[0] + q(n * h) * 0.5 * depth[0] / k[0])
        flow = np.diff(t) * between
        change = np.append(flow, 0.0) - np.concatenate([[0.0], flow])
        change[-1] -= end * t[-1]
        right = store / h * t + 0.5 * change
        right[0] += 0.5 * (q(n * h) + q((n + 1) * h))
        t = solve_banded((1, 1), bands, right)
    return np.array(out)


@pytest.mark.parametrize("back", ["adiabatic", "isothermal"])
def test_walls_of_two_layers_against_finite_differences(back):
    layers = [Layer(2e-4, 0.2, 1.5e6), Layer(3e-3, 15.0, 3.6e6)]

    def q(t):
        return 1e4 * np.sin(t) ** 2 + 5e3 * t

    t = finite_differences(layers, back, q, 0.01, 400)
    got = heat_flux([t], 0.01, Wall.of(layers, back), initial=0.0)
    np.testing.assert_allclose(got.flux[0, 30:], q(0.01 * np.arange(401))[30:], rtol=2e-3)
    assert not got.late.any()
    # The same taken for a thick wall of the coating is off by far.
    thick = heat_flux([t], 0.01, Wall.semi_infinite(0.2, 1.5e6, thickness=2e-4), initial=0.0)
    assert abs(thick.flux[0, -1] / q(4.0) - 1) > 0.2
    assert thick.late[-1]


def test_a_layered_wall_of_one_material_is_semi_infinite():
    layers = [Layer(1e-3, 1.46, 2.0e6), Layer(1.0, 1.46, 2.0e6)]
    t = np.array([1e-3, 0.1, 10.0])
    np.testing.assert_allclose(Wall.of(layers, "semi-infinite").ramp_response(t), MACOR.ramp_response(t), rtol=1e-10)
    np.testing.assert_allclose(Wall.of(layers[:1]).ramp_response([1e4]), 2.0e3, rtol=1e-6)


def test_the_limit_of_a_semi_infinite_wall_is_where_its_back_changes_the_flux():
    thin = Wall.semi_infinite(1.46, 2.0e6, thickness=2e-3)
    time = 0.2 * (2e-3) ** 2 / MACOR.layers[0].diffusivity
    step = 1e-4 * time
    real = Wall.of([Layer(2e-3, 1.46, 2.0e6)])
    off = np.diff(real.ramp_response([time, time + step])) / np.diff(thin.ramp_response([time, time + step])) - 1
    assert abs(off[0]) == pytest.approx(2 * np.exp(-5), rel=0.05)
    assert thin.fourier_number(time) == pytest.approx(0.2)


def test_curvature_of_a_sphere():
    """Exact for a sphere: k (sqrt(s / a) - 1 / R) T; a ramp of T then needs 2 e sqrt(t / pi) - k t / R."""
    t = 0.01 * np.arange(200)
    got = heat_flux([t], 0.01, MACOR, curvature=2 / 0.02)
    expected = 2 * MACOR.layers[0].effusivity * np.sqrt(t / np.pi) - 1.46 / 0.02 * t
    np.testing.assert_allclose(got.flux[0], expected, rtol=1e-9, atol=1e-6)


def test_lateral_conduction_of_a_wave():
    mesh = plate(81, 61)
    wave = np.sin(2 * mesh.vertices[:, 0])
    got = lateral_conduction(mesh, wave, MACOR, 4.0)
    expected = 1.46 * 4 * wave * 2 * np.sqrt(1.46 / 2e6 * 4 / np.pi)
    inside = np.isfinite(got)
    assert inside.sum() == 79 * 59
    np.testing.assert_allclose(got[inside], expected[inside], atol=0.01 * np.abs(expected).max())


def test_missing_samples_and_wrong_use():
    t = np.ones((2, 10))
    t[1, 4] = np.nan
    got = heat_flux(t, 0.1, MACOR).flux
    assert np.isfinite(got[0]).all()
    assert np.isfinite(got[1, :4]).all()
    assert np.isnan(got[1, 4:]).all()
    for wrong in ({"dt": 0.0}, {"correlation": (0.5,)}, {"sigma": -1.0}):
        with pytest.raises(UsageError):
            heat_flux(t, **{"dt": 0.1, "wall": MACOR, **wrong})
    with pytest.raises(UsageError, match="back one of"):
        Wall.of([Layer(1.0, 1.0, 1.0)], "open")
    with pytest.raises(UsageError, match="finite thickness"):
        Wall.of([Layer(np.inf, 1.0, 1.0)])
    with pytest.raises(UsageError, match="above zero"):
        Layer(0.0, 1.0, 1.0)
    both = heat_flux(np.cumsum(t[:1], axis=1), 0.1, Wall.semi_infinite(1.46, 2e6, relative_sigma=0.05), sigma=0.1)
    assert (both.sigma[0, 3:] > 0.05 * np.abs(both.flux[0, 3:])).all()
