"""Form factors against closed forms, what hides what, light thrown on and taken off; kernels against slow twins."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import DataError, UsageError
from windmark.paint import NodeField, add_self_illumination, form_factors, remove_self_illumination
from windmark.paint._kernels import triangle_factor
from windmark.paint.form_factors import _seats
from windmark.scene import Mesh, structured_triangles
from windmark.scene._tree_kernels import is_blocked
from windmark.scene.triangle_tree import LEAF, TriangleTree

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import box, corner, sphere


def wall_factor(x, y):
    """Of the unit wall seen from a floor element at distance x, y along the edge (Howell's catalogue, B-4)."""

    def half(width):
        h, c = 1 / width, x / width
        s = np.hypot(h, c)
        return (np.arctan(1 / c) - c / s * np.arctan(1 / s)) / (2 * np.pi)

    return half(y) + half(1 - y)


@pytest.mark.slow
@pytest.mark.parametrize("facets", [100, 1600])
def test_corner_against_the_closed_form(facets):
    mesh = corner()
    factors = form_factors(mesh, facets=facets)
    seen = factors.seen
    at = _seats(mesh, mesh.vertex_normals())
    floor = (np.arange(len(at)) < 441) & (at[:, 1] > 0.01) & (at[:, 1] < 0.99)
    exact = wall_factor(at[floor, 0], at[floor, 1])
    assert np.abs(seen[floor] - exact).max() < 0.008
    assert np.abs(seen[floor] - exact).mean() < 0.0015
    assert seen[0] > 0.2  # a node in the very edge
    areas = np.bincount(mesh.triangles[: 2 * 400].ravel(), minlength=len(seen))
    assert areas @ seen / areas.sum() == pytest.approx(0.20004, abs=0.004)


def test_inside_of_a_box_everything_is_seen_and_on_a_sphere_nothing():
    inside = box(9)
    inside = Mesh.make(inside.vertices, inside.triangles[:, ::-1].copy())
    seen = form_factors(inside, facets=400).seen
    middle = (np.abs(inside.vertices) < 0.99).sum(axis=1) == 2
    np.testing.assert_allclose(seen[middle], 1.0, atol=0.02)
    assert form_factors(sphere(30), facets=200).seen.max() < 1e-3


def test_a_ball_sees_the_floor_that_its_tangent_plane_cuts():
    """A floor without end fills (1 + cos) / 2 of what a place on a ball sees, the angle being that of its normal from
    straight down; from below a bulging surface it was hidden by the surface itself."""
    ball, n = sphere(24), 33
    x, y = (np.sinh(g.ravel()) for g in np.meshgrid(np.linspace(-5, 5, n), np.linspace(-5, 5, n)))  # to 74 radii
    floor = np.stack([x, y, np.full_like(x, -1.2)], axis=1)
    triangles = np.concatenate([ball.triangles, structured_triangles(n, n, first=len(ball.vertices))])
    mesh = Mesh.make(np.concatenate([ball.vertices, floor]), triangles)
    seen = form_factors(mesh, facets=300).seen[: len(ball.vertices)]
    down = -ball.vertices[:, 2]
    # Above -0.85 the floor's edge is to be seen; on the seam, nodes 0 and 24 of 25, normals are those of one side.
    known = (down > -0.85) & (np.arange(len(down)) % 25 % 24 > 0)
    np.testing.assert_allclose(seen[known], (1 + down[known]) / 2, atol=0.02)


def test_a_screen_hides():
    """A screen between floor and ceiling, half as large as they: the middle sees nothing of the ceiling."""
    n = 9
    a, b = (g.ravel() for g in np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n)))
    up, down = structured_triangles(n, n), structured_triangles(n, n, reverse=True)

    def sheets(screen):
        parts = [(1.0, 0.0, up), (1.0, 1.0, down), (screen, 0.5, up)]
        xyz = [np.stack([s * a, s * b, np.full(n * n, z)], axis=1) for s, z, _ in parts]
        return Mesh.make(np.concatenate(xyz), np.concatenate([t + k * n * n for k, (_, _, t) in enumerate(parts)]))

    centre = n * n // 2
    free, hidden = (form_factors(sheets(s), facets=3000) for s in (1e-3, 0.9))
    ceiling = slice(2 * (n - 1) ** 2, 4 * (n - 1) ** 2)

    def to_ceiling(f):
        return np.asarray(f.matrix[[centre]].todense())[0][np.unique(f.facet[ceiling])].sum()

    assert to_ceiling(free) > 0.5
    assert to_ceiling(hidden) < 0.1 * to_ceiling(free)


def test_kernels_against_slow_twins():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(60, 3, 3))
    mesh = Mesh.make(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3))
    tree = TriangleTree.of(mesh)
    flat, facet = tree.corners, np.arange(60)
    wrong = 0
    for _ in range(400):
        a, b = 2 * rng.normal(size=(2, 3))
        got = is_blocked(*a, *b, 5, tree.boxes, tree.leaves, LEAF, flat, facet, np.empty(0))
        hit = False
        for k, (p, q, r) in enumerate(flat.reshape(-1, 3, 3)):
            m = np.stack([q - p, r - p, a - b], axis=1)
            u, v, s = np.linalg.solve(m, a - p)
            hit |= k != 5 and u >= 0 and v >= 0 and u + v <= 1 and 0 < s < 1
        wrong += got != hit
    assert wrong == 0
    # Lambert's sum against many rays over the hemisphere.
    n, x = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    tri = np.array([[1.0, 0.2, -0.5], [-0.3, 1.0, 0.8], [0.2, -0.4, 1.2]])
    phi, r = 2 * np.pi * rng.uniform(size=400_000), np.sqrt(rng.uniform(size=400_000))
    d = np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r**2)], axis=1)
    inverse = np.linalg.inv(tri.T)
    part = ((d @ inverse.T) >= 0).all(axis=1).mean()
    def factor(corner):
        return triangle_factor(x, n, corner.ravel(), 1.0, np.empty((5, 3)))

    faces = tri if np.linalg.det(tri) < 0 else tri[::-1]
    assert factor(faces) == pytest.approx(part, abs=0.003)
    assert factor(faces[::-1]) == 0.0
    assert factor(faces - [0, 0, 3.0]) == factor((faces - [0, 0, 3.0])[::-1]) == 0.0


def test_light_thrown_on_is_taken_off_again():
    mesh = corner()
    factors = form_factors(mesh, facets=800)
    own = 1 + 0.5 * np.sin(5 * mesh.vertices @ [1.0, 0.7, 0.4])
    light, bounces = add_self_illumination(own, factors, 0.6)
    assert bounces > 3
    got = remove_self_illumination(NodeField.make(light, 0.01), factors, 0.6, reflectivity_sigma=0.05)
    np.testing.assert_allclose(got.field.value, own, rtol=1e-8)
    assert got.largest == pytest.approx(((light - own) / light).max())
    assert got.node == ((light - own) / light).argmax()
    assert mesh.vertices[got.node, [0, 2]].min() < 0.3
    assert "at most" in str(got)
    wrong = remove_self_illumination(NodeField.make(light), factors, 0.65).field.value
    shift = got.field.modes[:, got.field.names.index("self-illumination")]
    np.testing.assert_allclose(wrong - got.field.value, shift, atol=1e-12)


def test_two_parallel_walls_have_the_geometric_series():
    """Every facet sees the same all round: inside of a closed box I = E / (1 - rho)."""
    mesh = box(7)
    mesh = Mesh.make(mesh.vertices, mesh.triangles[:, ::-1].copy())
    light, _ = add_self_illumination(np.ones(len(mesh.vertices)), form_factors(mesh, facets=600), 0.5)
    middle = (np.abs(mesh.vertices) < 0.99).sum(axis=1) == 2
    np.testing.assert_allclose(light[middle], 2.0, rtol=0.03)


def test_unseen_surface_is_told_and_wrong_use():
    mesh = corner(9)
    factors = form_factors(mesh, facets=128)
    light = np.ones(len(mesh.vertices))
    light[81:] = np.nan
    got = remove_self_illumination(NodeField.make(light), factors, 0.5)
    assert 0.4 < got.guessed < 0.6
    assert np.isnan(got.field.value[81:]).all()
    assert "was not seen" in str(got)
    with pytest.raises(DataError, match="no node has a light"):
        remove_self_illumination(NodeField.make(np.full(162, np.nan)), factors, 0.5)
    with pytest.raises(UsageError, match="reflectivity must be"):
        remove_self_illumination(NodeField.make(np.ones(162)), factors, 1.0)
    with pytest.raises(UsageError, match="at least one facet"):
        form_factors(mesh, facets=0)
