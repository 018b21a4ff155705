"""Surface that is in a grid twice, beside all that only looks like it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.scene import Block, Mesh, structured_triangles
from windmark.scene.doubled import Doubled, doubled, doubled_zones, part_of

sys.path.insert(0, str(Path(__file__).parents[1] / "paint"))
from paint_shapes import box, plate, sphere


def together(*parts, names=("wing", "flap")):
    first = np.cumsum([0, *(len(p.vertices) for p in parts)])
    triangles = [p.triangles + first[k] for k, p in enumerate(parts)]
    volume = np.concatenate([np.full(len(t), n) for t, n in zip(triangles, names, strict=False)])
    return Mesh.make(np.concatenate([p.vertices for p in parts]), np.concatenate(triangles), volume)


def moved(mesh, by):
    return Mesh.make(mesh.vertices + by, mesh.triangles)


def area(mesh):
    return 0.5 * float(np.linalg.norm(mesh.triangle_normals(), axis=1).sum())


@pytest.mark.parametrize("other", [plate(), plate(13, 11)], ids=["the same", "of other cells"])
def test_a_sheet_on_another_has_half_of_both_too_much(other):
    mesh = together(plate(), other)
    found = doubled(mesh)
    assert found.extra.sum() == pytest.approx(12.0)
    assert (found.upon >= 0).all()
    assert doubled_zones(mesh, found) == "wing lies upon flap"


def test_identical_triangles_of_the_same_nodes_are_found():
    p = plate(5, 4)
    found = doubled(Mesh.make(p.vertices, np.concatenate([p.triangles, p.triangles[:3]])))
    assert found.extra.sum() == pytest.approx(3 * 0.5)
    assert (found.upon >= 0).sum() == 6


def test_zones_that_overlap_partly_have_what_overlaps_too_much():
    found = doubled(together(plate(41, 33), moved(plate(37, 31), [3.0, 0, 0])))
    assert found.extra.sum() == pytest.approx(0.25 * 12, rel=0.1)


def test_round_zones_of_different_cells_lie_upon_each_other():
    mesh = together(sphere(48), sphere(55))
    assert doubled(mesh).extra.sum() == pytest.approx(0.5 * area(mesh), rel=0.01)


@pytest.mark.parametrize("mesh", [
    plate(), sphere(), box(), together(plate(), moved(plate(13, 11), [4.0, 0, 0])),  # zones that meet
    together(plate(), Mesh.make(plate(13, 11).vertices, plate(13, 11).triangles[:, ::-1])),  # the other side of a sheet
    together(sphere(), Mesh.make(0.5 * sphere().vertices, sphere().triangles)),
    Mesh.make(sphere().vertices * [1.0, 100.0, 0.02], sphere().triangles),  # a thin part of long cells
], ids=["plate", "globe", "box", "neighbours", "two sides", "one in another", "thin"])  # fmt: skip
def test_what_is_there_once_is_not_found(mesh):
    found = doubled(mesh)
    assert not found
    assert not found.extra.any()


def test_a_step_of_a_tenth_of_a_cell_is_no_double():
    assert not doubled(together(plate(), moved(plate(), [0, 0, 0.02])))


def test_what_cannot_be_is_left_out_and_zones_have_their_names():
    """Collapsed triangles and nodes that are not known; blocks of a PLOT3D file."""
    p = plate(5, 4)
    xyz = np.concatenate([p.vertices, p.vertices, [[np.nan] * 3]])
    blocks = (Block("zone01", (5, 4, 1), 0), Block("zone07", (5, 4, 1), 20))
    t = np.concatenate([structured_triangles(5, 4), structured_triangles(5, 4, first=20), [[0, 0, 1], [0, 1, 40]]])
    mesh = Mesh(xyz, t.astype(np.int32), np.full(len(t), "wing"), blocks)
    assert doubled_zones(mesh, doubled(mesh)) == "zone07 of wing lies upon zone01 of wing"


def test_it_is_looked_for_once_for_all_places_of_a_surface():
    mesh = together(plate(), plate())
    assert doubled(mesh.moved(mesh.vertices * 1.01)) is doubled(mesh)


@pytest.mark.parametrize("seed", range(4))
def test_the_tree_finds_what_looking_at_every_pair_does(seed):
    """The slow twin: every triangle against every other one, in plain arrays."""
    rng = np.random.default_rng(seed)
    corner = rng.uniform(-1, 1, (150, 1, 3)) * [1, 1, 0.02] + rng.uniform(-0.5, 0.5, (150, 3, 3)) * [1, 1, 0.02]
    mesh = Mesh.make(corner.reshape(-1, 3), np.arange(450).reshape(-1, 3))
    n = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    twice = np.linalg.norm(n, axis=1)
    n /= twice[:, None]
    height = twice / np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    layers = np.zeros(150)
    for a, middle in enumerate(corner.mean(axis=1)):
        edge, off = np.roll(corner, -1, axis=1) - corner, middle - corner
        inside = (np.einsum("bj,bkj->bk", n, np.cross(edge, off)) > 0).all(axis=1)
        near = np.abs((n * off[:, 0]).sum(axis=1)) <= 0.05 * np.maximum(height[a], height)
        layers[a] = (inside & near & (n @ n[a] >= 0.9) & (np.arange(150) != a)).sum()
    found = doubled(mesh)
    assert layers.any()
    np.testing.assert_array_equal(found.upon >= 0, layers > 0)
    np.testing.assert_allclose(found.extra, 0.5 * twice * layers / (1 + layers))


def test_of_a_part_of_a_surface_that_is_there_once_nothing_is_looked_for():
    whole = together(plate(), moved(plate(13, 11), [4.0, 0, 0]))
    part = part_of(whole, whole.volume == "wing")
    assert "_doubled" in part.__dict__
    assert not doubled(part)
    twice = together(plate(), plate(), plate(), names=("wing", "wing", "flap"))
    found = doubled(part_of(twice, twice.volume == "wing"))
    assert found.extra.sum() == pytest.approx(12.0)
    assert not doubled(part_of(twice, twice.volume == "flap"))


def test_what_lies_upon_the_first_triangle_counts_as_all_else():
    """A large flap upon a triangle of the wing that is many times as large, and two lesser ones upon each other."""
    mesh = together(*[plate(2, 2)] * 4, names=("wing", "flap", "slat", "tail"))
    upon = np.array([2, -1, 0, -1, 6, -1, 4, -1])
    found = Doubled(np.array([0.1, 0, 3.0, 0, 1.0, 0, 1.0, 0]), upon)
    assert doubled_zones(mesh, found).startswith("wing lies upon flap")
