"""Walls in the grid do not move with the model: by the markers on them they take no part in alignment and resection."""

import json
import re

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera, Pose

pytestmark = pytest.mark.usefixtures("all_undrawn")


@pytest.fixture(scope="module")
def aligned(virtual_test, windmark, tmp_path_factory):
    """The wind-on image of the virtual test, whose grid has a floor and a side wall, aligned."""
    folder, _ = virtual_test
    out = tmp_path_factory.mktemp("walls") / "out"
    done = windmark(
        "align", folder / "wind-off.tif", folder / "wind-on.tif", "-m", folder / "markers.csv", "-c",
        folder / "camera.json", "-g", folder / "model.grid", "-r", 4, "--unit", "mm", "--background", "keep", "-o", out,
    )  # fmt: skip
    return done, out


@pytest.mark.slow
def test_align_leaves_the_walls_where_they_are(virtual_test, aligned):
    folder, test = virtual_test
    done, out = aligned
    assert done.code == 0
    assert "walls by the markers on them, which do not move with the model: zone05, zone06; left out of the" in done.err
    picture = next(p for p in out.rglob("*.tif") if "wind-on" in str(p))
    got, taken = io.read_image(picture), io.read_image(folder / "wind-on.tif")
    shot = test.shot("wind-off")
    wall = np.flatnonzero((test.markers.role == "wall") & shot.perfect.markers.visible)
    xy = np.rint(test.shot("wind-on").perfect.markers.ellipse_xy[wall]).astype(int)
    same = [got[y, x] == taken[y, x] for x, y in xy if np.isfinite(got[y, x])]
    assert len(same) >= 5
    assert all(same)  # the camera stands still: what shows a wall is the image's own pixel
    assert json.loads((out / "summary.json").read_text())["notes"]


@pytest.mark.slow
def test_resect_with_markers_gives_walls_no_value(virtual_test, windmark, tmp_path):
    folder, test = virtual_test
    io.write_camera(tmp_path / "on.json", test.cameras["cam1"], test.shot("wind-on").view.cam_from_model, unit="mm")
    call = ["resect", folder / "wind-on.tif", "-c", tmp_path / "on.json", "-g", folder / "model.grid", "--unit", "mm",
            "--nodes", "csv"]  # fmt: skip
    plain = windmark(*call, "-o", tmp_path / "plain")
    told = windmark(*call, "-m", folder / "markers.csv", "-o", tmp_path / "told")
    assert plain.code == told.code == 0
    counts = [int(re.search(r"values on (\d+) of", done.out)[1]) for done in (plain, told)]
    assert counts[0] - counts[1] > 300
    assert counts[1] > 300
    assert "zone05, zone06; left out of the job" in told.err
    both = windmark(*call, "-m", folder / "markers.csv", "--volume", "wing=zone01", "-o", tmp_path / "both")
    assert both.code == 2
    assert "one of them" in both.err


def test_a_part_that_bears_both_is_refused(windmark, tmp_path):
    grid = tmp_path / "grid.obj"
    grid.write_text("v 0 0 0\nv 100 0 0\nv 0 100 0\nv 100 100 0\nf 1 2 3\nf 2 4 3\n")
    (tmp_path / "m.csv").write_text("name,x,y,z,role\nm1,10,10,0,model\nw1,90,90,0,wall\n")
    io.write_camera(tmp_path / "c.json", Camera((64, 48), 60.0), Pose.look_at([50, 50, 100], [50, 50, 0], [0, 1, 0]),
                    unit="mm")  # fmt: skip
    io.write_image(tmp_path / "a.png", np.full((48, 64), 99, np.uint8))
    done = windmark("resect", tmp_path / "a.png", "-c", tmp_path / "c.json", "-g", grid, "--unit", "mm", "-m",
                    tmp_path / "m.csv", "-o", tmp_path / "out")  # fmt: skip
    assert done.code == 2
    assert "bears markers of walls (w1) and of the model (m1), so the wall would move with the model" in done.err
