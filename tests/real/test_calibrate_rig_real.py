"""The DICe stereo rig from the pictures of its printed dot board, in one command."""

import pytest


def test_both_cameras_and_their_pose_to_each_other(board_rig):
    """Published: nothing but the pitch; with the grid held the residuals are some 0.7 px, so the print is measured."""
    r = board_rig.figures
    assert r["views"] == 14
    assert r["marks"] > 1150
    assert r["rms_left_px"] <= 0.08  # 2-D, in pixels of the full pictures, all marks
    assert r["rms_right_px"] <= 0.08
    assert r["distance_mm"] == pytest.approx(89.5, abs=0.5)
    assert r["angle_deg"] == pytest.approx(27.57, abs=0.2)
    assert r["split"] < 3  # halves of three and four pairs
    assert (board_rig.folder / "rig.json").is_file()
