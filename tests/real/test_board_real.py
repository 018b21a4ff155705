"""Real dot boards from windmark's own detections; the tables are those of the benchmark `boards`."""

from __future__ import annotations

import importlib
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from windmark.calibration import start_focal

# set, pictures, share of the table's dots that get an index
CASES = [("DICe discs", 2, 0.95), ("CSP dot wall", 1, 0.98), ("PIV-E plate", 1, 0.95)]


@pytest.mark.parametrize(("name", "pictures", "share"), CASES, ids=[c[0] for c in CASES])
def test_every_index_is_that_of_the_table(shared_data, monkeypatch, name, pictures, share):
    pytest.importorskip("cv2")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    boards = importlib.import_module("boards")
    one = boards.SETS[name]
    folder = shared_data / one.folder
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    for view in islice(one.views(folder), pictures):
        count = boards.real_view(name, view)
        assert count["found"] == 1
        assert count["wrong"] == 0
        assert count["right"] >= share * count["dots"]


def test_focal_length_of_the_published_sheet_from_nothing(shared_data, monkeypatch):
    """DBAT's 2074 marks: 7.457 mm on 7.25301 mm and 2272 px, with a lens that k1 alone does not describe."""
    pytest.importorskip("cv2")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    folder = shared_data / "dbat-camcal"
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    points = importlib.import_module("_real_truth").photomodeler_points(folder / "photomodeler_3dpts.txt")
    marks = np.loadtxt(folder / "markpts.txt", delimiter=",", comments="#")
    marks = marks[np.isin(marks[:, 1].astype(int), list(points))]
    views = [
        (np.array([points[int(k)] for k in mine[:, 1]]), mine[:, 2:4] - 0.5)
        for mine in (marks[marks[:, 0] == image] for image in np.unique(marks[:, 0]))
    ]
    got = start_focal(views, (2272, 1704))
    assert got, got.reason
    assert got.focal_px == pytest.approx(7.457 / 7.25301 * 2272, rel=0.005)
    assert got.rms_px < 0.5
