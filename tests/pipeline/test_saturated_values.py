"""Nodes whose pixels are at the picture's highest level have no value, and it is said how many."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.clock import silent
from windmark.pipeline.mapping import map_image
from windmark.pipeline.merge import merge_images, picture_of
from windmark.pipeline.project import make_project
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.verdict.run import run_verdict
from windmark.scene import Mesh, structured_triangles

H, W = 90, 120


def project(tmp_path, images):
    for name in ("c.json", "g.grid", *(f"{i}.tif" for i in images)):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    return make_project(tmp_path / "p.toml", {
        "title": "t", "length_unit": "mm", "grid": {"file": "g.grid"}, "merge": {"gain": "none"},
        "camera": [{"name": f"cam-{i}", "file": "c.json", "pose": "known"} for i in images],
        "image": [{"file": f"{i}.tif", "camera": f"cam-{i}"} for i in images],
    })  # fmt: skip


def plate():
    x, y = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40))
    return Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), structured_triangles(40, 40))


def result(name, x):
    """An image of a plain plate of light 200 from a place x."""
    noise = np.random.default_rng(len(name)).normal(size=(H, W))
    pose = Pose.look_at((x, 0, 4), np.zeros(3), (0, 1, 0))
    return ImageResult(name, 200.0 + 2.0 * noise, Camera((W, H), 150.0), pose)


def pictured(name, x, spot_px, full=255):
    """A plate of light 200 that a highlight of three times that lights up within some pixels, in 8 bits."""
    item = result(name, x)
    place = item.camera.project(item.cam_from_model.apply(np.zeros((1, 3))))[0][0]
    far = np.hypot(*(np.indices((H, W))[::-1] - place[:, None, None]))
    image = np.where(far < spot_px, 600.0, item.image)
    return ImageResult(name, np.clip(np.rint(image), 0, full).astype(np.uint8), item.camera, item.cam_from_model)


def mapped(tmp_path, spot_px, full=255):
    work = project(tmp_path, ["a"])
    done = map_image(pictured("a", 0.3, spot_px, full), work, plate(), (), (), silent)
    assert done.problem is None
    return done, run_verdict(RunResult(work, None, plate(), (done,), {}))


@pytest.mark.parametrize("full", [255, 240])
def test_nodes_in_a_clipped_highlight_have_no_value_however_small_it_is(tmp_path, full):
    done, verdict = mapped(tmp_path, 3.0, full)
    assert 20 <= (done.image == full).sum() < 0.005 * done.image.size
    gone = done.nodes.visible & np.isnan(done.values)
    assert np.nanmax(done.values) < 215
    assert (done.saturated_part, gone.any()) == (gone.sum() / done.nodes.visible.sum(), True)
    assert done.saturated.startswith(f"{gone.sum()} of {done.nodes.visible.sum()} nodes")
    assert np.isnan(done.sigma[gone]).all()
    assert "saturated" not in [f.cause for f in verdict.findings]  # said, but of so few no doubt


def test_more_than_some_of_them_make_it_doubtful(tmp_path):
    done, verdict = mapped(tmp_path, 8.0)
    assert done.saturated_part > 0.02
    assert "saturated" in [f.cause for f in verdict.findings]


def test_what_is_not_saturated_stays_as_it_is(tmp_path):
    done, verdict = mapped(tmp_path, 0.0)
    assert (done.saturated, done.light is done.image) == ("", True)
    assert "saturated" not in [f.cause for f in verdict.findings]
    assert picture_of(done).noise is None


def test_where_one_picture_is_saturated_merged_values_are_the_others(tmp_path):
    items = [pictured("a", -0.3, 6.0), result("bb", 0.3)]
    (group,) = merge_images(project(tmp_path, ["a", "bb"]), items, plate(), (), (), ())
    value = group.merged.nodes.value
    middle = np.hypot(*plate().vertices[:, :2].T) < 0.15
    assert middle.any()
    np.testing.assert_allclose(value[middle], 200.0, atol=10.0)


def test_nodes_on_pixels_made_of_one_saturated_colour_have_no_value(tmp_path):
    item = result("a", 0.3)
    mixed = np.zeros((H, W), bool)
    mixed[40:44, 60:64] = True
    done = map_image(replace(item, mixed=mixed), project(tmp_path, ["a"]), plate(), (), (), silent)
    gone = done.nodes.visible & np.isnan(done.values)
    assert gone.any()
    assert "at the highest level of at least one colour" in done.saturated
    assert (done.saturated_part, done.dead) == (gone.sum() / done.nodes.visible.sum(), "")


def test_nodes_on_hot_and_dead_pixels_have_no_value(tmp_path):
    item = result("a", 0.3)
    image = np.rint(item.image).astype(np.uint16)
    image[45, 60], image[50, 70] = 9000, 0
    work = project(tmp_path, ["a"])
    done = map_image(replace(item, image=image), work, plate(), (), (), silent)
    gone = done.nodes.visible & np.isnan(done.values)
    assert done.dead.startswith(f"{gone.sum()} of {done.nodes.visible.sum()} nodes that it shows have no value: their")
    assert 0 < gone.sum() < 40
    assert (done.saturated, np.nanmax(done.values) < 215) == ("", True)
    verdict = run_verdict(RunResult(work, None, plate(), (done,), {}))
    assert [f.cause for f in verdict.findings] == ["few"]  # poses were given


def test_nodes_on_a_dead_column_and_a_group_have_no_value(tmp_path):
    item = result("a", 0.3)
    image = np.rint(item.image).astype(np.uint16)
    image[:, 50], image[40, 70:73] = image[:, 50] + np.uint16(60), 0
    done = map_image(replace(item, image=image), project(tmp_path, ["a"]), plate(), (), (), silent)
    gone = done.nodes.visible & np.isnan(done.values)
    assert done.dead.startswith(f"{gone.sum()} of {done.nodes.visible.sum()} nodes that it shows have no value: their")
    assert (np.nanmax(done.values) < 215, np.nanmin(done.values) > 185) == (True, True)
