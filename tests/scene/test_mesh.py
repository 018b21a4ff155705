"""The surface grid: what is refused, and the sizes and pieces that its tolerances are made of, against plain loops."""

import numpy as np
import pytest

from windmark.scene import Block, Mesh, structured_triangles
from windmark.scene.mesh import LARGER

QUAD = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
CELL = np.array([[0, 1, 2], [0, 2, 3]])
NAMES = np.array(["a"])


@pytest.mark.parametrize(
    ("vertices", "triangles", "volume", "words"),
    [
        (np.zeros((4, 2)), [[0, 1, 2]], NAMES, r"vertices must be \(V, 3\), got \(4, 2\)"),
        (np.zeros(3), [[0, 1, 2]], NAMES, r"vertices must be \(V, 3\), got \(3,\)"),
        (np.zeros((4, 3, 1)), [[0, 1, 2]], NAMES, r"vertices must be \(V, 3\), got \(4, 3, 1\)"),
        (QUAD, [[0, 1, 2, 3]], NAMES, r"triangles must be \(T, 3\), got \(1, 4\)"),
        (QUAD, [0, 1, 2], NAMES, r"triangles must be \(T, 3\), got \(3,\)"),
        (QUAD, [[[0], [1], [2]]], NAMES, r"triangles must be \(T, 3\), got \(1, 3, 1\)"),
        (QUAD, [[0, 1, 2]], np.array(["a", "b"]), "volume must have 1 entries, got 2"),
        (QUAD, [[0, 1, 2], [0, 2, 3]], NAMES, "volume must have 2 entries, got 1"),
        (QUAD, [[0, 1, 4]], NAMES, "triangles must index the 4 vertices"),
        (QUAD, [[-1, 1, 2]], NAMES, "triangles must index the 4 vertices"),
    ],
)
def test_arrays_that_are_no_mesh_are_named(vertices, triangles, volume, words):
    with pytest.raises(ValueError, match=words):
        Mesh(vertices, np.array(triangles, np.int32), volume)


def test_first_and_last_node_may_be_corners_and_blanked_is_one_flag_a_node():
    mesh = Mesh(QUAD, np.array([[0, 2, 3]], np.int32), NAMES, blanked=np.array([False, True, False, False]))
    assert mesh.used.tolist() == [0, 2, 3]
    with pytest.raises(ValueError, match=r"blanked must be \(4,\), got \(3,\)"):
        Mesh(QUAD, mesh.triangles, NAMES, blanked=np.zeros(3, bool))


def test_the_box_is_that_of_the_known_nodes_in_use():
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [np.nan, 9, 9], [-50, 0, 0]])
    mesh = Mesh.make(vertices, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(mesh.box, [[0, 0, 0], [3, 4, 0]])
    assert mesh.diagonal == 5.0
    low, _ = mesh.box
    low[:] = -7.0
    assert mesh.diagonal == 5.0
    np.testing.assert_array_equal(mesh.box[0], 0.0)  # what is given out is the caller's own
    empty = Mesh.make(vertices, np.zeros((0, 3), int))
    for corner in empty.box:
        np.testing.assert_array_equal(corner, np.full(3, np.nan))
    assert (empty.diagonal, empty.size, empty.sizes.tolist(), empty.pieces.tolist()) == (0.0, 0.0, [], [])


def test_normals_of_nodes_weigh_triangles_by_area():
    """A roof: one side three times as large as the other; nodes of the ridge lean to the larger one."""
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [-3, 0, 0], [0, 0, -1]])
    mesh = Mesh.make(vertices, [[0, 1, 2], [1, 0, 3]])
    areas = mesh.triangle_normals()
    np.testing.assert_array_equal(areas, [[0, 0, 3], [1, 0, 0]])
    np.testing.assert_allclose(mesh.vertex_normals()[:2], [np.array([1, 0, 3]) / np.sqrt(10)] * 2)
    np.testing.assert_allclose(mesh.vertex_normals()[2:], [[0, 0, 1], [1, 0, 0]])


def joined(count, pairs):
    """Number of its connected component for each of ``count`` things."""
    of = list(range(count))
    for a, b in pairs:
        old, new = of[a], of[b]
        of = [new if k == old else k for k in of]
    return of


def sizes_by_loops(mesh):
    """`Mesh.sizes` as its docstring says it, one triangle at a time."""
    firsts = [b.first for b in mesh.blocks]
    block = [sum(f <= t[0] for f in firsts) for t in mesh.triangles]
    run = [0]
    for k in range(1, len(mesh.triangles)):
        run.append(run[-1] + (mesh.volume[k] != mesh.volume[k - 1] or block[k] != block[k - 1]))
    node = joined(len(mesh.vertices), [(t[i], t[i + 1]) for t in mesh.triangles for i in (0, 1)])
    part = [(r, node[t[0]]) for r, t in zip(run, mesh.triangles, strict=True)]

    def box(parts):
        places = np.concatenate([mesh.vertices[t] for p, t in zip(part, mesh.triangles, strict=True) if p in parts])
        places = places[np.isfinite(places).all(axis=1)]
        return np.abs(places).max(), np.linalg.norm(places.max(axis=0) - places.min(axis=0))

    every = sorted(set(part), key=lambda p: -box([p])[1])
    whole, size, scale = box(every)[1], {}, 0.0
    for k, p in enumerate(every):
        if k == 0 or box([every[k - 1]])[1] > LARGER * box(every[k:])[1]:
            scale = box(every[k:])[1]
        size[p] = min(max(scale, box([p])[0]), whole)
    return [size[p] for p in part]


@pytest.mark.parametrize("seed", range(8))
def test_sizes_are_those_of_the_parts_of_one_scale(seed):
    rng = np.random.default_rng(seed)
    count = 7
    scale = 10.0 ** rng.uniform(-2, 3, count)
    vertices = np.concatenate([s * rng.normal(size=(4, 3)) for s in scale])
    cells = np.concatenate([CELL + 4 * k for k in range(count)])
    volume = np.repeat(rng.choice(["a", "b"], count), 2)
    blocks = tuple(Block(f"b{k}", (2, 2, 1), 8 * k) for k in range(count // 2))
    mesh = Mesh(vertices, cells.astype(np.int32), volume, blocks)
    np.testing.assert_allclose(mesh.sizes, sizes_by_loops(mesh))
    assert mesh.size == np.median(mesh.sizes)


def shifted(size, where=(0.0, 0.0, 0.0)):
    return size * (QUAD - [0.5, 0.5, 0.0]) + np.array(where)


@pytest.mark.parametrize(("times", "own"), [(9.0, False), (11.0, True)])
def test_a_part_ten_times_larger_is_of_another_scale(times, own):
    mesh = Mesh.make(np.concatenate([shifted(times), shifted(1.0)]), np.concatenate([CELL, CELL + 4]))
    np.testing.assert_allclose(mesh.sizes, np.sqrt(2) * np.array([times, times, *[1.0 if own else times] * 2]))
    # The same nodes as one part, or as more small ones that together are as large: no other scale.
    one = Mesh.make(mesh.vertices, np.concatenate([mesh.triangles, [[0, 4, 5]]]))
    np.testing.assert_allclose(one.sizes, np.sqrt(2) * times)


def test_volumes_and_blocks_part_a_surface_that_hangs_together():
    """One strip of two cells, the second one twenty times longer: it is a part where it is another volume or block."""
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [40, 0, 0], [40, 1, 0]])
    cells = np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [4, 5, 3]], np.int32)
    names = np.array(["a"] * 4)
    assert np.ptp(Mesh(vertices, cells, names).sizes) == 0
    small = np.hypot(1, 1)
    for mesh in (
        Mesh(vertices, cells, np.array(["a", "a", "b", "b"])),
        Mesh(vertices, cells, names, (Block("one", (2, 1, 1), 0), Block("two", (4, 1, 1), 2))),
    ):
        np.testing.assert_allclose(mesh.sizes, [small, small, *[np.hypot(40, 1)] * 2])


def test_a_small_part_far_out_is_as_large_as_its_coordinates():
    """They are rounded to a part of themselves: a tolerance below that would be noise."""
    vertices = np.concatenate([shifted(2000.0), shifted(1.0, (0.0, 0.0, -300.0))])
    mesh = Mesh.make(vertices, np.concatenate([CELL, CELL + 4]))
    np.testing.assert_allclose(mesh.sizes[2:], 300.0)
    np.testing.assert_allclose(mesh.sizes[:2], mesh.diagonal)


def test_a_node_without_a_place_leaves_the_other_parts_their_sizes():
    vertices = np.concatenate([shifted(50.0), shifted(1.0), shifted(1.0)])
    mesh = Mesh.make(vertices, np.concatenate([CELL, CELL + 4, CELL + 8]))
    lost = vertices.copy()
    lost[10, 1] = np.nan  # of one part one node; of another all
    np.testing.assert_allclose(Mesh.make(lost, mesh.triangles).sizes[:4], mesh.sizes[:4])
    lost[8:] = np.nan
    np.testing.assert_allclose(Mesh.make(lost, mesh.triangles).sizes[:4], mesh.sizes[:4])
    assert np.isfinite(Mesh.make(lost, mesh.triangles).size)


@pytest.mark.parametrize(("gap", "one"), [(0.85e-6, True), (1.15e-6, False)])
def test_blocks_that_meet_within_a_millionth_are_one_piece(gap, one):
    vertices = np.concatenate([QUAD, QUAD + np.array([1 + gap * np.hypot(2, 1), 0, 0])])
    mesh = Mesh.make(vertices, np.concatenate([CELL, CELL + 4]))
    assert (mesh.pieces[0] == mesh.pieces[2]) == one
    assert mesh.pieces[0] == mesh.pieces[1]
    assert mesh.pieces[2] == mesh.pieces[3]


def test_only_borders_join_and_closed_surfaces_have_none():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert len(set(Mesh.make(corners, tetrahedron).pieces.tolist())) == 1
    twice = Mesh.make(
        np.concatenate([corners, corners + np.array([1, 0, 0])]), np.concatenate([tetrahedron, tetrahedron + 4])
    )
    assert len(set(twice.pieces.tolist())) == 2  # they touch in a node, and are two bodies
    # A fin that stands with a corner on the middle node of a plate, without a node in common.
    x, y = np.meshgrid(np.arange(3.0), np.arange(3.0))
    plate = np.stack([x.ravel(), y.ravel(), np.zeros(9)], axis=1)
    fin = np.array([[1.0, 1, 0], [1, 1, 1], [1, 1.5, 1]])
    both = np.concatenate([structured_triangles(3, 3), [[9, 10, 11]]])
    assert len(set(Mesh.make(np.concatenate([plate, fin]), both).pieces.tolist())) == 2
    # Standing on its edge it is one: both nodes are at borders.
    edge = Mesh.make(np.concatenate([plate, fin - [1, 1, 0]]), both)
    assert len(set(edge.pieces.tolist())) == 1
    lost = edge.vertices.copy()
    lost[10] = np.nan
    assert len(set(Mesh.make(lost, both).pieces.tolist())) == 1


def test_a_mesh_that_moved_keeps_its_parts_and_has_sizes_of_its_own():
    mesh = Mesh.make(np.concatenate([shifted(20.0), shifted(1.0)]), np.concatenate([CELL, CELL + 4]))
    moved = mesh.moved(np.concatenate([shifted(20.0), shifted(1.5)]))
    np.testing.assert_allclose(moved.sizes[2:], np.hypot(1.5, 1.5))
    np.testing.assert_allclose(moved.sizes, Mesh.make(moved.vertices, moved.triangles).sizes)
    nothing = Mesh.make(QUAD, np.zeros((0, 3), int)).moved(QUAD + 1)
    assert nothing.sizes.tolist() == []


def test_structured_triangles_are_those_of_the_cells():
    ni, nj, first = 3, 4, 5
    expected = set()
    for j in range(nj - 1):
        for i in range(ni - 1):
            a = first + i + ni * j
            expected |= {(a, a + 1, a + 1 + ni), (a, a + 1 + ni, a + ni)}
    forth, back = structured_triangles(ni, nj, first), structured_triangles(ni, nj, first, reverse=True)
    assert {*map(tuple, forth.tolist())} == expected
    assert len(forth) == len(expected)
    np.testing.assert_array_equal(back, forth[:, ::-1])
    assert structured_triangles(1, 4).shape == (0, 3)
