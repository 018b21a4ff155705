from __future__ import annotations

import numpy as np
import pytest

from windmark.synth import HalfModel, Paint, TransonicFlow

UP = np.array([[0.0, 0, 1]])


def test_lamp_is_inverse_square_and_cosine():
    paint = Paint(lamps=np.array([[0, 0, 1000.0, 1e6]]))
    assert paint.intensity([[0, 0, 0.0]], UP, "wing")[0] == pytest.approx(1.0)
    assert paint.intensity([[0, 0, -1000.0]], UP, "wing")[0] == pytest.approx(0.25)
    tilted = np.array([[np.sin(0.6), 0, np.cos(0.6)]])
    assert paint.intensity([[0, 0, 0.0]], tilted, "wing")[0] == pytest.approx(np.cos(0.6))
    assert paint.intensity([[0, 0, 0.0]], -UP, "wing")[0] == 0
    two = Paint(lamps=np.array([[0, 0, 1000.0, 1e6], [0, 0, 500, 1e6]]))
    assert two.intensity([[0, 0, 0.0]], UP, "wing")[0] == pytest.approx(5.0)
    assert Paint().intensity([[0, 0, 0.0]], -UP, "wing")[0] == 1.0


def test_levels_and_stern_volmer():
    class Half:
        def pressure_ratio(self, xyz, normal, volume):
            return np.full(len(xyz), 0.5)

    paint = Paint({"wing": 0.8, "wall": 0.3})
    p = np.zeros((1, 3))
    assert paint.intensity(p, UP, "wing")[0] == 0.8
    assert paint.intensity(p, UP, "wing", flow=Half())[0] == pytest.approx(0.8 / (0.2 + 0.8 * 0.5))
    assert paint.intensity(p, UP, "wall", flow=Half())[0] == 0.3  # the wall's coating feels nothing
    assert paint.intensity(p, UP, "tail")[0] == 1.0


def test_pattern_moves_with_the_paint_and_lamps_stand_still():
    paint = Paint.random(np.random.default_rng(0), {}, [[0, 0, 1000.0, 1e6]])
    p, q = np.array([[10.0, 20, 0]]), np.array([[60.0, 20, 30]])
    moved = paint.intensity(q, UP, "wing", rest_xyz=p, rest_normal=UP)[0]
    assert moved == pytest.approx(paint.coating(p, "wing")[0] * paint.light(q, UP)[0])
    assert moved != pytest.approx(paint.intensity(q, UP, "wing")[0], rel=1e-4)


def test_unevenness_and_grain_have_the_amplitude_asked_for():
    rng = np.random.default_rng(1)
    points = rng.uniform(-2000, 2000, (20_000, 3))
    waves = Paint.random(np.random.default_rng(2), {}, [], unevenness=0.04, grain=0.0).coating(points, "wing")
    assert waves.mean() == pytest.approx(1, abs=2e-3)
    assert waves.std() == pytest.approx(0.04 / np.sqrt(2), rel=0.05)
    grain = Paint.random(np.random.default_rng(2), {}, [], unevenness=0.0, grain=0.02).coating(points, "wing")
    # Blending lattice values leaves 0.74 of their variance in each direction.
    assert grain.std() == pytest.approx(0.02 * 0.743**1.5, rel=0.06)


def test_flow_looks_like_a_transonic_wing():
    shape = HalfModel()
    flow = TransonicFlow(shape)
    t = np.full(400, 0.5)
    s = np.linspace(0, 1, 400)
    upper, lower = shape.wing_surface(s, t, 1.0), shape.wing_surface(s, t, -1.0)
    cp = flow.wing_cp(upper, np.tile(UP, (400, 1)))
    xc, eta = shape.planform(upper)
    assert cp[0] > 0.7  # stagnation
    assert -1.4 < cp.min() < -1
    assert xc[cp.argmin()] < 0.1  # suction peak
    steepest = xc[np.argmax(np.where(xc > 0.2, np.gradient(cp, xc), -np.inf))]
    assert steepest == pytest.approx(0.63 - 0.2 * eta[0], abs=0.02)  # shock
    assert cp[-1] > 0.1  # recovery
    assert flow.wing_cp(lower, np.tile(-UP, (400, 1))).mean() > cp.mean() + 0.3  # lift
    ratio = flow.pressure_ratio(upper, np.tile(UP, (400, 1)), "wing")
    np.testing.assert_allclose(ratio, 1 + 0.7 * 0.64 * cp)
    assert (ratio > 0.3).all()
    np.testing.assert_array_equal(flow.pressure_ratio(upper, upper, "wall"), 1)
    assert (
        np.abs(np.diff(flow.body_cp(np.column_stack([np.linspace(-270, 640, 500), *np.zeros((2, 500))])))).max() < 0.05
    )
