"""The verdict on 2D alignments in which markers stand still: walls, a torn picture, a part that does not move."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

import windmark as wm
from windmark.pipeline.align2d.outputs import record_of
from windmark.pipeline.same_picture import shown_by
from windmark.pipeline.verdict import DOUBTFUL, GOOD
from windmark.pipeline.verdict.aligned import align_verdict
from windmark.scene import Detections

BLANK = np.zeros((1000, 1000), np.float32)
NOISE = 0.02


def verdict_of(moved, standing, rng, *, copied=0, named=False):
    """Markers above that move and markers below that stand still, of which some are the reference's own."""
    x = np.vstack([rng.uniform([50, 50], [950, 450], (moved, 2)), rng.uniform([50, 500], [950, 950], (standing, 2))])
    y = x + rng.normal(0, NOISE, x.shape)
    y[:moved] += [3.0, -1.0] + 1e-3 * (x[:moved] - 500)
    if copied:
        y[-copied:] = x[-copied:]
    a, b = (Detections.make(p, cov=np.tile(NOISE**2 * np.eye(2), (len(p), 1, 1))) for p in (x, y))
    pairs = np.stack([np.arange(len(x))] * 2, axis=1)
    answer = wm.align_images(BLANK, BLANK, detections=b, reference_detections=a, pairs=pairs)
    assert len(answer.still) == standing
    item = SimpleNamespace(alignment=answer, image=None, path=Path("on.tif"), seconds=0.1)
    reference = SimpleNamespace(named=object() if named else None, image=BLANK)
    return align_verdict([record_of(item, reference)], {})


def test_most_markers_standing_still_are_no_walls_without_a_word():
    """22 of 35 were left out as walls, what the 13 did was laid over them, 60 sigmas off, and that was good."""
    verdict = verdict_of(13, 22, np.random.default_rng(1))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "one-sided")
    assert "22 of 35 markers stand still (at x" in verdict.reason
    assert "--keep-still" in verdict.next_step


def test_a_part_that_is_the_references_is_named_as_a_copy_and_where():
    verdict = verdict_of(20, 12, np.random.default_rng(2), copied=10)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "file")
    assert "10 of 32 markers" in verdict.reason
    assert "a copy of it" in verdict.reason


def test_walls_are_left_out_in_silence():
    for seed in range(5):
        assert verdict_of(25, 12, np.random.default_rng(seed)).word == GOOD
    # Places that were clicked are whole pixels: the same ones twice are no copy.
    assert verdict_of(25, 12, np.random.default_rng(6), copied=12, named=True).word == GOOD


def test_a_part_that_moved_by_itself_is_named_with_its_place_and_the_map_of_sigmas_has_it():
    """Five of sixty were "rejected", fewer than a tenth, and the flap was 6 px off at a sigma of 0.002 px."""
    rng = np.random.default_rng(3)
    x = rng.uniform([50, 50], [950, 950], (60, 2))
    flap = x[:, 0] > 870
    y = x + np.array([3.0, -1.0]) + np.outer(flap, [0.0, 6.0]) + rng.normal(0, NOISE, x.shape)
    a, b = (Detections.make(p, sigma_px=NOISE) for p in (x, y))
    answer = wm.align_images(BLANK, BLANK, detections=b, reference_detections=a)
    item = SimpleNamespace(alignment=answer, image=None, path=Path("on.tif"), seconds=0.1)
    row = record_of(item, SimpleNamespace(named=None, image=BLANK))
    assert [part["markers"] for part in row["apart"]] == [flap.sum()]
    verdict = align_verdict([row], {})
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "marker")
    assert f"{flap.sum()} markers that are next to each other (at x 8" in verdict.reason
    assert "moved by 6 px against the others" in verdict.reason
    assert len(verdict.findings) == 1  # that they were left out is not said once more


def test_a_picture_that_is_the_reference_is_named_and_two_exposures_are_not():
    """All its ratios were exactly 1, and that was good: "at most 1e-14 px RMS from where the others say"."""
    rng = np.random.default_rng(4)
    off, on = (rng.normal(1000, 5, (60, 80)).astype(np.uint16) for _ in range(2))
    contents = {"off.tif": shown_by(off), "on.tif": shown_by(on), "copy.tif": shown_by(off.copy())}
    verdict = align_verdict([], {}, contents)
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "file")
    (found,) = verdict.findings
    assert found.where == "copy.tif"
    assert "it is the same picture as off.tif, pixel by pixel" in found.reason
    # Pictures that show nothing are told as such, not as each other's copies.
    assert align_verdict([], {}, {"a": shown_by(np.zeros((6, 8))), "b": shown_by(np.zeros((6, 8)))}).word == GOOD
