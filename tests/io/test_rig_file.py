"""The file of a rig: what is written is read, and what is wrong is named."""

import json

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Pose

POSES = {"left": Pose.identity(), "right": Pose.from_rotvec([0.1, -0.5, 0.2], [600.0, 3.0, -40.0])}


def test_written_and_read(tmp_path):
    io.write_rig(tmp_path / "rig.json", POSES, unit="mm", cov={"right": np.eye(6)})
    back = io.read_rig(tmp_path / "rig.json")
    assert back.length_unit == "mm"
    assert list(back.cam_from_rig) == ["left", "right"]
    np.testing.assert_array_equal(back.cam_from_rig["right"].rotation, POSES["right"].rotation)
    np.testing.assert_array_equal(back.cam_from_rig["right"].translation, POSES["right"].translation)
    assert json.loads((tmp_path / "rig.json").read_text())["cam_from_rig"]["right"]["covariance"] == np.eye(6).tolist()
    assert list(back.cov) == ["right"]
    np.testing.assert_array_equal(back.cov["right"], np.eye(6))


def test_a_length_needs_its_unit(tmp_path):
    with pytest.raises(ValueError, match="unit must be one of"):
        io.write_rig(tmp_path / "rig.json", POSES, unit="yd")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: r.pop("length_unit"), "length_unit"),
        (lambda r: r.update(scale=2), "'scale': unknown key"),
        (lambda r: r.update(cam_from_rig={}), "expected the cameras of a rig by name"),
        (lambda r: r["cam_from_rig"]["right"].update(covariance=[1.0]), "cam_from_rig.right.covariance"),
        (lambda r: r["cam_from_rig"]["right"].pop("translation"), "cam_from_rig.right.translation': missing"),
        (lambda r: r["cam_from_rig"]["right"].update(translation=[1, 2]), "cam_from_rig.right.translation"),
        (lambda r: r["cam_from_rig"]["right"].update(rotation=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), "right.rotation"),
        (lambda r: r["cam_from_rig"]["right"].update(turn=3), "cam_from_rig.right.turn': unknown key"),
        (lambda r: r["cam_from_rig"].update(right=3), "cam_from_rig.right': not an object"),
    ],
)
def test_mistakes_name_file_and_key(tmp_path, change, words):
    path = tmp_path / "rig.json"
    io.write_rig(path, POSES, unit="mm")
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    with pytest.raises(io.FileError) as error:
        io.read_rig(path)
    assert words in str(error.value)
    assert "rig.json" in str(error.value)
