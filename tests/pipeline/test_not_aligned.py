"""An alignment that cannot be made costs only itself: the picture's pose and values are used, and the cause is said."""

from types import SimpleNamespace

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.pipeline.mapping import align_images
from windmark.pipeline.quantity import Quantity
from windmark.pipeline.results import ImageResult
from windmark.pipeline.verdict import DOUBTFUL
from windmark.pipeline.verdict.run import run_verdict
from windmark.scene import Mesh

CAMERA, POSE = Camera((64, 48), 80.0), Pose.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
PROJECT = SimpleNamespace(
    align=SimpleNamespace(reference="off", background="nan"), resect=SimpleNamespace(interpolation="linear"),
    length_unit="mm",
)  # fmt: skip


def failed_reference():
    off = ImageResult("off", None, CAMERA, problem="not registered: fixed labels contradict the spots: W03")
    on = ImageResult("on", None, CAMERA, POSE)
    return align_images([off, on], PROJECT, None)


def test_a_failed_reference_does_not_make_a_good_picture_a_failed_one():
    """It was "no image could be used" with the exit code of a refusal."""
    off, on = failed_reference()
    assert on.problem is None
    assert on.left_out == ("not aligned: the reference image off has no pose",)
    assert (off.left_out, off.problem[:14]) == ((), "not registered")


def test_the_cause_comes_before_the_consequence():
    result = SimpleNamespace(images=failed_reference(), markers=None, mesh=None, project=PROJECT, lost_views=(),
                             merged=(), unknown_sides=())  # fmt: skip
    verdict = run_verdict(result)
    assert verdict.word == DOUBTFUL
    assert verdict.reason.startswith("off: not registered: fixed labels"), verdict
    assert verdict.findings[-1].reason == "left out: not aligned: the reference image off has no pose"


def test_another_quantity_than_the_reference_is_left_out_of_the_alignment_alone():
    image = np.zeros((48, 64), np.float32)
    off = ImageResult("off", image, CAMERA, POSE, quantity=Quantity("temperature", "K"))
    on = ImageResult("on", image, CAMERA, POSE)
    plate = Mesh.make(np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    off, on = align_images([off, on], PROJECT, plate)
    assert on.problem is None
    assert "not aligned: its values are not" in on.left_out[0]
