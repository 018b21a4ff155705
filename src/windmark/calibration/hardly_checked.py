"""Known markers and distances that the others hardly check, in figures and in words.

Where a network has few known markers most of an error of one goes into the frame that they hold, and little is left in
the residuals that are tested: it moves everything, and is no contradiction (Baarda 1968). That is no fault of a
measurement, but its user has to know it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from windmark.errors import g2
from windmark.scene import MarkerSet

UNCHECKED = 0.01
"""Share of the weight of an error that is left in residuals, below which nothing checks it (Foerstner 1979): one that
would be noticed is so large then that a linear model says nothing of it."""
NAMED = 3
"""Others that are named beside the worst."""


@dataclass(frozen=True)
class Hardly:
    """A known marker of which the rest of a network shows little.

    Parameters
    ----------
    point, marker : rows among the markers of the calibration: of itself, and of the other one that its error moves
        most beside its sigma
    axis : along which the error is, mostly: "x", "y" or "z"
    share : of the weight of the error that is left in the residuals
    error, sigmas : an error that is mostly (80 %) noticed (length units), and that in its own sigmas; a smaller one is
        likely not
    moved, times : how far it moves the other marker (length units, along an axis), and that in the sigmas of the latter
    """

    point: int
    marker: int
    axis: str
    share: float
    error: float
    sigmas: float
    moved: float
    times: float


@dataclass(frozen=True)
class HardlyBar:
    """A known distance of which the rest of a network shows little.

    Parameters
    ----------
    first, second : its markers
    share : of the weight of its error that is left in its residual
    error, sigmas : an error that is mostly (80 %) noticed (length units), and that in its own sigmas; a smaller one is
        likely not
    scale : part by which it changes all lengths
    """

    first: str
    second: str
    share: float
    error: float
    sigmas: float
    scale: float


def hardly_checked_words(hardly: Sequence[Hardly], bars: Sequence[HardlyBar], markers: MarkerSet) -> str:
    """What is said of known markers and distances of a network that others hardly check, the worst first; "" of none.

    ``markers`` are those of the calibration.
    """
    said = _of_markers(hardly, markers), _of_bars(bars, markers.length_unit or "")
    return "; ".join(words for words in said if words)


def _of_bars(bars: Sequence[HardlyBar], unit: str) -> str:
    if not bars:
        return ""
    worst, *others = bars
    said = (
        f"the rest hardly checks the known distance {worst.first} to {worst.second}: an error of up to "
        f"{_length(worst.error, unit)} of it ({g2(worst.sigmas)} of its sigmas) may go unnoticed, and changes all "
        f"lengths by up to {g2(100 * worst.scale)} %"
    )
    if others:
        some = [
            f"{o.first} to {o.second} (up to {_length(o.error, unit)}, {g2(100 * o.scale)} % of all lengths)"
            for o in others[:NAMED]
        ]
        more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
        said += f"; hardly checked as well: {', '.join(some)}{more}"
    return said


def _of_markers(hardly: Sequence[Hardly], markers: MarkerSet) -> str:
    if not hardly:
        return ""
    worst, *others = hardly
    names, unit = markers.name.tolist(), markers.length_unit or ""
    one, far = str(names[worst.point]), str(names[worst.marker])
    if worst.share < UNCHECKED:
        said = (
            f"nothing checks the known marker {one} along {worst.axis}: an error there moves {far} "
            f"{g2(worst.moved / worst.error)} times as far, and all others with it"
        )
    else:
        said = (
            f"the other known markers hardly check {one}: an error of up to {_length(worst.error, unit)} of it "
            f"({g2(worst.sigmas)} of its sigmas, along {worst.axis} mostly) may go unnoticed, and moves {far} by "
            f"up to {_length(worst.moved, unit)}, {g2(worst.times)} of its sigmas"
        )
    if others:
        some = [_briefly(o, names, unit) for o in others[:NAMED]]
        more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
        said += f"; hardly checked as well: {', '.join(some)}{more}"
    return said


def _briefly(hardly: Hardly, names: Sequence[str], unit: str) -> str:
    one, far = names[hardly.point], names[hardly.marker]
    if hardly.share < UNCHECKED:
        return f"{one} (along {hardly.axis}, by nothing)"
    error, moved = _length(hardly.error, unit), _length(hardly.moved, unit)
    return f"{one} (up to {error} along {hardly.axis}, which moves {far} by {moved})"


def _length(value: float, unit: str) -> str:
    return f"{g2(value)} {unit}".rstrip()
