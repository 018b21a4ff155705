"""Whether a large picture fits is seen by a part of its rows, as packing all of it would say."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from windmark.app import photo
from windmark.app.photo import QUALITIES, _too_large, _url, preview

MOST = 44_000


def pictures():
    rng = np.random.default_rng(5)
    noise = rng.normal(0, 1, (800, 1000))
    ramp = np.add.outer(np.linspace(0, 90, 800), np.linspace(0, 90, 1000))
    for level in (0.0, 1.0, 3.0, 30.0):
        yield np.clip(ramp + level * noise + 40, 0, 255).astype(np.uint8)
        yield np.clip(ramp + 10 * level * gaussian_filter(noise, 4.0) + 40, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("quality", QUALITIES)
def test_the_rows_say_what_the_picture_would(quality):
    sizes = []
    for image in pictures():
        whole = len(_url(Image.fromarray(image), "webp", quality=quality, method=1))
        sizes.append(whole)
        said = _too_large(Image.fromarray(image), quality, MOST)
        assert said if whole > 1.7 * MOST else not said if whole < 0.75 * MOST else True
    assert min(sizes) < 0.75 * MOST < 1.7 * MOST < max(sizes)


def test_a_picture_that_fits_keeps_its_pixels():
    for image in pictures():
        url, size = preview(image, MOST)
        assert len(url) <= MOST
        least = len(_url(Image.fromarray(image), "webp", quality=QUALITIES[-1], method=1))
        assert (size == image.shape[::-1]) == (least <= MOST)


def test_what_is_seen_to_be_too_large_is_not_packed_whole(monkeypatch):
    packed = []

    def spy(picture, *given, **options):
        packed.append(picture.size)
        return _url(picture, *given, **options)

    monkeypatch.setattr(photo, "_url", spy)
    image = np.random.default_rng(0).integers(0, 255, (800, 1000)).astype(np.uint8)
    url, size = preview(image, MOST)
    assert len(url) <= MOST
    assert all(w * h < 0.3 * image.size for w, h in packed)
    monkeypatch.setattr(photo, "_too_large", lambda *_: False)
    packed.clear()
    assert preview(image, MOST) == (url, size)
    assert packed[0] == (1000, 800)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [(8, 6), (1, 1), (640, 480)])
def test_a_view_of_a_few_pixels_has_its_scale_bar(size):
    """The part of it that the bar covers was none of its pixels."""
    assert ">" in photo.scale_bar(size, 0.5, "mm", np.ones(size[::-1], bool))
