"""Masks: pictures and polygons."""

import numpy as np
import pytest
import tifffile
from PIL import Image

from windmark import io
from windmark.io.masks import filled


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
    np.testing.assert_array_equal(filled([corners], (25, 30)), winding(corners, (25, 30)))


def test_polygons_with_a_common_side_share_no_pixel():
    left = filled([[(0, 0), (10, 0), (10, 20), (0, 20)]], (21, 31))
    right = filled([[(10, 0), (30, 0), (30, 20), (10, 20)]], (21, 31))
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


SHAPE = np.zeros((20, 24), dtype=bool)
SHAPE[5:15, 6:20] = True


def transparent(kind, shape=SHAPE):
    """A picture whose shape an eye sees by its transparency alone, as Pillow's picture and what it is saved with."""
    alpha, white = 255 * shape.astype(np.uint8), np.full(shape.shape, 255, np.uint8)
    if kind == "colours":
        return Image.fromarray(np.dstack([white] * 3 + [alpha])), {}
    if kind == "grey":
        return Image.fromarray(np.dstack([white, alpha]), "LA"), {}
    if kind == "palette":
        picture = Image.fromarray(shape.astype(np.uint8), "P")
        picture.putpalette([255] * 6)
        return picture, {"transparency": 0}
    if kind == "one grey":  # 255 is the transparent one
        return Image.fromarray(np.where(shape, 200, 255).astype(np.uint8)), {"transparency": 255}
    return Image.fromarray(np.where(shape, 2000, 65535).astype(np.uint16)), {"transparency": 65535}


@pytest.mark.parametrize("kind", ["colours", "grey", "palette", "one grey", "one of 16 bits"])
def test_a_shape_that_is_transparency_alone_is_refused(tmp_path, kind):
    """White everywhere, transparent outside of the shape: nothing was masked, without a word."""
    picture, options = transparent(kind)
    picture.save(tmp_path / "mask.png", **options)
    with pytest.raises(io.FileError, match=r"mask.png: 340 transparent pixels of it are not black; expected grey"):
        io.read_mask(tmp_path / "mask.png", SHAPE.shape)


def test_a_black_one_is_no_mask_that_leaves_nothing(tmp_path):
    values = np.zeros((*SHAPE.shape, 4), np.uint8)
    values[SHAPE, 3] = 255
    Image.fromarray(values).save(tmp_path / "mask.png")
    tifffile.imwrite(tmp_path / "mask.tif", values, photometric="rgb", extrasamples=["unassalpha"])
    for name in ("mask.png", "mask.tif"):
        with pytest.raises(io.FileError, match="it is black, its shape transparency"):
            io.read_mask(tmp_path / name, SHAPE.shape)


def test_transparency_that_says_what_the_colours_say_is_none(tmp_path):
    """A white shape on a transparent black ground, and a picture that is opaque everywhere."""
    for alpha in (255 * SHAPE, np.full(SHAPE.shape, 255)):
        values = np.dstack([255 * SHAPE] * 3 + [alpha]).astype(np.uint8)
        Image.fromarray(values).save(tmp_path / "mask.png")
        np.testing.assert_array_equal(io.read_mask(tmp_path / "mask.png", SHAPE.shape), SHAPE)


def test_masks_that_mask_nothing_or_everything(tmp_path):
    path = tmp_path / "mask.png"
    io.write_image(path, np.where(SHAPE, 255, 40).astype(np.uint8))  # a photograph, or labels from 1
    with pytest.raises(io.FileError, match="its pixels are 40 to 255 and none is 0: it would mask nothing"):
        io.read_mask(path, SHAPE.shape)
    io.write_image(path, np.zeros(SHAPE.shape, np.uint8))
    with pytest.raises(io.FileError, match="no pixel is used: the mask is 0 everywhere"):
        io.read_mask(path, SHAPE.shape)
    (tmp_path / "beside.csv").write_text("x,y\n100,100\n120,100\n110,120\n")
    with pytest.raises(io.FileError, match="no pixel is used"):
        io.read_mask(tmp_path / "beside.csv", SHAPE.shape)
    io.write_images(tmp_path / "stack.tif", [255 * SHAPE.astype(np.uint8), ~SHAPE])
    np.testing.assert_array_equal(io.read_mask(tmp_path / "stack.tif[0]", SHAPE.shape), SHAPE)
    io.write_image(path, np.full(SHAPE.shape, 255, np.uint8))  # of a camera that nothing is in the way of
    assert io.read_mask(path, SHAPE.shape).all()
