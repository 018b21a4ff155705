"""An image without markers has a reason."""

import numpy as np
import pytest

import windmark.detection as wd

NOISE = np.random.default_rng(0).normal(100, 3, (64, 64))


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.full((40, 40), np.nan), {"radius_px": 3.0}, "no pixel can be used"),
        (NOISE, {"radius_px": 3.0, "mask": np.zeros((64, 64), bool)}, "no pixel can be used"),
        (np.full((40, 40), 7, np.uint8), {"radius_px": 3.0}, "are equal"),
        (NOISE[:2], {"radius_px": 3.0}, "smaller than 3 x 3"),
        (NOISE[:10, :30], {"radius_px": 6.0}, "30 x 10 px is smaller than a marker of radius 6 px"),
        (NOISE, {}, "no radius prevails"),
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
