"""Deformation on real pictures: a plate moved by known steps, a swaying building."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def bench(monkeypatch, shared_data):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    pytest.importorskip("cv2")
    import deformation_real

    yield deformation_real
    sys.modules.pop("deformation_real", None)


def need(folder):
    if not folder.is_dir():
        pytest.skip(f"real pictures ({folder.name}) are not here")


def test_plate_steps_of_one_millimetre_from_the_labels_of_the_set(bench):
    """Each step with cameras calibrated on the other five positions."""
    need(bench.PLATE)
    steps = bench.plate_steps(bench.plate_marks(found=False))
    r = bench.plate_figures(steps)
    assert r["discs"] == 16
    assert r["mean_worst"] <= 0.02
    assert r["single_in_plane"] <= 0.02
    assert r["single_depth"] <= 0.1
    assert 0.8 < r["z"] < 1.3  # errors of single discs against their stated sigma
    assert r["body_worst"] <= 0.02
    assert r["turn_worst_deg"] <= 0.1


def test_discs_of_a_swaying_building_are_followed_through_jumps(bench):
    """The hardest pictures: 34 px after a gap of 55 frames, then steps of 9 and 51 px from frame to frame."""
    need(bench.SWAY)
    pictures = bench.sway_pictures()
    pictures = pictures[:1] + pictures[30:34]
    followed, status = bench.sway_followed(pictures)
    r = bench.sway_figures(followed, bench.sway_chained(pictures), status)
    assert (r["frames_lost"], r["discs_lost"], r["swapped"]) == (0, 0, 0)
    assert r["most_step"] > 50
    assert r["apart_rms"] < 0.2
    # The view changes the distances of neighbours; less each row's perspective they are kept.
    assert r["gap_worst"] > 0.5
    assert r["gap_less_perspective_worst"] < 0.2
    assert bench.row_gaps(followed, None)[0].max() < 0.1  # the base stands still


def test_a_board_before_a_stereo_rig_stays_rigid(bench, tmp_path, board_rig):
    """Calibrated on seven pairs of small pictures; what a rigid motion leaves of the discs in three others."""
    import calibration_rig
    import deformation_board as board

    pictures = [p for k in (2, 6, 10) for p in calibration_rig.smaller(tmp_path, board_rig.block, slice(k, k + 2))]
    r = board.board_figures(tmp_path, board_rig.block, board_rig.folder, pictures)
    assert r["pairs"] == 3
    assert r["discs"] > 65
    assert r["moved_mm"] > 1.5
    assert r["left_rms_mm"] <= 0.004
    assert r["distance_spread_mm"] <= 0.001
