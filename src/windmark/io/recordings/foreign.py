"""Files of cameras that are not read, and what can turn them into files that are."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

from windmark.io.errors import FileError
from windmark.io.text import Pathlike

READ = "PNG, JPEG, TIFF or BMP, or a recording: mraw, cine, SPE, FITS, HDF5, NetCDF, AVI, MP4, MOV, CSV"

_FLIR = "a FLIR recording; export it as TIFF or CSV with FLIR Research Studio, ResearchIR or Thermal Studio"
_HAMAMATSU = "a Hamamatsu picture; export it as TIFF with HiPic, HCImage or HPD-TA"
_LAVISION = "a LaVision DaVis picture; export it as TIFF with DaVis"
_RAW = (
    "raw numbers without a header: size, type and order of the pixels are not in the file and are not guessed;"
    " export TIFF, or write the numbers as a TIFF or HDF5 with what you know of them"
)
_MICROSCOPE = "a microscope's file; export it as OME-TIFF with its program or Fiji"
FOREIGN = {
    ".seq": "a FLIR or NorPix sequence; export it as TIFF (or CSV) with FLIR Research Studio or NorPix StreamPix",
    ".csq": _FLIR, ".fff": _FLIR, ".ats": _FLIR, ".sfmov": _FLIR, ".fcf": _FLIR,
    ".ptw": "a FLIR (Cedip) Altair recording; export it as TIFF or CSV with Altair or FLIR ResearchIR",
    ".his": _HAMAMATSU, ".img": f"{_HAMAMATSU}; other programs use .img for raw numbers, which are not guessed",
    ".dcimg": _HAMAMATSU, ".im7": _LAVISION, ".imx": _LAVISION, ".set": _LAVISION,
    ".irb": "an InfraTec recording; export it as TIFF, FITS or CSV with IRBIS",
    ".hcc": "a Telops recording; export it as TIFF with Reveal IR", ".rdf": _FLIR,
    ".sif": "an Andor Solis picture; export it as TIFF or FITS with Solis",
    ".pcoraw": "a PCO recording of BigTIFF kind that is damaged; export it as TIFF with Camware",
    ".b16": "a PCO picture; export it as TIFF with Camware", ".nd2": _MICROSCOPE, ".czi": _MICROSCOPE,
    ".lif": _MICROSCOPE, ".raw": _RAW, ".bin": _RAW, ".dat": _RAW, ".dng": "a raw photograph; export it as 16-bit TIFF",
    ".nef": "a raw photograph; export it as 16-bit TIFF", ".cr2": "a raw photograph; export it as 16-bit TIFF",
    ".arw": "a raw photograph; export it as 16-bit TIFF", ".gif": "a GIF; export it as PNG or TIFF",
    ".chd": "the header that Phantom's programs write beside other formats; name the pictures themselves",
}  # fmt: skip
"""Extension -> what such a file is and what helps."""


def refuse_foreign(path: Pathlike) -> NoReturn:
    """Say what a file that is not read may be, and what can export it."""
    words = FOREIGN.get(Path(path).suffix.lower())
    if words is None:
        raise FileError(path, f"not an image that windmark reads; expected {READ}")
    raise FileError(path, f"is {words}")
