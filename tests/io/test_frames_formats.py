"""Every format that `io.frames` reads, against files written from their published layouts: bit for bit."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import tifffile
from camera_files import write_cine, write_mraw, write_spe, write_spe3

from windmark import io
from windmark.io.recordings._cine_table import LEVELS

RNG = np.random.default_rng(5)
STACK12 = RNG.integers(0, 4096, (7, 10, 12), dtype=np.uint16)
STACK16 = RNG.integers(0, 65536, (7, 10, 12), dtype=np.uint16)
STACK8 = RNG.integers(0, 256, (7, 10, 12), dtype=np.uint8)
RGB8 = RNG.integers(0, 256, (5, 6, 8, 3), dtype=np.uint8)


def assert_frames(path, expected, bits=None):
    """All frames in both orders, with everything that a sequence promises."""
    with io.frames(path) as frames:
        assert len(frames) == len(expected)
        assert frames.shape == expected.shape[1:]
        assert frames.size_px == (expected.shape[2], expected.shape[1])
        assert frames.dtype == expected.dtype
        assert bits is None or frames.bits == bits
        for k in (*range(len(expected)), *reversed(range(len(expected)))):
            np.testing.assert_array_equal(frames[k], expected[k])
        assert frames[0].dtype.isnative
        assert frames[0].flags.writeable
        assert frames[0].flags.c_contiguous
        return frames.time_s, frames.start, frames.note, frames.bayer


# --- Photron ----------------------------------------------------------------------------------


@pytest.mark.parametrize("xml", [False, True])
@pytest.mark.parametrize(("stored", "frames"), [(8, STACK8), (10, STACK12 >> 2), (12, STACK12), (16, STACK16)])
def test_photron(tmp_path, xml, stored, frames):
    header = write_mraw(tmp_path / "run.mraw", list(frames), stored, xml=xml, rate=500, first=-3, step=2)
    for path in (tmp_path / "run.mraw", header):
        times, start, note, _ = assert_frames(path, frames, stored)
        np.testing.assert_allclose(times, (-3 + 2 * np.arange(7)) / 500)
        assert start == "2026-02-03T10:34"
        assert "number of frame 0 is -3" in note


@pytest.mark.parametrize("size", [(3, 5), (1, 7), (9, 3)])
@pytest.mark.parametrize("stored", [10, 12])
def test_photron_frames_that_do_not_fill_their_last_byte(tmp_path, stored, size):
    frames = RNG.integers(0, 2**stored, (3, *size), dtype=np.uint16)
    write_mraw(tmp_path / "run.mraw", list(frames), stored)
    assert_frames(tmp_path / "run.mraw", frames, stored)


def test_photron_levels_at_the_upper_end_come_down(tmp_path):
    write_mraw(tmp_path / "run.mraw", [f << 4 for f in STACK12], 16, bits=12, side="Higher")
    assert "divided" in assert_frames(tmp_path / "run.mraw", STACK12, 12)[2]
    write_mraw(tmp_path / "low.mraw", list(STACK12), 16, bits=12)
    assert assert_frames(tmp_path / "low.mraw", STACK12, 12)[2] == ""


def test_photron_colours(tmp_path):
    write_mraw(tmp_path / "run.mraw", list(RGB8), 8, colour="Color")
    assert_frames(tmp_path / "run.mraw", RGB8, 8)


def test_photron_with_the_wrong_bits_is_refused(tmp_path):
    """Every size fits some other number of bits; only the length of the file tells."""
    header = write_mraw(tmp_path / "run.mraw", list(STACK12), 12)
    text = header.read_text()
    for wrong in (8, 16):
        header.write_text(text.replace("Color Bit : 12", f"Color Bit : {wrong}"))
        with pytest.raises(io.FileError, match=f"7 frames of {wrong} bits a pixel, as run.cih says"):
            io.frames(tmp_path / "run.mraw")
    header.write_text(text.replace("Total Frame : 7", "Total Frame : 9"))
    with pytest.raises(io.FileError, match="cut off: 1260 bytes, but 9 frames"):
        io.frames(header)


def test_photron_without_its_other_half(tmp_path):
    header = write_mraw(tmp_path / "run.mraw", list(STACK12), 12)
    (tmp_path / "run.mraw").rename(tmp_path / "else.mraw")
    with pytest.raises(io.FileError, match=r"run\.cih: its pictures are missing; expected run\.mraw beside it"):
        io.frames(header)
    with pytest.raises(io.FileError, match=r"its header is missing; expected else\.cihx or else\.cih beside it"):
        io.frames(tmp_path / "else.mraw")


# --- Phantom ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("stored", "frames", "real"), [(8, STACK8, 8), (16, STACK12, 12), (16, STACK16, 16)])
@pytest.mark.parametrize("from_top", [False, True])
def test_cine(tmp_path, stored, frames, real, from_top):
    times = 1.77e9 + 0.25 + np.arange(7) * 0.001
    write_cine(
        tmp_path / "run.cine", list(frames), stored, real_bits=real, times=times, trigger_s=1.77e9 + 0.25, first=-2,
        annotation=b"someannotation", from_top=from_top,
    )  # fmt: skip
    got, start, note, bayer = assert_frames(tmp_path / "run.cine", frames, real)
    np.testing.assert_allclose(got, np.arange(7) * 0.001, atol=3e-7)  # the writer rounds to 2.4e-7 s
    assert start.startswith("2026-02-02T02:40:00.25")
    assert "number of frame 0 is -2" in note
    assert "time 0 is the trigger" in note
    assert bayer is None


def test_cine_packed(tmp_path):
    codes = STACK12 >> 2
    write_cine(tmp_path / "p10.cine", list(codes), 16, packing=256, rate=2000, first=-4)
    times, _, note, _ = assert_frames(tmp_path / "p10.cine", LEVELS[codes], 12)
    np.testing.assert_allclose(times, (np.arange(7) - 4) / 2000)
    assert "no time stamps" in note
    write_cine(tmp_path / "p12.cine", list(STACK12), 16, packing=1024)
    assert assert_frames(tmp_path / "p12.cine", STACK12, 12)[0] is None


def test_linearisation_is_that_of_video_and_rises():
    """The published table follows Rec. 709 between its ends, and is known at some codes."""
    assert LEVELS.shape == (1024,)
    assert (np.diff(LEVELS.astype(int)) >= 0).all()
    assert LEVELS[[0, 64, 512, 1014, 1015, 1023]].tolist() == [2, 64, 998, 4064, 4095, 4095]
    code = np.arange(64, 1015)
    share = (code - 64) / 950
    curve = 64 + 4000 * np.where(share < 0.081, share / 4.5, ((share + 0.099) / 1.099) ** (1 / 0.45))
    assert np.abs(LEVELS[code] - curve).max() < 3


def test_cine_colours(tmp_path):
    write_cine(tmp_path / "m.cine", list(STACK8), 8, cfa=4)
    assert assert_frames(tmp_path / "m.cine", STACK8)[3] == "RGGB"
    np.testing.assert_allclose(io.read_grey(tmp_path / "m.cine[2]"), io.from_mosaic(STACK8[2], "RGGB"))
    np.testing.assert_array_equal(io.read_image(tmp_path / "m.cine[2]"), STACK8[2])
    write_cine(tmp_path / "c.cine", list(RGB8), 24, bgr=True)
    assert_frames(tmp_path / "c.cine", RGB8)


def test_old_cine_without_later_settings(tmp_path):
    write_cine(tmp_path / "old.cine", list(STACK8), 8, setup_bytes=160, rate=100)
    assert assert_frames(tmp_path / "old.cine", STACK8, 8)[0] is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"compression": 1}, "holds JPEG pictures, which lose grey levels"),
        ({"stored": 12}, "pixels of 12 bits, packing 0; expected 8 or 16"),
    ],
)
def test_cine_that_is_refused(tmp_path, change, message):
    write_cine(tmp_path / "run.cine", list(STACK8), **{"stored": 8, **change})
    with pytest.raises(io.FileError, match=message):
        io.frames(tmp_path / "run.cine")


# --- Princeton Instruments --------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["<f4", "<i4", "<i2", "<u2"])
def test_spe(tmp_path, kind):
    frames = (STACK12.astype(float) - 2000 * (kind != "<u2")).astype(np.dtype(kind).newbyteorder("="))
    write_spe(tmp_path / "run.spe", list(frames), kind)
    times, start, _, _ = assert_frames(tmp_path / "run.spe", frames)
    assert times is None
    assert start == "2026-02-03T10:34:56"


def test_spe3(tmp_path):
    ticks = 500 + 1000 * np.arange(7)
    write_spe3(tmp_path / "run.spe", list(STACK16), ticks)
    times, start, _, _ = assert_frames(tmp_path / "run.spe", STACK16, 16)
    np.testing.assert_allclose(times, ticks * 1e-6)
    assert start == "2026-02-03T10:34:00.5+01:00"


# --- TIFF, FITS, HDF5, NetCDF, tables ---------------------------------------------------------


@pytest.mark.parametrize("options", [
    {}, {"bigtiff": True}, {"byteorder": ">"}, {"compression": "zlib"}, {"metadata": {"axes": "TYX"}, "ome": True},
    {"imagej": True},
])  # fmt: skip
def test_tiff(tmp_path, options):
    tifffile.imwrite(tmp_path / "run.tif", STACK16, **options)
    assert_frames(tmp_path / "run.tif", STACK16, 16)


def test_tiff_times(tmp_path):
    tifffile.imwrite(tmp_path / "j.tif", STACK16, imagej=True, metadata={"axes": "TYX", "finterval": 0.02})
    np.testing.assert_allclose(io.frames(tmp_path / "j.tif").time_s, 0.02 * np.arange(7))
    times = [0.5 * k * k for k in range(7)]
    tifffile.imwrite(
        tmp_path / "o.ome.tif", STACK16,
        metadata={"axes": "TYX", "Plane": {"DeltaT": [1000 * t for t in times], "DeltaTUnit": ["ms"] * 7}},
    )  # fmt: skip
    np.testing.assert_allclose(io.frames(tmp_path / "o.ome.tif").time_s, times)


@pytest.mark.parametrize("frames", [STACK8, STACK16, STACK12.astype(np.int16), STACK12.astype(np.float32)])
def test_fits(tmp_path, frames):
    fits = pytest.importorskip("astropy.io.fits")
    head = fits.Header({"DATE-OBS": "2026-02-03T10:34:00", "CTYPE3": "TIME", "CUNIT3": "ms", "CDELT3": 2.0})
    fits.PrimaryHDU(frames, head).writeto(tmp_path / "run.fits")
    times, start, _, _ = assert_frames(tmp_path / "run.fits", frames)
    np.testing.assert_allclose(times, 0.002 * np.arange(7))
    assert start == "2026-02-03T10:34:00"
    fits.HDUList([fits.PrimaryHDU(), *(fits.ImageHDU(f) for f in frames)]).writeto(tmp_path / "many.fits")
    assert_frames(tmp_path / "many.fits", frames)
    if frames.dtype.kind != "f":  # floats are compressed with loss
        fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(frames)]).writeto(tmp_path / "small.fits.fz")
        assert_frames(tmp_path / "small.fits.fz", frames)


def write_hdf(path, frames, place="cam1/images", time=None, units="s", name="time", **options):
    with h5py.File(path, "a") as file:
        file.create_dataset(place, data=frames, **options)
        if time is not None:
            clock = file.create_dataset(f"{place.rpartition('/')[0]}/{name}", data=time)
            if units:
                clock.attrs["units"] = units


@pytest.mark.parametrize("options", [{}, {"chunks": (1, 10, 12), "compression": "gzip"}, {"chunks": (3, 4, 5)}])
@pytest.mark.parametrize("kind", ["<u2", ">u2", "<f4", "u1"])
def test_hdf(tmp_path, options, kind):
    frames = STACK8.astype(kind)
    write_hdf(tmp_path / "run.h5", frames, time=[0, 1, 2, 4, 5, 6, 7], units="ms since 2026-02-03 10:34", **options)
    times, start, _, _ = assert_frames(tmp_path / "run.h5", frames.astype(frames.dtype.newbyteorder("=")))
    np.testing.assert_allclose(times, [0, 0.001, 0.002, 0.004, 0.005, 0.006, 0.007])
    assert start == "2026-02-03T10:34"


def test_hdf_colours_and_one_picture(tmp_path):
    write_hdf(tmp_path / "c.h5", RGB8)
    assert_frames(tmp_path / "c.h5", RGB8)
    write_hdf(tmp_path / "p.h5", STACK16[0], place="picture")
    np.testing.assert_array_equal(io.read_image(tmp_path / "p.h5"), STACK16[0])


def test_time_without_a_unit_is_not_guessed(tmp_path):
    write_hdf(tmp_path / "run.h5", STACK8, time=np.arange(7.0), units="")
    frames = io.frames(tmp_path / "run.h5")
    assert frames.time_s is None
    assert "has no unit of time" in frames.note
    write_hdf(tmp_path / "named.h5", STACK8, time=np.arange(7.0), units="", name="time_s")
    np.testing.assert_array_equal(io.frames(tmp_path / "named.h5").time_s, np.arange(7))


def test_two_datasets_are_not_chosen_from(tmp_path):
    write_hdf(tmp_path / "run.h5", STACK8)
    write_hdf(tmp_path / "run.h5", STACK16, place="cam2/images")
    with pytest.raises(io.FileError, match=r"2 arrays that may be pictures, /cam1/images, /cam2/images: say which, as"):
        io.frames(tmp_path / "run.h5")
    assert_frames(f"{tmp_path / 'run.h5'}:/cam2/images", STACK16)
    np.testing.assert_array_equal(io.read_image(f"{tmp_path / 'run.h5'}:/cam1/images[5]"), STACK8[5])
    with pytest.raises(io.FileError, match=r"there is no /cam3 in it; expected one of /cam1/images, /cam2/images"):
        io.frames(f"{tmp_path / 'run.h5'}:/cam3")


def test_hdf_that_was_never_written_is_not_black(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file.create_dataset("images", (1000, 4000, 4000), np.uint16, chunks=(1, 4000, 4000))
    with pytest.raises(io.FileError, match="was never written"):
        io.frames(tmp_path / "run.h5")


def test_netcdf(tmp_path):
    import xarray as xr
    from scipy.io import netcdf_file

    stack = xr.Dataset({"image": (("time", "y", "x"), STACK12)}, {"time": ("time", np.arange(7.0), {"units": "ms"})})
    stack.to_netcdf(tmp_path / "four.nc", engine="h5netcdf")
    np.testing.assert_allclose(assert_frames(tmp_path / "four.nc", STACK12)[0], 0.001 * np.arange(7))
    with netcdf_file(tmp_path / "three.nc", "w") as file:
        for name, size in zip(("time", "y", "x"), STACK12.shape, strict=True):
            file.createDimension(name, size)
        clock = file.createVariable("time", "d", ("time",))
        clock[:], clock.units = 0.5 * np.arange(7), "seconds since 2026-02-03 10:34:00"
        file.createVariable("image", "h", ("time", "y", "x"))[:] = STACK12
    times, start, _, _ = assert_frames(tmp_path / "three.nc", STACK12.astype(np.int16))
    np.testing.assert_allclose(times, 0.5 * np.arange(7))
    assert start == "2026-02-03T10:34:00"


@pytest.mark.parametrize(("delimiter", "point"), [(";", ","), (";", "."), ("\t", ","), (",", ".")])
def test_table_of_temperatures(tmp_path, delimiter, point):
    picture = np.round(RNG.uniform(280, 310, (9, 11)), 2)
    rows = [delimiter.join(f"{v:.2f}".replace(".", point) for v in row) for row in picture]
    head = [f"Emissivity{delimiter}0{point}95", "File: run.seq", ""]
    (tmp_path / "t.csv").write_text("\n".join(head + rows))
    np.testing.assert_array_equal(io.read_image(tmp_path / "t.csv"), picture)
    assert io.is_recording(tmp_path / "t.csv")
    (tmp_path / "two.csv").write_text("\n".join([*rows, "Frame 2", *rows[::-1]]))
    assert_frames(tmp_path / "two.csv", np.stack([picture, picture[::-1]]))
    (tmp_path / "bad.csv").write_text("\n".join([*rows[:5], rows[5] + f"{delimiter}1{point}5", *rows[6:]]))
    with pytest.raises(io.FileError, match="rows of different lengths"):
        io.frames(tmp_path / "bad.csv")


def test_a_table_of_markers_is_no_recording(tmp_path):
    (tmp_path / "markers.csv").write_text("name,x,y,z,radius\nA,1,2,3,4\nB,2,3,4,5\n")
    assert not io.is_recording(tmp_path / "markers.csv")
    with pytest.raises(io.FileError, match="table with named columns"):
        io.frames(tmp_path / "markers.csv")
