"""What matching two pictures gives: pairs of spots, or why there are none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.two_view import TwoView

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CAUSES = {
    "too_few": "too few spots to tell a constellation from chance",
    "nothing": "no piece of one picture is found in the other one",
    "weak": "the best matching could be chance",
    "ambiguous": "two different matchings are about equally good",
}
"""Every cause of a `NotMatched`, in words."""
Cause = Literal["too_few", "nothing", "weak", "ambiguous"]


@dataclass(frozen=True)
class PairMatching:
    """Spots of two pictures that are one marker, one to one.

    Parameters
    ----------
    a, b : (K,) indices into the detections of the two pictures
    distance_px : (K,) signed Sampson distance of each pair from the epipolar geometry
    view : the two-view geometry of the pairs
    open_a, open_b : spots without a partner that should have one there: ambiguous, or missing in the other picture
    log10_nfa : decimal logarithm of the number of such matchings that chance would give
    score : log-likelihood ratio in nats, to compare with that of the runner-up
    runner_up : (score, pairs) of the best matching with other pairs, None where none came near
    options : everything it was made with, by name
    """

    a: Ints
    b: Ints
    distance_px: Array
    view: TwoView
    open_a: Ints
    open_b: Ints
    log10_nfa: float
    score: float
    runner_up: tuple[float, int] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.a)

    def __bool__(self) -> bool:
        return True


@dataclass(frozen=True)
class NotMatched:
    """Why two pictures were not matched; falsy.

    Parameters
    ----------
    reason : in words, with the numbers
    cause : one of `CAUSES`
    count : pairs of the best matching that was seen
    log10_nfa : its false-alarm number
    options : everything it was made with, by name
    """

    reason: str
    cause: Cause
    count: int = 0
    log10_nfa: float = float("inf")
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
