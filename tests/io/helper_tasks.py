"""What a file may do to the process that reads it; called there by tests of `windmark.io.apart`."""

from __future__ import annotations

import ctypes
import os
import sys

import numpy as np

from windmark.io.errors import FileError


def crash(path):
    """Read at address 0."""
    return {"never": ctypes.string_at(0)}


def loop(path):
    """Follow a chain that closes on itself."""
    while True:
        pass


def eat(path):
    """Believe a header."""
    return {"all": np.zeros(2**36, np.uint8)}


def refuse(path):
    """Say what is wrong."""
    raise FileError(path, "is none; expected one", 7)


def fail(path):
    """A fault of the program."""
    return {"never": 1 / 0}


def content(path, *, scale):
    """Arrays of every kind, and where they came from."""
    values = np.arange(5.0) * scale
    sys.stdout.write("to the screen")
    sys.stdout.flush()
    return {
        "a": values, "words": np.array(["ä", "bc"]), "n": 3, "deep": {"x": [1, None]}, "process": os.getpid(),
        "length": len(path),
    }  # fmt: skip
