"""Which pictures of several cameras are of one instant: those of one number, whatever is missing before them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from windmark.pipeline.deform.names import order
from windmark.pipeline.psp.taken import Taken

NAMED = 3
"""Pictures without a partner that are named."""


def in_order(pictures: Sequence[Taken]) -> list[Taken]:
    """The pictures of a camera by their numbers: 2 before 10; as they are where two of them have one number."""
    keys = [p.key for p in pictures]
    return sorted(pictures, key=lambda p: order(p.key)) if len(set(keys)) == len(keys) else list(pictures)


def by_instant(raw: Mapping[str, Sequence[Taken]]) -> list[dict[str, Taken]]:
    """Camera -> its picture of each instant, in order.

    Where a camera has two pictures of one number, or cameras that have as many pictures, and none is missing between,
    have other numbers (each counts for itself), numbers pair nothing: the first ones are of one instant, then the
    second ones.
    """
    keyed = {name: {p.key: p for p in own} for name, own in raw.items()}
    counts = {len(own) for own in raw.values()}
    several = any(len(keyed[name]) < len(own) for name, own in raw.items())
    shared = set.intersection(*(set(own) for own in keyed.values())) if keyed else set()
    if several or (len(counts) == 1 and (not shared or all(_without_gap(list(own)) for own in keyed.values()))):
        keyed = {name: {str(k): p for k, p in enumerate(own)} for name, own in raw.items()}
    keys = sorted({key for own in keyed.values() for key in own}, key=order)
    return [{name: own[key] for name, own in keyed.items() if key in own} for key in keys]


def _without_gap(keys: Sequence[str]) -> bool:
    """Whether keys are numbers that follow each other."""
    if not all(key.isdigit() for key in keys):
        return False
    return max(map(int, keys)) - min(map(int, keys)) == len(keys) - 1


def alone_words(kind: str, instants: Sequence[Mapping[str, Taken]], cameras: Sequence[str]) -> dict[str, str]:
    """Cameras that have no picture of instants of which others have one -> what is to be said of it."""
    out = {}
    for camera in cameras:
        lost = [next(iter(of.values())).name for of in instants if camera not in of]
        if lost:
            more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
            out[f"{kind} pictures of {camera}"] = (
                f"{len(lost)} of {len(instants)} are not there; what other cameras show then counts alone: "
                f"{', '.join(lost[:NAMED])}{more}"
            )
    return out

