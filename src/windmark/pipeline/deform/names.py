"""Which frame a picture is of, by its name: a number, a time stamp, or the name itself.

The frame is the last number of a name. It is a time stamp where that number, as a whole, is a date and a time of day
of 14 digits (``YYYYMMDDhhmmss``), with 3, 6 or 9 more for a fraction of the second; or where a name ends in such a
date, one of ``- _ T``, such a time, and perhaps ``.`` and a fraction. A counter behind a stamp
(``20261122-140005-0012``) is the last number, and counts. The stamp is taken as it stands: no time zone, no daylight
saving.
"""

from __future__ import annotations

import calendar
import re
from collections.abc import Collection, Iterable
from datetime import datetime
from typing import Any

import numpy as np

from windmark import io
from windmark.io.recordings.folder import natural

DIGITS = 18
"""Numbers of more digits do not fit a 64-bit integer: their frames are counted in order, their digits are a name."""
EXACT = 2**53
"""Whole numbers from here on are not exact as float64: their distance to the first one is."""
_NUMBER = re.compile(r"[0-9]+")
_DATE = r"(?:19[7-9]|20[0-9])[0-9][0-1][0-9][0-3][0-9]"
_STAMP_AT_END = re.compile(rf"(?<![0-9])({_DATE})[-_T]([0-2][0-9][0-5][0-9][0-5][0-9])(?:\.((?:[0-9]{{3}}){{1,3}}))?$")


def key_of(stem: str, *, stamps: bool = True) -> str:
    """The frame of an image: the last number in its name, without leading zeros; the name itself if it has none.

    Parameters
    ----------
    stem : the name without its extension
    stamps : a date and a time apart from each other at the end of the name are one number, see above
    """
    if stamps and (split := _STAMP_AT_END.search(stem)) is not None:
        joined = "".join(part or "" for part in split.groups())
        if stamp_ns(joined) is not None:
            return joined
    numbers = _NUMBER.findall(stem)
    return (numbers[-1].lstrip("0") or "0") if numbers else stem


def key_of_file(file: io.PictureFile, *, counted: bool = False) -> str:
    """`key_of` a picture; the frame of a recording has its number in the recording, whatever stands before it.

    ``counted``: pictures that a film lacks have a number, too, as other cameras have them.
    """
    key = key_of(file.stem, stamps=not isinstance(file, io.Frame))
    lost = file.frames.lost_before(file.number) if counted and isinstance(file, io.Frame) else 0
    return str(int(key) + lost) if lost and is_number(key) else key


def is_number(key: str) -> bool:
    """Whether a frame is called by digits."""
    return key.isascii() and key.isdigit()


def stamp_ns(key: str) -> int | None:
    """A frame's time stamp in nanoseconds since 1970-01-01; None where its digits are no date and time."""
    if len(key) not in (14, 17, 20, 23) or not is_number(key):
        return None
    try:
        moment = datetime.strptime(key[:14], "%Y%m%d%H%M%S")
    except ValueError:
        return None
    if not 1970 <= moment.year < 2100:
        return None
    return calendar.timegm(moment.timetuple()) * 10**9 + int(key[14:].ljust(9, "0"))


def stamp_text(key: str) -> str:
    """A frame's time stamp as ISO 8601 with as many digits as its name has; "" where it has none."""
    ns = stamp_ns(key)
    if ns is None:
        return ""
    unit = {14: "s", 17: "ms", 20: "us", 23: "ns"}[len(key)]
    return str(np.datetime64(ns, "ns").astype(f"datetime64[{unit}]"))


def order(key: str) -> tuple[int, Any]:
    """Sorts frames: numbers by value, stamps by time, names in natural order after them."""
    if not is_number(key):
        return 1, natural(key)
    digits = key.ljust(23, "0") if stamp_ns(key) is not None else key
    return 0, (len(digits), digits)


def number_of(key: str, index: int) -> int:
    """The 64-bit number of a frame: its digits; its place in the sequence where these are too many; -1 for a name."""
    if not is_number(key):
        return -1
    return int(key) if len(key) <= DIGITS else index


def kind_of(keys: Iterable[str]) -> str:
    """What says when frames were: "stamp" or "number" where all are called by one, otherwise "order"."""
    kinds = {
        "stamp" if stamp_ns(k) is not None else "number" if is_number(k) and len(k) <= DIGITS else "order" for k in keys
    }
    return kinds.pop() if len(kinds) == 1 else "order"


def instant_of(key: str, kind: str, first: str, index: int) -> float:
    """When a frame was: its number (large ones less the first), seconds since the first stamp, or its place."""
    if kind == "stamp":
        return ((stamp_ns(key) or 0) - (stamp_ns(first) or 0)) / 1e9
    if kind == "number":
        return float(int(key) - (int(first) if int(first) >= EXACT else 0))
    return float(index)


def said_of(keys: Collection[str], rate_hz: float | None) -> list[str]:
    """What is unusual about the names of frames, in words."""
    ordered, out = sorted(keys, key=order), []
    if keys and kind_of(keys) == "stamp":
        text = f"the pictures' names are time stamps ({ordered[0]} is {stamp_text(ordered[0])}), which are their times"
        out.append(text if rate_hz is None else f"{text}; rate_hz is not used")
    long = [k for k in ordered if len(k) > DIGITS and is_number(k) and stamp_ns(k) is None]
    if long:
        out.append(
            f"{len(long)} frames have numbers of more than {DIGITS} digits ({long[0]}): their frame is their place in "
            "the order of the numbers, from 0; the digits are kept as name"
        )
    if len(keys) > 1 and kind_of(keys) == "order" and {kind_of([k]) for k in keys} - {"order"}:
        out.append(
            "not all pictures' names are numbers, or time stamps, of one kind: they are taken one by one, in order"
        )
    return out
