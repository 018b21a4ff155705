"""Whether the cameras of a rig agree: one that shows nothing where the others see the model is not where it is said."""

from __future__ import annotations

from collections.abc import Sequence

from scipy.special import bdtr

from windmark.registration.judge.source import CONFIRMED
from windmark.registration.settle.solution import Solution
from windmark.registration.task import MIN_COUNT

ELSEWHERE = 50.0
"""A camera that does not confirm the solution contradicts it if it has so much evidence (nats) for another one, ..."""
UNLIKELY = 1e-3
"""... or where so few pairs are less likely than this by what the other cameras see, ..."""
SEEN_LEAST, SEEN_MOST = 0.25, 0.95
"""... at least and at most this part of the markers."""


def contradiction(best: Solution, others: Sequence[Solution], c: int) -> str:
    """Why camera c cannot have seen the model where the others see it; empty if it can."""
    spots = len(best.views.planes[c].task.xy)
    if spots < MIN_COUNT or best.scores[c] > CONFIRMED:
        return ""
    counts, expected = best.counts, best.state.numbers[:, 2]
    shows = f"shows {counts[c]} of {expected[c]:.0f} markers among its {spots} spots"
    wrong = "its cam_from_rig or focal length is wrong"
    for other in others:
        if other.scores[c] > ELSEWHERE:
            seen = f"{other.counts[c]} of {other.state.numbers[c, 2]:.0f}"
            return f"{shows} and would show {seen} with the model elsewhere: {wrong}"
    could = min(int(expected[c]), spots)
    rest, of = best.count - int(counts[c]), best.expected - int(expected[c])
    share = min(SEEN_MOST, max(SEEN_LEAST, (rest + 1) / (of + 2)))
    if could == 0 or of == 0 or bdtr(int(counts[c]), could, share) > UNLIKELY:
        return ""
    return f"{shows} where the others see {rest} of {of}: {wrong}, or its view is blocked; leave it out if so"
