"""Heat flux as a linear function of the samples: against the evenly spaced form, finite differences, and draws."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.paint import Layer, Wall, curvature_sum, flux_operator, heat_flux, lateral_conduction
from windmark.synth.heating import COATED_STEEL, RESIN, SolidWall

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import plate, sphere

RESINS = Wall.semi_infinite(0.25, 1.7e6)
COATED = Wall.of([Layer(*layer) for layer in COATED_STEEL.layers])
WALLS = pytest.mark.parametrize("wall", [RESINS, COATED, Wall.of(COATED.layers, "isothermal")], ids="abc")


def rises(count):
    return 300 + np.cumsum(np.random.default_rng(3).uniform(0, 0.1, (4, count)), axis=1)


@WALLS
def test_even_times_give_what_the_evenly_spaced_form_gives(wall):
    t = rises(60)
    found = flux_operator(0.05 * np.arange(60), wall, 0.0)
    even = heat_flux(t[:, 1:], 0.05, wall, initial=t[:, 0], curvature=50.0)
    here = t @ found.weights.T - 50.0 * (t @ found.curved.T)
    np.testing.assert_allclose(here[:, 1:], even.flux, rtol=1e-9, atol=1e-9 * np.abs(even.flux).max())
    assert np.isnan(here[:, 0]).all()


@WALLS
@pytest.mark.parametrize("behind", [0.0, 0.3])  # the start is at the last sample before it, or a part of the way on
def test_missing_samples_are_as_if_they_had_not_been_taken(wall, behind):
    rng = np.random.default_rng(5)
    times = np.sort(rng.uniform(0, 3, 50))
    t, start = rises(50)[0], float(times[6] + behind * (times[7] - times[6]))
    missing = np.isin(np.arange(50), [2, 7, 20, 21, 33])
    filling, weights, curved = flux_operator(times, wall, start).bridged(missing)
    alone = flux_operator(times[~missing], wall, start)
    spoilt = np.where(missing, 1e6, t)  # what stands there does not count
    for bridged, exact in ((weights, alone.weights), (curved, alone.curved)):
        scale = np.nanmax(np.abs(exact @ t[~missing]))
        np.testing.assert_allclose(bridged[~missing] @ spoilt, exact @ t[~missing], atol=1e-8 * scale)
    assert np.isnan(weights[missing]).all()
    assert np.nanmax(np.abs((filling @ spoilt - t)[missing])) < 0.3
    late = flux_operator(times, wall, start).bridged(np.arange(50) > 40)[1]
    assert np.isnan(late[41:]).all()
    assert np.isfinite(late[7:41]).all()


@pytest.mark.parametrize("solid", [RESIN, COATED_STEEL, SolidWall(((1.5e-3, 0.3, 1.8e6),))], ids="abc")
def test_a_curved_wall_against_finite_differences(solid):
    t = np.linspace(0, 2, 161)
    wall = RESINS if solid is RESIN else Wall.of([Layer(*layer) for layer in solid.layers])
    found = flux_operator(t, wall, 0.0)

    def flux(time):
        return 1000 * np.minimum(time / 0.3, 1) + 300 * np.sin(3 * time)

    for curvature in (40.0, -40.0, 150.0):
        rise = solid.rise(flux, t, curvature=curvature)
        flat = (found.weights @ rise)[30:]
        off = flat - curvature * (found.curved @ rise)[30:] - flux(t)[30:]
        assert np.abs(off).max() < 0.004 * 1000
        assert np.abs(flat - flux(t)[30:]).max() > 3 * np.abs(off).max()


def test_the_flux_has_the_errors_that_draws_show():
    times = np.linspace(0, 2, 41)
    operator = flux_operator(times, RESINS, 0.2)
    weights, curved = operator.bridged(np.isin(np.arange(41), [1, 15, 16]))[1:]
    both = (weights - 80 * curved)[20]
    noise = 0.03 * np.random.default_rng(1).standard_normal((40_000, 41))
    assert np.std(noise @ both) == pytest.approx(0.03 * np.sqrt((both**2).sum()), rel=0.015)


def test_times_and_starts_that_cannot_be_are_named():
    with pytest.raises(DataError, match=r"times must increase: 0\.1 s comes after 0\.2 s"):
        flux_operator([0.0, 0.2, 0.1], RESINS, 0.0)
    with pytest.raises(DataError, match="the heating begins at 5 s, the samples are from 0 to 2 s"):
        flux_operator([0.0, 1.0, 2.0], RESINS, 5.0)
    with pytest.raises(DataError, match="no sample says the initial temperature"):
        flux_operator([0.0, 1.0, 2.0], RESINS, 0.0).bridged(np.array([True, False, False]))


def test_curvature_and_what_flows_along_the_surface():
    ball = sphere(40)
    np.testing.assert_allclose(np.nanmedian(curvature_sum(ball)), 2.0 / np.linalg.norm(ball.vertices[50]), rtol=0.01)
    flat = plate(12, 12)
    assert np.nanmax(np.abs(curvature_sum(flat))) < 1e-9
    x = flat.vertices[:, 0]
    heat = lateral_conduction(flat, 3.0 * x**2, RESINS, 1.0)
    inner = heat[np.isfinite(heat)]
    assert len(inner) > 50
    depth = 2 * np.sqrt(0.25 / 1.7e6 / np.pi)
    np.testing.assert_allclose(inner, -0.25 * depth * 6.0, rtol=1e-5)
