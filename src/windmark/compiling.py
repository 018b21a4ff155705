"""Waiting for kernels that are compiled at their first use: how long, and a word when it begins.

Compiling is done once for each machine and is no part of a measurement: what is timed for a result is timed with
`working_time` or `job_time`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["announce", "compiled", "compiling_seconds", "job_time", "waiting", "working_time"]

WORTH_A_WORD = 1.0  # seconds of compiling after which it is said: one kernel that was missing is not worth a line


class _Here(threading.local):
    waited = 0.0
    deep = 0


class _Process:
    seconds = 0.0
    say: Callable[[], None] | None = None


_here = _Here()
_process = _Process()


def working_time() -> float:
    """Seconds of this thread's clock on the wall, which stands still while the thread waits for a kernel to be ready.

    To be used as `time.perf_counter`: differences only.
    """
    return time.perf_counter() - _here.waited


def job_time() -> float:
    """Seconds of the clock on the wall, which stands still while any thread of this process compiles: for whole jobs,
    whose threads wait for each other.

    To be used as `time.perf_counter`: differences only.
    """
    return time.perf_counter() - _process.seconds


def compiling_seconds() -> float:
    """Wall time for which this process has compiled so far; kernels that were read from a disk do not count."""
    return _process.seconds


def announce(say: Callable[[], None] | None) -> None:
    """What is done, once, when this process compiles more than a kernel or two; None: nothing."""
    _process.say = say


@contextmanager
def waiting() -> Iterator[None]:
    """For as long as a thread waits for a kernel: compiled by itself or by another thread, or read from a disk."""
    _here.deep += 1
    start = time.perf_counter()
    try:
        yield
    finally:
        _here.deep -= 1
        if not _here.deep:
            _here.waited += time.perf_counter() - start


def compiled(seconds: float) -> None:
    """A kernel was compiled, with all that it calls: one thread at a time does so."""
    _process.seconds += seconds
    if _process.say is not None and _process.seconds > WORTH_A_WORD:
        say, _process.say = _process.say, None
        say()
