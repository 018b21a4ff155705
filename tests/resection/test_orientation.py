"""Turning blocks outward."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.resection import orient_outward
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parent))
from resection_shapes import box, joined, plate, sphere


def flipped(mesh, which):
    t = mesh.triangles.copy()
    t[which] = t[which][:, [0, 2, 1]]
    return Mesh.make(mesh.vertices, t)


def same_orientation(a, b):
    return np.einsum("tk,tk->t", a.triangle_normals(), b.triangle_normals()) >= 0


def test_blocks_of_any_handedness_become_one_outward_body(rng):
    mesh = joined(box(5, half=(1, 2, 3.0)), sphere(20, center=(9.0, 0, 0)))
    for _ in range(5):
        wild = flipped(mesh, rng.random(len(mesh.triangles)) < rng.random())
        got = orient_outward(wild)
        assert same_orientation(got, mesh).all()
        np.testing.assert_array_equal(np.sort(got.triangles), np.sort(mesh.triangles))
        np.testing.assert_array_equal(got.triangles[:, 0], wild.triangles[:, 0])
    assert same_orientation(orient_outward(mesh), mesh).all()


def test_half_model():
    whole = sphere(24)
    middle = whole.vertices[whole.triangles].mean(axis=1)
    half = Mesh.make(whole.vertices, whole.triangles[middle[:, 0] > 0])
    got = orient_outward(flipped(half, np.arange(len(half.triangles)) % 3 > 0))
    assert same_orientation(got, half).all()


def test_flat_plate_keeps_its_majority_or_faces_the_air():
    mesh = plate()
    some = np.arange(len(mesh.triangles)) % 3 == 0
    assert same_orientation(orient_outward(flipped(mesh, some)), mesh).all()
    assert not same_orientation(orient_outward(flipped(mesh, ~some)), mesh).any()
    assert same_orientation(orient_outward(flipped(mesh, ~some), outside=[0, 0, 5.0]), mesh).all()
    assert not same_orientation(orient_outward(mesh, outside=[0, 0, -5.0]), mesh).any()


def test_one_sided_strip_is_left_alone():
    n = 30
    angle = np.linspace(0, 2 * np.pi, n + 1)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    out = np.stack([np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)], axis=1)
    xyz = np.concatenate([rim - 0.2 * out, rim + 0.2 * out])
    k = np.arange(n)
    strip = np.concatenate([np.stack([k, k + 1, k + n + 2], axis=1), np.stack([k, k + n + 2, k + n + 1], axis=1)])
    mesh = Mesh.make(xyz, strip)
    np.testing.assert_array_equal(orient_outward(mesh, outside=[0, 0, 9]).triangles, mesh.triangles)


def test_collapsed_and_empty():
    empty = Mesh.make(np.zeros((0, 3)), [])
    assert orient_outward(empty) is empty
    point = Mesh.make(np.zeros((3, 3)), [[0, 1, 2]])
    np.testing.assert_array_equal(orient_outward(point).triangles, point.triangles)
    with pytest.raises(ValueError, match="outside"):
        orient_outward(plate(), outside=[1, 2])
    with pytest.raises(ValueError, match="tolerance"):
        orient_outward(plate(), tolerance=-1)
