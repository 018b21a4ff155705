"""What is said of light that the model throws on itself where nobody asked to take it off."""

import sys
from pathlib import Path

import numpy as np

from windmark.paint import form_factors
from windmark.tasks.psp import left_words

sys.path.insert(0, str(Path(__file__).parent.parent / "paint"))
from paint_shapes import corner, sphere


def test_some_nodes_have_the_factors_they_have_among_all():
    mesh = corner(5)
    some = np.array([0, 7, 8, 30, 49])
    whole, part = form_factors(mesh, facets=20), form_factors(mesh, facets=20, nodes=some)
    assert part.matrix.shape == whole.matrix.shape
    assert (part.matrix.toarray()[some] == whole.matrix.toarray()[some]).all()
    assert (np.delete(part.seen, some) == 0).all()


def test_a_corner_is_named_and_what_bulges_is_not():
    (said,) = left_words(corner(15))
    assert "no [self_illumination] is given" in said
    # In the very edge a wall fills half of what the floor has above it, less where the edge ends.
    assert 35 <= float(said.split("at most ")[1].split()[0]) <= 51
    assert left_words(sphere(12)) == []
