"""Which code does the linear algebra: compiled kernels, or NumPy where numba is disabled; and on how many threads."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any

from numba.core import config

if config.DISABLE_JIT:
    from windmark.adjust.network.numpy_path import accumulate, factor_blocks, jacobian_rows, residuals
else:
    from windmark.adjust.network._block_kernels import factor_blocks
    from windmark.adjust.network._kernels import accumulate, jacobian_rows, residuals

__all__ = ["accumulate", "factor_blocks", "jacobian_rows", "residuals", "single_thread"]

MANY = 1500
"""Dense parameters from which more than one BLAS thread is worth its start."""


@cache
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def single_thread(dense: int) -> AbstractContextManager[Any]:
    """One BLAS thread for small systems: two that wait for each other take a thousand times as long as one."""
    return _controller().limit(limits=1, user_api="blas") if dense < MANY else nullcontext()
