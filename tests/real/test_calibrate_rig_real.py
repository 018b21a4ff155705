"""The DICe stereo rig from the pictures of its printed dot board, in one command."""

import sys
from pathlib import Path

import pytest

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "dice-stereo-dots"
BLOCK = 4  # the discs of 46 px are as good at a quarter of the size, and found in a tenth of the time


@pytest.fixture
def bench(monkeypatch):
    if not DATA.is_dir():
        pytest.skip("real pictures (dice-stereo-dots) are not here")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    pytest.importorskip("cv2")
    import calibration_rig

    yield calibration_rig
    sys.modules.pop("calibration_rig", None)


def test_both_cameras_and_their_pose_to_each_other(bench, tmp_path):
    """Published: nothing but the pitch; with the grid held the residuals are some 0.7 px, so the print is measured."""
    pairs = bench.smaller(tmp_path, BLOCK)
    images = [p for k in range(0, 28, 4) for p in pairs[k : k + 2]]  # every second one
    r = bench.figures_of(images, BLOCK, ("--no-reject",), tmp_path / "out")
    assert r["views"] == 14
    assert r["marks"] > 1150
    assert r["rms_left_px"] <= 0.08  # 2-D, in pixels of the full pictures, all marks
    assert r["rms_right_px"] <= 0.08
    assert r["distance_mm"] == pytest.approx(89.5, abs=0.5)
    assert r["angle_deg"] == pytest.approx(27.57, abs=0.2)
    assert r["split"] < 3  # halves of three and four pairs
    assert (tmp_path / "out" / "rig.json").is_file()
