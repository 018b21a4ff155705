"""Numba kernel of the thin-plate spline; the readable twin is `bases.plate`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]


@nb.njit(cache=True, nogil=True)
def plate_places(u: Array, nodes: Array, parameters: Array, out: Array) -> None:
    """Out (N, 2) = plane + sum of weights times r^2 ln r at places u (N, 2); parameters (2, 3 + M) of x and y."""
    for n in range(u.shape[0]):
        x, y = u[n, 0], u[n, 1]
        px = parameters[0, 0] + parameters[0, 1] * x + parameters[0, 2] * y
        py = parameters[1, 0] + parameters[1, 1] * x + parameters[1, 2] * y
        for k in range(nodes.shape[0]):
            dx, dy = x - nodes[k, 0], y - nodes[k, 1]
            square = dx * dx + dy * dy
            if square > 0.0:
                value = 0.5 * square * math.log(square)
                px += parameters[0, 3 + k] * value
                py += parameters[1, 3 + k] * value
        out[n, 0], out[n, 1] = px, py
