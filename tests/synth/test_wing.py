from __future__ import annotations

import numpy as np
import pytest

from windmark.synth import HalfModel, Patch, assemble


def test_every_triangle_faces_outward(half_model):
    """The triangle's normal agrees with the smooth surface's at the middle of its cell, in every block."""
    for patch in half_model.patches(6000).values():
        mesh = assemble([patch])
        s, t = np.meshgrid(np.linspace(0, 1, patch.ni)[:-1] + 0.5 / (patch.ni - 1),
                           np.linspace(0, 1, patch.nj)[:-1] + 0.5 / (patch.nj - 1))  # fmt: skip
        smooth = patch.normal(s.ravel(), t.ravel())
        flat = mesh.triangle_normals()
        assert (np.linalg.norm(flat, axis=1) > 0).all(), patch.name
        cells = len(smooth)
        assert (np.einsum("nk,nk->n", flat[:cells], smooth) > 0).all(), patch.name
        assert (np.einsum("nk,nk->n", flat[cells:], smooth) > 0).all(), patch.name


def test_outward_is_away_from_the_axis(half_model):
    patches = half_model.patches()
    s, t = np.full(5, 0.45), np.linspace(0.1, 0.9, 5)
    xyz, normal = patches["body"].place(s, t)
    assert np.abs(normal[:, 0]).max() < 1e-12  # the cylindrical part
    radial = xyz[:, 1:] / np.linalg.norm(xyz[:, 1:], axis=1, keepdims=True)
    np.testing.assert_allclose((normal[:, 1:] * radial).sum(axis=1), 1.0, atol=1e-3)
    assert (patches["wing_upper"].normal([0.5], [0.5])[:, 2] > 0.9).all()
    assert (patches["wing_lower"].normal([0.5], [0.5])[:, 2] < -0.9).all()
    assert (patches["wing_tip"].normal([0.5], [0.5])[:, 1] > 0.9).all()
    np.testing.assert_allclose(patches["floor"].normal([0.3], [0.3]), [[0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(patches["side"].normal([0.3], [0.3]), [[0, 1, 0]], atol=1e-12)


def test_section_is_naca(half_model):
    """Thickness 11 % of the chord near 30 % of it, closed at both ends; chord, sweep and washout as asked."""
    s = np.linspace(0, 1, 2001)
    y = 0.3
    upper, lower = (half_model.wing_surface(s, np.full_like(s, y), side) for side in (1.0, -1.0))
    chord = half_model.chord(upper[0, 1])
    thickness = np.linalg.norm(upper - lower, axis=1) / chord
    assert thickness.max() == pytest.approx(0.11, abs=2e-4)
    assert 0.27 < (0.5 * (1 - np.cos(np.pi * s)))[thickness.argmax()] < 0.33
    assert thickness[0] < 1e-12
    assert thickness[-1] < 1e-12
    assert np.linalg.norm(upper[-1] - upper[0]) == pytest.approx(chord, rel=1e-3)
    plain = HalfModel(twist_deg=0.0)
    tip = plain.wing_surface(np.array([0.0]), np.array([1.0]), 1.0)[0]
    np.testing.assert_allclose(tip[:2], [600 * np.tan(np.radians(28)), 600], atol=1e-9)
    ends = half_model.wing_surface(np.array([0.0, 1.0]), np.array([1.0, 1.0]), 1.0)
    assert np.degrees(np.arctan2(ends[1, 2] - ends[0, 2], ends[1, 0] - ends[0, 0])) == pytest.approx(3.0, abs=1e-6)


def test_tip_closes_the_wing(half_model):
    s = np.linspace(0, 1, 51)
    one = np.ones_like(s)
    np.testing.assert_allclose(half_model.tip_surface(s, 0 * s), half_model.wing_surface(s, one, 1.0), atol=0.02)
    np.testing.assert_allclose(half_model.tip_surface(s, one), half_model.wing_surface(s, one, -1.0), atol=0.02)


def test_planform_inverts_the_wing():
    plain = HalfModel(twist_deg=0.0, camber=0.0)
    s, t = np.meshgrid(np.linspace(0.05, 0.95, 9), np.linspace(0, 1, 5))
    xc, eta = plain.planform(plain.wing_surface(s, t, 1.0))
    np.testing.assert_allclose(xc, 0.5 * (1 - np.cos(np.pi * s)), atol=1e-9)
    np.testing.assert_allclose(eta, (plain.wing_root + t * (600 - plain.wing_root)) / 600, atol=1e-12)


@pytest.mark.parametrize("nodes", [2000, 60_000])
def test_density_is_what_was_asked(half_model, nodes):
    mesh = half_model.mesh(nodes)
    assert 0.8 * nodes < len(mesh.vertices) < 1.25 * nodes
    assert [b.name for b in mesh.blocks] == ["wing_upper", "wing_lower", "wing_tip", "body", "floor", "side"]
    assert sum(b.size for b in mesh.blocks) == len(mesh.vertices)
    assert set(np.unique(mesh.volume)) == {"wing", "body", "wall"}
    assert np.isfinite(mesh.vertex_normals()).all()


def test_place_lies_on_the_flat_triangle(half_model):
    """The placed point is in one of its cell's two triangles: on its plane, and inside."""
    patch = half_model.patches(3000)["wing_upper"]
    mesh = assemble([patch])
    rng = np.random.default_rng(5)
    xyz, normal = patch.place(rng.uniform(0, 1, 40), rng.uniform(0, 1, 40))
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-12)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    n = mesh.triangle_normals()
    for p in xyz:
        w = np.stack([np.einsum("tk,tk->t", np.cross(q - p, r - p), n) for q, r in ((b, c), (c, a), (a, b))])
        inside = (w >= -1e-9 * np.einsum("tk,tk->t", n, n)).all(axis=0)
        height = np.abs(np.einsum("tk,tk->t", p - a, n)) / np.linalg.norm(n, axis=1)
        assert height[inside].min() < 1e-9


def test_normal_is_that_of_the_smooth_surface():
    def ball(s, t):
        return np.stack([np.sin(2 + t) * np.cos(s), np.sin(2 + t) * np.sin(s), np.cos(2 + t)], axis=-1)

    sphere = Patch("ball", "wing", ball, 9, 9, reverse=True)
    s, t = np.array([0.2, 0.7, 1.0]), np.array([0.3, 0.5, 0.9])
    np.testing.assert_allclose(sphere.normal(s, t), sphere.point(s, t), atol=2e-5)
    np.testing.assert_allclose(sphere.normal(s[:2], t[:2]), sphere.point(s[:2], t[:2]), atol=1e-9)


def test_bad_shapes_are_refused(half_model):
    with pytest.raises(ValueError, match="tip_chord"):
        HalfModel(tip_chord=300.0)
    with pytest.raises(ValueError, match="ogive"):
        HalfModel(ogive_nose=800.0)
    with pytest.raises(ValueError, match="nodes"):
        half_model.patches(100)
    with pytest.raises(ValueError, match="ni and nj"):
        Patch("p", "wing", lambda s, t: s, 1, 5)
    with pytest.raises(ValueError, match=r"\[0, 1\]"):
        half_model.patches()["body"].place([1.2], [0.5])
