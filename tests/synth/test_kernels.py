"""The renderer's kernels against slow, readable twins."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from windmark.synth._kernels import box_share, cast, interpolate, lattice_noise, slab_share
from windmark.synth.screen import sample_offsets


def moller_trumbore(vertices, triangles, direction):
    """Nearest triangle along a ray from the origin, by trying them all: (index or -1, distance)."""
    a = vertices[triangles[:, 0]]
    e1, e2 = vertices[triangles[:, 1]] - a, vertices[triangles[:, 2]] - a
    p = np.cross(direction, e2)
    det = np.einsum("tk,tk->t", e1, p)
    q = np.cross(-a, e1)
    u, v = np.einsum("tk,tk->t", -a, p) / det, q @ direction / det
    t = np.einsum("tk,tk->t", e2, q) / det
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    return (int(np.argmin(t)), t.min()) if np.isfinite(t.min()) else (-1, np.inf)


def test_cast_finds_the_nearest_triangle():
    rng = np.random.default_rng(0)
    vertices = rng.uniform([-2, -2, 2], [2, 2, 8], (90, 3))
    triangles = rng.permutation(90).reshape(30, 3).astype(np.int32)
    height, width, n = 12, 15, 3
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, width), np.linspace(-0.4, 0.4, height))
    ray = np.zeros((height, width, 6))
    ray[..., 0], ray[..., 1] = x, y
    ray[..., 2], ray[..., 5] = 1 / (width - 1), 0.8 / (height - 1)
    slot = np.arange(height * width, dtype=np.int32).reshape(height, width)
    slot[3, 4] = -1
    hit, depth = np.full((slot.size, n * n), -1, np.int32), np.full((slot.size, n * n), np.inf)
    boxes = np.tile(np.array([0, width - 1, 0, height - 1], np.int32), (len(triangles), 1))
    boxes[7] = [5, 3, 0, 2]  # an empty box: never hit
    dx, dy = sample_offsets(n)
    cast(vertices, triangles, boxes, slot, ray, dx, dy, hit, depth)
    assert 0.3 < (hit >= 0).mean() < 1
    keep = np.delete(np.arange(len(triangles)), 7)
    for row, column, k in itertools.product(range(height), range(width), range(n * n)):
        s = row * width + column
        if (row, column) == (3, 4):
            assert hit[s, k] == -1
            continue
        u = x[row, column] + dx[k] / (width - 1)
        v = y[row, column] + dy[k] * 0.8 / (height - 1)
        expected, z = moller_trumbore(vertices, triangles[keep], np.array([u, v, 1.0]))
        assert hit[s, k] == (keep[expected] if expected >= 0 else -1)
        assert depth[s, k] == pytest.approx(z, rel=1e-9)


def test_cast_lets_no_ray_through_shared_edges():
    """Rays aimed exactly at the edges and nodes of a fan of triangles all hit something."""
    rng = np.random.default_rng(1)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 25))
    rim = np.column_stack([np.cos(angle), np.sin(angle), rng.uniform(3, 5, 25)])
    vertices = np.vstack([[[0.01, -0.02, 4.0]], rim])
    triangles = np.array([[0, k + 1, (k + 1) % 25 + 1] for k in range(25)], np.int32)
    f = rng.uniform(0, 0.999, (25, 40, 1))
    points = (vertices[0] * (1 - f) + vertices[1:, None] * f).reshape(-1, 3)
    ray = np.zeros((1, len(points), 6))
    ray[0, :, :2] = points[:, :2] / points[:, 2:]
    hit, depth = np.full((len(points), 1), -1, np.int32), np.full((len(points), 1), np.inf)
    boxes = np.tile(np.array([0, len(points) - 1, 0, 0], np.int32), (25, 1))
    cast(vertices, triangles, boxes, np.arange(len(points), dtype=np.int32)[None], ray, *sample_offsets(1), hit, depth)
    assert (hit >= 0).all()
    np.testing.assert_allclose(depth[:, 0], points[:, 2], rtol=1e-9)


def test_interpolate_is_linear_on_the_triangle():
    rng = np.random.default_rng(2)
    vertices = rng.uniform([-1, -1, 3], [1, 1, 6], (30, 3))
    triangles = np.arange(30, dtype=np.int32).reshape(10, 3)
    hit = rng.integers(0, 10, 50).astype(np.int32)
    w = rng.dirichlet(np.ones(3), 50)
    points = np.einsum("sk,skd->sd", w, vertices[triangles[hit]])
    fields = rng.standard_normal((30, 6))
    out = np.empty((2, 50, 3))
    interpolate(vertices, triangles, hit, points[:, :2] / points[:, 2:], fields, np.array([False, True]), out)
    first, second = np.split(np.einsum("sk,skf->sf", w, fields[triangles[hit]]), 2, axis=1)
    np.testing.assert_allclose(out[0], first, atol=1e-9)
    np.testing.assert_allclose(out[1], second / np.linalg.norm(second, axis=1, keepdims=True), atol=1e-7)


def test_box_share_is_the_area_of_the_cut_square():
    n = 400
    c = (np.arange(n) + 0.5) / n - 0.5
    x, y = np.meshgrid(c, c)
    rng = np.random.default_rng(3)
    for angle, distance in zip(rng.uniform(0, 2 * np.pi, 60), rng.uniform(-0.8, 0.8, 60), strict=True):
        gx, gy = np.cos(angle), np.sin(angle)
        inside = (gx * x + gy * y <= distance).mean()
        assert box_share(distance, gx, gy) == pytest.approx(inside, abs=3e-3)
    assert box_share(0.2, 1.0, 0.0) == pytest.approx(0.7)
    assert box_share(-0.2, 0.0, -1.0) == pytest.approx(0.3)


def test_slab_share_of_thin_strokes():
    """A stroke of width 0.2 across a unit square covers a fifth of it, wherever it lies inside."""
    for distance in (0.0, 0.1, 0.3):
        assert slab_share(0.1 - distance, 0.1 + distance, 1.0, 1.0, 0.0) == pytest.approx(0.2)
    assert slab_share(0.1 - 0.7, 0.1 + 0.7, 1.0, 1.0, 0.0) == 0.0
    assert slab_share(3.0, 5.0, 1.0, 0.6, 0.8) == 1.0


def test_lattice_noise_twin():
    rng = np.random.default_rng(4)
    table = rng.standard_normal((8, 8, 8))
    points = rng.uniform(-30, 30, (40, 3))
    got = lattice_noise(points, table, 0.5)
    for p, value in zip(points * 0.5, got, strict=True):
        base = np.floor(p).astype(int)
        f = p - base
        f = f * f * (3 - 2 * f)
        total = sum(
            np.prod([f[a] if corner[a] else 1 - f[a] for a in range(3)]) * table[tuple((base + corner) % 8)]
            for corner in itertools.product((0, 1), repeat=3)
        )
        assert value == pytest.approx(total, abs=1e-12)


@pytest.mark.parametrize("n", [1, 2, 5, 11, 16])
def test_samples_stay_in_their_cells_and_never_repeat(n):
    dx, dy = sample_offsets(n)
    k = np.arange(n * n)
    assert (np.floor((dx + 0.5) * n + 1e-12) == k % n).all()
    assert (np.floor((dy + 0.5) * n + 1e-12) == k // n).all()
    assert len(np.unique(dx.round(12))) == len(np.unique(dy.round(12))) == n * n
    assert abs(dx.mean()) < 1e-12
    assert abs(dy.mean()) < 1e-12
