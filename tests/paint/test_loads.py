"""Loads against closed forms and draws; axes; what was not seen; fills."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.paint import COEFFICIENTS, LoadReference, NodeField, fill_smoothly, integrate_loads
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import box, plate, sphere

UNIT = LoadReference(1.0, 1.0, 1.0)


def test_a_pressure_that_grows_with_height_is_the_volume_upside_down():
    """Archimedes: the force of p = z on a closed surface is minus its volume along z; here of a polyhedron, exactly."""
    mesh = sphere()
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    volume = float(np.einsum("tk,tk->", a, np.cross(b, c))) / 6
    got = integrate_loads(mesh, NodeField.make(mesh.vertices[:, 2]), LoadReference(2.0, 1.0, 1.0, alpha_deg=10.0))
    row = {name: v for name, (v, _) in got.row("all").items()}
    assert row["CN"] == pytest.approx(-volume / 2, rel=1e-12)
    assert row["CL"] == pytest.approx(-volume / 2 * np.cos(np.radians(10)), rel=1e-12)
    assert row["CD"] == pytest.approx(-volume / 2 * np.sin(np.radians(10)), rel=1e-12)
    for name in ("CA", "CY", "Cl", "Cm", "Cn"):
        assert row[name] == pytest.approx(0, abs=1e-12), name
    assert got.closed.all()
    assert not got.warnings


def test_signs_of_forces_and_moments():
    """A plate in z = 0 with pressure from above ahead of the moment point, and to starboard of it."""
    mesh = plate()
    ahead = NodeField.make(np.where(mesh.vertices[:, 0] < 0, 1.0, 0.0))  # x points aft
    row = integrate_loads(mesh, ahead, UNIT).row("model")
    assert row["CN"][0] < 0  # pressed down
    assert row["Cm"][0] < 0  # nose down
    starboard = NodeField.make(np.where(mesh.vertices[:, 1] > 0, 1.0, 0.0))
    assert integrate_loads(mesh, starboard, UNIT).row("model")["Cl"][0] > 0  # starboard wing down
    side = plate()
    turned = side.moved(side.vertices[:, [0, 2, 1]] * [1, 1, 1])  # in y = 0, normal to port
    row = integrate_loads(turned, NodeField.make(np.where(turned.vertices[:, 0] < 0, 1.0, 0.0)), UNIT).row("model")
    assert row["CY"][0] > 0
    assert row["Cn"][0] > 0  # pushed to starboard at the nose


def test_moments_are_exact_for_a_linear_pressure_and_by_the_moment_point():
    """p = x on the plate |x| < 2, |y| < 1.5: the moment about y is the integral of x^2 (with CN = -p)."""
    mesh = plate(9, 7)
    cp = NodeField.make(mesh.vertices[:, 0])
    row = integrate_loads(mesh, cp, LoadReference(12.0, 4.0, 3.0)).row("model")
    assert row["Cm"][0] == pytest.approx(16.0 / 12.0 / 4.0, rel=1e-12)
    uniform = integrate_loads(mesh, NodeField.make(np.ones(len(cp))), LoadReference(12.0, 1.0, 1.0, [1.0, 0.5, 0.0]))
    assert uniform.row("model")["Cm"][0] == pytest.approx(-1.0)
    assert uniform.row("model")["Cl"][0] == pytest.approx(-0.5)


def test_wind_axes():
    """At any incidence: right angles, drag along the wind, and no lift of a pure drag."""
    r = LoadReference(1.0, 1.0, 1.0, alpha_deg=12.0, beta_deg=7.0).wind_axes()
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(r) == pytest.approx(1)
    a, b = np.radians([12.0, 7.0])
    # The wind comes from u = cos a cos b ahead, v = sin b from starboard, w = sin a cos b from below.
    np.testing.assert_allclose(r[0], [np.cos(a) * np.cos(b), -np.sin(b), np.sin(a) * np.cos(b)])


def test_sigma_of_loads_is_that_of_draws_and_a_mode_dominates_it():
    mesh = box(7, (2.0, 1.0, 0.2))
    rng = np.random.default_rng(0)
    f = NodeField.make(np.where(mesh.vertices[:, 2] > 0, -0.5, 0.2), 0.05).with_mode(
        "temperature", np.where(mesh.vertices[:, 2] > 0, 0.01, 0.0))  # fmt: skip
    got = integrate_loads(mesh, f, UNIT)
    from windmark.paint.loads import load_operator

    op = load_operator(mesh, UNIT, np.ones(len(mesh.triangles), bool))
    seen = [op @ (f.value + 0.05 * rng.normal(size=len(f)) + f.modes[:, 0] * rng.normal()) for _ in range(3000)]
    scale = np.outer(got.sigma[0], got.sigma[0])
    np.testing.assert_allclose(np.cov(np.array(seen).T) / scale, got.cov[0] / scale, atol=0.08)
    white_only = integrate_loads(mesh, NodeField.make(f.value, 0.05), UNIT)
    k = COEFFICIENTS.index("CN")
    assert got.sigma[0, k] > 1.2 * white_only.sigma[0, k]
    assert got.dominant("box", "CN")[0][1] > 0.3


def test_volumes_add_up_and_an_open_one_is_told():
    mesh = box(5, names=True)
    cp = NodeField.make(mesh.vertices @ [0.3, -0.2, 0.5] + 1, 0.01)
    got = integrate_loads(mesh, cp, UNIT)
    np.testing.assert_allclose(got.value[:-1].sum(axis=0), got.value[-1], atol=1e-12)
    assert got.closed.tolist() == [False] * 6 + [True]
    assert sum("is open" in w for w in got.warnings) == 6
    one = integrate_loads(mesh, cp, UNIT, volumes=["z+"])
    np.testing.assert_allclose(one.value[0], got.value[got.names.index("z+")])
    with pytest.raises(UsageError, match="no volume flap"):
        integrate_loads(mesh, cp, UNIT, volumes=["flap"])


def test_unseen_surface_is_filled_named_and_in_the_sigma():
    mesh = sphere(80)
    true = mesh.vertices[:, 2] + 0.2 * mesh.vertices[:, 0]
    hidden = mesh.vertices[:, 1] > 0.6
    got = integrate_loads(mesh, NodeField.make(np.where(hidden, np.nan, true), 0.01), UNIT)
    whole = integrate_loads(mesh, NodeField.make(true, 0.01), UNIT)
    assert 0.17 < got.unseen[0] < 0.23
    assert "not seen" in got.warnings[0]
    k = COEFFICIENTS.index("CN")
    assert abs(got.value[0, k] - whole.value[0, k]) < 2 * got.sigma[0, k]
    assert got.sigma[0, k] > 3 * whole.sigma[0, k] > 0
    assert got.filled[0, k] != 0
    with pytest.raises(DataError, match=r"only .* % of the area of model has a value"):
        integrate_loads(mesh, NodeField.make(np.where(mesh.vertices[:, 1] > -0.2, np.nan, true)), UNIT)


@pytest.mark.slow
def test_the_error_of_a_rim_that_was_not_seen_is_what_the_rim_inside_of_it_shows():
    """The outermost nodes of a plate, on which Cp goes to a peak at one edge: far less than Cp's own scatter."""
    mesh = plate(41, 41, (4.0, 4.0))
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    hidden = np.maximum(np.abs(x), np.abs(y)) > 1.95
    force, moment, z, old = COEFFICIENTS.index("CN"), COEFFICIENTS.index("Cm"), [], []
    for seed in range(40):
        a = np.random.default_rng(seed).standard_normal(5)
        true = a[0] + a[1] * np.exp(-(x + 2) / 0.3) + 0.5 * a[2] * y + 0.3 * a[3] * np.sin(2 * x + a[4])
        got = integrate_loads(mesh, NodeField.make(np.where(hidden, np.nan, true), 1e-3), UNIT)
        off = got.value[0] - integrate_loads(mesh, NodeField.make(true), UNIT).value[0]
        # The moment hangs on which edge it is that errs.
        z.append(off[[force, moment]] / got.sigma[0, [force, moment]])
        old.append(got.sigma[0, force] / (0.5 * np.std(true[~hidden]) * got.unseen[0] * 16.0))
    size = np.sqrt(np.mean(np.square(z), axis=0))
    assert ((size > 0.4) & (size < 1.5)).all()
    assert (np.mean(np.abs(z) < 1.96, axis=0) > 0.85).all()
    assert np.median(old) < 0.5


def test_strips_between_gaps_and_gaps_without_end_have_the_volumes_scatter():
    mesh = plate(21, 21, (4.0, 4.0))
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    value = 0.3 * x + np.sin(y)
    one_in_two = (np.arange(len(x)) // 21) % 2 == 0  # every row of nodes lies between two gaps
    got = integrate_loads(mesh, NodeField.make(np.where(one_in_two, np.nan, value), 1e-3), UNIT, least_seen=0.4)
    assert got.causes[0]["unseen model"][COEFFICIENTS.index("CN")] > 0
    with pytest.raises(DataError, match="has a value"):
        integrate_loads(mesh, NodeField.make(np.full(len(x), np.nan)), UNIT)


@pytest.mark.slow
def test_fill_goes_on_with_the_slope_and_carries_modes_and_noise():
    mesh = plate(41, 41, (4.0, 4.0))
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    missing = np.hypot(x - 0.3, y + 0.5) < 0.35
    value = 1 + 0.3 * x - 0.2 * y + 0.1 * (x**2 - y**2)
    f = NodeField.make(np.where(missing, np.nan, value), 0.01).with_mode("t", x)
    got = fill_smoothly(mesh, f, missing)
    np.testing.assert_allclose(got.value[missing], value[missing], atol=1e-6)
    np.testing.assert_allclose(got.modes[missing, 0], x[missing], atol=1e-6)
    rng = np.random.default_rng(0)
    seen = [fill_smoothly(mesh, NodeField.make(value + 0.01 * rng.normal(size=len(x))), missing).value[missing]
            for _ in range(150)]  # fmt: skip
    ratio = np.std(seen, axis=0) / np.sqrt(got.white[missing])
    assert 0.9 < np.median(ratio) < 1.1
    assert ratio.min() > 0.75
    assert ratio.max() < 1.25


def test_fill_joins_blocks_that_meet_and_refuses_what_hangs_nowhere():
    mesh = box(9)
    value = mesh.vertices @ [1.0, 2.0, -1.0]
    corner = np.abs(mesh.vertices - 1).sum(axis=1) < 0.6
    got = fill_smoothly(mesh, NodeField.make(np.where(corner, np.nan, value)), corner)
    assert np.abs(got.value - value)[corner].max() < 0.5
    together = np.linalg.norm(mesh.vertices - 1, axis=1) < 1e-9
    assert np.ptp(got.value[together]) == 0
    with pytest.raises(DataError, match="hang together with no node that has a value"):
        fill_smoothly(mesh, NodeField.make(np.full(len(value), np.nan)), np.ones(len(value), bool))


def test_a_zone_that_is_there_twice_has_no_loads_and_is_named():
    p = plate(5, 4)
    twice = Mesh.make(p.vertices, np.concatenate([p.triangles, p.triangles]), "wing")
    with pytest.raises(DataError, match=r"triangles of wing lie upon others of it: 50 % of the area of wing is"):
        integrate_loads(twice, NodeField.make(np.ones(20)), UNIT)


def test_two_volumes_on_each_other_have_loads_each_and_none_together():
    mesh = Mesh.make(np.tile(plate().vertices, (2, 1)),
                     np.concatenate([plate().triangles, plate().triangles + len(plate().vertices)]),
                     np.repeat(["wing", "flap"], len(plate().triangles)))  # fmt: skip
    cp = NodeField.make(-np.ones(len(mesh.vertices)))
    with pytest.raises(DataError, match="wing lies upon flap"):
        integrate_loads(mesh, cp, UNIT)
    assert integrate_loads(mesh, cp, UNIT, volumes=["wing"]).row("all")["CN"][0] == pytest.approx(12.0)


def test_a_rim_that_is_there_twice_counts_and_is_said():
    """Two cells of 320: an overlap of so little is about as much of the loads."""
    mesh = Mesh.make(plate().vertices, np.concatenate([plate().triangles, plate().triangles[:4]]), "wing")
    got = integrate_loads(mesh, NodeField.make(-np.ones(len(plate().vertices))), UNIT)
    assert got.row("all")["CN"][0] == pytest.approx(12.0 * (1 + 4 / 640))
    said = "triangles of wing lie upon others of it: 0.621 % of the area of wing is in the grid twice and counts twice"
    assert got.warnings[0].startswith(said)


def test_a_volume_that_is_named_twice_is_refused():
    with pytest.raises(UsageError, match="names wing more than once"):
        integrate_loads(Mesh.make(plate().vertices, plate().triangles, "wing"), NodeField.make(np.ones(357)), UNIT,
                        volumes=["wing", "wing"])  # fmt: skip
