"""Images: every bit and every type as stored, stacks, packed bits, damage."""

from __future__ import annotations

import errno
import io
import os
import struct
import threading
import warnings
import zlib

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from windmark.io import (
    FileError,
    atomic,
    page_count,
    read_grey,
    read_image,
    read_images,
    to_grey,
    write_image,
    write_images,
)
from windmark.io._tiff import unpack_bits

RNG = np.random.default_rng(0)
GREY8 = RNG.integers(0, 256, (7, 11), dtype=np.uint8)
GREY16 = RNG.integers(0, 65536, (7, 11), dtype=np.uint16)
RGB = RNG.integers(0, 256, (7, 11, 3), dtype=np.uint8)
RGBA = RNG.integers(0, 256, (7, 11, 4), dtype=np.uint8)
FLOAT = RNG.normal(size=(7, 11)).astype(np.float32)
FLOAT[2, 3] = np.nan


def assert_same(a, b):
    np.testing.assert_array_equal(a, b)
    assert a.dtype == b.dtype
    assert a.dtype.isnative
    assert a.flags.writeable
    assert a.flags.c_contiguous


# --- round trips -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("g.png", GREY8), ("g.PNG", GREY16), ("c.png", RGB), ("a.png", RGBA), ("g.bmp", GREY8), ("c.bmp", RGB),
        ("g.tif", GREY8), ("g.tiff", GREY16), ("c.tif", RGB), ("a.tif", RGBA), ("f.tif", FLOAT),
        ("d.tif", FLOAT.astype(np.float64)), ("h.tif", FLOAT.astype(np.float16)), ("i.tif", GREY16.astype(np.int32)),
        ("s.tif", GREY8.astype(np.int8)), ("c16.tif", RGB.astype(np.uint16) * 257), ("narrow.tif", GREY8[:, :3]),
        ("one.png", GREY8[:1, :1]), ("f3.tif", RGB.astype(np.float32)),
    ],
)  # fmt: skip
def test_round_trip_is_exact(tmp_path, name, image):
    write_image(tmp_path / name, image)
    assert_same(read_image(tmp_path / name), image)
    assert page_count(tmp_path / name) == 1


def test_jpeg_is_close(tmp_path):
    smooth = np.add.outer(np.arange(64), np.arange(48)).astype(np.uint8)
    for name, image in (("g.jpg", smooth), ("c.jpeg", np.dstack([smooth, smooth // 2, smooth[::-1]]))):
        write_image(tmp_path / name, image)
        again = read_image(tmp_path / name)
        assert again.shape == image.shape
        assert np.abs(again.astype(int) - image).max() <= 6


def test_masks_become_black_and_white(tmp_path):
    write_image(tmp_path / "m.png", GREY8 > 128)
    assert_same(read_image(tmp_path / "m.png"), (GREY8 > 128).astype(np.uint8) * np.uint8(255))


def test_non_contiguous_and_big_endian_arrays(tmp_path):
    for name in ("v.png", "v.tif"):
        write_image(tmp_path / name, GREY16.astype(">u2")[::-1, ::2])
        assert_same(read_image(tmp_path / name), np.ascontiguousarray(GREY16[::-1, ::2]))


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        ("f.png", FLOAT, r"PNG cannot hold image float32 \(7, 11\); write a \.tif, or scale it to uint8 or uint16"),
        ("c.png", RGB.astype(np.uint16), "PNG cannot hold image uint16"),
        ("g.jpg", GREY16, "JPEG cannot hold image uint16"),
        ("a.jpg", RGBA, "JPEG cannot hold image uint8"),
        ("c.tif", GREY8 * 1j, "TIFF cannot hold image complex"),
        ("g.gif", GREY8, r"path must end in \.png, \.jpg"),
        ("g.png", GREY8[0], r"image must be \(H, W\) or \(H, W, 3 or 4\), got \(11,\)"),
        ("g.png", GREY8[:0], r"got \(0, 11\)"),
        ("g.tif", np.zeros((3, 4, 5)), r"got \(3, 4, 5\)"),
    ],
)
def test_what_cannot_be_written(tmp_path, name, image, message):
    with pytest.raises(ValueError, match=message):
        write_image(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["g.png", "g.tif", "g.jpg"])
@pytest.mark.parametrize("interruption", [KeyboardInterrupt(), OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))])
def test_interrupted_writing_leaves_the_old_image(tmp_path, monkeypatch, name, interruption):
    path = tmp_path / name
    write_image(path, GREY8)
    before = path.read_bytes()

    def fail(*_):
        raise interruption

    monkeypatch.setattr(atomic.os, "replace", fail)
    with pytest.raises((KeyboardInterrupt, FileError)):
        write_image(path, 255 - GREY8)
    assert path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


# --- stacks ----------------------------------------------------------------------------------


def test_stack(tmp_path):
    path = tmp_path / "s.tif"
    frames = [GREY16 // (k + 1) for k in range(5)]
    write_images(path, iter(frames))
    assert page_count(path) == 5
    with pytest.raises(FileError, match=r"has 5 pages: say .*s\.tif\[0\] for the first one"):
        read_image(path)
    assert_same(read_image(path, page=0), frames[0])
    assert_same(read_image(f"{path}[3]"), frames[3])
    assert_same(read_image(path, page=4), frames[4])
    for a, b in zip(read_images(path), frames, strict=True):
        assert_same(a, b)
    assert_same(read_image(path, page=None), np.stack(frames))
    with pytest.raises(FileError, match="no page 5; expected 0 to 4"):
        read_image(path, page=5)
    with pytest.raises(ValueError, match='page must be a number from 0, "only" or None, got -1'):
        read_image(path, page=-1)


def test_page_of_a_single_picture(tmp_path):
    write_image(tmp_path / "g.png", GREY8)
    assert_same(read_image(tmp_path / "g.png", page=None), GREY8[None])
    with pytest.raises(FileError, match="no page 1; it has one"):
        read_image(tmp_path / "g.png", page=1)


def test_pages_of_different_shape(tmp_path):
    write_images(tmp_path / "s.tif", [GREY8, GREY8[:3]])
    assert [picture.shape for picture in read_images(tmp_path / "s.tif")] == [(7, 11), (3, 11)]
    with pytest.raises(FileError, match="the pages differ in shape"):
        read_image(tmp_path / "s.tif", page=None)


def test_stack_needs_a_picture_and_tiff(tmp_path):
    with pytest.raises(ValueError, match="at least one picture"):
        write_images(tmp_path / "s.tif", [])
    with pytest.raises(ValueError, match=r"must end in \.tif"):
        write_images(tmp_path / "s.png", [GREY8])
    with pytest.raises(ValueError, match="got \\(2, 3, 7\\)"):
        write_images(tmp_path / "s.tif", [GREY8, np.zeros((2, 3, 7))])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("options", [{"imagej": True}, {"truncate": True}, {"bigtiff": True}, {"byteorder": ">"}])
def test_stacks_of_other_programs(tmp_path, options):
    frames = np.stack([GREY16, GREY16[::-1], GREY16 // 3])
    tifffile.imwrite(tmp_path / "s.tif", frames, photometric="minisblack", **options)
    assert page_count(tmp_path / "s.tif") == 3
    assert_same(read_image(tmp_path / "s.tif", page=1), frames[1])
    assert_same(read_image(tmp_path / "s.tif", page=None), frames)


def test_thumbnails_and_masks_are_no_pictures(tmp_path):
    with tifffile.TiffWriter(tmp_path / "s.tif") as writer:
        writer.write(GREY8[:2, :2], subfiletype=1, metadata=None)
        writer.write(GREY8, metadata=None)
        writer.write(GREY8[::-1] > 9, subfiletype=4, metadata=None)
        writer.write(GREY8[::-1], metadata=None)
    assert [p.tolist() for p in read_images(tmp_path / "s.tif")] == [GREY8.tolist(), GREY8[::-1].tolist()]


# --- kinds of TIFF ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"compression": "zlib"}, {"compression": "zlib", "predictor": True}, {"tile": (16, 16)}, {"rowsperstrip": 2},
        {"compression": "lzma"}, {"byteorder": ">"}, {"bigtiff": True},
    ],
)  # fmt: skip
@pytest.mark.parametrize("image", [GREY8, GREY16, RGB, RGB.astype(np.uint16) * 200, FLOAT])
def test_layouts(tmp_path, image, options):
    if image.dtype.kind == "f" and "predictor" in options:
        options = {"compression": "zlib"}  # the floats' predictor is written by other programs only
    tifffile.imwrite(tmp_path / "v.tif", image, photometric="rgb" if image.ndim == 3 else "minisblack", **options)
    assert_same(read_image(tmp_path / "v.tif"), image)


@pytest.mark.parametrize("compression", ["tiff_lzw", "packbits", "tiff_adobe_deflate"])
@pytest.mark.parametrize("image", [GREY8, GREY16, RGB, FLOAT])
def test_compressions_through_pillow(tmp_path, image, compression):
    Image.fromarray(image).save(tmp_path / "v.tif", compression=compression)
    assert_same(read_image(tmp_path / "v.tif"), image)


def test_pages_through_pillow(tmp_path):
    first, second = Image.fromarray(GREY8), Image.fromarray(GREY8[::-1].copy())
    first.save(tmp_path / "v.tif", compression="tiff_lzw", save_all=True, append_images=[second])
    assert page_count(tmp_path / "v.tif") == 2
    assert_same(read_image(tmp_path / "v.tif", page=1), GREY8[::-1].copy())


def test_jpeg_in_tiff(tmp_path):
    smooth = np.add.outer(np.arange(64), np.arange(48)).astype(np.uint8)
    Image.fromarray(np.dstack([smooth] * 3)).save(tmp_path / "v.tif", compression="jpeg", quality=95)
    again = read_image(tmp_path / "v.tif")
    assert again.shape == (64, 48, 3)
    assert np.abs(again.astype(int) - smooth[..., None]).max() <= 6


def test_planes_apart(tmp_path):
    tifffile.imwrite(tmp_path / "v.tif", np.moveaxis(RGB, -1, 0).copy(), photometric="rgb", planarconfig="separate")
    assert_same(read_image(tmp_path / "v.tif"), RGB)


def test_white_is_zero_is_turned_round(tmp_path):
    for name, image in (("8.tif", GREY8), ("16.tif", GREY16)):
        tifffile.imwrite(tmp_path / name, image, photometric="miniswhite")
        assert_same(read_image(tmp_path / name), np.iinfo(image.dtype).max - image)
    # Pillow turns 8-bit values round when it writes them white-is-zero, 16-bit values not.
    for image, expected in ((GREY8, GREY8), (GREY16, 65535 - GREY16)):
        Image.fromarray(image).save(tmp_path / "p.tif", compression="tiff_lzw", tiffinfo={262: 0})
        with tifffile.TiffFile(tmp_path / "p.tif") as tif:
            assert tif.pages[0].photometric == 0
        assert_same(read_image(tmp_path / "p.tif"), expected)


@pytest.mark.parametrize("name", ["b.png", "b.tif", "b.bmp"])
def test_one_bit(tmp_path, name):
    bits = GREY8 > 100
    Image.fromarray(bits).save(tmp_path / name)
    assert_same(read_image(tmp_path / name), bits.astype(np.uint8) * np.uint8(255))


@pytest.mark.parametrize("name", ["p.png", "p.tif", "p.bmp"])
def test_palettes_are_expanded(tmp_path, name):
    index = GREY8 % 4
    colours = np.array([[0, 0, 0], [255, 0, 10], [9, 200, 8], [255, 255, 255]], dtype=np.uint8)
    picture = Image.fromarray(index).convert("P")
    picture.putdata(index.ravel().tolist())
    picture.putpalette(colours.ravel().tolist())
    picture.save(tmp_path / name)
    assert_same(read_image(tmp_path / name), colours[index])
    greys = np.repeat(colours[:, :1], 3, axis=1)
    picture.putpalette(greys.ravel().tolist())
    picture.save(tmp_path / name)
    assert_same(read_image(tmp_path / name), greys[index, 0])


@pytest.mark.parametrize("turn", range(1, 9))
def test_orientation_tag_is_not_applied(tmp_path, turn):
    exif = Image.Exif()
    exif[0x0112] = turn
    for name, options in (
        ("o.jpg", {"quality": 100}),
        ("o.png", {}),
        ("o.tif", {}),
        ("z.tif", {"compression": "tiff_lzw"}),
    ):
        Image.fromarray(GREY8).save(tmp_path / name, exif=exif, **options)
        again = read_image(tmp_path / name)
        assert again.shape == GREY8.shape
        if name != "o.jpg":
            assert_same(again, GREY8)


# --- packed bits -----------------------------------------------------------------------------


def pack(values, bits):
    """Big-endian packed rows, the slow and readable way."""
    rows = []
    for row in values.reshape(len(values), -1):
        text = "".join(f"{v:0{bits}b}" for v in row)
        text += "0" * (-len(text) % 8)
        rows.append(bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8)))
    return rows


def packed_tiff(values, bits, *, order="<", rows_per_strip=3, deflate=False, fill_order=1, samples=1):
    """A minimal TIFF with packed integers."""
    height, width = values.shape[:2]
    rows = pack(values, bits)
    strips = [b"".join(rows[k : k + rows_per_strip]) for k in range(0, height, rows_per_strip)]
    if fill_order == 2:
        strips = [bytes(int(f"{b:08b}"[::-1], 2) for b in strip) for strip in strips]
    if deflate:
        strips = [zlib.compress(strip) for strip in strips]
    out = io.BytesIO()
    out.write(b"\0" * 8)
    offsets = []
    for strip in strips:
        offsets.append(out.tell())
        out.write(strip)
    lists = []
    for numbers in (offsets, [len(strip) for strip in strips], [bits] * samples):
        lists.append(out.tell())
        out.write(struct.pack(f"{order}{len(numbers)}I", *numbers))
    n = len(strips)
    tags = [
        (256, 1, width), (257, 1, height), (258, samples, bits if samples == 1 else lists[2]),
        (259, 1, 8 if deflate else 1),
        (262, 1, 1 if samples == 1 else 2), (266, 1, fill_order), (273, n, lists[0] if n > 1 else offsets[0]),
        (277, 1, samples), (278, 1, rows_per_strip), (279, n, lists[1] if n > 1 else len(strips[0])),
    ]  # fmt: skip
    start = out.tell()
    out.write(struct.pack(order + "H", len(tags)))
    for tag, count, value in tags:
        out.write(struct.pack(order + "HHII", tag, 4, count, value))
    out.write(struct.pack(order + "I", 0))
    data = bytearray(out.getvalue())
    data[:8] = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, start)
    return bytes(data)


@pytest.mark.parametrize("bits", [9, 10, 11, 12, 13, 14, 15])
@pytest.mark.parametrize("options", [{}, {"order": ">"}, {"deflate": True}, {"rows_per_strip": 100}, {"fill_order": 2}])
def test_packed_bits(tmp_path, bits, options):
    values = RNG.integers(0, 2**bits, (8, 7), dtype=np.uint16)
    (tmp_path / "p.tif").write_bytes(packed_tiff(values, bits, **options))
    assert_same(read_image(tmp_path / "p.tif"), values)


def test_packed_colours(tmp_path):
    values = RNG.integers(0, 2**12, (4, 5, 3), dtype=np.uint16)
    (tmp_path / "p.tif").write_bytes(packed_tiff(values, 12, samples=3))
    assert_same(read_image(tmp_path / "p.tif"), values)


def test_packed_12_bit_as_pillow_reads_it(tmp_path):
    values = RNG.integers(0, 2**12, (20, 14), dtype=np.uint16)
    (tmp_path / "p.tif").write_bytes(packed_tiff(values, 12))
    with Image.open(tmp_path / "p.tif") as picture:
        np.testing.assert_array_equal(np.array(picture), values)
    assert_same(read_image(tmp_path / "p.tif"), values)


def test_packed_rows_cut_off(tmp_path):
    values = RNG.integers(0, 2**12, (8, 7), dtype=np.uint16)
    data = packed_tiff(values, 12, rows_per_strip=100)
    (tmp_path / "p.tif").write_bytes(
        data.replace(struct.pack("<HHII", 279, 4, 1, 88), struct.pack("<HHII", 279, 4, 1, 60))
    )
    with pytest.raises(FileError, match="cut off: 5 of 8 rows are there"):
        read_image(tmp_path / "p.tif")


@given(bits=st.integers(2, 16), n=st.integers(1, 40), seed=st.integers(0, 99))
def test_unpacking_undoes_packing(bits, n, seed):
    values = np.random.default_rng(seed).integers(0, 2**bits, (3, n), dtype=np.uint16)
    packed = np.frombuffer(b"".join(pack(values, bits)), dtype=np.uint8).reshape(3, -1)
    np.testing.assert_array_equal(unpack_bits(packed, n, bits), values)


def test_twelve_bits_in_sixteen_are_not_scaled(tmp_path):
    for name in ("v.png", "v.tif"):
        write_image(tmp_path / name, GREY16 >> 4)
        assert_same(read_image(tmp_path / name), GREY16 >> 4)


# --- grey ------------------------------------------------------------------------------------


def test_to_grey():
    assert to_grey(GREY16) is GREY16
    grey = to_grey(RGB)
    assert grey.dtype == np.float32
    np.testing.assert_allclose(grey, RGB @ np.array([0.299, 0.587, 0.114]), rtol=1e-5)
    np.testing.assert_array_equal(to_grey(np.dstack([GREY16] * 3)), GREY16)
    np.testing.assert_array_equal(to_grey(RGBA), to_grey(RGBA[..., :3]))
    np.testing.assert_array_equal(to_grey(RGBA[..., :2]), RGBA[..., 0])
    assert to_grey(RGB.astype(np.float64)).dtype == np.float64
    with pytest.raises(ValueError, match=r"image must be \(H, W\) or \(H, W, 1 to 4\), got \(7, 11, 5\)"):
        to_grey(np.zeros((7, 11, 5)))


def test_read_grey(tmp_path):
    write_images(tmp_path / "c.tif", [RGB, RGB[::-1]])
    np.testing.assert_array_equal(read_grey(tmp_path / "c.tif", page=1), to_grey(RGB[::-1]))


# --- large pictures and threads -----------------------------------------------------------------


def test_a_hundred_megapixels_are_no_attack(tmp_path):
    from windmark.io import _pillow

    limit = Image.MAX_IMAGE_PIXELS
    assert limit is not None
    height = 2 * limit // 20_000 + 1  # above twice Pillow's limit it would raise, above once it would warn
    ihdr = struct.pack(">IIBBBBB", 20_000, height, 1, 0, 0, 0, 0)
    chunks = [(b"IHDR", ihdr), (b"IDAT", zlib.compress(b"\0" * 100)), (b"IEND", b"")]
    path = tmp_path / "big.png"
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d)) for t, d in chunks)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with _pillow.open_picture(path, ("PNG",)) as picture:
            assert picture.size == (20_000, height)
    assert limit == Image.MAX_IMAGE_PIXELS


def test_threads_leave_pillows_limit_alone(tmp_path):
    write_image(tmp_path / "g.png", GREY8)
    limit, seen = Image.MAX_IMAGE_PIXELS, []

    def work():
        for _ in range(30):
            seen.append(read_image(tmp_path / "g.png").sum())

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(seen) == {GREY8.sum()}
    assert limit == Image.MAX_IMAGE_PIXELS


# --- damage ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty; expected an image"),
        (b"name,x,y\n", "not an image that windmark reads; expected PNG, JPEG, TIFF or BMP"),
        (b"\x89PNG\r\n\x1a\n", "damaged or cut off"),
        (b"\xff\xd8\xff\xe0", "damaged or cut off"),
        (b"II*\0", "damaged or cut off: no page"),
        (b"II*\0\x08\0\0\0", "damaged or cut off: page 0 is not there"),
        (b"II*\0\x08\0\0\0\x01\0" + b"\0" * 12 + b"\x08\0\0\0", "damaged: page 1 is an earlier one again"),
        (b"BM", "damaged or cut off"),
    ],
)
def test_not_an_image(tmp_path, data, message):
    (tmp_path / "x.png").write_bytes(data)
    with pytest.raises(FileError, match=message) as caught:
        read_image(tmp_path / "x.png")
    assert caught.value.path == tmp_path / "x.png"


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(FileError, match=r"none\.tif: no such file"):
        read_image(tmp_path / "none.tif")
    with pytest.raises(FileError, match="this is a folder"):
        page_count(tmp_path)


def deep_png(image, adam7=False):
    """A PNG of 16 bits per channel from the standard (ISO/IEC 15948), each filter in turn; written without Pillow."""
    height, width, channels = image.shape
    passes = [(0, 0, 1, 1)]
    if adam7:
        passes = [(0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1)]
    step, out = 2 * channels, b""
    for row, column, down, right in passes:
        part = image[row::down, column::right]
        if not part.size:
            continue
        rows = np.ascontiguousarray(part).astype(">u2").view(np.uint8).reshape(len(part), -1).astype(int)
        before = np.zeros(rows.shape[1], int)
        for k, line in enumerate(rows):
            left, corner = (np.concatenate([np.zeros(step, int), v])[: len(v)] for v in (line, before))
            away = [abs(left + before - corner - v) for v in (left, before, corner)]
            nearest = np.choose(np.argmin(away, axis=0), [left, before, corner])
            filters = [0 * line, left, before, (left + before) // 2, nearest]
            out += bytes([k % 5]) + ((line - filters[k % 5]) % 256).astype(np.uint8).tobytes()
            before = line
    header = struct.pack(">IIBBBBB", width, height, 16, {2: 4, 3: 2, 4: 6}[channels], 0, 0, adam7)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(out)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d)) for t, d in chunks
    )


@pytest.mark.parametrize("adam7", [False, True])
@pytest.mark.parametrize("channels", [2, 3, 4])
def test_sixteen_bit_colour_png_keeps_every_bit(tmp_path, channels, adam7):
    image = RNG.integers(0, 65536, (17, 23, channels), dtype=np.uint16)
    (tmp_path / "c.png").write_bytes(deep_png(image, adam7))
    assert_same(read_image(tmp_path / "c.png"), image)
    (tmp_path / "c.png").write_bytes(deep_png(image)[:-40])
    with pytest.raises(FileError, match="damaged or cut off"):
        read_image(tmp_path / "c.png")


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    noise = RNG.integers(0, 256, (40, 50), dtype=np.uint8)
    write_image(folder / "a.png", noise)
    write_image(folder / "a.jpg", noise)
    write_image(folder / "a.bmp", noise)
    write_images(folder / "a.tif", [noise, noise[::-1]])
    tifffile.imwrite(folder / "z.tif", noise, compression="zlib", rowsperstrip=8)
    Image.fromarray(noise).save(folder / "l.tif", compression="tiff_lzw")
    (folder / "p.tif").write_bytes(packed_tiff(noise.astype(np.uint16) * 16, 12))
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.bmp", "a.tif", "z.tif", "l.tif", "p.tif"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_cut_off_files_are_refused(tmp_path, whole_files, name, share):
    data = whole_files[name]
    (tmp_path / name).write_bytes(data[: int(len(data) * share)])
    with pytest.raises(FileError, match=r"damaged|cut off|lacks a part|not an image") as caught:
        list(read_images(tmp_path / name))
    assert caught.value.path == tmp_path / name


@settings(max_examples=60)
@given(data=st.data())
def test_damaged_bytes_give_an_image_or_a_file_error(one_folder, whole_files, data):
    name = data.draw(st.sampled_from(sorted(whole_files)))
    content = bytearray(whole_files[name])
    head = data.draw(st.booleans())  # headers are where the harm is done
    last = min(len(content), 200) - 1 if head else len(content) - 1
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, last))] = data.draw(st.integers(0, 255))
    path = one_folder / name
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # decoders warn about odd tags
        try:
            image = read_image(path)
        except FileError:
            return
    assert image.ndim in (2, 3)


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_impossible_size_is_refused_before_the_memory_fills(tmp_path, whole_files, name):
    data = whole_files[name]
    if name == "a.png":
        chunk = b"IHDR" + struct.pack(">II", 60_000, 60_000) + data[24:29]
        data = data[:12] + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]
    else:
        for tag, value in ((256, 50), (257, 40)):
            old = struct.pack("<HHII", tag, 4, 1, value)
            assert old in data
            data = data.replace(old, struct.pack("<HHII", tag, 4, 1, 60_000))
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileError, match="60000 x 60000 pixels cannot come from a file this small"):
        read_image(tmp_path / name, page=0)


def test_missing_rows_are_not_black(tmp_path):
    tifffile.imwrite(tmp_path / "v.tif", GREY8, rowsperstrip=2, metadata=None)
    with tifffile.TiffFile(tmp_path / "v.tif", mode="r+b") as tif:
        tag = tif.pages[0].tags[279]
        tag.overwrite([0, *tag.value[1:]])
    with pytest.raises(FileError, match="page 0 lacks a part of its pixels"):
        read_image(tmp_path / "v.tif")


@pytest.mark.skipif(os.name == "nt", reason="the limit on the size of files is one of POSIX")
def test_a_disk_that_fills_up_within_a_picture_is_said(tmp_path):
    """NumPy wrote past Python and said "125000 requested and 49836 written", which gives no reason."""
    import resource

    values = RNG.integers(0, 256, (250, 500), dtype=np.uint8)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
        with pytest.raises(FileError, match=r"a\.tif: cannot be written: the file is larger than is allowed$"):
            write_image(tmp_path / "a.tif", values)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
    write_image(tmp_path / "a.tif", values)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), values)
