"""The reference of a point from several parts: straight between incidences, the mean of a run; gains in any unit."""

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.geometry import Camera, Pose
from windmark.paint import NodeField, TunnelGain
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp import BadPicture, ModelPicture, Reference, Sampling, ratio_of
from windmark.tasks.psp.few_modes import gain_pressure

CAMERA = Camera((160, 120), 200.0)
ABOVE = Pose.look_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), [0.0, 1.0, 0.0])
HOW = Sampling(edge_px=0)


def plate(n=15, size=40.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    return Mesh.make(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), structured_triangles(n, n), "wing")


def picture(light, sigma=0.0, name="a", camera="cam1", moves=None):
    mesh = plate()
    moves = np.zeros((len(mesh.vertices), 3, 1)) if moves is None else moves
    light = np.broadcast_to(light, (120, 160)).astype(float)
    return ModelPicture(name, camera, light, np.full(light.shape, sigma**2), CAMERA, ABOVE, mesh, moves)


def noisy(rng, light, sigma, **kw):
    return picture(light + sigma * rng.standard_normal((120, 160)), sigma, **kw)


def test_light_between_two_incidences_is_straight_and_so_is_its_error():
    rng, z = np.random.default_rng(1), []
    for _ in range(40):
        parts = [Reference([noisy(rng, level, 6.0)], share) for level, share in ((900.0, 0.25), (1100.0, 0.75))]
        got = ratio_of([noisy(rng, 1000.0, 0.01)], parts, how=HOW).ratio
        z.append(((got.value - 1.05) / np.sqrt(got.white))[got.known])
    assert np.mean(np.concatenate(z)) == pytest.approx(0.0, abs=0.1)
    assert np.std(np.concatenate(z)) == pytest.approx(1.0, abs=0.05)


def test_references_that_were_registered_apart_do_not_err_alike():
    """One sigma along a slope of 2 per pixel, 2 pixels a unit: by each part's own share, not by their sum."""
    slope = 1000 + 2.0 * np.arange(160.0)[None].repeat(120, axis=0)
    moves = np.zeros((225, 3, 1))
    moves[:, 0] = 0.5
    alone, parts = (
        ratio_of([picture(slope)], [Reference([picture(slope, moves=moves)], share) for share in shares], how=HOW).ratio
        for shares in ((1.0,), (0.5, 0.5))
    )  # fmt: skip
    on = alone.known & parts.known
    assert on.sum() > 100
    assert np.median(alone.sigma[on]) == pytest.approx(2.0 / 1160, rel=0.1)
    np.testing.assert_allclose(parts.sigma[on], alone.sigma[on] / np.sqrt(2), rtol=1e-6)
    assert all(name.startswith("registration") for name in parts.names)


def test_a_node_counts_between_incidences_where_both_show_it_and_in_a_run_where_one_does():
    hole = np.full((120, 160), 1000.0)
    hole[:, :60] = np.nan
    on, parts = [picture(1000.0)], [Reference([picture(hole)], 0.5), Reference([picture(1100.0)], 0.5)]
    both, run = (ratio_of(on, parts, how=HOW, own=own).ratio for own in (False, True))
    left = plate().vertices[:, 0] < -12
    assert not both.known[left].any()
    assert both.value[~left & both.known] == pytest.approx(1.05, abs=1e-9)
    # Where one of the two others shows it the run is of two points, else of three.
    assert run.value[left & run.known] == pytest.approx((1000 + 1100) / 2 / 1000, abs=1e-9)
    assert run.value[both.known] == pytest.approx((1000 + 1000 + 1100) / 3 / 1000, abs=1e-9)


def test_the_pictures_of_a_point_are_a_part_of_its_runs_mean():
    """Their noise is in both: of three points 2/3 of the variance is left, not 4/3."""
    rng, z, white = np.random.default_rng(2), [], []
    for _ in range(40):
        parts = [Reference([noisy(rng, 1000.0, 6.0)], 0.5) for _ in range(2)]
        got = ratio_of([noisy(rng, 1000.0, 6.0)], parts, how=HOW, own=True).ratio
        z.append(((got.value - 1) / np.sqrt(got.white))[got.known])
        white.append(np.median(got.white[got.known]))
    apart = ratio_of([noisy(rng, 1000.0, 6.0)], [Reference([noisy(rng, 1000.0, 6.0)])], how=HOW).ratio
    assert np.std(np.concatenate(z)) == pytest.approx(1.0, abs=0.05)
    assert np.median(white) / np.median(apart.white[apart.known]) == pytest.approx(1 / 3, rel=0.05)


def test_pictures_that_cannot_be_used_count_among_those_of_their_camera():
    on = [picture(1000.0, 1.0, name=f"{k}") for k in range(2)]
    bad = [BadPicture(f"bad {k}", "cam1", "unreadable") for k in range(3)]
    got = ratio_of(on, [Reference(on, 1.0, bad[2:])], how=HOW, bad=bad[:2])
    assert got.left_out == dict.fromkeys(("bad 0", "bad 1", "bad 2"), "unreadable")
    with pytest.raises(DataError, match="2 of 5 frames agree"):
        ratio_of(on, on, how=HOW, bad=bad)
    ratio_of(on, on, how=HOW, bad=[BadPicture(b.name, "cam2", b.why) for b in bad])


def test_a_point_of_a_run_that_cannot_be_used_is_left_out_while_enough_are():
    """One whose pictures contradict each other, and one that was not found."""
    good = [Reference([picture(1000.0)], 0.25, name=f"good {k}") for k in range(2)]
    odd = Reference([picture(1000.0)], 0.25, [BadPicture(f"gone {k}", "cam1", "unreadable") for k in range(2)], "odd")
    lost = Reference((), 0.25, name="lost", why="the model was not found")
    got = ratio_of([picture(1000.0)], [*good, odd, lost], how=HOW, own=True)
    assert got.left_out["lost"] == "the model was not found"
    assert "contradict each other" in got.left_out["odd"]
    assert got.ratio.value[got.ratio.known] == pytest.approx(1.0)
    with pytest.raises(
        DataError, match=r"only 1 of 3 other points can be used for the mean of its run; the first .* lost"
    ):
        ratio_of([picture(1000.0)], [good[0], lost, odd], how=HOW, own=True)
    with pytest.raises(DataError, match="the model was not found"):
        ratio_of([picture(1000.0)], [*good, lost], how=HOW)


def test_no_part_at_all_is_refused():
    with pytest.raises(DataError, match="with wind and without"):
        ratio_of([picture(1000.0)], [], own=True)


def test_a_gain_in_pounds_and_fahrenheit_gives_pascals():
    cov = np.diag([4.0, 0, 0, 0, 0, 0])
    gain = TunnelGain([900.0, -2, 0.01, 0.5, 1e-3, 0], (500.0, 2500.0), (60.0, 120.0), cov, "psf", "degF")
    ratio = NodeField.make([1.02, np.nan, 0.97], 1e-3)
    warm = NodeField.make([300.0, 300.0, 310.0], unit="K").with_mode("temperature", 0.5)
    steady = NodeField.make([6e4, 6e4, 5e3], unit="Pa").with_mode("steady pressure", 50.0)
    got = gain_pressure(gain, ratio, warm, steady)
    t, p = 300 * 1.8 - 459.67, 6e4 / 47.880259
    slope = (900 - 2 * t + 0.01 * t**2 + (0.5 + 1e-3 * t) * p) * 47.880259
    assert got.field.unit == "Pa"
    assert got.field.value[0] == pytest.approx(6e4 + 0.02 * slope)
    assert np.sqrt(got.field.white[0]) == pytest.approx(1e-3 * slope)
    modes = dict(zip(got.field.names, got.field.modes[0], strict=True))
    assert abs(modes["steady pressure"]) == pytest.approx(50.0 * (1 + 0.02 * (0.5 + 1e-3 * t)))
    assert abs(modes["calibration:1"]) == pytest.approx(2 * 0.02 * 47.880259)
    assert abs(modes["temperature"]) == pytest.approx(0.5 * 1.8 * 0.02 * abs(-2 + 0.02 * t + 1e-3 * p) * 47.880259)
    assert np.isnan(got.field.value[1])
    assert got.flags[2] != 0  # 104 psf is below the calibrated range
