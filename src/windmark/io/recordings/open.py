"""Which reader a file needs: by its content where that can be told, else by its extension."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from windmark.io.errors import FileError, decoding
from windmark.io.recordings.address import HDF, FrameAddress, frame_address
from windmark.io.recordings.base import Frames, Recording
from windmark.io.recordings.folder import FolderRecording, is_pattern
from windmark.io.recordings.foreign import refuse_foreign
from windmark.io.text import Pathlike

_VIDEO = (".avi", ".mp4", ".mov", ".mkv", ".m4v", ".mpg", ".mpeg", ".wmv", ".webm")
_FITS = (".fits", ".fit", ".fts", ".fz")
_PHOTRON = (".mraw", ".cih", ".cihx")
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_HDF5, _NETCDF3 = b"\x89HDF\r\n\x1a\n", (b"CDF\x01", b"CDF\x02", b"CDF\x05")
_SINGLE = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM")


def frames(path: Pathlike) -> Frames:
    """Any camera's recording as a lazy sequence of frames.

    Parameters
    ----------
    path : TIFF (stacks, OME, ImageJ, BigTIFF), Photron (``.mraw`` with ``.cih`` or ``.cihx``), Phantom (``.cine``),
        Princeton Instruments (``.spe``), FITS, HDF5 and NetCDF (``file.h5`` or ``file.h5:/cam1/images``), AVI, MP4,
        MOV, a table of temperatures (``.csv``), one picture, a folder of pictures, or a pattern such as
        ``run/*.tif``. ``run.cine[120]`` is a recording of that frame alone

    Returns
    -------
    A sequence: ``len(frames)``, ``frames[k]`` -> (H, W) or (H, W, C) in the file's own type, slices, and what the file
    says of itself; see `Frames`

    Raises
    ------
    FileError
        When it cannot be read: missing, damaged, cut off, of a format that is not read (with what can convert it).
    """
    address = frame_address(path)
    with decoding(address.file):
        recording = _recording(address)
        recording.stem, recording.address = address.stem, address.recording
        whole = Frames(recording)
    if address.number is None:
        return whole
    if address.number >= len(whole):
        whole.close()
        raise FileError(address.recording, f"no frame {address.number}; it has {_numbers(len(whole))}")
    return whole[address.number : address.number + 1]


def _numbers(count: int) -> str:
    return f"0 to {count - 1}" if count > 1 else "one, [0]"


def _recording(address: FrameAddress) -> Recording:
    file = address.file
    if address.dataset is None and (os.path.isdir(file) or is_pattern(file)):
        return FolderRecording(file)
    kind = recording_kind(file)
    if address.dataset is not None and kind not in ("HDF5", "NetCDF 3"):
        raise FileError(file, f"is no HDF5 or NetCDF file; there is no place {address.dataset} in it")
    if kind is None:
        refuse_foreign(file)
    return _READERS[kind](address)


def recording_kind(file: Pathlike) -> str | None:
    """The format of a file; None where it is none that is read.

    Raises
    ------
    FileError
        When the file is missing or empty.
    """
    with decoding(file), open(file, "rb") as stream:
        head = stream.read(4100)
    suffix = Path(file).suffix.lower()
    if suffix in _PHOTRON:
        return "Photron"
    if not head:
        raise FileError(file, "the file is empty; expected an image or a recording")
    by_content = _by_content(head)
    if by_content is not None:
        return by_content
    if suffix == ".spe":
        return "SPE"
    if suffix == ".cine":
        return "cine"
    if suffix in _FITS:
        return "FITS"
    if suffix in HDF:
        return "HDF5"
    if suffix in _VIDEO:
        return "video"
    return "table" if suffix == ".csv" else None


def _by_content(head: bytes) -> str | None:
    if head.startswith(_TIFF):
        return "TIFF"
    if head.startswith(_SINGLE):
        return "picture"
    if head.startswith(_HDF5):
        return "HDF5"
    if head.startswith(_NETCDF3):
        return "NetCDF 3"
    if head.startswith(b"SIMPLE  ="):
        return "FITS"
    if head.startswith(b"CI") and head[2:4] == b"\x2c\0":
        return "cine"
    if (head.startswith(b"RIFF") and head[8:11] == b"AVI") or head[4:8] == b"ftyp" or head[:4] == b"\x1aE\xdf\xa3":
        return "video"
    return None


def is_recording(path: Pathlike) -> bool:
    """Whether `frames` would take this: a recording, a picture, a folder or pattern of pictures. Nothing is decoded.

    An HDF5, NetCDF or CSV file, which may hold anything, is one where pictures are found in it. What cannot be
    opened is none.
    """
    try:
        address = frame_address(path)
        if address.dataset is not None or address.number is not None:
            return True
        if os.path.isdir(address.file) or is_pattern(address.file):
            from windmark.io.recordings.folder import picture_files

            return bool(picture_files(address.file))
        kind = recording_kind(address.file)
        if kind in ("HDF5", "NetCDF 3", "table"):
            frames(path).close()
    except ValueError:
        return False
    return kind is not None


def _tiff(address: FrameAddress) -> Recording:
    from windmark.io.recordings.tiff import TiffRecording

    return TiffRecording(address.file)


def _photron(address: FrameAddress) -> Recording:
    from windmark.io.recordings.photron import PhotronRecording

    return PhotronRecording(address.file)


def _cine(address: FrameAddress) -> Recording:
    from windmark.io.recordings.cine import CineRecording

    return CineRecording(address.file)


def _spe(address: FrameAddress) -> Recording:
    from windmark.io.recordings.spe import SpeRecording

    return SpeRecording(address.file)


def _fits(address: FrameAddress) -> Recording:
    from windmark.io.recordings.fits import FitsRecording

    return FitsRecording(address.file)


def _hdf(address: FrameAddress) -> Recording:
    from windmark.io.recordings.hdf import HdfRecording

    return HdfRecording(address.file, address.dataset)


def _netcdf3(address: FrameAddress) -> Recording:
    from windmark.io.recordings.hdf import Netcdf3Recording

    return Netcdf3Recording(address.file, address.dataset)


def _video(address: FrameAddress) -> Recording:
    from windmark.io.recordings.video import VideoRecording

    return VideoRecording(address.file)


def _table(address: FrameAddress) -> Recording:
    from windmark.io.recordings.flir import TableRecording

    return TableRecording(address.file)


def _picture(address: FrameAddress) -> Recording:
    from windmark.io.recordings.single import PictureRecording

    return PictureRecording(address.file)


_READERS: dict[str, Callable[[FrameAddress], Recording]] = {
    "TIFF": _tiff, "picture": _picture, "Photron": _photron, "cine": _cine, "SPE": _spe, "FITS": _fits, "HDF5": _hdf,
    "NetCDF 3": _netcdf3, "video": _video, "table": _table,
}  # fmt: skip
