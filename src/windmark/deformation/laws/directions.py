"""Points and directions that laws are given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError

Array = NDArray[np.float64]
Vector = Sequence[float]


def vector(values: Vector, name: str) -> Array:
    """A finite (3,) array.

    Raises
    ------
    ValueError
        Naming the option.
    """
    out = np.asarray(values, dtype=float)
    if out.shape != (3,) or not np.isfinite(out).all():
        raise UsageError(f"{name}: expected three finite numbers, got {values!r}")
    return out


def unit(values: Array, name: str) -> Array:
    """A unit vector.

    Raises
    ------
    ValueError
        When it has no length.
    """
    length = float(np.linalg.norm(values))
    if not length > 1e-12:
        raise UsageError(f"{name} has no length")
    return np.asarray(values / length)
