"""One layout for a PLOT3D file: where several fit its size, the numbers decide."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.io.errors import FileError
from windmark.io.plot3d_detect import MAX_IBLANK, Candidate, Kind, Source, candidates, read_blocks
from windmark.io.plot3d_diagnose import diagnosis, size_error
from windmark.io.plot3d_layout import Plot3dLayout, block_words

_LARGEST, _SMALLEST = 1e15, 1e-30  # lengths of wind-tunnel models and values on them lie well between
_CLEARLY_ROUGHER = 1.5
_ABSURD = 0.05  # share of absurd numbers that no grid has; a plane of symmetry may hold some underflow


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
        raise diagnosis(source, kind)
    if len(found) > 1:
        return _with_text_digits(source, _most_plausible(source, found))
    _refuse_one_short(source, found[0])
    _refuse_absurd(source, found[0])
    return _with_text_digits(source, found[0])


def _same(found: Plot3dLayout, asked: Plot3dLayout) -> bool:
    """Whether a layout that fits is the one asked for; text has no bytes to compare."""
    if found.text and asked.text:
        return found.iblank == asked.iblank and found.multi_block == asked.multi_block
    return found == asked


def _refuse_one_short(source: Source, only: Candidate) -> None:
    """Refuse a file that lacks its last number: "1 ni nj 1 x ..." is then also one block of (1, ni, nj) nodes.

    The 1 that would be its first coordinate is an integer: no real number in binary, and in text the only
    number without a point.
    """
    layout, (i, j, k) = only.layout, only.header.dims[0]
    if (layout.record_mark and not layout.text) or layout.multi_block or i != 1:
        return
    if source.numbers is None:
        is_count = int(source.data[12:16].view(f"{layout.byte_order}i4")[0]) == 1
    else:
        words = source.numbers.first_words[3:]
        is_count = words[:1] == (b"1",) and all(b"." in word or b"e" in word.lower() for word in words[1:])
    if is_count:
        header = replace(only.header, dims=((j, k, 1),), data_at=only.header.data_at * 4 // 3)
        raise size_error(source, Candidate(replace(layout, multi_block=True), header))


def _refuse_absurd(source: Source, only: Candidate) -> None:
    """Refuse a stream that fits by its size alone: half of a double precision file has the size of a single one."""
    if source.numbers is None and not only.layout.record_mark:
        absurd = _look(source, only).absurd
        if absurd > _ABSURD:
            what = f"the size fits {only.layout.words}, but {absurd:.0%} of the numbers would then be below"
            raise FileError(source.path, f"{what} {_SMALLEST:g} or above {_LARGEST:g}; expected lengths")


def _with_text_digits(source: Source, chosen: Candidate) -> Candidate:
    """Text says its precision by its digits: double where nine of them are not enough."""
    if source.numbers is None or all(float(f"{v:.9g}") == v for v in source.numbers.values[:999].tolist()):
        return chosen
    return replace(chosen, layout=replace(chosen.layout, real_bytes=8))


def checked_iblank(source: Source, candidate: Candidate, block: int, iblank: NDArray[np.integer] | None) -> None:
    """Refuse IBLANK values that can only be another kind of number: `FileError`."""
    if iblank is not None and (np.abs(iblank) > MAX_IBLANK).any():
        node = int(np.argmax(np.abs(iblank) > MAX_IBLANK))
        what = f"IBLANK of node {node} (from 0) is none; expected whole numbers, 0 for nodes that are not used"
        raise FileError(source.path, what, block_words(candidate.header, block))


@dataclass(frozen=True)
class _Look:
    """How the numbers look under one layout: shares of absurd and of not finite ones, and the steps between them."""

    candidate: Candidate
    absurd: float
    not_finite: float
    rough: float


def _most_plausible(source: Source, found: list[Candidate]) -> Candidate:
    """The layout whose numbers look like a grid, with a note that says why."""
    looks = sorted((_look(source, c) for c in found), key=lambda look: (look.absurd + look.not_finite, look.rough))
    best, second = looks[0], looks[1]
    words = " or ".join(look.candidate.layout.words for look in looks[1:])
    doubt, other = best.absurd + best.not_finite, second.absurd + second.not_finite
    if doubt < other:
        why = f"{other:.0%} of the numbers would be absurd otherwise, {doubt:.0%} are so now"
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
    absurd = infinite = total = in_use = 0
    rough = 0.0
    for dims, (reals, iblank) in zip(candidate.header.dims, read_blocks(source, candidate), strict=True):
        used = np.ones(reals.shape[1], dtype=bool) if iblank is None else iblank != 0
        size = np.abs(reals[:, used])
        infinite += int(np.count_nonzero(~np.isfinite(size)))
        absurd += int(np.count_nonzero(np.isfinite(size) & ((size > _LARGEST) | ((size > 0) & (size < _SMALLEST)))))
        total += size.size
        in_use += int(used.sum())
        if iblank is not None:
            absurd += int(np.count_nonzero(np.abs(iblank) > MAX_IBLANK))
            total += iblank.size
        rough += _roughness(np.nan_to_num(reals).reshape(-1, *dims[::-1]))
    # A grid whose every node is blanked would be absurd as a whole.
    return _Look(candidate, absurd / total if in_use else 1.0, infinite / total, rough / len(candidate.header.dims))


def _roughness(values: NDArray[np.floating]) -> float:
    """Mean step between neighbours, all directions together, over the range of the values: small for a grid."""
    with np.errstate(over="ignore", invalid="ignore"):
        spread = float(np.ptp(values.astype(float)))
        steps = [np.abs(np.diff(values, axis=k)).mean() for k in (1, 2, 3) if values.shape[k] > 1]
        return float(np.sum(steps)) / spread if spread > 0 else 0.0
