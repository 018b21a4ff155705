"""Recordings written: TIFF stack, folder of pictures, HDF5, NetCDF, lossless AVI; one frame in the memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from windmark.errors import UsageError
from windmark.io.atomic import atomic_path, told_file
from windmark.io.errors import FileError
from windmark.io.manifest import read_manifest
from windmark.io.recordings.base import Frames, Image
from windmark.io.recordings.folder import is_picture
from windmark.io.results import result_folder
from windmark.io.staging import Say, silent
from windmark.io.text import Pathlike

_TIFF, _HDF, _NETCDF, _AVI = (".tif", ".tiff"), (".h5", ".hdf5"), (".nc",), (".avi", ".mkv")
WRITTEN = (*_TIFF, *_HDF, *_NETCDF, *_AVI)
PICTURES = ("png", "tif")
_BIG = 2**31
Each = Callable[[str], None]


def write_frames(
    path: Pathlike, frames: Frames, *, pictures: str = "tif", each: Each = lambda _: None, say: Say = silent,
    about: Mapping[str, Any] | None = None,
) -> list[str]:  # fmt: skip
    """Write a recording, whole or not at all; the extension tells the format.

    Parameters
    ----------
    path : ``.tif`` (a stack, BigTIFF where it is large), ``.h5`` (dataset ``images``, a chunk per frame, and
        ``time_s``), ``.nc`` (the same by NetCDF's conventions), ``.avi`` or ``.mkv`` (FFV1, which loses nothing; extra
        ``video``), or a name without an extension: a folder of pictures
    frames : what is written; numbers as they are
    pictures : "png" or "tif", of a folder
    each : told the name of every frame
    say, about : of a folder, which holds one recording: see `result_folder`. Pictures of an older recording go when a
        new one comes

    Returns
    -------
    What the target cannot hold, in words: time stamps, for instance

    Raises
    ------
    ValueError
        For an extension or pixels that the format cannot hold.
    FileError
        When a frame cannot be read or the target cannot be written, or is a folder with others' pictures.
    """
    target, suffix = Path(path), Path(path).suffix.lower()
    if not len(frames):
        raise UsageError("write_frames: frames must hold at least one, got none")
    if frames.path.exists() and target.exists() and os.path.samefile(frames.path, target):
        raise UsageError(f"write_frames: path is the recording itself, {target}")
    lost = [] if frames.time_s is None or suffix in (*_HDF, *_NETCDF) else ["the time stamps"]
    if suffix in _TIFF:
        _write_tiff(target, frames, each)
    elif suffix in _HDF:
        _write_hdf(target, frames, each, netcdf=False)
    elif suffix in _NETCDF:
        _write_hdf(target, frames, each, netcdf=True)
    elif suffix in _AVI:
        lost = _write_film(target, frames, each)
    elif not suffix or target.is_dir():
        _write_folder(target, frames, pictures, each, say, about)
    else:
        names = ", ".join(WRITTEN)
        raise UsageError(f"write_frames: path must end in {names}, or be a folder, got {os.fspath(path)!r}")
    if frames.bayer is not None:
        lost.append(f"that the pixels are a mosaic, {frames.bayer}")
    return lost


def _write_tiff(target: Path, frames: Frames, each: Each) -> None:
    import tifffile

    total = len(frames) * frames.dtype.itemsize * int(np.prod(frames.shape))
    with (
        atomic_path(target) as temporary, told_file(temporary) as stream,
        tifffile.TiffWriter(stream, bigtiff=total > _BIG) as writer,
    ):  # fmt: skip
        for k, picture in enumerate(frames):
            each(frames.name(k))
            photometric = "rgb" if picture.ndim == 3 and picture.shape[2] > 2 else "minisblack"
            writer.write(picture, photometric=photometric, metadata=None, software="windmark")


def _write_folder(
    target: Path, frames: Frames, pictures: str, each: Each, say: Say, about: Mapping[str, Any] | None
) -> None:
    from windmark.io.images import write_image

    if pictures not in PICTURES:
        raise UsageError(f"write_frames: pictures must be one of {', '.join(PICTURES)}, got {pictures!r}")
    with result_folder(target, about, say=say) as out:
        _refuse_others(target)
        for k, picture in enumerate(frames):
            each(frames.name(k))
            write_image(out.place / f"{frames.name(k)}.{pictures}", picture)


def _refuse_others(target: Path) -> None:
    """A folder is one recording: pictures that we did not write would become part of it."""
    old = read_manifest(target)
    ours = {} if old is None else old["outputs"]
    there = sorted(os.listdir(target)) if target.is_dir() else []
    others = [name for name in there if is_picture(name) and name[0] != "." and name not in ours]
    if others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise FileError(target, f"holds {others[0]}{more}, which no conversion wrote, and a folder is one recording; "
                        "expected a new folder, or one that a conversion wrote")  # fmt: skip


def _write_hdf(target: Path, frames: Frames, each: Each, *, netcdf: bool) -> None:
    """Dataset ``images`` with a chunk per frame. NetCDF 4 is HDF5 with named dimensions."""
    if netcdf:
        import h5netcdf as library
    else:
        import h5py as library
    shape, names = (len(frames), *frames.shape), ("time", "y", "x", "channel")[: 1 + len(frames.shape)]
    with atomic_path(target) as temporary, library.File(temporary, "w") as file:
        options: dict[str, Any] = {"chunks": (1, *frames.shape)}
        if netcdf:
            file.dimensions = dict(zip(names, shape, strict=True))
            images = file.create_variable("images", names, frames.dtype, **options)
        else:
            images = file.create_dataset("images", shape, frames.dtype, **options)
        for k, picture in enumerate(frames):
            each(frames.name(k))
            images[k] = picture
        images.attrs["bits"] = frames.bits
        images.attrs["source"] = frames.path.name
        if frames.bayer is not None:
            images.attrs["bayer"] = frames.bayer
        if frames.time_s is None:
            return
        if netcdf:
            clock = file.create_variable("time", ("time",), np.float64)
            clock[:] = frames.time_s
        else:
            clock = file.create_dataset("time_s", data=frames.time_s)
        clock.attrs["units"] = "s" if frames.start is None else f"seconds since {frames.start}"


def _write_film(target: Path, frames: Frames, each: Each) -> list[str]:
    """FFV1: every bit of 8- and 16-bit grey and of 8-bit colours."""
    try:
        import av
    except ModuleNotFoundError:
        raise FileError(target, "films need PyAV: pip install windmark[video]") from None
    kinds = {("uint8", 2): "gray", ("uint16", 2): "gray16le", ("uint8", 3): "bgr0", ("uint16", 3): "gbrp16le"}
    kind = kinds.get((frames.dtype.name, len(frames.shape)))
    if kind is None or (len(frames.shape) == 3 and frames.shape[2] != 3):
        raise UsageError(f"write_frames: a film cannot hold {frames.dtype} {frames.shape}; write .tif or .h5")
    rate, lost = _rate(frames)
    given = {"gray": "gray", "gray16le": "gray16le", "bgr0": "rgb24", "gbrp16le": "rgb48le"}[kind]
    with atomic_path(target) as temporary, av.open(str(temporary), "w") as out:
        stream = out.add_stream("ffv1", rate=rate)
        stream.width, stream.height = frames.size_px
        stream.pix_fmt = kind
        for k, picture in enumerate(frames):
            each(frames.name(k))
            shown = av.VideoFrame.from_ndarray(picture, format=given)
            out.mux(stream.encode(shown if given == kind else shown.reformat(format=kind)))
        out.mux(stream.encode())
    return lost


def _rate(frames: Frames) -> tuple[Fraction, list[str]]:
    """Frames per second, and what is lost of the time stamps by it."""
    times = frames.time_s
    if times is None or len(times) < 2 or not (np.diff(times) > 0).all():
        return Fraction(25), ["the time between frames, which is not known: the film says 25 frames/s"]
    step = float(np.median(np.diff(times)))
    rate = Fraction(1 / step).limit_denominator(1000)
    even: Image = np.abs(times - times[0] - step * np.arange(len(times)))
    return rate, [] if even.max() < 0.01 * step else ["the time stamps, which are not even"]
