"""Pictures of a calibration or a reconstruction: one that cannot be read costs only itself."""

import numpy as np
import pytest

from windmark import io
from windmark.pipeline.calibrate.read import read_image, read_pictures
from windmark.scene import Detections
from windmark.tasks.calibrate.picture import Picture


def read(paths, options, cameras=("camera",), patterns=None):
    def make(path, name, taken):
        image, _ = read_image(path, options)
        return Picture(name, taken.camera, image.shape[::-1], Detections.make(np.ones((3, 2))), taken.frame)

    return read_pictures(paths, dict.fromkeys(cameras), patterns or {}, None, make)


@pytest.fixture
def options():
    from windmark.pipeline.calibrate import MatchOptions

    return MatchOptions()


@pytest.fixture
def paths(tmp_path):
    for name in ("a1", "b1", "a2", "b2"):
        io.write_image(tmp_path / f"{name}.png", np.full((60, 80), 200, np.uint8))
    return [tmp_path / f"{name}.png" for name in ("a1", "b1", "a2", "b2")]


def test_the_others_go_on(paths, options):
    paths[1].write_bytes(b"no picture")
    pictures, cameras = read(paths, options)
    assert [p.name for p in pictures] == ["a1", "b1", "a2", "b2"]
    assert [len(p.detections) for p in pictures] == [3, 0, 3, 3]
    assert pictures[1].problem == pictures[1].unread
    assert pictures[1].unread.startswith("cannot be read: ")
    assert {p.size_px for p in pictures} == {(80, 60)} == {cameras["camera"].size_px}
    assert not any(p.problem for p in pictures if p.name != "b1")


def test_too_few_are_a_bad_file(paths, options):
    for path in paths[1:]:
        path.unlink()
    with pytest.raises(io.FileError, match="b1"):
        read(paths, options)


def test_a_camera_without_any_is_a_bad_file(paths, options):
    for path in (paths[1], paths[3]):
        path.write_bytes(b"no picture")
    with pytest.raises(io.FileError, match="b1"):
        read(paths, options, ("a", "b"), {"a": "a*", "b": "b*"})
