from __future__ import annotations

import numpy as np
import pytest

from windmark.synth import rows_layout


@pytest.fixture(scope="module")
def markers(half_model):
    return rows_layout(half_model, half_model.patches(), np.random.default_rng(1))


def test_names_volumes_roles_and_radii(markers):
    assert len(markers) == 45
    letters = np.array([n[0] for n in markers.name])
    assert [(letters == c).sum() for c in "WBT"] == [28, 6, 11]
    for letter, volume, role, radius in (
        ("W", "wing", "model", 2.5),
        ("B", "body", "model", 2.5),
        ("T", "wall", "wall", 4),
    ):
        of = letters == letter
        assert (markers.volume[of] == volume).all()
        assert (markers.role[of] == role).all()
        assert (markers.radius[of] == radius).all()
    np.testing.assert_allclose(np.linalg.norm(markers.normal, axis=1), 1, atol=1e-12)


def test_no_marker_is_on_two_volumes(half_model, markers):
    """No vertex of another volume comes nearer than a disc's radius and a cell, and discs do not touch."""
    mesh = half_model.mesh()
    for volume in ("wing", "body", "wall"):
        nodes = mesh.vertices[np.unique(mesh.triangles[mesh.volume == volume])]
        own = markers.volume == volume
        nearest = np.array([np.linalg.norm(nodes - p, axis=1).min() for p in markers.xyz])
        assert (nearest[own] < 20).all()
        assert (nearest[~own] > 10).all()
    gap = np.linalg.norm(markers.xyz[:, None] - markers.xyz, axis=-1) + 1e9 * np.eye(len(markers))
    same_side = markers.normal @ markers.normal.T > 0  # not the two sides of the wing
    assert gap[same_side].min() > 4 * markers.radius.max()


def test_some_are_below(markers):
    assert (markers.normal[:, 2] < -0.5).sum() >= 5


def test_same_seed_same_layout_and_jitter_does_something(half_model, markers):
    patches = half_model.patches()
    again = rows_layout(half_model, patches, np.random.default_rng(1))
    assert again.xyz.tobytes() == markers.xyz.tobytes()
    other = rows_layout(half_model, patches, np.random.default_rng(2))
    shift = np.linalg.norm(other.xyz - markers.xyz, axis=1)[:24]
    assert 2 < np.median(shift) < 20
    regular = rows_layout(half_model, patches, np.random.default_rng(2), jitter=0.0)
    y = regular.xyz[:24, 1].reshape(6, 4)
    assert np.ptp(y, axis=1).max() < 0.5  # twist moves them a little


def test_counts_can_be_chosen(half_model):
    m = rows_layout(half_model, half_model.patches(), np.random.default_rng(0), upper=(3, 5), lower=(0, 0), body=0,
                    floor=(0, 0), side=0)  # fmt: skip
    assert len(m) == 15
    assert (m.volume == "wing").all()
