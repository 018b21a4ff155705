"""Sections against closed forms and the whole surface, sigma by draws. Cuts as `windmark.section` gives them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.errors import DataError
from windmark.paint import LoadReference, NodeField, integrate_loads, section_profile, span_loading
from windmark.resection import section
from windmark.scene import Mesh
from windmark.scene.doubled import part_of

sys.path.insert(0, str(Path(__file__).parent))
from paint_shapes import box, sphere

UNIT = LoadReference(1.0, 1.0, 1.0)


def cylinder(n=120, m=21, radius=1.0, span=4.0):
    """A circular cylinder along y, open at its ends, normals outward."""
    from windmark.scene import Mesh, structured_triangles

    a, y = np.meshgrid(np.linspace(0, 2 * np.pi, n + 1), np.linspace(-0.5, 0.5, m) * span)
    xyz = np.stack([radius * np.cos(a), y, radius * np.sin(a)], axis=-1).reshape(-1, 3)
    return Mesh.make(xyz, structured_triangles(n + 1, m, reverse=True))


def test_a_cylinder_in_potential_flow_with_circulation():
    """Cp = 1 - (2 sin t + g)^2 has the lift 4 pi g R per span (Kutta and Joukowski) and no drag: cn = 2 pi g."""
    mesh = cylinder()
    assert ((mesh.triangle_normals() * mesh.vertices[mesh.triangles[:, 0]])[:, [0, 2]].sum(axis=1) > 0).all()
    t = np.arctan2(mesh.vertices[:, 2], mesh.vertices[:, 0])
    g = 0.4
    cp = NodeField.make(1 - (2 * np.sin(t) + g) ** 2, 0.02)
    cuts = [section(mesh, [0, y, 0], [0, 1, 0]) for y in (-1.03, 0.0, 1.2)]
    got = span_loading(mesh, cp, cuts, [0, 1, 0], UNIT)
    np.testing.assert_allclose(got.value[:, 0], 2 * np.pi * g, rtol=2e-3)
    np.testing.assert_allclose(got.value[:, 1], 0, atol=2e-3)
    # All forces go through the axis, a quarter of the chord behind the point that the moment is about.
    np.testing.assert_allclose(got.value[:, 2], -0.5 * np.pi * g, rtol=4e-3)
    np.testing.assert_allclose(got.station, [-1.03, 0.0, 1.2])
    np.testing.assert_allclose(got.chord, 2.0, rtol=1e-3)
    profile = section_profile(mesh, cp, cuts[1], UNIT)
    np.testing.assert_allclose(profile.x_c, 0.5 + 0.5 * profile.xyz[:, 0], atol=1e-3)
    off = np.abs(profile.xyz[:, 2]) > 0.05
    assert (profile.upper == (profile.xyz[:, 2] > 0))[off].all()


def test_sections_add_up_to_the_whole():
    mesh = cylinder()
    cp = NodeField.make(0.3 * mesh.vertices[:, 2] * (1 + mesh.vertices[:, 1]))
    y = np.linspace(-2, 2, 41)[1:-1]
    got = span_loading(mesh, cp, [section(mesh, [0, v, 0], [0, 1, 0]) for v in y], [0, 1, 0], UNIT)
    each = got.value[:, 0] * got.chord
    whole = np.trapezoid(np.interp(np.linspace(-2, 2, 401), y, each), np.linspace(-2, 2, 401))
    assert whole == pytest.approx(integrate_loads(mesh, cp, UNIT).row("model")["CN"][0], rel=0.01)


def test_sigma_of_sections_is_that_of_draws_and_a_mode_ties_them():
    mesh = sphere(60)
    rng = np.random.default_rng(0)
    cp = NodeField.make(mesh.vertices[:, 2], 0.05).with_mode("temperature", 0.02 * (1 + mesh.vertices[:, 2]))
    cuts = [section(mesh, [0, v, 0], [0, 1, 0]) for v in (-0.4, 0.1)]
    got = span_loading(mesh, cp, cuts, [0, 1, 0], UNIT)
    seen = []
    for _ in range(200):
        e = 0.05 * rng.normal(size=len(cp)) + cp.modes[:, 0] * rng.normal()
        seen.append(span_loading(mesh, NodeField.make(cp.value + e), cuts, [0, 1, 0], UNIT).value.ravel())
    scale = np.sqrt(np.diag(got.cov))
    scale = np.outer(scale, scale)
    np.testing.assert_allclose(np.cov(np.array(seen).T) / scale, got.cov / scale, atol=0.3)
    assert got.causes["temperature"][0] > 0.05 * got.cov[0, 0]
    assert abs(got.cov[0, 3]) > 0.05 * got.cov[0, 0]


def test_what_was_not_seen_of_a_section():
    mesh = sphere(60)
    true = mesh.vertices[:, 2].copy()
    some = np.where((mesh.vertices[:, 0] > 0.95), np.nan, true)
    much = np.where((mesh.vertices[:, 0] > 0.2), np.nan, true)
    cuts = [section(mesh, [0, 0.01, 0], [0, 1, 0])]
    whole = span_loading(mesh, NodeField.make(true, 0.01), cuts, [0, 1, 0], UNIT)
    part = span_loading(mesh, NodeField.make(some, 0.01), cuts, [0, 1, 0], UNIT, most_unseen=0.15)
    assert 0.05 < part.unseen[0] < 0.15
    assert part.value[0, 0] == pytest.approx(whole.value[0, 0], rel=0.01)
    none = span_loading(mesh, NodeField.make(much, 0.01), cuts, [0, 1, 0], UNIT)
    assert np.isnan(none.value).all()
    assert "of the cut was not seen; no loads" in none.warnings[0]


def test_cuts_that_are_none():
    mesh = box(5)
    with pytest.raises(DataError, match="does not meet the grid"):
        section_profile(mesh, NodeField.make(np.ones(len(mesh.vertices))), section(mesh, [0, 9, 0], [0, 1, 0]), UNIT)
    with pytest.raises(DataError, match="cross-section"):
        section_profile(mesh, NodeField.make(np.ones(len(mesh.vertices))), section(mesh, [0.3, 0, 0], [1, 0, 0]), UNIT)


def test_a_section_of_a_surface_that_is_there_twice_is_refused():
    """The same zone again would make each section's force twice as large, and no sigma would show it."""
    once = cylinder()
    count = len(once.vertices)
    volume = np.repeat(["wing", "again"], len(once.triangles))
    mesh = Mesh.make(np.tile(once.vertices, (2, 1)), np.concatenate([once.triangles, once.triangles + count]), volume)
    cp, cut = NodeField.make(mesh.vertices[:, 2]), section(mesh, [0, 0.1, 0], [0, 1, 0])
    for made in (lambda: section_profile(mesh, cp, cut, UNIT), lambda: span_loading(mesh, cp, [cut], [0, 1, 0], UNIT)):
        with pytest.raises(DataError, match="wing lies upon again: 50 % of the cut's length is in the grid twice"):
            made()
    alone = part_of(mesh, mesh.volume == "wing")
    got = span_loading(alone, cp, [section(alone, [0, 0.1, 0], [0, 1, 0])], [0, 1, 0], UNIT)
    assert got.value[0, 0] == pytest.approx(span_loading(
        once, NodeField.make(once.vertices[:, 2]), [section(once, [0, 0.1, 0], [0, 1, 0])], [0, 1, 0], UNIT
    ).value[0, 0])  # fmt: skip
