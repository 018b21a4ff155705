"""Real pictures and tables for the tests of this folder; they live beside the checkout, not in it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import pytest

SHARED_DATA = Path(__file__).parents[2].parent / "shared" / "data"


def pytest_collection_modifyitems(items):
    """Real pictures are large: all tests of this folder are slow."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data sets; the test is skipped where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"{SHARED_DATA} is absent: real-data tests need ../shared/data")
    return SHARED_DATA


class BoardRig(NamedTuple):
    """What came of the calibration of DICe's rig by seven pairs of pictures so many times smaller, and its folder."""

    block: int
    figures: dict[str, float]
    folder: Path


@pytest.fixture(scope="session")
def board_rig(shared_data, made_once) -> BoardRig:
    """From every second pair; the discs of 46 px are as good at a quarter of the size, and found in a tenth of the
    time.
    """
    if not (shared_data / "dice-stereo-dots").is_dir():
        pytest.skip("real pictures (dice-stereo-dots) are not here")
    pytest.importorskip("cv2")
    block = 4

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
            import calibration_rig as rig
        images = [p for k in range(0, 28, 4) for p in rig.smaller(folder, block, slice(k, k + 2))]
        figures = rig.figures_of(images, block, ("--no-reject",), folder / "out")
        (folder / "figures.json").write_text(json.dumps(figures), encoding="utf-8")

    made = made_once("board-rig", make)
    return BoardRig(block, json.loads((made / "figures.json").read_text(encoding="utf-8")), made / "out")
