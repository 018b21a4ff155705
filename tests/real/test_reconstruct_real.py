"""The dot wall: 4094 equal dots in four of five views linked from four named ones."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def proof(shared_data):
    """The benchmark's functions."""
    sys.path.insert(0, str(BENCHMARKS))
    spec = importlib.util.spec_from_file_location("reconstruct_real", BENCHMARKS / "reconstruct_real.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_wall_from_four_named_dots(proof):
    data = proof.wall(which=slice(4))
    poses, cov = proof.first_poses(data)
    found = proof.associate(data.detections, data.camera, poses, pose_cov=cov)
    row = proof.counts(data, found.tracks, found.xyz)
    assert row["linked_percent"] >= 99.5
    assert row["wrong"] <= 0.0005 * row["links"]
    assert row["double"] <= 2
    assert row["rms_x_mm"] < 0.12
    assert row["rms_y_mm"] < 0.12
    assert row["rms_z_mm"] < 0.25
