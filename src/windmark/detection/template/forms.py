"""Quadratic forms of residuals, one for each kind of correlation that noise may have, and their expectations.

All correlations are products of one over rows and one over columns, so that C f is two small matrix products.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTHS_PX = (0.5, 0.8, 1.2, 1.8, 2.7)  # standard deviations of filters on white noise: correlation exp(-d^2 / (4 l^2))
PARTS = 3 + len(LENGTHS_PX)  # white, columns, rows, lengths
NOTHING = 1e-12  # a correlation: what is nearly 0 but not quite makes products ten times as slow


def forms_of(images: Array) -> Array:
    """Quadratic forms (PARTS, B) of images (B, S, S), one for each of `tables_of`.

    To 1e-6: chance moves them by 1e-2.
    """
    count, size = images.shape[:2]
    rows = images.astype(np.float32).reshape(-1, size)
    turned = np.ascontiguousarray(rows.reshape(images.shape).swapaxes(1, 2)).reshape(count, -1)
    out = [np.square(images).sum((1, 2)), np.square(images.sum(1)).sum(1), np.square(images.sum(2)).sum(1)]
    for _, table in tables_of(size)[3:]:
        along = table.astype(np.float32)
        half = np.ascontiguousarray((rows @ along).reshape(images.shape).swapaxes(1, 2))
        out.append(np.einsum("ka,ka->k", (half.reshape(-1, size) @ along).reshape(count, -1), turned))
    return np.array(out, dtype=np.float64)


@cache
def tables_of(size: int) -> tuple[tuple[Array, Array], ...]:
    """Correlations (S, S) along columns and along rows of pixels: white, columns, rows, then `LENGTHS_PX`."""
    gap2 = (np.arange(size)[:, None] - np.arange(size)[None, :]) ** 2
    alone, together = np.eye(size), np.ones((size, size))
    lengths = [np.exp(-gap2 / (4.0 * length**2)) for length in LENGTHS_PX]
    lengths = [np.where(t > NOTHING, t, 0.0) for t in lengths]
    return (alone, alone), (together, alone), (alone, together), *((t, t) for t in lengths)


def expectations(
    weights: list[Array], products: tuple[tuple[Array, Array], ...], jacobian: Array, pixels: float, count: int = PARTS
) -> tuple[Array, Array]:
    """Expectations (forms, parts) of the forms per pixel for each part of strength 1, and the forms' own size.

    Of each weight the first `count` of the products make forms; the first two weights, parts. To 1e-6, as the forms.

    With S = w T w and C = v T' v: tr(S Q C Q) = tr(S C) - 2 tr(U^T S C U) + tr(U^T S U U^T C U), and
    tr(S C) = (w v)^T (T * T') (w v) because T * T' is again a correlation along columns times one along rows.
    """
    shape = jacobian.shape
    basis = np.linalg.qr(jacobian.reshape(shape[0], -1).T)[0].T.reshape(shape).astype(np.float32)
    weights = [w.astype(np.float32) for w in weights]
    rows, columns = np.array(products[:count], dtype=np.float32).swapaxes(0, 1)
    parts = count * len(weights[:2])
    sandwich = np.concatenate([w * (rows[:, None] @ (w * basis) @ columns[:, None]) for w in weights])
    inner = np.einsum("iab,fjab->fij", basis, sandwich, optimize=True)
    flat = sandwich.reshape(len(sandwich), -1)
    out = np.tensordot(inner, inner[:parts].swapaxes(1, 2), axes=((1, 2), (1, 2))) - 2.0 * flat @ flat[:parts].T
    a, b = np.triu_indices(count)
    both_rows, both_columns, block = rows[a] * rows[b], columns[a] * columns[b], np.empty((count, count))
    for i, w in enumerate(weights):
        for j, v in enumerate(weights[:2]):
            block[a, b] = block[b, a] = ((w * v) * (both_rows @ (w * v) @ both_columns)).sum((1, 2))
            out[i * count : (i + 1) * count, j * count : (j + 1) * count] += block
    size = np.concatenate([np.sqrt((w**2 * (rows**2 @ w**2 @ columns**2)).sum((1, 2))) for w in weights])
    return np.asarray(out, np.float64) / pixels, np.asarray(size, np.float64) / pixels
