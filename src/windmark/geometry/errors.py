"""Errors that pure geometry can raise."""

from __future__ import annotations


class DegenerateGeometry(ValueError):
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
