"""Which code does the linear algebra: compiled kernels, or NumPy where numba is disabled; and on how many threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from numba.core import config

if config.DISABLE_JIT:
    from windmark.adjust.network.numpy_path import (
        accumulate,
        factor_blocks,
        gather,
        influences,
        jacobian_rows,
        residuals,
    )
else:
    from windmark.adjust.network._block_kernels import factor_blocks
    from windmark.adjust.network._influence_kernels import gather, influences
    from windmark.adjust.network._kernels import accumulate, jacobian_rows, residuals

__all__ = ["accumulate", "factor_blocks", "gather", "influences", "jacobian_rows", "residuals", "single_thread"]

MANY = 1500
"""Dense parameters from which more than one BLAS thread is worth its start."""


@cache
def _libraries() -> tuple[Any, ...]:
    from threadpoolctl import ThreadpoolController

    return tuple(ThreadpoolController().select(user_api="blas").lib_controllers)


@contextmanager
def single_thread(dense: int) -> Iterator[None]:
    """One BLAS thread for small systems: two that wait for each other take a thousand times as long as one.

    Asked of the libraries themselves: `threadpoolctl.threadpool_limits` takes as long as a small factorisation.
    """
    more = [(b, n) for b in _libraries() if (n := b.get_num_threads()) and n > 1] if dense < MANY else []
    for library, _ in more:
        library.set_num_threads(1)
    try:
        yield
    finally:
        for library, count in more:
            library.set_num_threads(count)
