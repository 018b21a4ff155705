"""The main job from the command line, on a virtual test: what a user gets, end to end."""

import re

import numpy as np
import pytest
import xarray
from test_packing import page_text

from windmark import io
from windmark.app import verbs
from windmark.pipeline.project import read_project
from windmark.pipeline.truth import compare

PACKED = r'base64,[A-Za-z0-9+/=]+|<script type="text/plain".*?</script>'
"""Data, in which any letters may stand beside each other."""


@pytest.fixture(scope="module")
def finished(virtual_test, tmp_path_factory):
    """The job done once: (result, record, folder of the results, test)."""
    folder, test = virtual_test
    project = read_project(folder / "project.toml")
    output = project.output.model_copy(update={"folder": tmp_path_factory.mktemp("job") / "results"})
    project = project.model_copy(update={"output": output})
    result, record = verbs.carry_out(project, lambda done: compare(done, test))
    return result, record, output.folder, test


def test_every_visible_marker_is_labelled_and_none_wrong(finished):
    _, record, _, _ = finished
    for row in record["truth"]["images"]:
        assert row["labelled wrong"] == 0
        assert row["labelled right"] == row["markers visible"] >= 20
    assert record["truth"]["good"]


def test_pose_and_values_agree_with_the_truth(finished):
    for row in finished[1]["truth"]["images"]:
        assert row["pose deg"] < 0.03
        assert row["place on the surface RMS px"] < 0.03
        assert row["value error median %"] < 1.5


def test_every_promised_file_is_there_and_reads_back(finished):
    result, _, folder, test = finished
    for item in result.images:
        place = folder / item.name
        camera, pose = io.read_camera(place / "camera.json")
        assert camera.focal_px == item.camera.focal_px
        np.testing.assert_allclose(pose.rotation, item.cam_from_model.rotation, atol=1e-15)
        spots = io.read_detections(place / "detections.csv")[item.name]
        np.testing.assert_array_equal(spots.xy, item.detections.xy)
        table = io.read_matches(place / "matches.csv")
        assert set(table.name) <= set(test.markers.name)
        # What the judge saw: from the ellipses' centres, not from where the discs' centres are imaged.
        rms = item.registered.rms_px
        np.testing.assert_allclose(np.sqrt(np.mean(table.residual**2) * 2), rms, rtol=1e-6)
        _, fields = io.read_nodes_netcdf(place / "nodes.nc")[:2]
        np.testing.assert_array_equal(fields["value"], item.values)
        np.testing.assert_array_equal(fields["sigma"], item.sigma)
        assert (np.isfinite(item.sigma) == item.nodes.visible).all()
        for name in ("nodes.vtp", "nodes.dat", "nodes.f", "nodes.nam", "nodes.csv", "view-top.tif", "aligned.tif"):
            assert (place / name).stat().st_size > 0
    assert str(folder.parents[0]) not in (folder / "summary.json").read_text(encoding="utf-8")


def test_values_are_nan_exactly_where_the_camera_does_not_see(finished):
    for item in finished[0].images:
        np.testing.assert_array_equal(np.isfinite(item.values), item.nodes.visible)
        assert 0.2 < item.nodes.visible.mean() < 0.8


def test_the_report_stands_alone(finished):
    page = (finished[2] / "report.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert "http" not in re.sub(PACKED, "", page)
    assert page_text(finished[2] / "report.html").count('src="data:image/') >= 4  # each picture, and each in its views
    assert page.count('<image href="data:image/') >= 12  # pixels of spots
    assert "No marker is labelled wrong" in page


def test_alignment_brings_the_moved_model_onto_the_reference(finished):
    """Markers of the aligned wind-on image lie where the reference image has them; in the raw image they do not."""
    result, _, _, test = finished
    off, on = result.images
    truth_off, truth_on = (test.shot(i.name).perfect.markers for i in (off, on))
    wing = truth_off.visible & (test.markers.role == "model")
    moved = np.linalg.norm(truth_on.ellipse_xy[wing] - truth_off.ellipse_xy[wing], axis=1)
    assert np.median(moved) > 1.0
    from windmark.detection import detect

    found = detect(on.aligned, radius_px=4).xy
    nearest = [np.linalg.norm(found - xy, axis=1).min() for xy in truth_off.ellipse_xy[wing]]
    assert np.median(nearest) < 0.05


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_same_input_same_result(finished, virtual_test, tmp_path, windmark):
    """A second run through the command line gives the same numbers."""
    folder, _ = virtual_test
    done = windmark("run", folder / "project.toml", "-o", tmp_path / "again", "--json")
    assert done.code == 0
    first, second = finished[1]["images"][0]["registration"], done.json["images"][0]["registration"]
    assert first["labels"] == second["labels"]
    assert first["pov"] == second["pov"]


@pytest.mark.slow
def test_steps_alone_detect_register_resect(virtual_test, tmp_path, windmark):
    folder, _ = virtual_test
    image = folder / "wind-off.tif"
    done = windmark("detect", image, "-r", 4, "-o", tmp_path / "d.csv", "--picture", tmp_path / "d.png")
    assert done.code == 0
    assert len(io.read_detections(tmp_path / "d.csv")["wind-off.tif"]) >= 25
    assert io.read_image(tmp_path / "d.png").ndim == 3
    done = windmark(
        "register", image, "-m", folder / "markers.csv", "-c", folder / "camera.json", "-r", 4, "--unit", "mm",
        "-o", tmp_path / "registered",
    )  # fmt: skip
    assert done.code == 0, done.err
    posed = tmp_path / "registered" / "wind-off" / "camera.json"
    done = windmark(
        "resect", image, "-c", posed, "-g", folder / "model.grid", "--unit", "mm", "-o", tmp_path / "mapped",
        "--nodes", "csv", "--pixels",
    )  # fmt: skip
    assert done.code == 0, done.err
    mapped = tmp_path / "mapped" / "wind-off"
    assert sorted(p.name for p in mapped.iterdir()) == ["camera.json", "nodes.csv", "pixels.nc"]
    camera, pose = io.read_camera(posed)
    with xarray.open_dataset(mapped / "pixels.nc") as found:
        xyz = np.stack([found[axis].values for axis in "xyz"], axis=-1)
        rows, columns = np.nonzero(np.isfinite(xyz[..., 0]))
        assert len(rows) > 100_000
        xy = camera.project(pose.apply(xyz[rows, columns]))[0]
        np.testing.assert_allclose(xy, np.stack([columns, rows], axis=-1), atol=1e-6)
        told = np.isfinite(found["value"].values)
        assert 0 < (~told).sum() < 50  # hot and dead pixels
        np.testing.assert_array_equal(found["value"].values[told], io.read_image(image)[told])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_align_from_the_command_line(virtual_test, tmp_path, windmark):
    folder, test = virtual_test
    model = test.markers.with_role("model")
    io.write_markers(tmp_path / "model.csv", model)
    done = windmark(
        "align", folder / "wind-off.tif", folder / "wind-on.tif", "--reference", "wind-off", "-m",
        tmp_path / "model.csv", "-c", folder / "camera.json", "-g", folder / "model.grid", "-r", 4, "--unit", "mm",
        "-o", tmp_path / "aligned",
    )  # fmt: skip
    assert done.code == 0, done.err
    aligned = io.read_image(tmp_path / "aligned" / "wind-on" / "aligned.tif")
    assert aligned.shape == (1024, 1280)
    assert aligned.dtype == np.float32
    assert not list((tmp_path / "aligned").rglob("nodes.*"))
