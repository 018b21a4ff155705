"""What the correlation of a frame's noise does to the covariance of a centre, apart from everything else.

With L L^T = C_0 the covariance in white noise as strong as the marker's is taken to be, and C that in the frame's
noise, the *colour* is the matrix M with C = L M L^T: one on white noise, up to 25 on coarse paint. It depends on the
noise's correlation, the disc's shape and its contrast, which hardly change from one frame of a sequence to the next,
while C_0 follows place, light and noise at once. So M is handed on for some frames: computing it costs as much as the
fit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def colour_of(cov: Array, white: Array) -> Array:
    """M (K, 2, 2) of covariances (K, 2, 2) in the frame's noise and in white noise; NaN where either is unknown."""
    a, b, c = _factor(white)
    with np.errstate(divide="ignore", invalid="ignore"):
        xx = cov[:, 0, 0] / (a * a)
        xy = (cov[:, 0, 1] / a - xx * b) / c
        yy = (cov[:, 1, 1] - b * b * xx - 2.0 * b * c * xy) / (c * c)
    return _symmetric(xx, xy, yy)


def coloured(white: Array, colour: Array) -> Array:
    """Covariances (K, 2, 2) in the frame's noise, from those in white noise and M."""
    a, b, c = _factor(white)
    xx, xy, yy = colour[:, 0, 0], colour[:, 0, 1], colour[:, 1, 1]
    return _symmetric(a * a * xx, a * (b * xx + c * xy), b * b * xx + 2.0 * b * c * xy + c * c * yy)


def _factor(cov: Array) -> tuple[Array, Array, Array]:
    """Cholesky factor [[a, 0], [b, c]]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.sqrt(cov[:, 0, 0])
        b = cov[:, 0, 1] / a
        return a, b, np.sqrt(cov[:, 1, 1] - b * b)


def _symmetric(xx: Array, xy: Array, yy: Array) -> Array:
    out = np.empty((len(xx), 2, 2))
    out[:, 0, 0], out[:, 1, 1] = xx, yy
    out[:, 0, 1] = out[:, 1, 0] = xy
    return out
