"""Residuals against those across a disc's centre. Private."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from windmark.geometry._jit import nb


@nb.njit(cache=True, nogil=True, error_model="numpy")
def odd_sums(images: Any, centre: Any, weigh: Any, known: Any, out: Any) -> None:
    """Of B markers (B, 4): sum of w o^2, its expectation in white noise of variance 1, and both with weights of 1.

    `images` (B, 4, S, S) as of `fit.Batch`, `centre` (B, 2) from their first pixel; w = a^T weigh a with a the
    influence of a pixel, `weigh` (B, 2, 2); `known` (B, 4, 4) the inverse normal matrix of the odd things that a fit
    takes out: both influences, light times x and y. Pixels count that have four used ones round the point across.
    """
    size = images.shape[2]
    t, place, share = np.empty(4), np.empty((5, 2), np.int64), np.empty(5)
    for b in range(len(images)):
        image, matrix = images[b], weigh[b]
        out[b] = 0.0
        for j in range(size):
            for i in range(size):
                if not _across(image[3], j, i, centre[b], place, share):
                    continue
                odd, expected = 0.0, 0.0
                t[:] = 0.0
                for k in range(5):
                    m, n, s = place[k, 0], place[k, 1], share[k]
                    odd += s * image[2, m, n]
                    expected += s * s + (2.0 * s if k > 0 and m == j and n == i else 0.0)
                    t[0] += s * image[0, m, n]
                    t[1] += s * image[1, m, n]
                    t[2] += s * image[3, m, n] * (n - size // 2)
                    t[3] += s * image[3, m, n] * (m - size // 2)
                for k in range(4):
                    for m in range(4):
                        expected -= t[k] * known[b, k, m] * t[m]
                x, y = image[0, j, i], image[1, j, i]
                weight = matrix[0, 0] * x * x + 2.0 * matrix[0, 1] * x * y + matrix[1, 1] * y * y
                out[b, 0] += weight * odd * odd
                out[b, 1] += weight * expected
                out[b, 2] += odd * odd
                out[b, 3] += expected


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _across(model: Any, j: int, i: int, centre: Any, place: Any, share: Any) -> bool:
    """A pixel and the four round the point across the centre (5, 2), their shares in the difference; if all are used.

    `model` (S, S) is 0 where a pixel was not used.
    """
    size, x, y = model.shape[0], 2.0 * centre[0] - i, 2.0 * centre[1] - j
    left, top = int(math.floor(x)), int(math.floor(y))
    if model[j, i] == 0.0 or left < 0 or top < 0 or left >= size - 1 or top >= size - 1:
        return False
    place[0, 0], place[0, 1], share[0] = j, i, 1.0
    for k in range(4):
        m, n = k // 2, k % 2
        if model[top + m, left + n] == 0.0:
            return False
        place[k + 1, 0], place[k + 1, 1] = top + m, left + n
        share[k + 1] = -(x - left if n else 1.0 - x + left) * (y - top if m else 1.0 - y + top)
    return True
