"""Signals that ask the process to end, and wait until something is done as a whole."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""Ctrl-C, a queue or a closing machine, a closing terminal, Ctrl-Break on Windows; the last two are not everywhere."""


@contextmanager
def interrupts_wait(said: str = "") -> Iterator[None]:
    """What arrives in the block is raised, as `KeyboardInterrupt`, when the block is done; what is ignored stays so.

    Parameters
    ----------
    said : what the user reads then; "" for the usual words
    """
    caught: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in ENDING:
            if signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, lambda n, _: caught.append(n))
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # None: not Python's own, nobody can set it again
                signal.signal(number, handler)
    if caught:
        raise KeyboardInterrupt(*([said] if said else []))
