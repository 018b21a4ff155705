"""What windmark says on purpose, as opposed to its faults; and what counts as degenerate."""

from __future__ import annotations

import dis
import os
from pathlib import Path
from types import TracebackType

COLLINEAR = 1e-10
"""Triangles with an area below this times the longest edge squared determine no pose."""


class WindmarkError(ValueError):
    """Something that the user can change: its message says what came and what was expected.

    Of this type are bad files (`io.FileError`), laws (`LawError`) and geometry that determines nothing
    (`DegenerateGeometry`). A wrong shape, unit or option is a plain `ValueError`, raised by windmark's own code: `said`
    tells it from the one that a fault of windmark brings out of a library.
    """


class DegenerateGeometry(WindmarkError):
    """The given geometry does not determine what was asked for.

    Parameters
    ----------
    message
        What is degenerate, in words.
    weak
        Names of the parameters or directions that are not determined.
    """

    def __init__(self, message: str, weak: tuple[str, ...] = ()) -> None:
        super().__init__(message if not weak else f"{message} (not determined: {', '.join(weak)})")
        self.weak = weak


def said(error: ValueError) -> str:
    """The message of an error that windmark raised on purpose; any other is a fault and is raised again, as it came.

    Where one image, page or part fails by what the data are, the others go on and its message is kept. An array of a
    wrong shape inside windmark raises a `ValueError`, too, but is no word on the data.
    """
    if not on_purpose(error):
        raise error
    return str(error)


def on_purpose(error: BaseException) -> bool:
    """Whether it is a `WindmarkError`, or a `ValueError` that a ``raise`` in windmark's own code has made."""
    if isinstance(error, WindmarkError):
        return True
    step = error.__traceback__
    if not isinstance(error, ValueError) or step is None:
        return False
    while step.tb_next is not None:
        step = step.tb_next
    return _is_ours(step) and step.tb_frame.f_code.co_code[step.tb_lasti] == _RAISE


_RAISE = dis.opmap["RAISE_VARARGS"]
_PACKAGE = str(Path(__file__).resolve().parent.parent) + os.sep


def _is_ours(step: TracebackType) -> bool:
    return os.path.realpath(step.tb_frame.f_code.co_filename).startswith(_PACKAGE)
