"""Markers and taps taken out and filled: one that nothing lies round does not cost the others their values."""

import numpy as np

from windmark.paint import NodeField, stranded
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp.patching import patched


def two_plates(n=11):
    """A seen wing and, 0.6 of a pitch beside it, a body of which nothing was seen."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(float(n)), np.arange(float(n))))
    xyz = np.column_stack([np.concatenate([x, x + n - 0.4]), np.concatenate([y, y]), np.zeros(2 * n * n)])
    faces = structured_triangles(n, n)
    mesh = Mesh.make(xyz, np.concatenate([faces, faces + n * n]), np.repeat(["wing", "body"], len(faces)))
    value = np.where(xyz[:, 0] < n - 0.5, 1.0 + 0.01 * xyz[:, 0], np.nan)
    return mesh, NodeField.make(value, 0.01)


def test_a_marker_that_nothing_seen_hangs_together_with_leaves_the_others_filled():
    mesh, field = two_plates()
    centres = np.array([[4.0, 4.0, 0.0], [10.6, 5.0, 0.0]])  # on the wing; on the body, a radius from the wing's rim
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    remarks: list[str] = []
    out, filled = patched(mesh, field, (centres, np.array([0.5, 0.5]), up), (), remarks)
    wing = (np.abs(mesh.vertices - centres[0]).max(axis=1) < 0.1).nonzero()[0]
    body = (np.abs(mesh.vertices - centres[1]).max(axis=1) < 0.1).nonzero()[0]
    assert filled[wing].all()
    np.testing.assert_allclose(out.value[wing], 1.04, atol=1e-3)
    assert not filled[body].any()
    assert np.isnan(out.value[body]).all()
    assert remarks == []


def test_stranded_nodes_are_those_without_a_known_one_round_them():
    mesh, field = two_plates()
    missing = np.zeros(len(mesh.vertices), bool)
    missing[[60, 121 + 60]] = True
    np.testing.assert_array_equal(np.flatnonzero(stranded(mesh, field, missing)), [121 + 60])
    assert not stranded(mesh, field, np.zeros_like(missing)).any()
