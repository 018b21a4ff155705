"""What matching two pictures gives: pairs of spots, or why there are none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from windmark.geometry.described import described
from windmark.geometry.two_view import TwoView
from windmark.scene.shown import pandas_table

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


@described(lambda m: {
    "pairs": len(m), "open": f"{len(m.open_a)} and {len(m.open_b)}", "log10_nfa": f"{m.log10_nfa:.0f}",
    "runner-up": "none" if m.runner_up is None else f"{m.runner_up[1]} pairs",
})  # fmt: skip
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

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> xyz = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 3)) * [2.0, 1.5, 0.2]
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> left, right = (wm.Pose.look_at([x, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-0.5, 0.5))
    >>> a, b = (wm.Detections.make(camera.project(pose.apply(xyz))[0].round(1)) for pose in (left, right))
    >>> pairs = wm.match_pair(a, b, camera)
    >>> shift = b.xy[pairs.b] - a.xy[pairs.a]  # how far each marker moved from picture to picture
    >>> shift.shape, bool(abs(pairs.distance_px).max() < 0.3)
    ((60, 2), True)
    >>> bool(pairs.view.b_from_a.angle_to(right @ left.inverse()) < 0.01), pairs.runner_up is None
    (True, True)
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

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: the spots of every pair and their distance from the epipolar geometry."""
        return pandas_table({"a": self.a, "b": self.b, "distance_px": self.distance_px})

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

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> a, b = np.random.default_rng(1).uniform(0.0, 480.0, (2, 30, 2))  # spots that have nothing in common
    >>> answer = wm.match_pair(wm.Detections.make(a), wm.Detections.make(b), wm.Camera((640, 480), 800.0))
    >>> bool(answer), answer.cause
    (False, 'nothing')
    >>> answer.count
    0
    """

    reason: str
    cause: Cause
    count: int = 0
    log10_nfa: float = float("inf")
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
