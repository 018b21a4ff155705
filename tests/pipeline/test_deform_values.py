"""Pictures on the deformed grid: what is left out, and that the deformed grid gives the paint's true ratio."""

from pathlib import Path

import numpy as np
import pytest

from windmark import synth
from windmark.geometry import Camera, Pose
from windmark.pipeline.deform.entries import ValuesEntry
from windmark.pipeline.deform.values import away_from, inside_px, surface_values
from windmark.pipeline.light import light_of
from windmark.scene import MarkerSet, Mesh

CAMERA = Camera((80, 60), 100.0)
AHEAD = Pose.identity()


def sheet(x0, x1, y0, y1, z, n=9):
    """A flat sheet that faces the camera."""
    x, y = np.meshgrid(np.linspace(x0, x1, n), np.linspace(y0, y1, n))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.full(n * n, float(z))])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + n, corner + n + 1
    return vertices, np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])


def mesh_of(*sheets):
    vertices, triangles, at = [], [], 0
    for v, t in sheets:
        vertices.append(v)
        triangles.append(t + at)
        at += len(v)
    triangles = np.concatenate(triangles)
    return Mesh(np.concatenate(vertices), triangles, np.full(len(triangles), "wing"))


def test_outlines_are_the_sheets_ends_and_where_one_passes_before_the_other():
    # 40 px wide and 20 high, and behind its right half a larger one that goes on to the right.
    near, far = sheet(-2, 2, -1, 1, 10), sheet(0, 8, -3, 3, 20)
    inside = inside_px(mesh_of(near, far), CAMERA, AHEAD)
    middle = int(CAMERA.cy)
    left = int(np.ceil(CAMERA.cx - 20))
    assert inside[middle, left - 2] == 0  # off the surface
    assert inside[middle, left + 6] == pytest.approx(7, abs=1)
    right = int(np.floor(CAMERA.cx + 20))
    assert inside[middle, right - 6] == pytest.approx(6, abs=1.5)  # the near sheet's end, though the far one goes on
    assert inside[middle, right + 6] == pytest.approx(6, abs=1.5)
    assert inside[middle, right + 11] > inside[middle, right + 6]


def test_a_slope_is_no_outline():
    vertices, triangles = sheet(-2, 2, -1, 1, 10)
    vertices[:, 2] += np.tan(np.radians(75)) * vertices[:, 0] / 4
    inside = inside_px(mesh_of((vertices, triangles)), CAMERA, AHEAD)
    assert inside.max() >= 8


def test_a_surface_that_fills_the_image_has_no_outline_and_none_at_all_is_all_off():
    assert np.isinf(inside_px(mesh_of(sheet(-9, 9, -9, 9, 10)), CAMERA, AHEAD)).all()
    assert not inside_px(mesh_of(sheet(-2, 2, -1, 1, 10)), CAMERA, Pose.from_rotvec([0, np.pi, 0], np.zeros(3))).any()


def test_values_are_light_without_black_and_stop_short_of_the_outline():
    mesh = mesh_of(sheet(-2, 2, -1, 1, 10, n=41))
    image = np.full((60, 80), 150.0)
    values = surface_values(image, mesh, CAMERA, AHEAD, ValuesEntry(black=50.0, edge_px=3.0))
    xy = CAMERA.project(mesh.vertices)[0]
    off = np.minimum(20 - np.abs(xy[:, 0] - CAMERA.cx), 10 - np.abs(xy[:, 1] - CAMERA.cy))
    assert (values[off > 5] == 100.0).all()
    assert np.isnan(values[off < 2]).all()
    everywhere = surface_values(image, mesh, CAMERA, AHEAD, ValuesEntry(edge_px=0.0))
    assert np.isfinite(everywhere).all()


def test_nodes_on_markers_are_left_out_but_walls_and_unknown_radii_hide_nothing():
    mesh = mesh_of(sheet(-2, 2, -1, 1, 10, n=41))
    names = ["a", "b", "c"]
    markers = MarkerSet.make(
        names, [[0, 0, 10], [1, 0, 10], [-1, 0, 10]], radius=[0.2, 0.2, np.nan], role=["model", "wall", "model"]
    )
    bare = away_from(markers, mesh, 1.6)
    far = np.linalg.norm(mesh.vertices - [0, 0, 10], axis=1)
    assert (bare == (far > 0.32)).all()
    assert away_from(markers, mesh, 0.0).all()


@pytest.fixture(scope="module")
def paint():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
        patch.syspath_prepend(str(Path(__file__).parents[1] / "deformation"))
        import deformation_paint
    return deformation_paint, deformation_paint.mapped(9_001, (640, 400), 15_000)


@pytest.mark.slow
def test_the_deformed_grid_gives_the_ratio_as_well_as_the_true_grid_does(paint):
    _, paint = paint
    rms = {n: float(np.sqrt(np.nanmean(e**2))) for n, e in paint.errors.items()}
    assert np.isfinite(paint.errors["truth"]).sum() > 2000
    assert rms["one camera"] < 1.05 * rms["truth"]
    assert rms["two cameras"] < 1.05 * rms["truth"]
    assert rms["as a whole"] > 1.5 * rms["truth"]
    assert 1.0 < np.nanmax(paint.off_px) < 5.0


def test_the_error_maps_are_drawn_side_by_side(paint):
    bench, done = paint
    figure = bench.picture(done)
    panels = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title() for axes in panels] == ["truth", "grid as a whole", "grid deformed"]
    spread = [float(np.std(np.asarray(axes.images[0].get_array()))) for axes in panels]
    assert min(spread) > 0.01


def test_wind_changes_what_the_paint_gives_back_and_nothing_else():
    test = synth.stereo_wing(1, size_px=(64, 40), nodes=3_000)
    calm, windy = (synth.deformed_world(test, synth.WingState(0.01, 0.5, mach=m)) for m in (0.0, 0.7))
    assert (calm.mesh.vertices == windy.mesh.vertices).all()
    light = calm.node_intensity(), windy.node_intensity()
    ratio = np.divide(*light, out=np.ones(len(light[0])), where=light[1] > 0)
    wing = np.unique(test.mesh.triangles[test.mesh.volume == "wing"])
    wall = np.setdiff1d(np.arange(len(ratio)), np.unique(test.mesh.triangles[test.mesh.volume != "wall"]))
    assert np.ptp(ratio[wing]) > 0.2
    assert (ratio[wall] == 1.0).all()


def crossing(angle_deg, shift=0.0):
    """A sheet, and another one that meets it under an angle in its middle without a common node."""
    turn = np.radians(angle_deg)
    vertices, triangles = sheet(0.02, 2, -1, 1, 0)
    risen = np.column_stack([np.cos(turn) * vertices[:, 0], vertices[:, 1], 10 + shift - np.sin(turn) * vertices[:, 0]])
    return mesh_of(sheet(-2, 0.5, -1, 1, 10), (risen, triangles))


def test_parts_that_run_into_each_other_have_an_outline_between_them():
    """A wing in a body: at the line where they meet a lens mixes the light of two surfaces."""
    inside = inside_px(crossing(40), CAMERA, AHEAD)
    middle, centre = int(CAMERA.cy), round(CAMERA.cx)
    assert inside[middle, centre - 1 : centre + 2].min() <= 1
    assert inside[middle, centre - 6] == pytest.approx(6, abs=1.5)
    assert inside[middle, centre + 6] == pytest.approx(6, abs=1.5)


def test_blocks_that_touch_or_overlap_have_no_outline_between_them():
    """Blocks with common places, a sheet folded along them, and blocks that overlap without."""
    left, right = sheet(-2, 0, -1, 1, 10), sheet(0, 2, -1, 1, 10)
    folded = right[0] - np.column_stack([0 * right[0][:, :2], np.tan(np.radians(40)) * right[0][:, 0]])
    over = crossing(0, -1e-3)
    for mesh in (mesh_of(left, right), mesh_of(left, (folded, right[1])), over):
        inside = inside_px(mesh, CAMERA, AHEAD)
        assert inside[int(CAMERA.cy), int(CAMERA.cx) - 2 : int(CAMERA.cx) + 3].min() >= 8


def test_saturated_nodes_have_no_value():
    mesh = mesh_of(sheet(-2, 2, -1, 1, 10, n=41))
    image = np.full((60, 80), 150, np.uint8)
    image[:, 40:] = 255
    values = surface_values(light_of(image), mesh, CAMERA, AHEAD, ValuesEntry(edge_px=0.0))
    x = CAMERA.project(mesh.vertices)[0][:, 0]
    assert (values[x <= 39] == 150.0).all()
    assert np.isnan(values[x > 39.01]).all()
