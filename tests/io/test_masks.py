"""Masks: pictures and polygons."""

import numpy as np
import pytest
import tifffile

from windmark import io
from windmark.io.masks import polygon_pixels


def winding(corners, shape):
    """Readable twin: a pixel is inside if a ray to the right crosses an odd number of sides."""
    out = np.zeros(shape, bool)
    for y in range(shape[0]):
        for x in range(shape[1]):
            crossings = 0
            for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                if (y0 <= y) != (y1 <= y) and x0 + (y - y0) * (x1 - x0) / (y1 - y0) > x:
                    crossings += 1
            out[y, x] = crossings % 2
    return out


@pytest.mark.parametrize("seed", range(6))
def test_as_its_slow_twin(seed):
    corners = np.random.default_rng(seed).uniform(-5, 35, (3 + seed, 2))
    np.testing.assert_array_equal(polygon_pixels(corners, (25, 30)), winding(corners, (25, 30)))


def test_polygons_with_a_common_side_share_no_pixel():
    left = polygon_pixels([(0, 0), (10, 0), (10, 20), (0, 20)], (21, 31))
    right = polygon_pixels([(10, 0), (30, 0), (30, 20), (10, 20)], (21, 31))
    assert not (left & right).any()
    assert (left | right).sum() == 30 * 20


def test_table_of_polygons_with_a_hole(tmp_path):
    path = tmp_path / "mask.csv"
    path.write_text(
        "polygon,x,y\nouter,0,0\nouter,20,0\nouter,20,20\nouter,0,20\nhole,5,5\nhole,10,5\nhole,10,10\nhole,5,10\n"
    )
    use = io.read_mask(path, (30, 40))
    assert use.shape == (30, 40)
    assert use.sum() == 20 * 20 - 5 * 5
    assert use[2, 2]
    assert not use[7, 7]
    assert not use[25, 25]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,2\n3,4\n", "2 corners; expected at least three"),
        ("x,y\n", "no corners"),
        ("x\n1\n", "y"),
        ("x,y\n1,a\n2,3\n4,5\n", "expected a finite number"),
    ],
)
def test_bad_tables_are_named(tmp_path, text, message):
    path = tmp_path / "mask.csv"
    path.write_text(text)
    with pytest.raises(io.FileError, match=message):
        io.read_mask(path, (10, 10))


def test_a_picture_of_another_size_is_named(tmp_path):
    io.write_image(tmp_path / "mask.png", np.zeros((5, 6), np.uint8))
    with pytest.raises(io.FileError, match="is 6 x 5 pixels, the image 10 x 10"):
        io.read_mask(tmp_path / "mask.png", (10, 10))


def test_masks_of_one_bit(tmp_path):
    """White-is-zero of one bit, as scanners write it, is turned; what tifffile writes of booleans is the array"""
    use = np.zeros((20, 24), dtype=bool)
    use[5:15, 6:20] = True
    tifffile.imwrite(tmp_path / "array.tif", use)  # white-is-zero, and True is 1
    with tifffile.TiffFile(tmp_path / "array.tif") as file:
        assert (file.pages[0].photometric, file.pages[0].bitspersample) == (0, 1)
    np.testing.assert_array_equal(io.read_mask(tmp_path / "array.tif", use.shape), use)
    np.testing.assert_array_equal(io.read_image(tmp_path / "array.tif"), 255 * use.astype(np.uint8))
    for name, values in (("one.tif", ~use), ("eight.tif", 255 * (~use).astype(np.uint8))):
        tifffile.imwrite(tmp_path / name, values, photometric="miniswhite", metadata=None)
        np.testing.assert_array_equal(io.read_mask(tmp_path / name, use.shape), use)
    tifffile.imwrite(tmp_path / "black.tif", use, photometric="minisblack", metadata=None)
    np.testing.assert_array_equal(io.read_mask(tmp_path / "black.tif", use.shape), use)
