"""Pictures that show what another one shows, noise and all: a recording that dropped one, or a file under two names."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST = 6
"""Fewer spots in common say nothing."""
PART, MOST = 0.1, 0.75
"""So much of their noise this part of the spots of two pictures of one scene differs by in 1 of 10^11 cases, or less
often; the others may have been fitted in another window, from another start."""
NEXT = 3
"""So many spots on in order a spot is looked for that is the same, as there may be several copies."""
ONCE_MORE = "its spots do not differ by a tenth of their noise"
"""Why a picture is taken for another one once more; stands in every sentence that says so."""


def print_of(image: NDArray[np.generic]) -> int:
    """The same for the same grey levels; noise makes other pictures differ.

    Two checksums: of a hundred thousand pictures two would have the same single one of 32 bits.
    """
    content = image.tobytes()
    return zlib.crc32(content) | zlib.adler32(content) << 32


def is_repeated(point_a: Ints, xy_a: Array, point_b: Ints, xy_b: Array, sigma_px: float) -> bool:
    """Whether two pictures are one, by the spots (K,), (K, 2) and (L,), (L, 2) of their markers.

    ``sigma_px`` is that of a spot, per coordinate. Of an instant that was taken twice the noise differs: by a tenth of
    it in both coordinates one spot does in 1 of 300 cases.
    """
    _, i, j = np.intersect1d(point_a, point_b, assume_unique=True, return_indices=True)
    same = np.abs(xy_a[i] - xy_b[j]).max(axis=1, initial=0.0) < PART * sigma_px
    return bool(len(i) >= LEAST and same.mean() >= MOST)


def repeated_views(view: Ints, point: Ints | None, xy: Array, cov: Array) -> dict[int, int]:
    """View -> an earlier one that it shows once more, from all spots (O,), (O, 2), (O, 2, 2).

    ``point`` (O,) tells the spots' markers; None where these are not known. Spots that are as near to each other as to
    be the same stand next to each other in order, so the work grows no faster than sorting them.
    """
    reach = PART * np.sqrt(0.5 * (cov[:, 0, 0] + cov[:, 1, 1]))
    order = np.argsort(xy[:, 0]) if point is None else np.lexsort((xy[:, 0], point))
    x, y = xy[order, 0], xy[order, 1]
    alike = [np.zeros((2, 0), np.int64)]
    for step in range(1, NEXT + 1):
        near = np.flatnonzero(np.abs(x[step:] - x[:-step]) < reach[order[step:]])
        near = near[np.abs(y[near + step] - y[near]) < reach[order[near]]]
        a, b = order[near], order[near + step]
        same = view[a] != view[b] if point is None else (view[a] != view[b]) & (point[a] == point[b])
        alike.append(np.sort([view[a[same]], view[b[same]]], axis=0))
    if not any(each.size for each in alike):
        return {}
    pairs, count = np.unique(np.concatenate(alike, axis=1), axis=1, return_counts=True)
    spots = np.bincount(view, minlength=1)
    out: dict[int, int] = {}
    for (first, later), same in zip(pairs.T.tolist(), count.tolist(), strict=True):
        if same >= max(LEAST, MOST * min(spots[first], spots[later])):
            out.setdefault(later, out.get(first, first))
    return out
