"""Signals that ask the process to end, and wait until something is done as a whole."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""Ctrl-C, a queue or a closing machine, a closing terminal, Ctrl-Break on Windows; the last two are not everywhere."""


_caught: list[int] | None = None
"""What has arrived in the block that waits; None outside of one. The main thread's alone, as signals are."""


@contextmanager
def interrupts_wait(said: str = "") -> Iterator[None]:
    """What arrives in the block is raised, as `KeyboardInterrupt`, when the block is done; what is ignored stays so.

    A block within another one is a part of it: what arrives there waits for the outer one, too.

    Parameters
    ----------
    said : what the user reads then; "" for the usual words
    """
    global _caught
    if threading.current_thread() is not threading.main_thread() or _caught is not None:
        yield
        return
    caught: list[int] = []
    before = {number: signal.getsignal(number) for number in ENDING}
    try:
        for number, handler in before.items():
            if handler != signal.SIG_IGN:
                signal.signal(number, lambda n, _: caught.append(n))
        _caught = caught
        yield
    finally:
        _caught = None
        for number, handler in before.items():
            if handler not in (None, signal.SIG_IGN):  # None: not Python's own, nobody can set it again
                signal.signal(number, handler)
    if caught:
        raise KeyboardInterrupt(*([said] if said else []))
