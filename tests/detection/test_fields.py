"""Pictures of two fields, taken one after the other: told where markers moved between them, and only there."""

import io

import numpy as np
import pytest
from PIL import Image

from windmark import detect
from windmark.detection.fields import SURE, field_shift
from windmark.synth import marker_sheet


def sheet(seed=3, **options):
    """A picture of 42 markers, and their places."""
    given = {"radius_px": 4.0, "grid": (7, 6), "pitch_px": 48, "blur_passes": 1, "noise": 0.02, "level": 150.0,
             "depth": 90.0, "max_tilt_deg": 40.0}  # fmt: skip
    return marker_sheet(np.random.default_rng(seed), **(given | options))[0]


def combed(image, dx, dy):
    """Rows of odd number of the same scene a moment later."""
    from scipy.ndimage import shift

    out = image.copy()
    out[1::2] = shift(image, (dy, dx), order=3, mode="nearest")[1::2]
    return out


@pytest.mark.parametrize("move", [(1.3, 0.0), (0.0, 1.3), (-0.6, 0.8), (0.25, 0.0)])
def test_a_move_between_the_fields_is_measured(move):
    image = combed(sheet(), *move)
    spots = detect(image, radius_px=4.0)
    found = field_shift(image, spots.xy, 4.0)
    np.testing.assert_allclose(found.xy, move, atol=0.12)
    assert found.sure_px == pytest.approx(np.hypot(*move), abs=0.12)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["plain", "sharp", "two taps", "small"])
def test_whole_frames_have_none(seed, kind):
    """Two taps: rows of odd number are read with another gain and black level."""
    radius = 2.5 if kind == "small" else 4.0
    image = sheet(seed, radius_px=radius, blur_passes=0 if kind == "sharp" else 1)
    if kind == "two taps":
        image[1::2] = 1.03 * image[1::2] + 2.0
    spots = detect(image, radius_px=radius)
    found = field_shift(image, spots.xy, radius)
    assert abs(found.xy[0]) < 0.03
    assert found.sure_px < 0.1


def test_few_spots_and_borders_say_nothing():
    image = sheet()
    spots = detect(image, radius_px=4.0)
    for xy in (spots.xy[:5], np.zeros((0, 2)), np.zeros((20, 2)), np.full((9, 2), 4000.0)):
        found = field_shift(image, xy, 4.0)
        assert np.isnan(found.xy).all()
        assert found.sure_px == 0.0
    flat = field_shift(np.full_like(image, 7.0), spots.xy, 4.0)
    assert flat.sure_px == 0.0
    assert field_shift(image, spots.xy, np.nan).sure_px == 0.0


def test_dead_pixels_take_their_windows_out():
    """Of an infrared picture they are NaN: they had ended the job in an error of linear algebra."""
    image = combed(sheet(), 1.0, 0.0)
    spots = detect(image, radius_px=4.0)
    some, every = image.copy(), image.copy()
    for x, y in np.rint(spots.xy[:12]).astype(int).tolist():
        some[y, x + 3] = np.nan
    every[::3] = np.nan
    assert field_shift(some, spots.xy, 4.0).xy[0] == pytest.approx(1.0, abs=0.12)
    assert field_shift(every, spots.xy, 4.0).sure_px == 0.0
    assert SURE > 4


def compressed(image, quality, off):
    """The picture from a JPEG whose blocks begin ``off`` pixels before it."""
    whole = np.pad(np.clip(np.rint(image), 0, 255).astype(np.uint8), ((off, 8), (off, 8)), mode="edge")
    file = io.BytesIO()
    Image.fromarray(whole).save(file, "JPEG", quality=quality)
    height, width = image.shape
    return np.asarray(Image.open(file))[off : off + height, off : off + width]


@pytest.mark.parametrize("quality", [15, 20, 30, 50])
@pytest.mark.parametrize(("radius", "off"), [(3.0, 0), (4.0, 3), (6.0, 1)])
def test_strong_compression_is_no_second_field(radius, off, quality):
    """The last row of a block of 8 is not the mean of its neighbours: that was a shift of 0.2 to 0.4 px."""
    image = compressed(sheet(5, radius_px=radius, pitch_px=int(12 * radius) + 1), quality, off)
    assert field_shift(image, detect(image, radius_px=radius).xy, radius).sure_px < 0.1


def test_fields_are_seen_through_a_mild_compression():
    image = compressed(combed(sheet(), 0.0, 1.3), 90, 2)
    assert field_shift(image, detect(image, radius_px=4.0).xy, 4.0).sure_px == pytest.approx(1.3, abs=0.15)
