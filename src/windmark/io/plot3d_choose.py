"""One layout for a PLOT3D file: let the numbers decide where several fit, and say what is wrong where none does."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError
from windmark.io.plot3d_detect import (
    MAX_IBLANK,
    Candidate,
    Kind,
    Source,
    all_record_sizes,
    candidates,
    expected_size,
    marked_headers,
    read_blocks,
    record_count,
    record_variants,
    size_variants,
    stream_headers,
    text_headers,
    walk_records,
)
from windmark.io.plot3d_layout import Plot3dLayout, block_size, block_words, record_sizes

_LARGEST, _SMALLEST = 1e15, 1e-30  # lengths of wind-tunnel models and values on them lie well between
_CLEARLY_ROUGHER = 1.5
_MOST_WRONG_SIZE = 64.0  # a file whose header claims this many times its size, or so little of it, is something else


def choose(source: Source, kind: Kind, layout: Plot3dLayout | None = None) -> Candidate:
    """Find the layout of a file.

    Parameters
    ----------
    source : the file
    kind : "grid" or "function"
    layout : the layout, if the user knows it; then it must fit

    Raises
    ------
    FileError
        Where no layout fits (with the nearest one, and the byte and block at which it breaks), or where
        several fit and the numbers do not decide (with all of them in words).
    """
    found = candidates(source, kind)
    if layout is not None:
        wanted = [c for c in found if _same(c.layout, layout)]
        if not wanted:
            others = "; it fits: " + " or ".join(c.layout.words for c in found) if found else ""
            raise FileError(source.path, f"does not fit the layout asked for ({layout.words}){others}")
        return wanted[0]
    if not found:
        raise _diagnosis(source, kind)
    chosen = found[0] if len(found) == 1 else _most_plausible(source, found)
    return _with_text_digits(source, chosen)


def _same(found: Plot3dLayout, asked: Plot3dLayout) -> bool:
    """Whether a layout that fits is the one asked for; text has no bytes to compare."""
    if found.text and asked.text:
        return found.iblank == asked.iblank and found.multi_block == asked.multi_block
    return found == asked


def _with_text_digits(source: Source, chosen: Candidate) -> Candidate:
    """Text says its precision by its digits: double where nine of them are not enough."""
    if source.numbers is None or all(float(f"{v:.9g}") == v for v in source.numbers.values[:999].tolist()):
        return chosen
    return replace(chosen, layout=replace(chosen.layout, real_bytes=8))


@dataclass(frozen=True)
class _Look:
    """How the numbers look under one layout."""

    candidate: Candidate
    absurd: float
    rough: float


def _most_plausible(source: Source, found: list[Candidate]) -> Candidate:
    """The layout whose numbers look like a grid, with a note that says why."""
    looks = sorted((_look(source, c) for c in found), key=lambda look: (look.absurd, look.rough))
    best, second = looks[0], looks[1]
    words = " or ".join(look.candidate.layout.words for look in looks[1:])
    if best.absurd < second.absurd:
        why = f"{second.absurd:.0%} of the numbers would be absurd otherwise, {best.absurd:.0%} are so now"
    elif second.rough > _CLEARLY_ROUGHER * best.rough:
        why = f"neighbouring nodes would be {second.rough / best.rough:.1f} times farther apart otherwise"
    else:
        raise FileError(
            source.path,
            f"the sizes fit more than one layout: {best.candidate.layout.words}, or {words}; "
            "give the right one as layout=Plot3dLayout(...)",
        )
    note = f"the sizes fit this or {words}; this was chosen because {why}"
    return replace(best.candidate, layout=replace(best.candidate.layout, note=note))


def _look(source: Source, candidate: Candidate) -> _Look:
    absurd = total = in_use = 0
    rough = 0.0
    for dims, (reals, iblank) in zip(candidate.header.dims, read_blocks(source, candidate), strict=True):
        used = np.ones(reals.shape[1], dtype=bool) if iblank is None else iblank != 0
        size = np.abs(reals[:, used])
        absurd += int(np.count_nonzero(~(size <= _LARGEST) | ((size > 0) & (size < _SMALLEST))))
        total += size.size
        in_use += int(used.sum())
        if iblank is not None:
            absurd += int(np.count_nonzero(np.abs(iblank) > MAX_IBLANK))
            total += iblank.size
        rough += _roughness(reals.reshape(-1, *dims[::-1]))
    # A grid whose every node is blanked would be absurd as a whole.
    return _Look(candidate, absurd / total if in_use else 1.0, rough / len(candidate.header.dims))


def _roughness(values: NDArray[np.floating]) -> float:
    """Mean step between neighbours along the longest direction, over the range: small for a grid."""
    axis = 1 + int(np.argmax(values.shape[1:]))
    if values.shape[axis] == 1:
        return 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        spread = np.ptp(values.astype(float))
        return float(np.mean(np.abs(np.diff(values, axis=axis)))) / float(spread) if spread > 0 else 0.0


def _diagnosis(source: Source, kind: Kind) -> FileError:
    """What is wrong with a file that fits no layout, in numbers."""
    if source.numbers is None:
        starts = list(marked_headers(source.data, kind))
        if starts:
            return _record_error(source, starts[0], kind)
        starts = list(stream_headers(source.data, kind))
    else:
        starts = list(text_headers(source.numbers, kind))
    variants = [v for start in starts for v in size_variants(start, kind)]
    if variants:
        nearest = min(variants, key=lambda v: abs(math.log(expected_size(v) / source.size)))
        if abs(math.log(expected_size(nearest) / source.size)) < math.log(_MOST_WRONG_SIZE):
            return _size_error(source, nearest)
    unit = "bytes" if source.numbers is None else "numbers"
    return FileError(
        source.path,
        f"not a PLOT3D {kind} file: no reading of its first numbers gives block sizes near its {source.size} {unit}",
    )


def _size_error(source: Source, nearest: Candidate) -> FileError:
    """A stream or text whose length differs from what its header declares."""
    header, layout = nearest.header, nearest.layout
    unit = "numbers" if layout.text else "bytes"
    what = f"{len(header.dims)} blocks declared; as {layout.words} that is {expected_size(nearest)} {unit}"
    at = header.data_at
    for k, dims in enumerate(header.dims):
        size = block_size(dims, header.reals_per_node, layout)
        if at + size > source.size:
            where = block_words(header, k)
            there = f"this block needs {size} {unit} from {unit[:-1]} {at}, the file ends at {source.size}"
            return FileError(source.path, f"{what}; {there}", where)
        at += size
    return FileError(source.path, f"{what}, but the file goes on to {source.size}")


def _record_error(source: Source, start: Candidate, kind: Kind) -> FileError:
    """Fortran records that disagree with the header: the first that does, under the layout that fits longest."""
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
    wanted = f"{expected[k]} bytes as {best.layout.words}"
    if k == 0:  # nothing has told the precision yet
        known = [v for v in variants if v.layout.records == "whole"]
        wanted = " or ".join(f"{all_record_sizes(v)[0]} bytes ({v.layout.words})" for v in known)
    if k < len(claims) and claims[k] != expected[k]:
        what = f"the record at byte {at} says {claims[k]} bytes; expected {wanted}"
    elif at + 2 * mark + expected[k] > source.size:
        what = f"expected a record of {wanted} from byte {at}, the file ends at {source.size}"
    else:
        what = f"the record at byte {at} is damaged: it begins with its size, {expected[k]}, but does not end with it"
    return FileError(source.path, what, block_words(start.header, _block_of_record(best, k)))


def _agreeing(expected: list[int], sizes: list[int]) -> int:
    """How many leading records agree."""
    return next(
        (k for k, (a, b) in enumerate(zip(expected, sizes, strict=False)) if a != b), min(len(expected), len(sizes))
    )


def _block_of_record(candidate: Candidate, record: int) -> int:
    header = candidate.header
    for block, dims in enumerate(header.dims):
        record -= len(record_sizes(dims, header.reals_per_node, candidate.layout))
        if record < 0:
            return block
    return len(header.dims) - 1
