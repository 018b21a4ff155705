"""Pictures of a printed dot board: its dots are where the camera sees them, with the size and the holes they have."""

import numpy as np
import pytest

from windmark import io
from windmark.app.cli import app
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.pipeline.simulate_board import RINGS, simulate_board
from windmark.pipeline.simulate_sequence import simulate_sequence
from windmark.synth.board_pictures import HOLE, INK, PAPER, WALL, Board, board_picture

CAMERA = Camera((320, 240), 500.0, 1.001, 158.0, 121.0, k1=-0.2, k2=0.1, p1=1e-3)


@pytest.fixture(scope="module")
def seen():
    board = Board.printed(np.random.default_rng(5), 6, 4, 3.0, scatter=0.02, rings=((2, 1),))
    lean = Pose.from_rotvec([0.4, -0.3, 0.2], np.zeros(3))
    pose = Pose.from_rotvec(np.zeros(3), [0.5, -0.3, 45.0]) @ lean @ Pose.from_rotvec(np.zeros(3), -board.middle)
    return board, pose, board_picture(board, CAMERA, pose)


def test_each_dot_is_where_its_disc_is_seen(seen):
    board, pose, picture = seen
    at = pose.apply(np.column_stack([board.xy.reshape(-1, 2), np.zeros(24)]))
    truth = imaged_ellipse(CAMERA, at, np.repeat(-pose.rotation[None, :, 2], 24, axis=0), board.radius)
    off, areas = [], []
    for xy, axes in zip(truth.xy, truth.axes_px, strict=True):
        x0, y0 = np.rint(xy).astype(int) - 14
        ink = np.clip((PAPER - picture[y0 : y0 + 29, x0 : x0 + 29]) / (PAPER - INK), 0, 1)
        rows, columns = np.mgrid[y0 : y0 + 29, x0 : x0 + 29]
        areas.append(ink.sum() / (np.pi * axes[0] * axes[1]))
        off.append([(ink * columns).sum() / ink.sum() - xy[0], (ink * rows).sum() / ink.sum() - xy[1]])
    ring = 1 * 6 + 2
    assert np.abs(off).max() < 0.02
    assert np.delete(areas, ring) == pytest.approx(np.ones(23), abs=0.01)
    assert areas[ring] == pytest.approx(1 - HOLE**2, abs=0.02)


def test_paper_ends_a_pitch_beyond_the_dots(seen):
    _, pose, picture = seen
    for corner, light in (((-2.4, -2.4), PAPER), ((-3.6, -3.6), WALL)):
        xy, _ = CAMERA.project(pose.apply(np.array([[*corner, 0.0]])))
        column, row = np.rint(xy[0]).astype(int)
        assert picture[row, column] == light


@pytest.mark.slow
def test_the_folder_holds_pictures_and_truth(tmp_path):
    cameras = simulate_board(tmp_path, 3, 3)
    assert sorted(p.name for p in (tmp_path / "board").iterdir()) == [
        f"{c}_{k}.tif" for c in ("left", "right") for k in (1, 2, 3)
    ]
    dots = io.read_markers(tmp_path / "truth" / "board.csv")
    assert np.allclose(dots.xyz[dots.name.tolist().index("c00r00")], 0)
    camera, pose = io.read_camera(tmp_path / "truth" / "poses" / "right_2.json")
    inside = camera.project(pose.apply(dots.xyz))[0]
    assert camera.in_image(inside).mean() > 0.97
    grey = io.read_grey(tmp_path / "board" / "right_2.tif")
    first = dots.name.tolist().index(f"c{1 - RINGS[0][0]:02d}r{1 - RINGS[0][1]:02d}")
    centre = np.rint(inside[first]).astype(int)
    assert grey[centre[1], centre[0]] < 0.3 * np.median(grey[centre[1] - 12 : centre[1] + 13, centre[0] - 12])
    assert set(cameras) == {"left", "right"}


@pytest.mark.parametrize(("make", "count"), [(simulate_board, 2), (simulate_sequence, 1)])
def test_too_few_are_refused_before_anything_is_written(tmp_path, make, count):
    with pytest.raises(UsageError, match="expected at least"):
        make(tmp_path, 1, count)
    assert list(tmp_path.iterdir()) == []


def test_only_one_kind_of_test_at_a_time(tmp_path):
    from typer.testing import CliRunner

    done = CliRunner().invoke(app, ["simulate", str(tmp_path / "x"), "--board", "4", "--sequence", "3"])
    assert done.exit_code == 2
    assert "--board, --sequence are different tests" in done.stderr
