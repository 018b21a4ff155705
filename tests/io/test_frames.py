"""The sequence that `io.frames` gives, addresses of frames, folders, threads, and what is refused."""

from __future__ import annotations

import gc
import struct
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PureWindowsPath

import h5py
import numpy as np
import pytest
import tifffile
from camera_files import write_cine, write_mraw, write_spe

from windmark import io
from windmark.errors import UsageError
from windmark.io.recordings.foreign import FOREIGN

RNG = np.random.default_rng(8)
STACK = RNG.integers(0, 4096, (9, 10, 12), dtype=np.uint16)


@pytest.fixture
def cine(tmp_path):
    write_cine(tmp_path / "run.cine", list(STACK), 16, real_bits=12, times=1e9 + 0.1 * np.arange(9), trigger_s=1e9)
    return tmp_path / "run.cine"


# --- the sequence -----------------------------------------------------------------------------


def test_a_sequence(cine):
    with io.frames(cine) as frames:
        assert len(frames) == 9
        np.testing.assert_array_equal(np.stack(list(frames)), STACK)
        np.testing.assert_array_equal(frames[-1], STACK[-1])
        with pytest.raises(IndexError, match="no frame 9; it has 9"):
            frames[9]
        assert frames.name(3) == "run-000003"
        np.testing.assert_allclose(frames.time_s, 0.1 * np.arange(9), atol=1e-6)


@pytest.mark.parametrize(
    "which", [slice(None), slice(2, 7, 2), slice(None, None, -1), slice(7, None, -3), slice(5, 5), slice(-3, None)]
)
def test_slices_of_slices(cine, which):
    frames, expected, numbers = io.frames(cine), STACK, np.arange(9)
    for part in (which, slice(1, None), slice(None, None, -1)):
        frames, expected, numbers = frames[part], expected[part], numbers[part]
        assert len(frames) == len(expected)
        for k in range(len(expected)):
            np.testing.assert_array_equal(frames[k], expected[k])
            assert frames.name(k) == f"run-{numbers[k]:06d}"
        np.testing.assert_allclose(frames.time_s, 0.1 * numbers, atol=1e-6)


def test_what_is_read_can_be_changed(cine):
    frames = io.frames(cine)
    frames[0][:] = 0
    np.testing.assert_array_equal(frames[0], STACK[0])


@pytest.mark.parametrize("name", ["run.cine", "run.tif", "run.h5", "run.mraw", "run.spe", "run.avi"])
def test_threads_read_at_once(tmp_path, cine, name):
    tifffile.imwrite(tmp_path / "run.tif", STACK, compression="zlib")
    write_mraw(tmp_path / "run.mraw", list(STACK), 12)
    write_spe(tmp_path / "run.spe", list(STACK))
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["images"] = STACK
    if name == "run.avi":
        pytest.importorskip("av")
        io.write_frames(tmp_path / "run.avi", io.frames(cine))
    order = RNG.integers(0, 9, 200)
    with io.frames(tmp_path / name) as frames, ThreadPoolExecutor(8) as pool:
        for k, picture in zip(order, pool.map(lambda k: frames[int(k)], order), strict=True):
            np.testing.assert_array_equal(picture, STACK[k])


@pytest.mark.slow
def test_a_forgotten_recording_closes_itself(cine):
    frames = io.frames(cine)
    frames[0]
    del frames
    gc.collect()  # an open file would be a ResourceWarning, which is an error
    cine.unlink()


def test_not_a_number_stays(tmp_path):
    stack = STACK.astype(np.float32)
    stack[2, 3, 4] = np.nan
    tifffile.imwrite(tmp_path / "run.tif", stack)
    np.testing.assert_array_equal(io.frames(tmp_path / "run.tif")[2], stack[2])


# --- addresses --------------------------------------------------------------------------------


def test_addresses(tmp_path, cine):
    address = io.frame_address(f"{cine}[3]")
    assert (address.file, address.dataset, address.number) == (cine, None, 3)
    assert io.picture_name(f"{cine}[3]") == "run-000003"
    assert io.picture_name(cine) == "run"
    for path in (f"{cine}[3]", Path(f"{cine}[3]")):
        np.testing.assert_array_equal(io.read_image(path), STACK[3])
        np.testing.assert_array_equal(io.read_grey(path), STACK[3])
        assert len(io.frames(path)) == 1
        assert io.frames(path).name(0) == "run-000003"
    with pytest.raises(io.FileError, match=r"run\.cine: has 9 frames: say .*run\.cine\[0\] for the first one"):
        io.read_image(cine)
    with pytest.raises(io.FileError, match=r"no page 9; expected 0 to 8"):
        io.read_image(f"{cine}[9]")
    with pytest.raises(io.FileError, match="no frame 9; it has 0 to 8"):
        io.frames(f"{cine}[9]")
    with pytest.raises(ValueError, match="frames are counted from 0, got -1"):
        io.read_image(f"{cine}[-1]")
    with pytest.raises(io.FileError, match="names a frame, and page 2 another one"):
        io.read_image(f"{cine}[3]", page=2)
    with pytest.raises(io.FileError, match=r"none\.cine: no such file"):
        io.read_image(tmp_path / "none.cine[3]")


def test_a_real_name_with_brackets_wins(tmp_path):
    tifffile.imwrite(tmp_path / "run.tif", STACK)
    io.write_image(tmp_path / "x.tif", STACK[7])
    (tmp_path / "x.tif").rename(tmp_path / "run.tif[3]")
    np.testing.assert_array_equal(io.read_image(tmp_path / "run.tif[3]"), STACK[7])
    np.testing.assert_array_equal(io.read_image(tmp_path / "run.tif[4]"), STACK[4])
    io.write_image(tmp_path / "a[1].tif", STACK[2])
    np.testing.assert_array_equal(io.read_image(tmp_path / "a[1].tif"), STACK[2])
    assert [str(p) for p in io.pictures([tmp_path / "a[1].tif"])] == [str(tmp_path / "a[1].tif")]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("C:/data/run.cine[12]", ("C:/data/run.cine", None, 12)),
        ("C:/data/run.h5:/cam1/images[5]", ("C:/data/run.h5", "/cam1/images", 5)),
        (r"C:\data\run.h5:\cam1\images[5]", (r"C:\data\run.h5", "/cam1/images", 5)),
        ("C:/run[3]", ("C:/run", None, 3)),
        ("run.nc:/images", ("run.nc", "/images", None)),
        ("run.h5", ("run.h5", None, None)),
        ("odd[x].tif", ("odd[x].tif", None, None)),
        ("[3]", ("[3]", None, None)),
    ],
)
def test_drives_and_datasets(text, parts):
    address = io.frame_address(text)
    assert (str(address.file), address.dataset, address.number) == parts
    assert PureWindowsPath("file.h5:/cam1[2]").name == "cam1[2]"  # a path object keeps such an address on Windows, too


def test_a_dataset_of_what_has_none(tmp_path, cine):
    (tmp_path / "run.h5").write_bytes(cine.read_bytes())
    with pytest.raises(io.FileError, match="is no HDF5 or NetCDF file; there is no place /images in it"):
        io.frames(f"{tmp_path / 'run.h5'}:/images")


# --- folders ----------------------------------------------------------------------------------


def test_a_folder_in_natural_order(tmp_path):
    for k in (1, 2, 9, 10, 11):
        io.write_image(tmp_path / f"run{k}.tif", STACK[k % 9])
    (tmp_path / "notes.txt").write_text("x")
    for path in (tmp_path, tmp_path / "*.tif"):
        frames = io.frames(path)
        assert [frames.name(k) for k in range(5)] == ["run1", "run2", "run9", "run10", "run11"]
        np.testing.assert_array_equal(frames[3], STACK[1])
        assert "numbers 3 to 8 are missing" in frames.note
    assert [p.name for p in io.pictures([tmp_path])] == [f"run{k}.tif" for k in (1, 2, 9, 10, 11)]
    np.testing.assert_array_equal(io.read_image(f"{tmp_path}[2]"), STACK[0])
    io.write_image(tmp_path / "mask.png", STACK[0] > 100)
    with pytest.raises(io.FileError, match=r"a folder with \.png and \.tif pictures; say which, as in .*\*\.png"):
        io.frames(tmp_path)
    assert len(io.frames(tmp_path / "*.tif")) == 5


def test_a_pattern_in_a_folder_with_brackets(tmp_path):
    (tmp_path / "run [2]").mkdir()
    for k in range(3):
        io.write_image(tmp_path / "run [2]" / f"a{k}.tif", STACK[k])
    assert len(io.frames(tmp_path / "run [2]" / "a*.tif")) == 3
    assert len(io.frames(tmp_path / "run [[]2]" / "a*.tif")) == 3


def test_arrays_that_are_no_pictures(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["empty"], file["complex"] = h5py.Empty("f"), STACK.astype(np.complex64)
        file["none"], file["wide"] = np.zeros((0, 4, 5)), np.zeros((3, 4, 5, 7))
        file["loop"], file["away"] = h5py.SoftLink("/"), h5py.ExternalLink("none.h5", "/a")
        file["group/pictures"] = STACK
    np.testing.assert_array_equal(io.frames(tmp_path / "run.h5")[2], STACK[2])
    for name, message in (
        ("empty", "expected"), ("complex", "expected integers or floats"), ("none", "holds no frame"),
        ("wide", "up to 4 colours"), ("loop", "there is no loop|there is no /loop"), ("away", "there is no"),
        ("group", "there is no"),
    ):  # fmt: skip
        with pytest.raises(io.FileError, match=message):
            io.frames(f"{tmp_path / 'run.h5'}:/{name}")


def test_sizes_that_differ_are_named(tmp_path):
    io.write_image(tmp_path / "a1.tif", STACK[0])
    io.write_image(tmp_path / "a2.tif", STACK[0][:5])
    io.write_images(tmp_path / "a3.tif", STACK)
    frames = io.frames(tmp_path)
    with pytest.raises(io.FileError, match=r"a2: is uint16 \(5, 12\); expected uint16 \(10, 12\), as the first"):
        frames[1]
    with pytest.raises(io.FileError, match=r"a3\.tif: has 9 pages: say"):
        frames[2]


def test_empty_folders_and_patterns(tmp_path):
    with pytest.raises(io.FileError, match="a folder without pictures"):
        io.frames(tmp_path)
    with pytest.raises(io.FileError, match="no file matches this pattern"):
        io.frames(tmp_path / "*.tif")
    assert not io.is_recording(tmp_path)
    with pytest.raises(io.FileError, match="this is a folder"):
        io.read_image(tmp_path)


# --- what verbs are given ---------------------------------------------------------------------


def test_pictures_of_files_and_recordings(tmp_path, cine):
    io.write_image(tmp_path / "one.png", STACK[0] >> 4)
    items = io.pictures([tmp_path / "one.png", f"{cine}[4]", cine, tmp_path / "none.tif"])
    assert [i.name for i in items] == [
        "one.png", "run-000004", *(f"run-{k:06d}" for k in range(9)), "none.tif"
    ]  # fmt: skip
    assert str(items[4]) == f"{cine}[2]"
    np.testing.assert_array_equal(io.read_grey(items[4]), STACK[2])
    assert io.times_of(items) is None
    np.testing.assert_allclose(io.times_of(items[2:11]), 0.1 * np.arange(9), atol=1e-6)
    assert io.times_of(items[2:11][::-1]) is None
    assert [str(p) for p in io.addresses([cine])] == [f"{cine}[{k}]" for k in range(9)]
    both = io.gathered([f"{cine}[4]", f"{cine}[1]"])
    np.testing.assert_array_equal(np.stack(list(both)), STACK[[4, 1]])


@pytest.mark.parametrize("suffix", sorted(FOREIGN))
def test_what_cannot_be_read_says_what_helps(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    path.write_bytes(b"\0\1\2\3" * 100)
    with pytest.raises(io.FileError, match=r"export|name the pictures"):
        io.frames(path)
    assert not io.is_recording(path)


def test_raw_numbers_are_not_guessed(tmp_path):
    (tmp_path / "run.raw").write_bytes(STACK.tobytes())
    with pytest.raises(io.FileError, match=r"raw numbers without a header: size, type and order .* not guessed"):
        io.read_image(tmp_path / "run.raw")


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    import sys

    (tmp_path / "a.fits").write_bytes(b"SIMPLE  =                    T".ljust(2880))
    (tmp_path / "a.avi").write_bytes(b"RIFF\0\0\0\0AVI LIST")
    for module, extra, name in (("astropy.io", "fits", "a.fits"), ("av", "video", "a.avi")):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(io.FileError, match=rf"pip install windmark\[{extra}\]"):
            io.frames(tmp_path / name)


# --- small files with large numbers -----------------------------------------------------------


@pytest.mark.parametrize(("name", "content"), [
    ("a.cine", struct.pack("<2sHHHiIiIIIIII", b"CI", 44, 0, 1, 0, 2**32 - 1, 0, 2**32 - 1, 44, 84, 84, 0, 0)
     + struct.pack("<IiiHHIIiiII", 40, 2**30, 2**30, 1, 16, 0, 0, 0, 0, 0, 0)),
    ("b.cine", struct.pack("<2sHHHiIiIIIIII", b"CI", 44, 0, 1, 0, 2**31, 0, 2**31, 44, 84, 84, 0, 0)
     + struct.pack("<IiiHHIIiiII", 40, 1000, 1000, 1, 16, 0, 0, 0, 0, 0, 0)),
    ("a.spe", bytearray(4100)),
    ("b.spe", b"\0" * 42 + b"\xff\xff" + b"\0" * 4056),
    ("a.tif", b"II*\0\x08\0\0\0\xff\xff" + b"\xff" * 40),
    ("b.tif", b"II+\0\x08\0\0\0" + b"\xff" * 50),
    ("a.avi", b"RIFF\xff\xff\xff\xffAVI LIST\xff\xff\xff\xffhdrlavih" + b"\xff" * 60),
    ("a.h5", b"\x89HDF\r\n\x1a\n" + b"\xff" * 60),
    ("a.nc", b"CDF\x01" + b"\x7f" * 60),
    ("a.fits", b"SIMPLE  =                    T".ljust(80) + b"NAXIS   =           2147483647".ljust(80)),
    ("a.mraw", b"\0"),
    ("c.cine", b""), ("c.spe", b""), ("c.mraw", b""), ("c.h5", b""), ("c.avi", b""), ("c.fits", b""), ("c.csv", b""),
])  # fmt: skip
def test_a_few_bytes_are_refused_in_one_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(bytes(content))
    (tmp_path / "a.cih").write_text(
        "Image Width : 900000\nImage Height : 900000\nTotal Frame : 999999\nColor Bit : 16\nEffectiveBit Depth : 16\n"
    )
    with pytest.raises(io.FileError) as caught:
        io.frames(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert "Error" not in str(caught.value)


def test_no_frames(tmp_path, cine):
    data = bytearray(cine.read_bytes())
    struct.pack_into("<I", data, 20, 0)
    (tmp_path / "none.cine").write_bytes(data)
    with pytest.raises(io.FileError, match="holds no frame"):
        io.frames(tmp_path / "none.cine")
    struct.pack_into("<I", data, 20, 400)
    (tmp_path / "many.cine").write_bytes(data)
    with pytest.raises(io.FileError, match=r"images lie outside the file|lies at"):
        io.frames(tmp_path / "many.cine")
    (tmp_path / "cut.cine").write_bytes(cine.read_bytes()[:-20])
    with pytest.raises(io.FileError, match="image 8 is not complete"):
        io.frames(tmp_path / "cut.cine")


def test_a_pattern_where_one_picture_is_wanted(tmp_path):
    for name in ("a1.tif", "a2.tif", "b1.tif"):
        tifffile.imwrite(tmp_path / name, STACK[0])
    assert io.one_picture(tmp_path / "b*.tif") == tmp_path / "b1.tif"
    for same in (tmp_path / "a1.tif", tmp_path / "run.cine[120]", tmp_path / "none.tif"):
        assert io.one_picture(same) == same
    with pytest.raises(UsageError, match=r"a\*\.tif: 2 files match this pattern, a1\.tif to a2\.tif; expected one"):
        io.one_picture(tmp_path / "a*.tif")
    with pytest.raises(io.FileError, match="no file matches"):
        io.one_picture(tmp_path / "c*.tif")
