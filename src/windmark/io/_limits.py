"""Limits of memory and time that a process sets itself."""

from __future__ import annotations

import ctypes
import faulthandler
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

WAITING = 10 if hasattr(signal, "setitimer") else 2


@contextmanager
def limit_time(seconds: float) -> Iterator[None]:
    """End the process where the block works longer than this; no library can hold it up.

    What counts is the processor's time where the system has a timer of it: a busy machine or a slow disk is no damage.
    Elsewhere, and for what only waits, a thread of C counts `WAITING` times as much on the clock.
    """
    has_timer = hasattr(signal, "setitimer")
    if has_timer:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)
    with open(os.devnull, "w") as nothing:
        faulthandler.dump_traceback_later(WAITING * seconds, exit=True, file=nothing)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
            if has_timer:
                signal.setitimer(signal.ITIMER_PROF, 0)


@contextmanager
def limit_memory(more: int) -> Iterator[None]:
    """Within the block the process may take ``more`` bytes on top of what it has; the system refuses what is above."""
    before = _set_limit(more)
    try:
        yield
    finally:
        if before is not None:
            import resource

            resource.setrlimit(resource.RLIMIT_AS, before)


def _set_limit(more: int) -> tuple[int, int] | None:
    """The limit before, where it is to be set back."""
    if sys.platform == "win32":
        with suppress(OSError, AttributeError):
            _limit_job(more)
        return None
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    statm = Path("/proc/self/statm")
    if not statm.exists():
        return None
    taken = int(statm.read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = min([taken + more, *(bound for bound in (soft, hard) if bound != resource.RLIM_INFINITY)])
    resource.setrlimit(resource.RLIMIT_AS, (wanted, hard))
    return soft, hard


class JobLimits(ctypes.Structure):
    """``JOBOBJECT_EXTENDED_LIMIT_INFORMATION`` of Windows."""

    _fields_ = (
        ("per_process_time", ctypes.c_int64), ("per_job_time", ctypes.c_int64), ("flags", ctypes.c_uint32),
        ("least_set", ctypes.c_size_t), ("most_set", ctypes.c_size_t), ("processes", ctypes.c_uint32),
        ("affinity", ctypes.c_size_t), ("priority", ctypes.c_uint32), ("scheduling", ctypes.c_uint32),
        ("counters", ctypes.c_uint64 * 6), ("process_memory", ctypes.c_size_t), ("job_memory", ctypes.c_size_t),
        ("peak_process", ctypes.c_size_t), ("peak_job", ctypes.c_size_t),
    )  # fmt: skip


_PROCESS_MEMORY, _EXTENDED = 0x100, 9
_JOB: list[int] = []


def _limit_job(more: int) -> None:
    """Windows: a job of this process alone, whose memory is limited to ``more`` and what a start takes."""
    kernel = ctypes.windll.kernel32  # type: ignore[attr-defined]
    kernel.CreateJobObjectW.restype = kernel.GetCurrentProcess.restype = ctypes.c_void_p
    if not _JOB:
        _JOB.append(kernel.CreateJobObjectW(None, None))
        kernel.AssignProcessToJobObject(ctypes.c_void_p(_JOB[0]), ctypes.c_void_p(kernel.GetCurrentProcess()))
    limits = JobLimits(flags=_PROCESS_MEMORY, process_memory=more + 512 * 2**20)
    kernel.SetInformationJobObject(ctypes.c_void_p(_JOB[0]), _EXTENDED, ctypes.byref(limits), ctypes.sizeof(limits))
