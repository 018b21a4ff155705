"""The grid as a job uses it: volumes by name, orientation."""

from dataclasses import replace

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.grid import oriented, read_grid, sides_words, with_curvature
from windmark.pipeline.job import begin
from windmark.pipeline.lengths import Lengths
from windmark.pipeline.project import make_project
from windmark.pipeline.project_entries import GridEntry
from windmark.pipeline.results import RunResult
from windmark.pipeline.verdict.run import run_verdict
from windmark.scene import MarkerSet, Mesh, structured_triangles


def box(turned=()):
    """A unit cube of 12 triangles, outward; ``turned`` triangles the other way round."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for k in turned:
        triangles[k] = triangles[k][::-1]
    return Mesh.make(corners, triangles)


def is_outward(mesh):
    """Whether every triangle of a box about (0.5, 0.5, 0.5) faces away from its middle."""
    middle = mesh.vertices[mesh.triangles].mean(axis=1) - 0.5
    return bool((np.einsum("tk,tk->t", mesh.triangle_normals(), middle) > 0).all())


@pytest.mark.parametrize("turned", [range(12), [4], [0, 5, 7]])
def test_auto_orientation_mends_what_is_turned(tmp_path, turned):
    io.write_mesh(tmp_path / "box.ply", box(turned))
    assert is_outward(read_grid(GridEntry(file=tmp_path / "box.ply"), Lengths()))
    assert not is_outward(read_grid(GridEntry(file=tmp_path / "box.ply", orientation="file"), Lengths()))


@pytest.mark.slow
def test_zones_become_volumes_and_the_rest_drops_out(virtual_test):
    folder, test = virtual_test
    grid = folder / "model.grid"
    mesh = read_grid(GridEntry(file=grid, volumes={"wing": ("zone01", "zone02"), "body": ("zone04",)}), Lengths())
    assert set(mesh.volume) == {"wing", "body"}
    np.testing.assert_allclose(mesh.vertices, test.mesh.vertices, rtol=1e-6)
    assert len(mesh.triangles) < len(test.mesh.triangles)
    with pytest.raises(io.FileError, match=r"model\.grid.*zone77.*zone01"):
        read_grid(GridEntry(file=grid, volumes={"wing": ("zone77",)}), Lengths())


def test_zones_that_take_no_part_may_hold_anything(virtual_test, tmp_path):
    """NaN in a zone of the far field: refused where the zone takes part, no matter where it does not."""
    test = virtual_test[1]
    vertices = test.mesh.vertices.copy()
    last = test.mesh.blocks[-1]
    vertices[last.first + 3] = np.nan
    io.write_mesh(tmp_path / "far.grid", replace(test.mesh, vertices=vertices))
    with pytest.raises(io.FileError, match=r"zone06: node i=3, j=0, k=0.*expected finite"):
        read_grid(GridEntry(file=tmp_path / "far.grid"), Lengths())
    wing = {"wing": ("zone01", "zone02", "zone03")}
    mesh = read_grid(GridEntry(file=tmp_path / "far.grid", volumes=wing), Lengths())
    whole = read_grid(GridEntry(file=virtual_test[0] / "model.grid", volumes=wing), Lengths())
    np.testing.assert_array_equal(mesh.triangles, whole.triangles)
    assert mesh.diagonal == whole.diagonal > 0
    with pytest.raises(io.FileError, match="expected finite"):
        read_grid(GridEntry(file=tmp_path / "far.grid", volumes={"far": ("zone06",)}), Lengths())


def test_a_zone_with_the_name_of_a_volume_takes_no_part_unless_named(tmp_path):
    mesh = replace(box(), volume=np.array(["wing"] * 6 + ["part"] * 6))
    io.write_mesh(tmp_path / "box.obj", mesh)
    got = read_grid(GridEntry(file=tmp_path / "box.obj", volumes={"wing": ("part",)}), Lengths())
    assert len(got.triangles) == 6
    assert set(got.volume) == {"wing"}


@pytest.mark.parametrize(
    ("volumes", "words"),
    [
        ({"wing": ("a", "b"), "body": ("b",)}, "one volume, given more than once: b"),
        ({"wing": ()}, "volumes: wing; expected at least one zone in each"),
        ({}, "volumes: none given"),
    ],
)
def test_volumes_that_say_nothing_or_too_much_are_refused(volumes, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        GridEntry(file=tmp_path, volumes=volumes)


def test_a_surface_for_the_markers_alone_bends_their_discs_as_the_grid_does(virtual_test):
    """Without [grid] nothing is mapped, but a disc on a curved part is still not centred on its marker."""
    folder = virtual_test[0]
    settings = {
        "title": "one", "length_unit": "mm", "camera": [{"file": folder / "camera.json"}],
        "image": [{"file": folder / "wind-off.tif"}], "detect": {"radius_px": [4.0]},
    }  # fmt: skip
    grid, markers = folder / "model.grid", {"file": folder / "markers.csv", "roles": ("model",)}

    def begun(**more):
        return begin(make_project(folder / "one.toml", settings | more)).inputs

    flat, alone = begun(markers=markers), begun(markers=markers | {"surface": grid})
    mapped = begun(markers=markers, grid={"file": grid})
    assert alone.mesh is None
    assert not flat.markers.curvature.any()
    assert (np.abs(mapped.markers.curvature).max(axis=(1, 2)) > 0).sum() > 10
    np.testing.assert_array_equal(alone.markers.curvature, mapped.markers.curvature)
    with pytest.raises(io.FileError, match=r"markers\.surface.*does nothing beside \[grid\]"):
        begun(markers=markers | {"surface": grid}, grid={"file": grid})
    with pytest.raises(io.FileError, match=r"markers\.csv"):
        begun(markers=markers | {"surface": folder / "markers.csv"})


def half_cylinder(rng=None):
    """Of radius 4 along y; with a random generator a third of its triangles the other way round."""
    around, along = np.meshgrid(np.radians(np.arange(0, 181, 5)), np.arange(9.0), indexing="ij")
    xyz = np.stack([4 * np.cos(around), along, 4 * np.sin(around)], axis=-1).transpose(1, 0, 2).reshape(-1, 3)
    triangles = structured_triangles(37, 9)
    if rng is not None:
        some = rng.random(len(triangles)) < 0.3
        triangles[some] = triangles[some][:, ::-1]
    return Mesh.make(xyz, triangles)


def test_curvature_does_not_hang_on_how_single_triangles_are_wound():
    rng = np.random.default_rng(3)
    markers = MarkerSet.make(["a"], [[0, 4.2, 4.0]], normal=[[0, 0, 1.0]], radius=0.6)
    good, mixed = (with_curvature(markers, mesh).curvature for mesh in (half_cylinder(), half_cylinder(rng)))
    assert abs(good[0, 0, 0] - 0.25) < 0.01
    np.testing.assert_array_equal(mixed, good)


@pytest.mark.parametrize("told", [True, False])
def test_two_sides_of_a_thin_part_of_which_nothing_tells_which_is_which_are_doubted(tmp_path, told):
    (tmp_path / "g.grid").write_text("", encoding="utf-8")
    (tmp_path / "c.json").write_text("{}", encoding="utf-8")
    (tmp_path / "a.tif").write_text("", encoding="utf-8")
    one = half_cylinder()
    other = one.triangles[:, ::-1] if told else one.triangles
    triangles = np.concatenate([one.triangles, other + len(one.vertices)])
    names = np.repeat(["upper", "lower"], len(one.triangles))
    mesh = Mesh.make(np.concatenate([one.vertices] * 2), triangles, names)
    entry = GridEntry(file=tmp_path / "g.grid")
    words = sides_words(mesh, oriented(mesh, entry), entry)
    assert [w[:36] for w in words] == ([] if told else ["upper and lower lie on each other, th"[:36]])
    assert sides_words(mesh, mesh, GridEntry(file=tmp_path / "g.grid", orientation="file")) == []
    project = make_project(tmp_path / "p.toml", {
        "title": "t", "length_unit": "mm", "grid": {"file": "g.grid"}, "camera": [{"file": "c.json", "pose": "known"}],
        "image": [{"file": "a.tif"}],
    })  # fmt: skip
    verdict = run_verdict(RunResult(project, None, None, (), {}, unknown_sides=tuple(words)))
    assert ("grid" in [f.cause for f in verdict.findings]) == (not told)
