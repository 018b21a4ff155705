"""Loads of sections: of what cameras show, with the error of what they do not; none where nothing was seen."""

import numpy as np
import pytest

from windmark.paint import LoadReference, NodeField, span_loading
from windmark.resection import section
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp import SectionWanted, section_loads
from windmark.tasks.psp.cuts import part_words

AXES = LoadReference(1, 1, 1)
ACROSS = SectionWanted("across", (0, 0.3, 0), (0, 1, 0))


def box(n=41, size=40.0):
    """Two sides of a thin wing, and which nodes are of the upper one."""
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    top = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    t = structured_triangles(n, n)
    mesh = Mesh.make(np.concatenate([top, top - [0, 0, 1e-3]]), np.concatenate([t, t[:, ::-1] + n * n]), "wing")
    return mesh, np.arange(2 * n * n) < n * n


def loads_of(mesh, cp, wanted=ACROSS, seen=None):
    (one,) = section_loads(mesh, cp, [wanted], AXES, seen=seen)
    return one


def test_a_section_without_a_value_has_no_loads_and_says_why():
    """Zeros at p_inf, with no sigma, looked like loads: of a part that no camera shows, of a side without a Cp."""
    mesh, top = box()
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    cp = NodeField.make(np.where(top & (y > 5), -0.4, np.nan), 0.01)
    nothing = loads_of(mesh, cp)
    assert nothing.why == "no camera shows any of it"
    assert nothing.shown == 0
    # Cameras look at the aft quarter of it, and nothing there came to a pressure.
    aft = loads_of(mesh, cp, seen=top & ((y > 5) | (x > 10)))
    assert "% of its length, and nothing of that has a Cp" in aft.why
    for one in (nothing, aft):
        assert np.isnan(one.loads.value).all()
        assert np.isnan(one.loads.sigma).all()


def test_a_section_of_which_much_has_no_value_has_no_loads_whatever_part_of_it_is_shown():
    mesh, top = box()
    x = mesh.vertices[:, 0]
    hole = NodeField.make(np.where(top & (np.abs(x) > 6), -0.4, np.nan), 0.01)
    one = loads_of(mesh, hole, seen=top)
    assert "cameras look at 50 % of its length, and 6" in one.why
    assert np.isnan(one.loads.value).all()


def test_what_cp_is_taken_to_go_on_over_is_in_sigma_as_it_is_in_the_loads_of_volumes():
    """Cp that rises towards an edge of which the last cells are not seen."""
    mesh, top = box()
    x = mesh.vertices[:, 0]
    true = np.where(top, -0.02 * x, 0.0)
    cp = NodeField.make(np.where(top & (x > -16.5), true, np.nan), 0.001)
    one = loads_of(mesh, cp, seen=top)
    assert one.why == ""
    whole = span_loading(mesh, NodeField.make(true), [section(mesh, ACROSS.point, ACROSS.normal)], ACROSS.normal, AXES)
    off = abs(one.loads.value - whole.value)[0, 0]
    assert off > 0.003
    assert 0.5 * off < one.loads.sigma[0, 0] < 2 * off
    assert one.loads.causes["unseen wing"][0] == pytest.approx(one.loads.sigma[0, 0] ** 2, rel=0.05)
    assert one.loads.cov[0, 0] == pytest.approx(one.loads.sigma[0, 0] ** 2)


def test_a_section_that_is_seen_whole_is_as_it_was():
    mesh, _ = box()
    cp = NodeField.make(-0.01 * mesh.vertices[:, 0], 0.01)
    one = loads_of(mesh, cp)
    alone = span_loading(mesh, cp, [section(mesh, ACROSS.point, ACROSS.normal)], ACROSS.normal, AXES)
    assert (one.loads.value == alone.value).all()
    assert (one.loads.sigma == alone.sigma).all()
    assert one.shown == 1
    assert part_words([one]) == []


def test_how_much_of_a_section_cameras_show_is_said():
    mesh, top = box()
    one = loads_of(mesh, NodeField.make(np.where(top, -0.4, np.nan), 0.01))
    (words,) = part_words([one])
    assert "that cameras show, 50 to 50 %" in words
