"""The hinge: its line stays, all else turns about it."""

import numpy as np

from windmark.deformation.laws import Hinge


def test_a_hinge_leaves_its_line_where_it_is_and_turns_by_the_right_hand_rule():
    """A line that does not go through the origin, along z: x turns towards y."""
    hinge = Hinge((3.0, 4.0, 5.0), (3.0, 4.0, 25.0))
    along = np.array([[3.0, 4.0, z] for z in (-7.0, 5.0, 15.0)])
    np.testing.assert_allclose(hinge.bind(along).place(np.array([37.0])), along, atol=1e-12)
    aside = hinge.bind(along + np.array([2.0, 0, 0])).place(np.array([90.0]))
    np.testing.assert_allclose(aside, along + np.array([0, 2.0, 0]), atol=1e-12)
