"""FITS cubes and pictures, through astropy (the extra ``fits``)."""

from __future__ import annotations

import os
import threading
import warnings
from typing import Any

import numpy as np

from windmark.io.errors import FileError
from windmark.io.recordings.base import Image, Recording, check_compressed, check_size
from windmark.io.recordings.hdf import time_unit
from windmark.io.text import Pathlike

_BLOCK = 2880
"""FITS files consist of blocks; some programs leave the last one unfilled."""


class FitsRecording(Recording):
    """The cube (NAXIS = 3) of a FITS file; or its pictures (NAXIS = 2) one after the other.

    Integers with BZERO come back as the unsigned ones that they mean. Rows are those of the file, the first one first;
    programs that show FITS put it at the bottom.
    """

    kind = "FITS"

    def __init__(self, path: Pathlike) -> None:
        try:
            from astropy.io import fits
        except ModuleNotFoundError:
            raise FileError(path, "FITS needs astropy: pip install windmark[fits]") from None
        super().__init__(path)
        self._guard = threading.Lock()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # astropy mends small faults of headers; what matters is checked below
            self._file = fits.open(path, mode="readonly", memmap=False, lazy_load_hdus=False, uint=True)
            try:
                self._open()
            except BaseException:
                self._file.close()
                raise

    def _open(self) -> None:
        images = [h for h in self._file if h.is_image and h.header.get("NAXIS", 0) in (2, 3)]
        cubes = [h for h in images if h.header["NAXIS"] == 3]
        if not images:
            raise FileError(self.path, "holds no picture; expected NAXIS = 2 or 3")
        if len(cubes) > 1:
            raise FileError(self.path, f"holds {len(cubes)} cubes; expected one: save them apart")
        self._images = cubes or images
        shape = self._images[0].shape
        self.shape = (int(shape[-2]), int(shape[-1]))
        self._cube = bool(cubes)
        self.count = int(shape[0]) if cubes else len(images)
        check_size(self.path, self.shape[1], self.shape[0], self.count)
        for image in self._images:
            self._check_stored(image)
        self.dtype = self.read(0).dtype
        self.bits = 8 * self.dtype.itemsize
        self._clock(self._images[0].header)

    def _check_stored(self, image: Any) -> None:
        """All pixels must be there, or be unpacked from what is there."""
        header, at = image.header, image.fileinfo()
        needed = int(np.prod(image.shape)) * abs(int(header["BITPIX"])) // 8
        size = os.path.getsize(self.path)
        if int(at["datLoc"]) + int(at["datSpan"]) >= size + _BLOCK:
            raise FileError(self.path, f"damaged or cut off: {size} bytes, its header tells of more")
        if type(image).__name__ == "CompImageHDU":
            check_compressed(self.path, needed, max(size - int(at["datLoc"]), 0))
        elif int(at["datLoc"]) + needed > size:
            raise FileError(self.path, f"damaged or cut off: its pictures need {needed} bytes behind the header")

    def _clock(self, header: Any) -> None:
        said = header.get("DATE-OBS")
        self.start = said if isinstance(said, str) else None
        if self._cube and str(header.get("CTYPE3", "")).strip().upper().startswith("TIME"):
            factor, _ = time_unit(str(header.get("CUNIT3", "")))
            step, first, at = (header.get(k, v) for k, v in (("CDELT3", 1.0), ("CRVAL3", 0.0), ("CRPIX3", 1.0)))
            if factor is None:
                self.noted("the third axis is time without a unit (CUNIT3): frames have no time stamps")
            elif all(isinstance(v, int | float) and np.isfinite(v) for v in (step, first, at)):
                self.time_s = (first + (np.arange(self.count) + 1 - at) * step) * factor

    def read(self, number: int) -> Image:
        """One frame."""
        with self._guard, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if self._cube:
                values = self._images[0].section[number]
            else:
                values = self._images[number].section[:, :]
        values = np.asarray(values)
        return values.astype(values.dtype.newbyteorder("="))

    def close(self) -> None:
        """Give the file back."""
        self._file.close()
