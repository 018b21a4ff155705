"""2D alignment of real pictures: plates that move, a building that sways."""

import numpy as np
import pytest

import windmark as wm
from windmark import io


def aligned(folder, reference, image, **options):
    return wm.align_images(*(io.read_grey(folder / name) for name in (image, reference)), **options)


@pytest.mark.parametrize(
    ("camera", "pairs", "held_out_px", "motion_px"),
    # Camera 3 sees the two levels of the plate 20 degrees off: parallax, most with the disc at the border; see
    # benchmarks/alignment_real.py.
    [("1", 61, 0.035, 3.8), ("3", 28, 0.15, 20.3)],
)
def test_the_plate_of_the_piv_challenge_in_two_places(shared_data, camera, pairs, held_out_px, motion_px):
    folder = shared_data / "piv-challenge-e-calib" / f"camera{camera}"
    answer = aligned(folder, f"E_camera_{camera}_z_4.tif", f"E_camera_{camera}_z_7.tif", polarity="bright")
    assert answer, answer.reason
    assert len(answer.pairs) >= pairs
    assert answer.held_out_px < held_out_px
    assert np.hypot(*answer.shift_px.T).max() == pytest.approx(motion_px, abs=0.3)


def test_a_building_that_sways_by_sixty_pixels(shared_data):
    """Rows of seven discs, each moved by its own amount; nothing but the pictures is given."""
    folder = shared_data / "frame-sway-1cam" / "images"
    answer = aligned(folder, "IMG00001.jpg", "IMG00072.jpg", radius_px=(8, 10))
    assert answer, answer.reason
    assert len(answer.pairs) == 28
    order = np.argsort(answer.reference_xy[:, 1])
    rows = answer.shift_px[order].reshape(4, 7, 2)
    assert np.abs(rows[3]).max() < 2  # the base stands
    assert np.median(np.abs(rows[0, :, 0])) > 40
    assert answer.held_out_px < 1.0
