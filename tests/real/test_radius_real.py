"""The radius that is found without being told, on one view of every real set; the truth is that of the benchmarks."""

from __future__ import annotations

import importlib
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from windmark.detection import estimate_radius

# set, view, radius of most of its discs
CASES = [
    ("NASA camera 5", 0, 2.6),
    ("DICe discs", 0, 48.0),
    ("DBAT sheet", 0, 16.0),
    ("CSP dot wall", 0, 2.0),
    ("PIV-E plate", 0, 18.9),
    ("V-block", 2, 3.5),
    ("MyPTV ridge", 0, 1.6),
    ("Frame sway", 1, 10.6),
]


@pytest.mark.parametrize(("name", "number", "radius"), CASES, ids=[c[0] for c in CASES])
def test_radius_is_found(shared_data, monkeypatch, name, number, radius):
    pytest.importorskip("cv2")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    one = importlib.import_module("_real_truth").SETS[name]
    folder = shared_data / one.folder
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    view = next(islice(one.views(folder), number, None))
    got = estimate_radius(view.image, view.polarity)
    assert np.abs(np.log(np.array(got.radii_px) / radius)).min() < 0.2
    assert 0.9 * len(view.true) <= got.spots <= 1.1 * len(view.true)
