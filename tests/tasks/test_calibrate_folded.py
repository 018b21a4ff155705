"""A board without marks that is folded, or two boards edge to edge: that is the reason, and a flat one has none."""

import numpy as np
import pytest

from windmark.calibration import BoardView, NotCalibrated
from windmark.geometry import Camera, Pose
from windmark.pipeline.verdict.network import calibrate_verdict
from windmark.scene import Detections
from windmark.tasks.calibrate import Board, BoardPicture, CalibrateSettings, calibrate_dots

SIZE, COLUMNS, ROWS, PITCH, FOLD = (2000, 1500), 12, 8, 5.0, 7
CAMERA = Camera(SIZE, 2600.0, 1.0, 1010.0, 745.0, k1=-0.1)
SETTINGS = CalibrateSettings(None, ("focal_px", "cx", "cy", "k1"))


def board(fold_deg):
    """(N, 3) dots, from the column `FOLD` on turned about the line before it."""
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    xyz = np.column_stack([column.ravel(), row.ravel(), np.zeros(column.size)]) * PITCH
    behind, edge = column.ravel() >= FOLD, (FOLD - 0.5) * PITCH
    far = xyz[behind, 0] - edge
    xyz[behind, 0], xyz[behind, 2] = (
        edge + far * np.cos(np.radians(fold_deg)), -far * np.sin(np.radians(fold_deg))
    )  # fmt: skip
    return xyz


def calibrated(fold_deg, count=6):
    rng, xyz, pictures = np.random.default_rng(33), board(fold_deg), []
    middle = Pose(np.eye(3), [-PITCH * (COLUMNS - 1) / 2, -PITCH * (ROWS - 1) / 2, 0])
    for k in range(count):
        around, tilt = 2 * np.pi * k / count, np.radians(20 + 6 * (k % 3))
        turn = Pose.from_rotvec([0, 0, (0.1, 3.0, 1.5, -0.2, -1.7, 0.3)[k]], np.zeros(3))
        lean = Pose.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0]), [0, 0, 115 + 5 * (k % 4)])
        xy = CAMERA.project((lean @ turn @ middle).apply(xyz))[0]
        spots = Detections.make(xy + rng.normal(0, 0.05, xy.shape), sigma_px=0.05, radius_px=18.0)
        pictures.append(BoardPicture(f"p{k}", "camera", SIZE, spots))
    return calibrate_dots(pictures, Board(PITCH), {"camera": CAMERA}, SETTINGS)


@pytest.mark.parametrize(
    "fold_deg", [1.0, pytest.param(6.0, marks=pytest.mark.slow), pytest.param(-6.0, marks=pytest.mark.slow)]
)
def test_a_folded_board_is_the_reason(fold_deg):
    out, pictures = calibrated(fold_deg)
    assert all(isinstance(p.board, BoardView) for p in pictures)
    verdict = calibrate_verdict(out, "mm")
    said = next(f.reason for f in verdict.findings if f.cause == "table")
    assert "the dots are not on one plane" in said
    assert f"{abs(fold_deg):.2g} degrees apart" in said
    assert "5 columns at one side" in said or "rows" in said
    if isinstance(out, NotCalibrated):
        assert out.cause == "not_flat"
        assert "one flat board" in verdict.next_step


def test_a_flat_board_is_none():
    out, _ = calibrated(0.0)
    assert out, out.reason
    assert not out.result.doubts
