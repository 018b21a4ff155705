"""How a PLOT3D file stores its blocks.

PLOT3D files describe themselves only by their sizes: nothing in them says byte order, precision, record
marks or IBLANK. `Plot3dLayout` names one of these ways; `plot3d_detect` finds the one that fits a file.

Source: Walatka, Buning, Pierce and Elson, PLOT3D User's Manual, NASA TM-101067, chapter 8 (formats).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from windmark.errors import UsageError

Dims = tuple[int, int, int]


@dataclass(frozen=True)
class Plot3dLayout:
    """One of the ways to store a PLOT3D grid or function file.

    Parameters
    ----------
    text : numbers in words (Fortran list-directed), else binary; the next three are of binary files only
    byte_order : "<" little-endian, ">" big-endian
    record_mark : bytes of the length before and after each Fortran record: 4, 8, or 0 for a C stream
    records : "whole": one record per block, as nearly all files; "component": one per coordinate;
        "plane": one per plane of constant k (PLOT3D's /PLANES)
    real_bytes : 4 or 8 per real number (in text: 9 or 17 digits on writing)
    iblank : grids only: an integer per node follows the coordinates; 0 means that the node is not used
    multi_block : the file begins with its number of blocks
    note : how this layout was chosen where several fit the file, in words; no part of the layout
    """

    text: bool = False
    byte_order: Literal["<", ">"] = "<"
    record_mark: Literal[0, 4, 8] = 4
    records: Literal["whole", "component", "plane"] = "whole"
    real_bytes: Literal[4, 8] = 4
    iblank: bool = False
    multi_block: bool = True
    note: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        allowed = {
            "byte_order": ("<", ">"),
            "record_mark": (0, 4, 8),
            "records": ("whole", "component", "plane"),
            "real_bytes": (4, 8),
        }
        for name, values in allowed.items():
            if getattr(self, name) not in values:
                raise UsageError(f"Plot3dLayout: {name} must be one of {values}, got {getattr(self, name)!r}")
        if self.records != "whole" and (self.text or not self.record_mark):
            raise UsageError(f"Plot3dLayout: records={self.records!r} needs record marks; a stream or text has none")

    @property
    def real_words(self) -> str:
        """Precision and IBLANK for people."""
        real = "single precision" if self.real_bytes == 4 else "double precision"
        return f"{real} with IBLANK" if self.iblank else real

    @property
    def words(self) -> str:
        """The layout for people."""
        rest = ["multi-block" if self.multi_block else "one block without a count"]
        if self.text:
            return ", ".join(["ASCII", *rest, *(["with IBLANK"] if self.iblank else [])])
        kind = f"Fortran records ({self.record_mark}-byte marks)" if self.record_mark else "C stream"
        order = "little-endian" if self.byte_order == "<" else "big-endian"
        rest += {"whole": [], "component": ["one record per coordinate"], "plane": ["one record per plane"]}[
            self.records
        ]
        return ", ".join([kind, order, self.real_words, *rest])


@dataclass(frozen=True)
class Header:
    """What a file declares: the blocks' sizes.

    Parameters
    ----------
    dims : (ni, nj, nk) of each block
    reals_per_node : 3 for a grid, the number of functions for a function file
    data_at : where the data begins: a byte (records: of the first data record's mark), or a number's index in text
    """

    dims: tuple[Dims, ...]
    reals_per_node: int
    data_at: int


def block_size(dims: Dims, reals_per_node: int, layout: Plot3dLayout) -> int:
    """Bytes (binary) or numbers (text) of one block without record marks; a Python integer of any size."""
    real, integer = (1, 1) if layout.text else (layout.real_bytes, 4)
    return math.prod(dims) * (reals_per_node * real + integer * layout.iblank)


def record_sizes(dims: Dims, reals_per_node: int, layout: Plot3dLayout) -> list[int]:
    """Bytes of each record of one block, without its marks."""
    size = block_size(dims, reals_per_node, layout)
    if layout.records == "plane":
        return [size // dims[2]] * dims[2]
    if layout.records == "component":
        n = math.prod(dims)
        return [n * layout.real_bytes] * reals_per_node + [n * 4] * layout.iblank
    return [size]


def block_words(header: Header, block: int) -> str:
    """Say which block of how many, counted from 1 as in ``.tgts`` files, and its size."""
    ni, nj, nk = header.dims[block]
    return f"block {block + 1} of {len(header.dims)} ({ni} x {nj} x {nk})"
