"""What counts as degenerate, and the error that says so."""

from __future__ import annotations

from windmark.errors import DataError

COLLINEAR = 1e-10
"""Triangles with an area below this times the longest edge squared determine no pose."""


class DegenerateGeometry(DataError):
    """The given geometry does not determine what was asked for.

    Parameters
    ----------
    message
        What is degenerate, in words.
    weak
        Names of the parameters or directions that are not determined.

    Examples
    --------
    >>> import windmark as wm
    >>> on_a_line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    >>> try:
    ...     wm.pose_candidates([[300, 240], [320, 240], [340, 240]], on_a_line, wm.Camera((640, 480), 800.0))
    ... except wm.DegenerateGeometry as error:
    ...     print(error.weak)
    ('rotation about the line of the points',)
    """

    def __init__(self, message: str, weak: tuple[str, ...] = ()) -> None:
        super().__init__(message if not weak else f"{message} (not determined: {', '.join(weak)})")
        self.weak = weak
