"""What taps are told by the nodes round them: holes that were filled, and surfaces that bend between nodes."""

import numpy as np
import pytest

from windmark.paint import NodeField, TunnelConditions
from windmark.scene import Mesh
from windmark.scene.mesh import structured_triangles
from windmark.tasks.psp.taps import EITHER_SIDE, OFF_GRID, Readings, at_taps, in_cp

STREAM = TunnelConditions(6e4, 3e4, mach=0.8, t_0=300.0)


def plate(n=41, size=40.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    return Mesh.make(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), structured_triangles(n, n), "wing")


def places(rng, count):
    return np.column_stack([rng.uniform(-15, 15, (count, 2)), np.zeros(count)])


def readings(xyz, pressure, sigma=20.0):
    up = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    return Readings(tuple(f"t{k}" for k in range(len(xyz))), xyz, up, pressure, np.full(len(xyz), sigma))


def test_holes_that_were_filled_err_as_a_whole_and_leave_no_scatter_to_others():
    """The nodes of a tap's triangle are wrong by the same 200 Pa: that is no scatter of 20 Pa nodes elsewhere."""
    mesh, found, alike = plate(), [], []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        xyz = places(rng, 12)
        true = 6e4 + 500 * mesh.vertices[:, 0]
        near = np.linalg.norm(mesh.vertices[:, None] - xyz, axis=2)
        filled = near.min(axis=1) < 1.8
        hole = 200 * rng.standard_normal(len(xyz))
        noise = 20 * rng.standard_normal(len(true))
        value = true + np.where(filled, hole[near.argmin(axis=1)], noise)
        prior = NodeField(value, np.where(filled, 200.0, 20.0) ** 2, np.zeros((len(true), 0)), (), "Pa")
        taps = readings(xyz, 6e4 + 500 * xyz[:, 0] + 20 * rng.standard_normal(len(xyz)))
        for out, mask in ((found, filled), (alike, np.zeros_like(filled))):
            _, fit, _ = at_taps(mesh, prior, mask, taps, "offset-slope", [])
            out.append(fit.scatter)
    assert np.median(found) < 40
    assert np.median(alike) > 80  # as if the nodes of a hole were independent


def test_a_peak_that_is_a_few_nodes_wide_costs_a_tap_its_weight():
    """Between nodes a triangle is flat; the peak bends by 90 Pa from node to node."""
    mesh = plate()
    bend = 45.0 * np.maximum(mesh.vertices[:, 0], 0) ** 2
    xyz = np.array([[-12.0, 3.2, 0], [-7.5, -8.1, 0], [-3.4, 9.2, 0], [5.5, 4.5, 0], [9.5, -6.5, 0], [13.5, 8.5, 0]])
    true = 5e4 + 300 * xyz[:, 0] + 45.0 * np.maximum(xyz[:, 0], 0) ** 2
    prior = NodeField.make(5e4 + 300 * mesh.vertices[:, 0] + bend, 1.0, unit="Pa")
    _, fit, table = at_taps(mesh, prior, np.zeros(len(bend), bool), readings(xyz, true, 1.0), "offset-slope", [])
    assert not fit.blocked
    assert fit.scatter == 0
    table = in_cp(table, readings(xyz, true, 1.0), STREAM, NodeField.make((prior.value - 6e4) / 3e4, 1e-5),
                  np.zeros(len(bend), bool), mesh)  # fmt: skip
    sigma, off = table.paint_sigma * 3e4, (table.paint - table.cp) * 3e4
    assert (sigma[:3] < 1).all()
    np.testing.assert_allclose(np.abs(off[3:]), sigma[3:], rtol=0.05)
    assert (off[3:] > 5).all()


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_taps_are_said_to_be_too_few(count):
    mesh, remarks = plate(), []
    prior = NodeField.make(5e4 + 300 * mesh.vertices[:, 0], 20.0, unit="Pa")
    xyz = places(np.random.default_rng(1), count)
    field, fit, table = at_taps(
        mesh, prior, np.zeros(len(prior), bool), readings(xyz, 5e4 + 300 * xyz[:, 0]), "offset-slope", remarks
    )  # fmt: skip
    assert fit is None
    assert field is prior
    assert table is not None
    assert "not fitted to the taps" in remarks[0]


def test_taps_beside_the_grid_do_not_count():
    mesh, remarks = plate(), []
    prior = NodeField.make(5e4 + 300 * mesh.vertices[:, 0], 20.0, unit="Pa")
    xyz = np.concatenate([places(np.random.default_rng(1), 6), [[300.0, 0.0, 0.0]]])
    _, fit, table = at_taps(
        mesh, prior, np.zeros(len(prior), bool), readings(xyz, 5e4 + 300 * xyz[:, 0]), "offset-slope", remarks
    )  # fmt: skip
    assert fit is not None
    assert table.words[-1] == OFF_GRID
    assert "1 of 7 taps lie outside the grid" in remarks[0]


def test_a_tap_on_a_thin_edge_without_its_normal_does_not_count():
    """Two sheets 0.02 apart with different pressures: a tap between them is of neither, with its normal of one."""
    top, remarks = plate(), []
    below = top.vertices - [0, 0, 0.02]
    mesh = Mesh.make(np.concatenate([top.vertices, below]),
                     np.concatenate([top.triangles, top.triangles[:, ::-1] + len(below)]), "wing")  # fmt: skip
    pressure = np.concatenate([5e4 + 300 * top.vertices[:, 0], 7e4 - 200 * below[:, 0]])
    prior = NodeField.make(pressure, 20.0, unit="Pa")
    xyz = places(np.random.default_rng(1), 6) - [0, 0, 0.01]
    taps = readings(xyz, 5e4 + 300 * xyz[:, 0])
    _, fit, table = at_taps(mesh, prior, np.zeros(len(prior), bool), taps, "offset-slope", remarks)
    assert fit is not None
    assert not any(table.words)
    lost = Readings(taps.names, xyz, np.where(np.arange(6)[:, None] < 4, taps.normal, np.nan), taps.value, taps.sigma)
    _, fit, table = at_taps(mesh, prior, np.zeros(len(prior), bool), lost, "offset-slope", remarks)
    assert table.words == ("", "", "", "", EITHER_SIDE, EITHER_SIDE)
    assert fit.used.sum() == 4
    assert "2 of 6 taps are as near to the other side of a thin part" in remarks[0]
