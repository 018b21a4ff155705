"""TIFF stacks, with the times that ImageJ and OME write."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.io._tiff import open_tiff
from windmark.io.recordings.base import Image, Recording, Times
from windmark.io.text import Pathlike

_SECONDS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}


class TiffRecording(Recording):
    """All pictures of a TIFF file; thumbnails and masks are not counted."""

    kind = "TIFF stack"

    def __init__(self, path: Pathlike) -> None:
        super().__init__(path)
        self._guard = threading.Lock()
        self._open = ExitStack()
        try:
            self._stack = self._open.enter_context(open_tiff(path))
            self.count = self._stack.count
            first = native(self._stack.read(0))
            self.shape, self.dtype = first.shape, first.dtype
            self.bits = min(int(self._stack.bits), 8 * self.dtype.itemsize)
            self.time_s = _times(self._stack.file, self.count)
        except BaseException:
            self._open.close()
            raise

    def read(self, number: int) -> Image:
        """One page."""
        with self._guard:
            return native(self._stack.read(number))

    def close(self) -> None:
        """Give the file back."""
        self._open.close()


def native(values: NDArray[Any]) -> NDArray[Any]:
    """In the machine's own byte order."""
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _times(tif: Any, count: int) -> Times | None:
    """From ImageJ's frame interval, or from the DeltaT of OME's planes; None where it has not one for each page."""
    if tif.is_imagej:
        step = (tif.imagej_metadata or {}).get("finterval")
        return np.arange(count, dtype=np.float64) * float(step) if isinstance(step, int | float) and step > 0 else None
    if not tif.is_ome or not tif.ome_metadata:
        return None
    from xml.etree import ElementTree

    try:
        planes = [p for p in ElementTree.fromstring(tif.ome_metadata).iter() if p.tag.endswith("}Plane")]
        times = [float(p.attrib["DeltaT"]) * _SECONDS[p.attrib.get("DeltaTUnit", "s")] for p in planes]
    except (ElementTree.ParseError, KeyError, ValueError):
        return None
    return np.array(times) if len(times) == count else None
