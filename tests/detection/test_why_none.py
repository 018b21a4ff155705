"""An image without markers has a reason."""

import numpy as np
import pytest

import windmark.detection as wd

NOISE = np.random.default_rng(0).normal(100, 3, (64, 64))

DISC = np.hypot(*(np.indices((60, 60)) - 30.0)) > 4.0  # as a threshold leaves it


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.full((40, 40), np.nan), {"radius_px": 3.0}, "no pixel can be used"),
        (NOISE, {"radius_px": 3.0, "mask": np.zeros((64, 64), bool)}, "no pixel can be used"),
        (np.full((40, 40), 7, np.uint8), {"radius_px": 3.0}, "are equal"),
        (NOISE[:2], {"radius_px": 3.0}, "smaller than 3 x 3"),
        (NOISE[:10, :30], {"radius_px": 6.0}, "30 x 10 px is smaller than a marker of radius 6 px"),
        (NOISE, {}, "no radius prevails"),
        (DISC, {"radius_px": 4.0}, "only 2 grey levels"),
        (DISC, {}, "only 2 grey levels"),
        (np.add.outer(np.arange(64.0), np.arange(64.0)), {"radius_px": 4.0}, "nothing dark of this size"),
    ],
)
def test_what_is_wrong_is_said(image, options, words):
    assert len(wd.detect(image, **options)) == 0
    assert words in wd.why_none(image, **options)


def test_rejected_candidates_are_counted_with_their_reasons(draw):
    image = draw((90, 90), [(45.0, 45.0, 3.0)], depth=60.0) + np.random.default_rng(0).normal(0, 1, (90, 90))
    assert wd.why_none(image, radius_px=3.0) == ""
    words = wd.why_none(image, radius_px=3.0, min_depth=1000.0)
    assert "rejected" in words
    assert "1 shallower than the smallest depth asked for" in words


def test_an_image_of_64_pixels_and_one_with_missing_pixels(draw):
    image = draw((64, 64), [(20.3, 30.6, 3.0), (50.0, 12.2, 3.0)], blur=1) + np.random.default_rng(0).normal(
        0, 1, (64, 64)
    )
    image[40:] = np.nan
    image[5, ::7] = np.inf
    found = wd.detect(image, radius_px=3.0)
    np.testing.assert_allclose(np.sort(found.xy, axis=0), [[20.3, 12.2], [50.0, 30.6]], atol=0.1)


def test_the_setting_that_finds_markers_is_said(draw):
    discs = [(20.3 + 25 * i, 30.6 + 25 * j, 3.0) for i in range(5) for j in range(3)]
    image = 255.0 - draw((110, 150), discs, blur=1) + np.random.default_rng(0).normal(0, 1, (110, 150))
    assert "bright markers: 15 found with `--polarity bright`" in wd.why_none(image, radius_px=3.0)
    assert "bright markers: 15 found with `--polarity bright`" in wd.why_none(image)
    assert "other sizes: 15 found without `--radius`" in wd.why_none(image, radius_px=9.0, polarity="bright")
    assert "found with" not in wd.why_none(NOISE, radius_px=3.0)


def test_few_are_asked_about_too(draw):
    """Two dark specks beside fifteen bright discs, looked for as dark: the other polarity is named, with its number."""
    discs = [(20.3 + 25 * i, 30.6 + 25 * j, 3.0) for i in range(5) for j in range(3)]
    image = 255.0 - draw((110, 150), discs, blur=1) + np.random.default_rng(0).normal(0, 1, (110, 150))
    image -= 100.0 - draw((110, 150), [(32.0, 95.0, 3.0), (82.0, 95.0, 3.0)], depth=60.0)
    options = {"radius_px": 3.0, "polarity": "dark", "photometry": "additive"}
    found = wd.detect(image, **options)
    assert len(found) == 2
    assert wd.hint(image, options, len(found)) == "bright markers: 15 found with `--polarity bright`"
    assert wd.hint(image, {**options, "polarity": "bright"}, 15) == ""


def test_a_few_discs_among_many_spots_of_another_shape_are_not_taken_for_all(draw):
    """Balls that are lit from the side: the eight that look like discs were all that is there, without a word."""
    places = [(24.3 + 25 * i, 26.6 + 25 * j) for i in range(8) for j in range(5)]
    image = 120.0 - draw((150, 225), [(*p, 5.0) for p in places], blur=1, background=120.0, depth=60.0)
    y, x = np.mgrid[:150, :225]
    for cx, cy in places[8:]:
        image *= np.where(np.hypot(x - cx, y - cy) < 9, 1 + 0.7 * np.clip((x - cx) / 5, -1, 1), 1)
    image += 20 + np.random.default_rng(1).normal(0, 1, image.shape)
    options = {"radius_px": 5.0, "polarity": "bright"}
    look = wd.find_markers(image, **options)
    assert len(look.detections) == 8
    assert look.unlike == 32
    assert look.is_few
    words = wd.hint(image, options, len(look.detections))
    assert words == "spots that are no blurred discs: 40 found with `--refine bowl`"


def test_a_few_letters_beside_discs_are_no_reason_to_doubt(draw):
    discs = [(20.3 + 25 * i, 30.6 + 25 * j, 3.0) for i in range(5) for j in range(3)]
    image = draw((110, 150), discs, blur=1) + np.random.default_rng(0).normal(0, 1, (110, 150))
    image[95:101, 40:46] = image[95:101, 80:86] = 60.0  # squares
    look = wd.find_markers(image, radius_px=3.0)
    assert len(look.detections) == 15
    assert 1 <= look.unlike <= 2
    assert not look.is_few
