"""Which images are merged with each other, and what is said where that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.merge import merge_images
from windmark.pipeline.merge_outputs import merge_summary
from windmark.pipeline.project import make_project
from windmark.pipeline.results import ImageResult
from windmark.pipeline.wanted import LineEntry, MergeOptions, check_merge, groups
from windmark.resection import NotMerged
from windmark.scene import Mesh, structured_triangles


def project(tmp_path, images, **merge):
    for name in ("c.json", "g.grid", *(f"{i}.tif" for i in images)):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    return make_project(tmp_path / "p.toml", {
        "title": "t", "length_unit": "mm", "grid": {"file": "g.grid"}, "merge": merge,
        "camera": [{"name": f"cam-{i}", "file": "c.json", "pose": "known"} for i in images],
        "image": [{"file": f"{i}.tif", "camera": f"cam-{i}"} for i in images],
    })  # fmt: skip


def plate():
    x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20))
    return Mesh.make(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), structured_triangles(20, 20))


def result(name, x=None, level=1000.0):
    """An image of a plain plate from a place x; without a pose for None."""
    camera = Camera((120, 90), 150.0)
    pose = None if x is None else Pose.look_at((x, 0, 4), np.zeros(3), (0, 1, 0))
    noise = np.random.default_rng(len(name)).normal(size=(90, 120))
    return ImageResult(name, level + noise * level / 100, camera, pose, problem=None if pose else "not registered: x")


def test_groups_by_point():
    images = [("a", "1"), ("b", "1"), ("c", "2")]
    assert groups(MergeOptions(), images) == {"1": ["a", "b"], "2": ["c"]}
    assert groups(MergeOptions(images=("a", "c")), images) == {"1": ["a"], "2": ["c"]}
    assert groups(MergeOptions(), [("a", None), ("b", None)]) == {None: ["a", "b"]}


def test_one_camera_may_take_several_pictures_of_a_point_but_not_without_saying_so():
    two = [("a", "1", "cam"), ("b", "1", "cam")]
    check_merge(MergeOptions(), two, True)
    with pytest.raises(ValueError, match="both of camera cam"):
        check_merge(MergeOptions(), [(n, None, c) for n, _, c in two], True)
    with pytest.raises(ValueError, match="needs a grid"):
        check_merge(MergeOptions(), two, False)
    with pytest.raises(ValueError, match="reference 'b' is not among"):
        check_merge(MergeOptions(images=("a",), reference="b"), two, True)


def test_start_and_end_of_a_line_must_differ():
    with pytest.raises(ValueError, match="start and end must differ"):
        LineEntry(name="x", start=(0, 0, 0), end=(0, 0, 0))


def test_merged_with_its_gain(tmp_path):
    wanted = project(tmp_path, ("a", "bb"))
    (found,) = merge_images(wanted, [result("a", 0.5), result("bb", -0.8, 3000.0)], plate(), (), (), ())
    record = merge_summary(found)
    assert found.folder == "merged"
    assert record["merged"]
    assert record["legend"] == {"0": "a", "1": "bb"}
    assert abs(record["gain"]["bb"]["gain"] - 3) < 0.02


def test_one_image_left_is_nothing_to_merge(tmp_path):
    wanted = project(tmp_path, ("a", "bb"))
    (found,) = merge_images(wanted, [result("a", 0.5), result("bb")], plate(), (), (), ())
    assert isinstance(found.outcome, NotMerged)
    assert "only a is left (bb: not registered: x)" in found.outcome.reason
    assert merge_summary(found)["reason"] == found.outcome.reason
    assert found.missing == {"bb": "not registered: x"}


def test_a_lost_reference_gives_way_to_another(tmp_path):
    wanted = project(tmp_path, ("a", "bb", "ccc"), reference="a")
    (found,) = merge_images(wanted, [result("a"), result("bb", 0.5), result("ccc", -0.5)], plate(), (), (), ())
    assert merge_summary(found)["reference"] == "bb"
    assert list(found.missing) == ["a"]
