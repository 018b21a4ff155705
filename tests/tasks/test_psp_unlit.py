"""Surface without light or paint has no pressure: what light it has others throw on it."""

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp import ModelPicture, Patches, Sampling, ratio_of
from windmark.tasks.psp.unlit import unlit_words

CAMERA = Camera((160, 120), 200.0)
ABOVE = Pose.look_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), [0.0, 1.0, 0.0])


def two_plates():
    """A wing and, beside it, a body: 15 x 15 nodes each, two pixels per unit."""
    n, parts, faces = 15, [], []
    for k, left in enumerate((-36.0, 2.0)):
        x, y = np.meshgrid(np.linspace(left, left + 34, n), np.linspace(-20, 20, n))
        parts.append(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]))
        faces.append(structured_triangles(n, n) + k * n * n)
    triangles = np.concatenate(faces)
    names = np.repeat(["wing", "body"], len(faces[0]))
    return Mesh.make(np.concatenate(parts), triangles, names)


def pictures(light, mesh):
    moves = np.zeros((len(mesh.vertices), 3, 1))
    return [ModelPicture("a", "cam1", light, np.full(light.shape, 1e-4), CAMERA, ABOVE, mesh, moves)]


def shares(body, wing=1000.0):
    """Light of the picture's left half and of its right half."""
    out = np.full((120, 160), wing)
    out[:, 80:] = body
    return out


def test_what_is_not_lit_gets_no_value_and_is_named():
    mesh = two_plates()
    got = ratio_of(pictures(shares(30.0, 800.0), mesh), pictures(shares(30.0), mesh))
    wing, body = np.split(np.arange(len(mesh.vertices)), 2)
    assert np.isfinite(got.ratio.value[wing]).sum() > 100
    assert not np.isfinite(got.ratio.value[body]).any()
    assert got.unlit[body].sum() > 100
    assert not got.unlit[wing].any()
    (said,) = unlit_words(mesh, got.unlit, got.ratio.known)
    assert said.startswith("100 % of body that cameras show has next to none of the bright parts' light")


def test_dim_paint_has_values_and_markers_are_not_meant():
    mesh = two_plates()
    got = ratio_of(pictures(shares(60.0), mesh), pictures(shares(60.0), mesh))
    assert not got.unlit.any()
    assert unlit_words(mesh, got.unlit, got.ratio.known) == []
    light = shares(1000.0)
    light[55:66, 30:41] = 5.0  # a marker on the wing
    centre = ABOVE.inverse().apply(np.array([[(35 - 79.5) / 2, (60 - 59.5) / 2, 100.0]]))
    disc = Patches(mesh, np.atleast_2d(centre) * [1, 1, 0], np.array([4.5]), np.array([[0.0, 0.0, 1.0]]))
    for how in (Sampling(), Sampling(patches=disc)):
        dark = ratio_of(pictures(light, mesh), pictures(light, mesh), how=how).unlit
        assert dark.any() == (how.patches is None)


def test_a_marker_on_unlit_surface_is_no_hole_in_a_seen_side():
    """It is not called unlit, but its surroundings are: loads of what is lit must not hang on it."""
    mesh = two_plates()
    light = shares(30.0)
    light[55:66, 110:121] = 5.0
    centre = ABOVE.inverse().apply(np.array([[(115 - 79.5) / 2, (60 - 59.5) / 2, 100.0]]))
    disc = Patches(mesh, np.atleast_2d(centre) * [1, 1, 0], np.array([4.5]), np.array([[0.0, 0.0, 1.0]]))
    got = ratio_of(pictures(light, mesh), pictures(light, mesh), how=Sampling(patches=disc))
    body = np.arange(len(mesh.vertices)) >= len(mesh.vertices) // 2
    assert disc.nodes[body].any()
    assert not got.shown[body].any()
    assert (got.shown[~body] == got.ratio.known[~body]).all()


def test_dim_surface_that_goes_over_into_unlit_one_is_part_of_it():
    """In the corner beside a lit wing an unlit body has a tenth of its light: what the wing throws on it."""
    mesh = two_plates()
    light = shares(0.0)
    light[:, 80:] = 20 + 100 * np.exp(-np.arange(80) / 15)
    unlit = ratio_of(pictures(light, mesh), pictures(light, mesh)).unlit
    body = np.arange(len(mesh.vertices)) >= len(mesh.vertices) // 2
    assert unlit[body].sum() > 100
    assert not np.isfinite(ratio_of(pictures(light, mesh), pictures(light, mesh)).ratio.value[body]).any()
    light[:, 80:] = np.maximum(light[:, 80:], 60)  # a lamp grazes it
    assert not ratio_of(pictures(light, mesh), pictures(light, mesh)).unlit.any()
