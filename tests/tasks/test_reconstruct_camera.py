"""`reconstruct` with a camera file that is another camera's, or a primary that is elsewhere: it is named, and no right
marker is; or it is said that it would not show. Truth known."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.reconstruct.outputs import record
from windmark.pipeline.verdict.network import reconstruct_verdict
from windmark.scene import Detections, MarkerSet
from windmark.tasks.reconstruct import NotReconstructed, reconstruct

RIGHT = Camera((640, 480), 900.0, cx=322.0, cy=238.0, k1=-0.1, k2=0.05)
NO_LENS = replace(RIGHT, k1=0.0, k2=0.0)
OTHER_CENTRE = replace(RIGHT, cx=340.0)
OTHER_ASPECT = replace(RIGHT, aspect=1.006)
CORNERS = ((0, 0), (150, 0), (0, 112), (150, 112), (75, 56), (60, 10))
SIGMA = 0.02


def relief():
    """(34, 3) markers on a surface of some relief, mm, none near another."""
    rng, xy = np.random.default_rng(5), np.zeros((0, 2))
    while len(xy) < 34:
        new = rng.uniform(0, [150, 112])
        if not len(xy) or np.linalg.norm(xy - new, axis=1).min() > 13:
            xy = np.vstack([xy, new])
    z = 25 * np.sin(xy[:, 0] / 25) * np.cos(xy[:, 1] / 31) + rng.uniform(-6, 6, len(xy))
    return np.column_stack([xy, z])


XYZ = relief()


def spots(views, step_deg, bend=0.0):
    """Spots of pictures round the markers as `RIGHT` sees them, in another order in each; bent in the later half."""
    rng, centre, out = np.random.default_rng(views), XYZ.mean(axis=0), []
    for k in range(views):
        a, b = np.radians((k - (views - 1) / 2) * step_deg), np.radians((8 if k % 2 else -8) + 5)
        eye = centre + 430 * np.array([np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)])
        turn = (0.0, 0.4, -0.3, 1.5, 0.2)[k % 5]
        pose = Pose.look_at(eye, centre, [np.sin(turn), np.cos(turn), 0])
        up = bend * (XYZ[:, :1] / 150) ** 2 * (k >= views // 2)
        xy = RIGHT.project(pose.apply(XYZ + up * [0, 0, 1]))[0][rng.permutation(len(XYZ))]
        out.append(Detections.make(xy + rng.normal(0, 0.005, xy.shape), sigma_px=0.005))
    return out


def primaries(count, wrong=0.0):
    """The first corners, the last of them so far (mm) above where it is."""
    at = [int(np.linalg.norm(XYZ[:, :2] - c, axis=1).argmin()) for c in CORNERS[:count]]
    known = XYZ[at] + np.random.default_rng(1).normal(0, SIGMA, (count, 3))
    known[-1, 2] += wrong
    sigma = np.full((count, 3), SIGMA)
    return MarkerSet.make([f"A{k}" for k in range(count)], known, sigma=sigma, length_unit="mm")


def made(camera, views, count, step_deg=10.0, wrong=0.0):
    return reconstruct(spots(views, step_deg), camera, primaries(count, wrong))


def said_of(answer):
    """What is said against it, without what a refusal quotes."""
    if isinstance(answer, NotReconstructed):
        return answer.reason.split("(with the given one")[0]
    return "; ".join(answer.warnings)


def test_a_camera_without_its_lens_is_the_reason_and_no_control_point_is():
    answer = made(NO_LENS, 8, 6)
    said = said_of(answer)
    assert "another camera than the file of" in said
    assert "lens distortion" in said
    assert "the file has none" in said
    assert "known markers are not" not in said  # eight pictures tell it from that
    if answer:
        assert not answer.calibration.doubts
    found = reconstruct_verdict(answer, "mm", []).findings[0]
    assert (found.cause, "calibrate the camera" in found.next_step) == ("lens", True)


@pytest.mark.slow
def test_another_principal_point_is_no_focal_length_and_costs_no_control_point_its_name():
    result = made(OTHER_CENTRE, 6, 6)
    assert [d.cause for d in result.doubts] == ["lens"]
    assert "principal point at (32" in str(result.doubts[0])
    assert not result.calibration.doubts
    assert not [n for n in result.suspect if n.startswith("A")]


def test_another_aspect_ratio_of_few_pictures_is_named_though_the_primaries_are_hardly_recognised():
    answer = made(OTHER_ASPECT, 2, 4, step_deg=15)
    said = said_of(answer)
    assert "aspect ratio of 1.000" in said


@pytest.mark.slow
@pytest.mark.parametrize(("views", "step_deg"), [(2, 15.0), (3, 12.0)])
def test_few_pictures_without_the_lens_are_doubted_and_the_right_camera_is_unchecked(views, step_deg):
    wrong = made(NO_LENS, views, 4, step_deg)
    assert "lens distortion" in said_of(wrong)
    verdict = reconstruct_verdict(wrong, "mm", [])
    assert (verdict.word != "good", verdict.findings[0].cause) == (True, "lens")
    right = made(RIGHT, views, 4, step_deg)
    assert not right.warnings
    assert "taken as exact" in right.unchecked
    assert "mm" in right.unchecked
    verdict = reconstruct_verdict(right, "mm", [])
    assert verdict.word == "good"
    assert right.unchecked in verdict.reason


def test_the_right_camera_of_many_pictures_is_checked_and_six_primaries_check_each_other():
    result = made(RIGHT, 8, 6)
    assert not result.warnings
    assert result.unchecked == ""
    assert result.calibration.hardly_checked == ()
    assert "known marker" not in reconstruct_verdict(result, "mm", []).reason


def test_an_error_of_one_of_four_that_does_not_show_is_what_is_said_to_be_unchecked():
    result = made(RIGHT, 8, 4, wrong=7 * SIGMA)
    assert not result.warnings  # the others do not contradict it
    told = {str(result.markers.name[h.point]): h for h in result.calibration.hardly_checked}
    assert told["A3"].error > 7 * SIGMA
    truth = XYZ[np.linalg.norm(XYZ[:, None] - result.markers.xyz, axis=2).argmin(axis=0)]
    off = np.abs(result.markers.xyz - truth).max(axis=1) / result.markers.sigma.max(axis=1)
    assert off.max() > 4  # it moves others by far more than their sigmas
    assert off.max() < 1.5 * max(h.times for h in told.values())
    verdict = reconstruct_verdict(result, "mm", [])
    assert verdict.word == "good"  # a common job, and nothing in it is wrong as far as can be seen
    assert result.calibration.unchecked in verdict.reason
    assert "A3" in result.calibration.unchecked
    assert "a further known marker near" in verdict.next_step
    said = {u["what"]: u["words"] for u in record(result, primaries(4), (), "mm", None)["unchecked"]}
    assert said["primaries"] == result.calibration.unchecked


@pytest.mark.slow
def test_a_wrong_control_point_is_no_other_camera():
    result = made(RIGHT, 8, 6, wrong=0.3)
    assert not result.doubts
    assert [d.names for d in result.calibration.doubts] == [("A5",)]
    few = made(RIGHT, 3, 4, step_deg=12, wrong=0.3)
    said = said_of(few)
    assert "A3" in said
    assert "another camera than" not in said


@pytest.mark.slow
@pytest.mark.parametrize("bend", [0.1, 0.2])
def test_a_model_that_bent_between_the_pictures_is_the_reason_and_no_camera_is(bend):
    """By a tenth of a millimetre at the tip, 430 mm away."""
    answer = reconstruct(spots(8, 10.0, bend), RIGHT, primaries(6))
    assert answer
    found = reconstruct_verdict(answer, "mm", []).findings[0]
    assert (found.cause, "take all pictures of one state" in found.next_step) == ("scene", True)
    assert "markers stand elsewhere from 4 on than up to 3" in found.reason
    assert " mm (rms)" in found.reason
    assert "another camera" not in said_of(answer)
