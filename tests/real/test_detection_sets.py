"""The detector on real images with truth: nothing missed that can be found, few false, centres near the truth.

The truth is made by `benchmarks/_real_truth.py` (thresholds, published tables, a plain fit), which also states the
radii; the full table over all views is `benchmarks/detection_real.py`.
"""

from __future__ import annotations

import importlib
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from windmark.detection import detect


@pytest.fixture
def tools(monkeypatch):
    """The truth and the pairing of the benchmarks."""
    pytest.importorskip("cv2")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module("_real_truth"), importlib.import_module("_scoring")


# set, view, share of the discs that has to be found, false markers allowed, median distance to the truth in px
CASES = [
    ("NASA camera 5", 0, 1.0, 0, 0.05),
    ("DICe discs", 0, 1.0, 0, 0.4),
    ("DBAT sheet", 0, 1.0, 8, 0.4),
    ("CSP dot wall", 0, 1.0, 12, 0.1),
    ("PIV-E plate", 0, 1.0, 1, 0.4),
    ("V-block", 0, 1.0, 0, 0.1),
    ("MyPTV ridge", 0, 0.97, 8, 0.2),
    ("Frame sway", 0, 1.0, 5, 0.3),
]


@pytest.mark.parametrize(("name", "number", "recall", "false_max", "median_px"), CASES, ids=[c[0] for c in CASES])
def test_discs_are_found(shared_data, tools, name, number, recall, false_max, median_px):
    truth, scoring = tools
    one = truth.SETS[name]
    view = next(islice(one.views(shared_data / one.folder), number, None))
    found = detect(view.image, radius_px=one.radius_px, polarity=view.polarity)
    pairs = scoring.pair(found.xy, view.true, view.gate_px)
    rest = found.xy[pairs.false]
    if len(view.other) and len(rest):
        rest = rest[np.hypot(*(rest[:, None] - view.other).transpose(2, 0, 1)).min(axis=1) > view.other_gate_px]
    assert len(pairs.true) >= recall * len(view.true)
    assert len(rest) <= false_max
    error = found.xy[pairs.found] - view.true[pairs.true]
    assert np.median(np.hypot(*error.T)) < median_px
    assert np.abs(np.median(error, axis=0)).max() < median_px
    assert (found.depth[pairs.found] > 0).all()
