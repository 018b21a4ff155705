"""Runs that are killed, for several tests: in a process of its own, as soon as the journal has so many frames."""

import gc
import os
import signal
import time

from windmark.pipeline.resume import measured

LOOK_S = 0.01
"""Between looks at the journal: a small part of what a frame takes, and each look reads all of it."""


def in_child(call):
    """Run it in a process of its own that may be killed; what is compiled and imported is there already."""
    pid = os.fork()
    if pid == 0:
        gc.disable()  # what others left, a film's decoder among it, waits for its threads, which are not here
        try:
            call()
        finally:
            os._exit(0)
    return pid


def killed_at(folder, frames, call, how=signal.SIGKILL):
    """Kill the child as soon as the journal in ``folder`` has so many frames."""
    pid = in_child(call)
    end = time.monotonic() + 120
    while measured(folder) < frames and time.monotonic() < end:
        time.sleep(LOOK_S)
    os.kill(pid, how)
    os.waitpid(pid, 0)


