"""The main job on NASA's camera 5: from image, targets, grid and interior parameters alone."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from windmark import io
from windmark.app.cli import app

PROJECT = Path(__file__).parents[2] / "examples" / "nasa-upsp-cam5.toml"


@pytest.fixture(scope="module")
def finished(shared_data, tmp_path_factory):
    """(summary, folder of the image's results)."""
    folder = tmp_path_factory.mktemp("nasa") / "results"
    done = CliRunner().invoke(app, ["run", str(PROJECT), "-o", str(folder), "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout), folder / "CAM5"


def test_all_fifteen_dots_are_labelled_and_none_wrong(finished, shared_data):
    """A label is right when the published pose puts that target within 6 px of the spot (the next is 80 px off)."""
    summary, folder = finished
    assert sorted(summary["images"][0]["registration"]["labels"]) == [f"st{k}" for k in range(10, 25)]
    data = shared_data / "nasa-upsp-cam5"
    camera, pose = io.read_camera(data / "camera05_35_6.json")
    markers = io.read_markers(data / "fml_tc3_volume.tgts")
    place = dict(zip(markers.name.tolist(), camera.project(pose.apply(markers.xyz))[0], strict=True))
    matches = io.read_matches(folder / "matches.csv")
    for name, xy in zip(matches.name, matches.xy, strict=True):
        assert np.linalg.norm(xy - place[name]) < 6


def test_residual_and_pose_are_the_data_s_optimum(finished):
    registration = finished[0]["images"][0]["registration"]
    assert registration["rms_px"] == pytest.approx(1.075, abs=0.007)  # 1.074 is the optimum for equal weights
    assert registration["published_pose"]["angle_deg"] < 0.3
    assert registration["log10_nfa"] < -9


def test_values_on_the_nodes_in_every_format(finished, shared_data):
    summary, folder = finished
    assert summary["grid_nodes"] == 309_062
    mesh = io.read_mesh(shared_data / "nasa-upsp-cam5" / "fml_tc3_volume.grid")
    value = io.read_plot3d_function(folder / "nodes.f", mesh)["value [grey level]"]
    _, tecplot = io.read_tecplot(folder / "nodes.dat")
    _, netcdf = io.read_nodes_netcdf(folder / "nodes.nc")[:2]
    np.testing.assert_array_equal(np.isfinite(tecplot["value [grey level]"]), np.isfinite(value))
    np.testing.assert_allclose(netcdf["value"], value, rtol=1e-6)
    assert (folder / "nodes.vtp").stat().st_size > 1e6
    assert np.isfinite(value).sum() == summary["images"][0]["nodes_visible"] > 60_000


def test_nodes_that_cannot_be_seen_are_nan(finished, shared_data):
    """Underside and far end of the plate by plain geometry; what is out of the frame by projection."""
    _, folder = finished
    data = shared_data / "nasa-upsp-cam5"
    mesh = io.read_mesh(data / "fml_tc3_volume.grid")
    value = io.read_plot3d_function(folder / "nodes.f", mesh)["value [grey level]"]
    camera, pose = io.read_camera(folder / "camera.json")
    xy, _ = camera.project(pose.apply(mesh.vertices))
    outside = ~camera.in_image(xy)
    assert np.isnan(value[outside]).all()
    top = mesh.vertices[:, 2] > -7.001
    assert np.isnan(value[~top]).all()
    inner = top & (np.abs(mesh.vertices[:, 2] + 7) < 1e-3) & ~outside & (xy > 20).all(axis=1) & (xy[:, 0] < 1200)
    inner &= (xy[:, 1] < 780) & (mesh.vertex_normals()[:, 2] > 0.9)  # not the side walls' own copies of the rim
    assert np.isfinite(value[inner]).mean() > 0.999
