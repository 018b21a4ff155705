"""Pictures that a film lacks, by its time stamps: gaps of whole pictures in what has a constant rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

NEAR = 0.25
"""A gap is one of whole pictures if it is so near to them, in the time from one picture to the next."""
FINE = 4.0
"""Ticks from one picture to the next from which rounding makes no step look like two."""
TOLD = 3
"""So many gaps are named."""


def gaps_between(stamps: Sequence[int], *, rounded: bool = False) -> dict[int, int]:
    """Frame behind each gap -> how many pictures are missing there; none where the rate is not constant.

    Parameters
    ----------
    stamps : of all frames, in the stream's whole ticks, increasing
    rounded : they are times rounded to a tick (milliseconds in an MKV), and do not count pictures (as in an AVI)
    """
    steps = np.diff(np.asarray(stamps, np.float64))
    if len(steps) < 2:
        return {}
    usual = float(np.mean(steps[steps <= 1.5 * np.median(steps)]))
    if rounded and usual < FINE:
        return {}
    times = np.round(steps / usual)
    away = np.abs(steps - times * usual)
    if (away > np.maximum(NEAR * usual, 1.0)).any() or (times < 1).any():
        return {}
    return {int(k) + 1: int(times[k]) - 1 for k in np.flatnonzero(times > 1)}


def said_of(gaps: dict[int, int], keys: NDArray[np.int64] | None, count: int) -> str:
    """The gaps in words, and which frames may be wrong by them; "" for none.

    Parameters
    ----------
    gaps : see `gaps_between`
    keys : frames that are coded by themselves, increasing; None where frames say themselves what they lack
    count : frames of the film
    """
    if not gaps:
        return ""
    where = [f"{n} before frame {k}" for k, n in list(gaps.items())[:TOLD]]
    more = f" and {len(gaps) - TOLD} more places" if len(gaps) > TOLD else ""
    said = f"by its time stamps the film lacks pictures: {', '.join(where)}{more}"
    if keys is None:
        return said
    coded = [(k, _next(keys, k, count)) for k in gaps if k not in keys]
    if not coded:
        return said
    first, end = coded[0]
    those = f"frames {first} to {end - 1}" if end - 1 > first else f"frame {first}"
    others = " and those behind other gaps" if len(coded) > 1 else ""
    return f"{said} (where these were lost after the film was coded, {those}{others} are coded from what is not there)"


def _next(keys: NDArray[np.int64], frame: int, count: int) -> int:
    """The next frame that is coded by itself."""
    k = int(np.searchsorted(keys, frame))
    return int(keys[k]) if k < len(keys) else count
