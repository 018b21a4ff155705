"""Markers in the air beside a grid, its mirror image, and bodies that bear no marker."""

import numpy as np
import pytest

from windmark.pipeline.verdict.grid import grid_findings, grid_notes
from windmark.scene import MarkerSet, Mesh, structured_triangles

BODY, POD = ([0, 0, 0], [300, 90, 60]), ([40, 150, 90], [90, 35, 22])
AROUND = 29


def unit(lon, lat):
    return np.stack([np.cos(lat), np.sin(lat) * np.cos(lon), np.sin(lat) * np.sin(lon)], axis=-1)


def grid(*bodies, flip=(1, 1, 1)):
    """Ellipsoids of a middle and half axes, one volume each; ``flip`` changes signs of coordinates."""
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, AROUND), np.linspace(0, np.pi, AROUND))
    ball = unit(lon, lat).reshape(-1, 3)
    vertices = np.concatenate([np.array(middle) + np.array(half) * ball for middle, half in bodies])
    one = structured_triangles(AROUND, AROUND, reverse=True)
    triangles = np.concatenate([one + n * len(ball) for n in range(len(bodies))])
    triangles = triangles if np.prod(flip) > 0 else triangles[:, ::-1]
    names = np.repeat([f"part{n + 1}" for n in range(len(bodies))], len(one))
    return Mesh.make(vertices * np.array(flip), triangles, names)


def table(*counts_and_bodies):
    """So many markers on each of these bodies, with normals."""
    rng, xyz, normals = np.random.default_rng(4), [], []
    for count, (middle, half) in counts_and_bodies:
        on = rng.normal(size=(count, 3))
        on /= np.linalg.norm(on, axis=1, keepdims=True)
        xyz.append(np.array(middle) + np.array(half) * on)
        normals.append(on / half / np.linalg.norm(on / half, axis=1, keepdims=True))
    places = np.concatenate(xyz)
    return MarkerSet.make([f"M{n}" for n in range(len(places))], places, normal=np.concatenate(normals), radius=3.0)


MARKERS = table((40, BODY), (8, POD))


@pytest.mark.parametrize(("flip", "axis"), [((1, -1, 1), "y"), ((1, 1, -1), "z")])
def test_a_grid_that_is_mirrored_beside_its_markers_is_told(flip, axis):
    """The body is its own mirror image; only the markers of the pod hang in the air."""
    found = grid_findings(MARKERS, grid(BODY, POD, flip=flip), "mm")
    assert [(f.word, f.cause) for f in found] == [("doubtful", "grid")]
    assert found[0].reason.startswith("8 of 48 markers are up to ")
    assert f"mirrored about {axis} = 0 mm it goes through all markers" in found[0].reason


def test_the_right_grid_is_neither_doubted_nor_spoken_of():
    mesh = grid(BODY, POD)
    assert grid_findings(MARKERS, mesh, "mm") == []
    assert grid_notes(MARKERS, mesh, "mm") == []


def test_markers_on_a_part_that_the_grid_has_not_are_said_and_not_doubted():
    mesh = grid(BODY)
    assert grid_findings(MARKERS, mesh, "mm") == []
    (said,) = grid_notes(MARKERS, mesh, "mm")
    assert said.startswith("8 of 48 markers are up to ")
    assert "a part that the grid has not" in said


def test_the_grid_of_one_half_is_not_the_mirror_image_of_the_other_half():
    """Markers on both pods of a model whose grid has one of them: mirrored it would lose those that it has."""
    other = (POD[0] * np.array([1, -1, 1]), POD[1])
    markers, mesh = table((40, BODY), (8, other), (4, POD)), grid(BODY, POD)
    assert grid_findings(markers, mesh, "mm") == []
    assert [said[:27] for said in grid_notes(markers, mesh, "mm")] == ["8 of 52 markers are up to 1"]


def test_a_body_that_symmetry_added_to_the_grid_is_doubted_where_a_picture_shows_it():
    copy = (POD[0] * np.array([1, -1, 1]), POD[1])
    mesh = grid(BODY, POD, copy)
    (found,) = grid_findings(MARKERS, mesh, "mm")
    assert found.word == "doubtful"
    assert found.reason.startswith("part3 bears no marker and is the mirror image of part2, which bears some, about y ")
    unseen = np.ones(len(mesh.vertices), bool)
    unseen[-AROUND * AROUND :] = False
    assert grid_findings(MARKERS, mesh, "mm", unseen) == []
    both = table((40, BODY), (8, POD), (1, copy))
    assert grid_findings(both, mesh, "mm") == grid_notes(both, mesh, "mm") == []


def test_a_body_without_markers_is_said_unless_it_touches_one_that_has_some():
    alone, wing = ([0, -200, 0], [60, 20, 20]), ([0, -120, 0], [60, 60, 10])
    (said,) = grid_notes(MARKERS, grid(BODY, POD, alone), "mm")
    assert "part3; that it is there is taken from the grid" in said
    assert grid_findings(MARKERS, grid(BODY, POD, alone), "mm") == []
    assert grid_notes(MARKERS, grid(BODY, POD, wing), "mm") == []
