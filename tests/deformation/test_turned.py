"""Normals go along with the surface as the laws turn it."""

import numpy as np

from windmark.deformation import Volume, Volumes, law
from windmark.deformation.turned import rotated, turns


@law(angle="deg")
def hinge(X, angle):
    """Of a plane's points; what is beside the plane is not turned with it."""
    a = np.radians(angle)
    return np.c_[X[:, 0], X[:, 1] * np.cos(a), X[:, 2] - X[:, 1] * np.sin(a)]


def test_the_normals_of_a_flap_turn_with_it_and_those_of_no_law_or_unknown_ones_stay():
    xyz = np.array([[0.0, 10.0, 0.0], [5.0, 30.0, 0.0], [-9.0, 20.0, 0.0], [3.0, 15.0, 0.0]])
    normal = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [np.nan] * 3])
    volumes = Volumes.of([Volume("body"), Volume("flap", hinge, parent="body")])
    placed = volumes.bind(xyz, ["flap", "flap", "body", "flap"])
    turned = turns(placed, np.array([30.0]), normal)
    there = rotated(turned, normal)
    assert np.allclose(there[:2], [0.0, -0.5, -np.cos(np.radians(30.0))], atol=1e-6)
    assert np.allclose(there[2], normal[2])
    assert np.isnan(there[3]).all()
    form = np.tile(np.diag([0.1, 0.0, 0.0]), (4, 1, 1))
    assert np.allclose(rotated(turned, form)[0], form[0], atol=1e-6)  # about the hinge's own axis
