"""The virtual paint test: calibration, flow, camera, truth, and that it is the same every time."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Pose
from windmark.synth import PaintCamera, PolarFlow, Rays, SternVolmer, StillAir, WingState, psp_test, render
from windmark.synth.paint_camera import SENSOR
from windmark.synth.pressure_paint import TYPICAL
from windmark.synth.psp import UNEVEN_mm, _waves
from windmark.synth.psp_truth import load_truth, node_truth, placed, section_truth


@pytest.fixture(scope="module")
def made():
    return psp_test(5, incidences=2, size_px=(320, 200), nodes=6_000, on_frames=2, off_frames=2)


def test_stern_volmer_is_one_at_its_reference_and_falls_with_pressure_and_heat():
    law = SternVolmer(np.array([[0.2, 0.001], [0.8, 0.01]]), 1e5, 293.15)
    assert law.ratio(1e5, 293.15) == pytest.approx(1)
    # By hand: A0 = 0.2 + 0.001 * 10, A1 = 0.8 + 0.01 * 10 at 10 K more; half the pressure.
    assert law.ratio(5e4, 303.15) == pytest.approx(0.21 + 0.45)
    assert (np.diff(TYPICAL.ratio(np.linspace(1e4, 1.3e5, 50), 300.0)) > 0).all()
    with pytest.raises(ValueError, match="sums to 1"):
        SternVolmer(np.array([[0.2], [0.7]]))


def test_suction_shock_and_vortex_go_with_incidence():
    low, high = (PolarFlow(alpha_deg=a) for a in (0.0, 4.0))
    shape = low.shape
    mid, up = 0.5 * shape.span, np.array([[0.0, 0.0, 1.0]])

    def above(flow, xc, y):
        xyz = np.column_stack([shape.leading_edge(y) + xc * shape.chord(y), np.full_like(xc, y), 0 * xc])
        return flow.cp(xyz, np.repeat(up, len(xc), axis=0), "wing")

    xc = np.linspace(0.05, 0.95, 400)
    cp0, cp4 = above(low, xc, mid), above(high, xc, mid)
    assert cp4.min() < cp0.min() - 0.3
    shock0, shock4 = (xc[np.argmax(np.gradient(cp, xc))] for cp in (cp0, cp4))
    assert shock4 - shock0 == pytest.approx(0.048, abs=0.006)
    aft = np.array([0.8])
    dip0, dip4 = (above(f, aft, 0.88 * shape.span) - above(f, aft, 0.93 * shape.span) for f in (low, high))
    assert dip4[0] > dip0[0] + 0.2  # the vortex sucks near the tip
    assert low.state(np.zeros((1, 3)), up, "wall")[0] == pytest.approx(low.p_inf_Pa)
    assert low.q_inf_Pa == pytest.approx(0.5 * 1.4 * low.p_inf_Pa * 0.8**2)
    assert low.wall_T_K == pytest.approx(303.15 * (1 - 0.104 * 0.128 / 1.128))


def test_camera_has_the_gain_that_it_says():
    camera = PaintCamera.random(np.random.default_rng(1), (200, 150), (1, 2), unequal=0.0)
    bright = np.linspace(0.2, 2.5, 200)[None].repeat(150, axis=0)
    a, b = (camera.expose(bright, np.random.default_rng([2, k])).astype(float) for k in range(2))
    mean, variance = (0.5 * (a + b)).mean(axis=0) - SENSOR.black, 0.5 * np.median((a - b) ** 2, axis=0) / 0.4549
    gain = np.polyfit(mean, variance, 1)[0]
    assert 1 / gain == pytest.approx(camera.electrons_per_level, rel=0.06)
    dark = camera.dark_picture(np.random.default_rng(3)).astype(float)
    assert 0 < np.median(dark) - SENSOR.black < 100


@pytest.mark.slow
def test_pictures_show_the_true_ratio(made):
    """The same place of the model in the same light: only the air differs."""
    point = made.points[1]
    state = WingState(motion=Pose.identity())
    camera, pose = made.test.cameras["cam1"], made.test.cam_from_tunnel["cam1"]
    rays = Rays.of(camera)
    on, off = (render(made.world(state, air, 0.0), camera, pose, rays=rays) for air in (point.wind, point.still))
    own = on.triangle >= 0
    own[own] = made.mesh.volume[on.triangle[own]] == "wing"
    xyz = on.xyz[own]
    above = np.repeat([[0.0, 0.0, 1.0]], len(xyz), axis=0)
    p, T = point.wind.state(xyz, above, "wing")
    expected = made.law.ratio(p, T) / made.law.ratio(*point.still.state(xyz, above, "wing"))
    off_by = off.image[own] / on.image[own] / expected - 1
    assert abs(np.median(off_by)) < 2e-3
    assert np.median(np.abs(off_by)) < 0.01


def test_light_fades_flickers_and_falls_off(made):
    point, state = made.points[0], WingState()
    fresh, faded, bright = (
        made.world(state, point.still, lit, lamp).node_intensity() for lit, lamp in ((0, 1), (1000, 1), (0, 1.01))
    )
    wing = np.unique(made.mesh.triangles[made.mesh.volume == "wing"])
    light = made.paint.light(made.mesh.vertices[wing], made.mesh.vertex_normals()[wing])
    np.testing.assert_allclose(faded[wing], fresh[wing] * np.exp(-made.paint.fading_per_s * 1000 * light))
    assert (light > 0.5).sum() > 500
    np.testing.assert_allclose(bright, 1.01 * fresh)
    far = replace(made.paint, lamps=np.array([[0, 0, 2000.0, 1.0]]))
    at = far.light(np.zeros((2, 3)), np.array([[0, 0, 1.0], [0, np.sqrt(0.75), 0.5]]))
    np.testing.assert_allclose(at, [2.5e-7, 1.25e-7])


@pytest.mark.slow
def test_truth_of_loads_holds_on_a_finer_grid_and_sections_follow_the_nodes(made):
    fine = psp_test(5, incidences=2, size_px=(320, 200), nodes=40_000, on_frames=1, off_frames=1)
    state = WingState(0.01, -0.5, made.points[1].off.motion)
    found = []
    for test in (made, fine):
        point = test.points[1]
        cp = node_truth(test, point).cp
        found.append(load_truth(test, placed(test, state), state, cp)[0])
    assert found[0].cl == pytest.approx(found[1].cl, rel=0.01)
    assert found[0].cm == pytest.approx(found[1].cm, rel=0.01)
    assert found[1].cl > 0.4
    x, side, cp = section_truth(made, made.points[1].wind, 0.55)
    order = np.argsort(x[side > 0])
    normal_force = np.trapezoid(cp[side < 0][np.argsort(x[side < 0])], np.sort(x[side < 0])) - np.trapezoid(
        cp[side > 0][order], x[side > 0][order]
    )
    assert normal_force == pytest.approx(0.75, abs=0.25)


def test_wall_temperature_is_uneven_and_the_ratio_feels_it(made):
    at = node_truth(made, made.points[0])
    wing = np.unique(made.mesh.triangles[made.mesh.volume == "wing"])
    assert 0.2 < np.std(at.T_K[wing]) < 2.5
    again = made.law.ratio(at.p_Pa, at.T_K) / made.law.ratio(*(
        np.full(len(at.cp), v) for v in (made.points[0].still.p_Pa, made.points[0].still.T_K)
    ))  # fmt: skip
    np.testing.assert_allclose(at.ratio[wing], again[wing])
    assert np.isnan(at.cp[np.unique(made.mesh.triangles[made.mesh.volume == "wall"])]).all()
    assert StillAir(9e4, 290.0).state(np.zeros((2, 3)), np.zeros((2, 3)), "wing")[0].tolist() == [9e4, 9e4]


@pytest.mark.slow
def test_same_seed_same_pictures():
    made, again, other = (
        psp_test(seed, incidences=1, size_px=(120, 80), nodes=2_000, on_frames=2, off_frames=2) for seed in (5, 5, 6)
    )
    first, second = ([*test.pictures(test.points[0])] for test in (made, again))
    assert len(first) == 8
    for a, b in zip(first, second, strict=True):
        assert a[:3] == b[:3]
        np.testing.assert_array_equal(a[3], b[3])
    assert (next(iter(other.pictures(other.points[0])))[3] != first[0][3]).any()


def test_the_wall_keeps_its_temperature_over_the_length_that_is_said():
    rng, apart, square = np.random.default_rng(11), 80.0, []
    for _ in range(3000):
        waves = _waves(rng, 1.0)
        here, there = np.cos(np.array([[0.0, 0, 0], [apart, 0, 0]]) @ waves[:, :3].T + waves[:, 3]) @ waves[:, 4]
        square.append((there - here) ** 2)
    assert np.mean(square) == pytest.approx(2 * (1 - np.exp(-0.5 * (apart / UNEVEN_mm) ** 2)), rel=0.1)
