"""Say what is wrong with a file that fits no PLOT3D layout: what was expected, at which byte of which block."""

from __future__ import annotations

import math

from windmark.io.errors import FileError
from windmark.io.plot3d_detect import (
    Candidate,
    Kind,
    Source,
    all_record_sizes,
    expected_size,
    marked_headers,
    record_count,
    record_variants,
    size_variants,
    stream_headers,
    text_headers,
    walk_records,
)
from windmark.io.plot3d_layout import Plot3dLayout, block_size, block_words, record_sizes

_MOST_WRONG_SIZE = 64.0  # a file whose header claims this many times its size, or so little of it, is something else


def diagnosis(source: Source, kind: Kind) -> FileError:
    """The error for a file that fits no layout."""
    if source.numbers is None:
        starts = list(marked_headers(source.data, kind))
        if starts:
            return _record_error(source, starts[0], kind)
        error = _header_error(source, kind)
        if error:
            return error
        starts = list(stream_headers(source.data, kind))
    else:
        starts = list(text_headers(source.numbers, kind))
    variants = [v for start in starts for v in size_variants(start, kind)]
    if variants:
        nearest = min(variants, key=lambda v: _distance(v, source.size) + (0.1 if not v.layout.multi_block else 0.0))
        if _distance(nearest, source.size) < math.log(_MOST_WRONG_SIZE):
            return size_error(source, nearest)
    unit = "bytes" if source.numbers is None else "numbers"
    what = f"no reading of its first numbers gives block sizes near its {source.size} {unit}"
    return FileError(source.path, f"not a PLOT3D {kind} file: {what}")


def _distance(candidate: Candidate, size: int) -> float:
    """How far the file's size is from the expected one, as a logarithm."""
    return abs(math.log(expected_size(candidate) / size))


def size_error(source: Source, nearest: Candidate) -> FileError:
    """The error for a stream or text whose length differs from what its header declares."""
    header, layout = nearest.header, nearest.layout
    unit = "numbers" if layout.text else "bytes"
    blocks = "1 block" if len(header.dims) == 1 else f"{len(header.dims)} blocks"
    what = f"{blocks} declared; as {layout.words} that is {expected_size(nearest)} {unit}"
    at = header.data_at
    for k, dims in enumerate(header.dims):
        size = block_size(dims, header.reals_per_node, layout)
        if at + size > source.size:
            there = f"this one needs {size} {unit} from {unit[:-1]} {at}, the file ends at {source.size}"
            return FileError(source.path, f"{what}; {there}", block_words(header, k))
        at += size
    return FileError(source.path, f"{what}, but the file goes on to {source.size}")


def _header_error(source: Source, kind: Kind) -> FileError | None:
    """The error for Fortran records that begin well: a count of blocks, but no table of their sizes."""
    per_block = 12 if kind == "grid" else 16
    for mark in (4, 8):
        for order in ("<", ">"):
            layout = Plot3dLayout(byte_order=order, record_mark=mark)
            walk = walk_records(source.data, 0, layout, most=2)
            if walk.sizes[:1] != [4]:
                continue
            count = int(source.data[mark : mark + 4].view(f"{order}i4")[0])
            at = 4 + 2 * mark
            table = f"a record of {per_block * count} bytes with their sizes from byte {at}"
            what = f"{count} blocks declared; expected {table}"
            if len(walk.sizes) == 1:
                return FileError(source.path, f"{what}, the file ends at {source.size}")
            hint = " (a two-dimensional grid?)" if walk.sizes[1] == 8 * count else ""
            return FileError(source.path, f"{what}, got {walk.sizes[1]}{hint}")
    return None


def _record_error(source: Source, start: Candidate, kind: Kind) -> FileError:
    """The error for records that disagree with the header: the first that does, in the layout that fits longest."""
    walk = walk_records(source.data, start.header.data_at, start.layout)
    claims = walk.sizes if walk.claimed is None else [*walk.sizes, walk.claimed]
    few = max(len(claims), 4 * len(start.header.dims))  # sizes of planes are not listed where there are too many
    variants = [v for v in record_variants(start, kind) if v.layout.records == "whole" or record_count(v) <= few]
    best = max(variants, key=lambda v: _agreeing(all_record_sizes(v), claims))
    expected, mark = all_record_sizes(best), start.layout.record_mark
    k = min(_agreeing(expected, claims), len(walk.sizes))
    at = start.header.data_at + sum(size + 2 * mark for size in walk.sizes[:k])
    if k == len(expected):
        return FileError(source.path, f"the last block ends at byte {at}, but the file goes on to {source.size}")
    wanted = f"{expected[k]} bytes ({best.layout.real_words})"
    if k == 0 and claims[:1] != expected[:1]:  # nothing has told the precision yet
        known = [v for v in variants if v.layout.records == "whole"]
        wanted = " or ".join(f"{all_record_sizes(v)[0]} bytes ({v.layout.real_words})" for v in known)
    if k < len(claims) and claims[k] != expected[k]:
        what = f"the record at byte {at} says {claims[k]} bytes; expected {wanted}"
    elif at + 2 * mark + expected[k] > source.size:
        what = f"expected a record of {wanted} from byte {at}, the file ends at {source.size}"
    else:
        what = f"the record at byte {at} is damaged: it begins with its size, {expected[k]}, but does not end with it"
    return FileError(source.path, what, block_words(start.header, _block_of_record(best, k)))


def _agreeing(expected: list[int], sizes: list[int]) -> int:
    """How many leading records agree."""
    pairs = zip(expected, sizes, strict=False)
    return next((k for k, (a, b) in enumerate(pairs) if a != b), min(len(expected), len(sizes)))


def _block_of_record(candidate: Candidate, record: int) -> int:
    header = candidate.header
    for block, dims in enumerate(header.dims):
        record -= len(record_sizes(dims, header.reals_per_node, candidate.layout))
        if record < 0:
            return block
    return len(header.dims) - 1
