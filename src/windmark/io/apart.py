"""Read a file in a process of its own, with limits: some libraries crash, loop or fill the memory on damaged files.

VTK and HDF5 are complete and well kept, but what they believe of a damaged file no Python code can take back: VTK ends
the process, HDF5 follows a chain that closes on itself for ever. So a helper process parses and hands back plain
arrays; a file that ends it, or takes too long or too much, is refused, and the next one gets a new helper. It starts
with the first such file (about 0.5 s, once), waits for the next, and ends with its owner; the price per file is the
copy of the arrays, some 1 ms/MB. Memory is limited by the system where it can be (Linux; Windows through a job), time
everywhere. Where no helper can be started (programs frozen into one file, systems that forbid it) the file is read here.
"""

from __future__ import annotations

import atexit
import importlib
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from windmark.io._limits import limit_memory, limit_time
from windmark.io.errors import FileError, reading
from windmark.io.text import Pathlike

MIB = 2**20
_MEMORY_MIB, _MEMORY_PER_BYTE = 1024, 50
"""Address space for a file: text of two bytes per number takes some 30 times its size on the way through VTK."""
_TIME_S, _TIME_S_PER_MIB = 4.0, 1.0
"""VTK's slowest reader takes 0.1 s/MiB of text."""
_KEPT_MIB = 64
"""A helper that has answered more is not kept: it would hold on to the memory."""
_START = "import sys; sys.path[:] = sys.argv[1:]; from windmark.io.apart import serve; serve()"

Content = dict[str, Any]
"""Arrays of numbers or text, and what JSON can hold."""


def read_apart(function: str, path: Pathlike, **options: Any) -> Content:
    """What ``function(path, **options)`` returns, called in a process of its own.

    Parameters
    ----------
    function : ``module:name``; returns a dictionary of arrays and of what JSON can hold
    path : the file
    options : further arguments, what JSON can hold

    Raises
    ------
    FileError
        As the function raises it; also where the file crashes its library, or is not read within 4 s + 1 s/MiB or
        1 GiB + 50 times its size of memory (time of the processor, see `limit_time`).
    """
    with reading(path), open(path, "rb") as stream:
        size = os.fstat(stream.fileno()).st_size
    with _GUARD:
        helper = _helper()
        if helper is None:
            return _called(function, path, options)
        try:
            return helper.call(function, path, options, size)
        finally:
            if not helper.is_ready:  # Ctrl-C in the middle of an answer, a file that ended it, or much memory taken
                _drop()


def _called(function: str, path: Pathlike, options: Mapping[str, Any]) -> Content:
    module, _, name = function.partition(":")
    content: Content = getattr(importlib.import_module(module), name)(path, **options)
    return content


class _Helper:
    """A process that reads files for this one."""

    def __init__(self) -> None:
        here = [os.path.abspath(entry) for entry in sys.path]  # "" is the folder that was current at the start
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, *here],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        self.owner = os.getpid()
        self.is_ready = _receive(self._out) == b"ready"

    @property
    def _out(self) -> IO[bytes]:
        return self._process.stdout  # type: ignore[return-value]

    @property
    def _in(self) -> IO[bytes]:
        return self._process.stdin  # type: ignore[return-value]

    @property
    def is_alive(self) -> bool:
        """Whether it is this process's own, and waiting."""
        return self.owner == os.getpid() and self._process.poll() is None

    def call(self, function: str, path: Pathlike, options: Mapping[str, Any], size: int) -> Content:
        """The answer of the function, or the reason why there is none."""
        memory = _MEMORY_MIB * MIB + _MEMORY_PER_BYTE * size
        limit_s = _TIME_S + _TIME_S_PER_MIB * size / MIB
        request = [function, os.path.abspath(path), options, memory, limit_s]
        self.is_ready = False
        start = time.monotonic()
        with suppress(OSError):  # a helper that was killed from outside: no answer
            _send(self._in, json.dumps(request).encode())
        answer = _receive(self._out)
        if answer is None:
            late = time.monotonic() - start >= limit_s  # of its processor's time, so of the clock's, too
            what = f"it is not read within {limit_s:.0f} s" if late else "it ends the library that reads it"
            raise FileError(path, f"damaged: {what}")
        content = _unpacked(answer)
        self.is_ready = len(answer) <= _KEPT_MIB * MIB
        kind = content.pop("answer")
        if kind == "refused":
            raise FileError(path, content["what"], content["where"])
        if kind == "memory":
            raise FileError(path, f"damaged, or too large: it takes over {memory // MIB} MiB of memory to read it")
        if kind == "error":
            raise RuntimeError(f"{function} failed on {path}\n{content['what']}")
        return content

    def close(self) -> None:
        """End it, whatever it does; a forked copy of its owner only lets go."""
        if self.owner == os.getpid():
            self._process.kill()
            self._process.wait()
        else:
            self._process.returncode = 0  # not ours to wait for
        for stream in (self._in, self._out):
            with suppress(OSError):
                stream.close()


_GUARD = threading.RLock()
_KEPT: list[_Helper] = []


def _helper() -> _Helper | None:
    """The helper of this process; None where it can have none."""
    if _KEPT and not _KEPT[0].is_alive:
        _drop()
    if not _KEPT and sys.executable and not getattr(sys, "frozen", False):
        with suppress(OSError):
            _KEPT.append(_Helper())
            if not _KEPT[0].is_ready:
                _drop()
    return _KEPT[0] if _KEPT else None


@atexit.register
def _drop() -> None:
    while _KEPT:
        _KEPT.pop().close()


def _renew_guard() -> None:
    """In a forked process: another thread of the parent may have held the lock."""
    global _GUARD
    _GUARD = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_guard)


def serve() -> None:
    """The helper's side: answer requests until the owner is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the owner, who ends this process
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for channel in (0, 1):
        os.dup2(nothing, channel)  # libraries that print must not answer
    _send(answers, b"ready")
    while (request := _receive(requests)) is not None:
        function, path, options, memory, limit_s = json.loads(request)
        with limit_memory(memory), limit_time(limit_s):
            answer = _answer(function, path, options)
        _send(answers, answer)


def _answer(function: str, path: str, options: Mapping[str, Any]) -> bytes:
    import traceback

    try:
        return _packed({"answer": "done", **_called(function, path, options)})
    except FileError as error:
        return _packed({"answer": "refused", "what": error.what, "where": error.where})
    except MemoryError:
        return _packed({"answer": "memory"})
    except Exception:  # a fault of windmark: told where it can be seen
        return _packed({"answer": "error", "what": traceback.format_exc()})


def _packed(content: Content) -> bytes:
    """Arrays and JSON as one archive of NumPy: whatever a damaged file has made of the helper, no code comes back."""
    arrays = {f"_{k}": v for k, v in content.items() if isinstance(v, np.ndarray)}
    plain = json.dumps({k: v for k, v in content.items() if not isinstance(v, np.ndarray)})
    out = io.BytesIO()
    np.savez(out, plain=np.frombuffer(plain.encode(), np.uint8), **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def _unpacked(data: bytes) -> Content:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        plain: NDArray[np.uint8] = archive["plain"]
        content: Content = json.loads(plain.tobytes())
        return content | {name[1:]: archive[name] for name in archive.files if name != "plain"}


def _send(stream: IO[bytes], data: bytes) -> None:
    stream.write(len(data).to_bytes(8, "little"))
    stream.write(data)
    stream.flush()


def _receive(stream: IO[bytes]) -> bytes | None:
    """The next message; None at the end of the stream."""
    head = stream.read(8)
    size = int.from_bytes(head, "little")
    data = stream.read(size) if len(head) == 8 else b""
    return data if len(head) == 8 and len(data) == size else None
