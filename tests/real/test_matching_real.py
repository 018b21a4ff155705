"""Registration of real pictures from windmark's own spots: right or refused, never shifted or turned."""

from __future__ import annotations

import importlib.util
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from windmark.registration import register

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def cases(shared_data):
    """The pictures of the benchmark, with their truth."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        spec = importlib.util.spec_from_file_location("_matching_real_cases", BENCHMARKS / "_matching_real_cases.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(BENCHMARKS))
    return module


def answer(case, **options):
    """What register says; a registration has no wrong label."""
    result = register(case.detections, case.markers, case.camera, **{"max_time_s": 2.0, **case.options, **options})
    if result:
        match = result.matching
        offset = np.linalg.norm(case.detections.xy[match.detection] - case.true_xy[match.marker], axis=1)
        assert (offset < np.broadcast_to(case.gate_px, len(case.markers))[match.marker]).all()
    return result


def test_camera_5_among_hundreds_of_false_spots_in_any_order(cases):
    loose = [case for case in cases.nasa() if "1.6, no other" in case.name or "random" in case.name]
    assert max(len(case.detections) for case in loose) > 200
    results = [answer(case) for case in loose]
    ranked = [result for case, result in zip(loose, results, strict=True) if "random" not in case.name]
    assert ranked
    assert all(len(result.matching) == 15 for result in ranked)


def test_the_regular_two_level_plate_is_ambiguous_until_turn_and_shift_are_given(cases):
    wanted = {"seen discs": False, "plate": False, "plate, prior": False, "plate, a label": False, "plate, both": True}
    for case in islice(cases.plate(), len(wanted)):
        result = answer(case)
        assert bool(result) == wanted[case.name.split(", ", 2)[2]]
        if not result:
            assert result.cause == "ambiguous"


def test_the_regular_sheet_with_rough_coordinates(cases):
    cold, prior, label, exact = islice(cases.sheet(), 4)
    assert answer(cold).cause == "ambiguous"
    for case, least in ((prior, 95), (label, 95), (exact, 97)):
        result = answer(case)
        assert result, result.reason
        assert len(result.matching) >= least
