"""Normals against the grid that they belong to: out of the body, into it, or nothing tells."""

from dataclasses import replace

import numpy as np

from windmark import synth
from windmark.pipeline.verdict.grid import grid_look
from windmark.pipeline.verdict.inward import inward_findings
from windmark.resection.outward import outward
from windmark.scene import Mesh, structured_triangles


def sheet(height: float, triangles_of: int = 12) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(-1, 1, triangles_of), np.linspace(-1, 1, triangles_of), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)]), structured_triangles(*x.shape)


def plate(*heights: float) -> Mesh:
    """Sheets over each other, each with its own nodes."""
    parts = [sheet(h) for h in heights]
    start = np.cumsum([0, *(len(p) for p, _ in parts)])
    triangles = [t + s for (_, t), s in zip(parts, start, strict=False)]
    return Mesh.make(np.vstack([p for p, _ in parts]), np.vstack(triangles))


def places(seed: int, height: float) -> np.ndarray:
    return np.column_stack([np.random.default_rng(seed).uniform(-0.9, 0.9, (8, 2)), np.full(8, height)])


UP = np.tile([0.0, 0.0, 1.0], (8, 1))


def test_normals_of_a_body_with_two_sides():
    """However its triangles are wound: both sheets are wound alike here."""
    body = plate(0.0, -0.2)
    assert (outward(body, places(1, 0.0), UP) == 1).all()
    assert (outward(body, places(2, 0.0), -UP) == -1).all()
    assert (outward(body, places(3, -0.2), -UP) == 1).all()


def test_walls_all_round_change_nothing():
    body = plate(0.0, -0.2, 3.0, -3.0)
    assert (outward(body, places(1, 0.0), UP) == 1).all()
    assert (outward(body, places(2, 0.0), -UP) == -1).all()


def test_a_sheet_and_a_missing_normal_tell_nothing():
    assert (outward(plate(0.0), places(1, 0.0), UP) == 0).all()
    assert (outward(plate(0.0, -0.2), places(1, 0.0), np.nan * UP) == 0).all()


def test_a_table_whose_normals_point_into_the_model_is_a_bad_one():
    """The pictures of such a table are all refused, and markers and grid alone show it."""
    test = synth.wind_tunnel(11, nodes=4000, clutter=None)
    look = grid_look(test.markers, test.mesh)
    assert look is not None
    assert not inward_findings(look)
    turned = grid_look(replace(test.markers, normal=-test.markers.normal), test.mesh)
    assert turned is not None
    (found,) = inward_findings(turned)
    assert (found.word, found.cause) == ("bad", "discs")
    assert "the normals of the table point into the model" in found.reason
