"""Datums of a calibration: what fixes position, direction and size. There is no default; a guess would be wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from windmark.scene import MarkerCovariance


@dataclass(frozen=True)
class Fixed:
    """Some markers stay where they are; at least three, not on one line.

    Parameters
    ----------
    markers : their names; None holds all, so that only cameras and poses are found
    """

    markers: Sequence[str] | None = None


@dataclass(frozen=True)
class Weighted:
    """Some markers are known with a standard deviation, that of the table or the one given, or with a joint covariance.

    Parameters
    ----------
    markers : their names; None takes all with a finite sigma in the table, and those of the covariance
    sigma : one standard deviation for all their coordinates, in the length unit; None takes the table's
    covariance : of those of them whose errors are correlated, as of one survey; it counts in place of their sigma
    """

    markers: Sequence[str] | None = None
    sigma: float | None = None
    covariance: MarkerCovariance | None = None


@dataclass(frozen=True)
class Free:
    """Free network: the markers neither shift, turn nor (without known distances) grow on average.

    Coordinates come out fitted to those of the table, covariances are the smallest there are.

    Parameters
    ----------
    markers : those that hold it, by name; None takes all
    """

    markers: Sequence[str] | None = None


@dataclass(frozen=True)
class Distance:
    """A known distance between two markers.

    Parameters
    ----------
    first, second : names
    length, sigma : in the length unit
    """

    first: str
    second: str
    length: float
    sigma: float


Datum = Fixed | Weighted | Free
