"""Find the layout of a PLOT3D file: the one whose sizes agree, to the byte, with the file.

Every combination of byte order, record marks, precision, IBLANK and block count is compared with the exact
length of the file and of each Fortran record. Sizes come from the header, so they are compared as unbounded
integers before anything is allocated. Where more than one combination fits, the numbers themselves decide.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError, reading
from windmark.io.numbers_text import NumberText, is_text, parse_numbers
from windmark.io.plot3d_layout import Header, Plot3dLayout, block_size, record_sizes

Bytes = NDArray[np.uint8]
Kind = Literal["grid", "function"]

_HEAD_BYTES = 4096
MAX_IBLANK = 10000  # IBLANK below 0 is the number of another grid; beyond this it is another kind of number
_RECORDS: tuple[Literal["whole", "component", "plane"], ...] = ("whole", "component", "plane")


@dataclass(frozen=True)
class Source:
    """The file's content: bytes, or numbers if it is text."""

    path: Path
    data: Bytes
    numbers: NumberText | None

    @property
    def size(self) -> int:
        """Bytes, or numbers if it is text."""
        return len(self.data) if self.numbers is None else self.numbers.total


@dataclass(frozen=True)
class Candidate:
    """A layout and the header it gives."""

    layout: Plot3dLayout
    header: Header


def load(path: str | os.PathLike[str]) -> Source:
    """Read a file whole, as numbers if it is text."""
    with reading(path):
        data = np.fromfile(path, dtype=np.uint8)
    if not len(data):
        raise FileError(path, "the file is empty; expected a PLOT3D file")
    text = is_text(data[:_HEAD_BYTES].tobytes())
    return Source(Path(path), data, parse_numbers(data.tobytes(), path) if text else None)


def candidates(source: Source, kind: Kind) -> list[Candidate]:
    """Every layout whose sizes agree with the file's.

    Record marks that agree all through the file are no accident, so a file with them is not read as a stream.
    """
    if source.numbers is not None:
        return list(_unmarked(source, kind, text_headers(source.numbers, kind)))
    marked = [c for start in marked_headers(source.data, kind) for c in _marked(source.data, start, kind)]
    return marked or list(_unmarked(source, kind, stream_headers(source.data, kind)))


def size_variants(start: Candidate, kind: Kind) -> Iterator[Candidate]:
    """All precisions, IBLANK or not, for a header."""
    reals: tuple[Literal[4, 8], ...] = (4,) if start.layout.text else (4, 8)
    for real_bytes in reals:
        for iblank in (False, True) if kind == "grid" else (False,):
            yield replace(start, layout=replace(start.layout, real_bytes=real_bytes, iblank=iblank))


def _unmarked(source: Source, kind: Kind, starts: Iterator[Candidate]) -> Iterator[Candidate]:
    for start in starts:
        for c in size_variants(start, kind):
            if expected_size(c) == source.size:
                yield c


def expected_size(candidate: Candidate) -> int:
    """The size of a stream (bytes) or text (numbers) with this header and layout."""
    header, layout = candidate.header, candidate.layout
    return header.data_at + sum(block_size(d, header.reals_per_node, layout) for d in header.dims)


def _marked(data: Bytes, start: Candidate, kind: Kind) -> Iterator[Candidate]:
    walk = walk_records(data, start.header.data_at, start.layout)
    if walk.end != len(data):
        return
    for c in record_variants(start, kind):
        if record_count(c) == len(walk.sizes) and all_record_sizes(c) == walk.sizes:
            yield c


def record_variants(start: Candidate, kind: Kind) -> Iterator[Candidate]:
    """All precisions, IBLANK or not, and partitions into records that differ from each other."""
    flat = all(d[2] == 1 for d in start.header.dims)
    for records in _RECORDS:
        if records == "whole" or (kind == "grid" and not (records == "plane" and flat)):
            yield from size_variants(replace(start, layout=replace(start.layout, records=records)), kind)


def record_count(candidate: Candidate) -> int:
    """Data records of the whole file: known before their sizes are listed, which may be many."""
    header, layout = candidate.header, candidate.layout
    if layout.records == "plane":
        return sum(d[2] for d in header.dims)
    return len(header.dims) * (header.reals_per_node + layout.iblank if layout.records == "component" else 1)


def all_record_sizes(candidate: Candidate) -> list[int]:
    """Bytes of each data record of the file."""
    header, layout = candidate.header, candidate.layout
    return [size for d in header.dims for size in record_sizes(d, header.reals_per_node, layout)]


@dataclass(frozen=True)
class Walk:
    """Fortran records from some byte on.

    Parameters
    ----------
    sizes : payload bytes of each record whose two marks agree
    end : the byte after the last of them
    claimed : the opening mark of the record that is broken at ``end``, None if there is no whole mark
    """

    sizes: list[int]
    end: int
    claimed: int | None


def walk_records(data: Bytes, at: int, layout: Plot3dLayout, most: int | None = None) -> Walk:
    """Follow the record marks from byte ``at``, at most ``most`` records."""
    mark = layout.record_mark
    sizes: list[int] = []
    dtype = f"{layout.byte_order}i{mark}"
    claimed = None
    while at + mark <= len(data) and (most is None or len(sizes) < most):
        claimed = int(data[at : at + mark].view(dtype)[0])
        close = at + mark + claimed
        if claimed < 0 or close + mark > len(data) or int(data[close : close + mark].view(dtype)[0]) != claimed:
            return Walk(sizes, at, claimed)
        sizes.append(claimed)
        at = close + mark
    return Walk(sizes, at, None)


def marked_headers(data: Bytes, kind: Kind) -> Iterator[Candidate]:
    """Headers in Fortran records: the count of blocks and their sizes, or the size of the only block."""
    per_block = 3 if kind == "grid" else 4
    for mark in (4, 8):
        for order in ("<", ">"):
            layout = Plot3dLayout(byte_order=order, record_mark=mark)
            sizes = walk_records(data, 0, layout, most=2).sizes
            first = mark
            if len(sizes) == 2 and sizes[0] == 4:
                n = int(data[mark : mark + 4].view(f"{order}i4")[0])
                if sizes[1] != 4 * per_block * n:
                    continue
                first += 4 + 2 * mark
            elif sizes[:1] == [4 * per_block]:
                n = 1
                layout = replace(layout, multi_block=False)
            else:
                continue
            end = first + 4 * per_block * n
            header = _header(data[first:end].view(f"{order}i4"), end + mark, kind)
            if header:
                yield Candidate(layout, header)


def stream_headers(data: Bytes, kind: Kind) -> Iterator[Candidate]:
    """Headers without record marks, in either byte order."""
    for order in ("<", ">"):
        ints = data[: len(data) - len(data) % 4].view(f"{order}i4")
        layout = Plot3dLayout(byte_order=order, record_mark=0)
        for multi, header in _plain_headers(ints, kind, 4):
            yield Candidate(replace(layout, multi_block=multi), header)


def text_headers(numbers: NumberText, kind: Kind) -> Iterator[Candidate]:
    """Headers in words."""
    per_block = 3 if kind == "grid" else 4
    first = numbers.head(1)
    count = int(first[0]) if len(first) and 0 < first[0] < numbers.total else 0
    head = numbers.head(1 + per_block * max(1, count))
    if len(head) and np.isfinite(head).all() and np.abs(head).max() < 2**31:
        # What is no integer becomes 0, which is no size.
        ints = np.where(head == np.floor(head), head, 0).astype(np.int64)
        for multi, header in _plain_headers(ints, kind, 1):
            yield Candidate(Plot3dLayout(text=True, multi_block=multi), header)


def _plain_headers(ints: NDArray[np.integer], kind: Kind, unit: int) -> Iterator[tuple[bool, Header]]:
    per_block = 3 if kind == "grid" else 4
    count = int(ints[0]) if len(ints) else 0
    for multi, first, n in ((True, 1, count), (False, 0, 1)):
        end = first + per_block * n
        if n > 0 and end <= len(ints):
            header = _header(ints[first:end], end * unit, kind)
            if header:
                yield multi, header


def _header(ints: NDArray[np.integer], data_at: int, kind: Kind) -> Header | None:
    """The header if all its numbers can be sizes."""
    table = ints.reshape(-1, 3 if kind == "grid" else 4)
    if not len(table) or table.min() < 1 or (kind == "function" and np.ptp(table[:, 3])):
        return None
    dims = tuple((int(i), int(j), int(k)) for i, j, k in table[:, :3].tolist())
    return Header(dims, 3 if kind == "grid" else int(table[0, 3]), data_at)


def read_blocks(
    source: Source, candidate: Candidate
) -> Iterator[tuple[NDArray[np.floating], NDArray[np.integer] | None]]:
    """The blocks' content: reals (reals_per_node, N) and IBLANK (N,) or None, i fastest."""
    if source.numbers is None:
        yield from _binary_blocks(source.data, candidate)
        return
    header, at, numbers = candidate.header, candidate.header.data_at, source.numbers.all()
    for d in header.dims:
        end = at + block_size(d, header.reals_per_node, candidate.layout)
        rows = numbers[at:end].reshape(header.reals_per_node + candidate.layout.iblank, -1)
        iblank = _whole_numbers(rows[-1]) if candidate.layout.iblank else None
        yield rows[: header.reals_per_node], iblank
        at = end


def _whole_numbers(values: NDArray[np.float64]) -> NDArray[np.integer]:
    """IBLANK as integers; what is none becomes a value that `implausible` counts."""
    with np.errstate(invalid="ignore"):
        whole = np.where((values == np.floor(values)) & (np.abs(values) < 2**31), values, MAX_IBLANK + 1)
    return whole.astype(np.int64)


def _binary_blocks(
    data: Bytes, candidate: Candidate
) -> Iterator[tuple[NDArray[np.floating], NDArray[np.integer] | None]]:
    header, layout, at = candidate.header, candidate.layout, candidate.header.data_at
    n_reals, mark, order = header.reals_per_node, layout.record_mark, layout.byte_order
    for d in header.dims:
        parts = []
        for size in record_sizes(d, n_reals, layout):
            parts.append(data[at + mark : at + mark + size])
            at += size + 2 * mark
        groups = np.stack(parts) if layout.records == "plane" else np.concatenate(parts)[None]
        n = groups.shape[1] // (n_reals * layout.real_bytes + 4 * layout.iblank)
        split = n * n_reals * layout.real_bytes
        reals = np.ascontiguousarray(groups[:, :split]).view(f"{order}f{layout.real_bytes}")
        iblank = np.ascontiguousarray(groups[:, split:]).view(f"{order}i4").ravel() if layout.iblank else None
        yield reals.reshape(len(groups), n_reals, n).swapaxes(0, 1).reshape(n_reals, -1), iblank
