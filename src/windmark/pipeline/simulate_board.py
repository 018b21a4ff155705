"""Pictures of a printed dot board by two cameras as files: what `calibrate --board` wants, and beside it the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from windmark import io
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet
from windmark.synth import Sensor
from windmark.synth.board_pictures import Board, board_picture

SIZE_PX = (800, 600)
COLUMNS, ROWS, PITCH = 13, 9, 3.5
RINGS = ((4, 4), (9, 4), (4, 7))
"""Dots with a hole: `MARKS`."""
MARKS = "holes:0,0:5,0:0,3"
"""Them for `--board-marks`."""
SCATTER = 0.003
"""mm that the printer is off, 1 sigma along each axis."""
FOCAL_PX, DISTANCE = 1100.0, 105.0
LEAST = 3
LEFT, RIGHT = "left", "right"


def simulate_board(folder: Path, seed: int, count: int = 8) -> dict[str, Camera]:
    """Take pictures of a printed board and write them into ``folder`` (existing, empty or not).

    Files: board/left_1.tif, board/right_1.tif and so on (one pair an instant, the cameras do not move against each
    other), and truth/left.json, truth/right.json (cameras), truth/rig.json (right from left), truth/board.csv (where
    each dot is on the board, from the first ring) and truth/poses/left_1.json.

    Returns
    -------
    camera's name -> the camera

    Raises
    ------
    UsageError
        For fewer than three instants.
    """
    if count < LEAST:
        raise UsageError(f"board: expected at least {LEAST}, got {count}")
    rng = np.random.default_rng([seed, 21])
    board = Board.printed(rng, COLUMNS, ROWS, PITCH, scatter=SCATTER, rings=RINGS)
    cameras = {LEFT: _camera(rng), RIGHT: _camera(rng)}
    turn = Pose.from_rotvec([0.0, np.radians(-18.0), 0.02], np.zeros(3))
    middle = np.array([0.0, 0.0, DISTANCE])
    beside = Pose(turn.rotation, middle - turn.rotate(middle[None])[0])  # both look at the same place
    from_left = {LEFT: Pose.identity(), RIGHT: beside}
    for name in ("board", "truth", "truth/poses"):
        (folder / name).mkdir(exist_ok=True)
    for k in range(count):
        held = _held(rng, k, count, board)
        for c, (name, camera) in enumerate(cameras.items()):
            pose = from_left[name] @ held
            light = board_picture(board, camera, pose)
            noise, bad = np.random.default_rng([seed, 22, k, c]), np.random.default_rng([seed, 23, c])
            image = Sensor().expose(light, noise, bad)
            io.write_image(folder / "board" / f"{name}_{k + 1}.tif", image)
            named = pose @ Pose.from_rotvec(np.zeros(3), [*board.xy[RINGS[0][1], RINGS[0][0]], 0.0])
            io.write_camera(folder / "truth" / "poses" / f"{name}_{k + 1}.json", camera, named, unit="mm")
    for name, camera in cameras.items():
        io.write_camera(folder / "truth" / f"{name}.json", camera)
    io.write_rig(folder / "truth" / "rig.json", from_left, unit="mm")
    _write_dots(folder / "truth" / "board.csv", board)
    return cameras


def _camera(rng: np.random.Generator) -> Camera:
    width, height = SIZE_PX
    return Camera(
        SIZE_PX, FOCAL_PX * rng.uniform(0.98, 1.02), 1.0002, (width - 1) / 2 + rng.normal(0, 8),
        (height - 1) / 2 + rng.normal(0, 8), k1=-0.12 + rng.normal(0, 0.01), k2=0.05, p1=2e-4, p2=-1e-4,
    )  # fmt: skip


def _held(rng: np.random.Generator, k: int, count: int, board: Board) -> Pose:
    """The board in the hand: leaning to another side each time, by 15 to 32 degrees, rolled in some pictures."""
    around = 2 * np.pi * k / count + rng.normal(0, 0.2)
    lean = np.radians(rng.uniform(15, 32)) * np.array([np.cos(around), np.sin(around), 0.0])
    roll = np.radians((k % 3 - 1) * rng.uniform(10, 25))
    centred = Pose.from_rotvec(np.zeros(3), -board.middle)
    turned = Pose.from_rotvec(lean, np.zeros(3)) @ Pose.from_rotvec([0.0, 0.0, roll], np.zeros(3))
    place = np.array([*rng.normal(0, 1.5, 2), DISTANCE * rng.uniform(1.0, 1.12)])
    return Pose.from_rotvec(np.zeros(3), place) @ turned @ centred


def _write_dots(path: Path, board: Board) -> None:
    """Names count from the first mark, as `--board-marks` has them: c00r00 is the first ring."""
    columns, rows = np.meshgrid(np.arange(COLUMNS) - RINGS[0][0], np.arange(ROWS) - RINGS[0][1])
    names = [f"c{c:02d}r{r:02d}" for c, r in zip(columns.ravel(), rows.ravel(), strict=True)]
    first = board.xy[RINGS[0][1], RINGS[0][0]]
    xyz = np.column_stack([(board.xy - first).reshape(-1, 2), np.zeros(len(names))])
    io.write_markers(path, MarkerSet.make(names, xyz, radius=board.radius, length_unit="mm"), length_unit="mm")
