"""Real dot boards from windmark's own detections; the tables are those of the benchmark `boards`."""

from __future__ import annotations

import importlib
from itertools import islice
from pathlib import Path

import pytest

# set, pictures, share of the table's dots that get an index
CASES = [("DICe discs", 4, 0.95), ("CSP dot wall", 1, 0.98), ("PIV-E plate", 1, 0.95)]


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
