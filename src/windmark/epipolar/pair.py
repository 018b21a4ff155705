"""The verb `match_pair`: which spots of two pictures are the same markers, from the spots alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.epipolar.completed import FEWEST, Job, Matching, completed
from windmark.epipolar.constellation.patches import Patches, find_patches
from windmark.epipolar.constellation.shifts import shifted
from windmark.epipolar.result import Cause, NotMatched, PairMatching
from windmark.geometry import Camera
from windmark.scene import Detections
from windmark.scene.shown import check_kinds, optional

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TRIALS = (1000, 250)
"""Sets of five pairs that are drawn at most: from all patches together, and from one, which is mostly right."""
ENOUGH = 2
"""So many rivals show that a layout is regular; the other patches are left."""
SMALL, GROWN = 30, 0.75
"""In so small a matching the epipolar lines decide little; then a piece that only grew is a rival, too, if it has this
part of its pairs."""
OTHER = 0.2
"""Matchings that share at most this part of their pairs are different."""


def match_pair(
    detections_a: Detections,
    detections_b: Detections,
    camera_a: Camera,
    camera_b: Camera | None = None,
    *,
    max_log10_nfa: float = -6.0,
    max_rival: float = 0.25,
    seed: int = 0,
) -> PairMatching | NotMatched:
    """Match the spots of two pictures taken close to each other, without descriptors, labels or poses.

    Patches that an affine map explains (`constellation.patches`) give pairs; from these comes the two-view geometry
    (`geometry.two_view`), robustly; along its epipolar lines the matching is completed, the neighbours deciding where
    several spots lie on one line (AIAA 2005-5007, section VI.D). A spot with two candidates stays open.

    Parameters
    ----------
    detections_a, detections_b : spots; false and missing ones are expected
    camera_a, camera_b : interior parameters, None for the same camera; a focal length within some per cent will do
    max_log10_nfa : accepted only if chance gives such a matching less often (decimal logarithm)
    max_rival : and if no other matching, with other pairs, that is no chance either, has more than this part of its
        pairs: else the layout looks like itself when it is shifted or turned. How well each explains the spots does not
        tell them apart: a wrong one with little parallax may well grow farther than the right one
    seed : of the random search for the two-view geometry

    Returns
    -------
    A `PairMatching`, or a falsy `NotMatched` with its reason. How far apart the views may be depends on the relief:
    some 40 degrees on smooth surfaces, some 10 degrees where neighbours in the picture are at random depths.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> xyz = np.random.default_rng(1).uniform(-1.0, 1.0, (60, 3)) * [2.0, 1.5, 0.2]
    >>> camera = wm.Camera((640, 480), 800.0)
    >>> left, right = (wm.Pose.look_at([x, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]) for x in (-0.5, 0.5))
    >>> a, b = (camera.project(pose.apply(xyz))[0].round(1) for pose in (left, right))
    >>> pairs = wm.match_pair(wm.Detections.make(a), wm.Detections.make(b[::-1]), camera)
    >>> bool(pairs), len(pairs.a)
    (True, 60)
    >>> np.array_equal(pairs.a, 59 - pairs.b), round(pairs.view.parallax_deg)
    (True, 9)
    """
    check_kinds(
        "match_pair", detections_a=(detections_a, Detections), detections_b=(detections_b, Detections),
        camera_a=(camera_a, Camera), camera_b=(camera_b, optional(Camera)),
    )  # fmt: skip
    options: dict[str, Any] = {"max_log10_nfa": max_log10_nfa, "max_rival": max_rival, "seed": seed}
    job = Job.of(detections_a, detections_b, camera_a, camera_b or camera_a, seed)
    if min(len(job.near.a), len(job.near.b)) < FEWEST:
        few = f"{len(job.near.a)} and {len(job.near.b)} spots, at least {FEWEST} in each picture are needed"
        return NotMatched(few, "too_few", options=options)
    patches = find_patches(job.near)
    found, grown = _matchings(job, patches, max_log10_nfa, max_rival)
    if not found:
        return NotMatched(
            f"no piece of one picture is found in the other one ({len(job.near.a)} and {len(job.near.b)} spots): views "
            "too far apart, or of different things", "nothing", options=options,
        )  # fmt: skip
    best, others = found[0], [m for m in found[1:] if m.shared(found[0]) <= OTHER]
    refusal = _refusal(found, grown, max_log10_nfa, max_rival)
    if refusal is not None:
        return NotMatched(refusal[1], refusal[0], best.count, best.evidence.log10_nfa, options)
    a = np.flatnonzero(best.match >= 0)
    b = best.match[a]
    open_a = np.flatnonzero(best.evidence.expected & (best.match < 0))
    open_b = np.setdiff1d(np.flatnonzero(best.behind.expected), b)
    return PairMatching(
        job.index_a[a], job.index_b[b], best.distance_px[a], best.view, job.index_a[open_a], job.index_b[open_b],
        best.evidence.log10_nfa, best.score, (others[0].score, others[0].count) if others else None, options,
    )  # fmt: skip


def _matchings(job: Job, patches: Patches, max_log10_nfa: float, max_rival: float) -> tuple[list[Matching], int]:
    """Complete matchings, best first: from all patches together, from each by itself, and shifts of the best one.

    No more than are needed to show that a layout is regular. And the size of the largest patch or shift that is none of
    the best one, complete or not.
    """
    found: list[Matching] = []
    pairs, size = patches.pairs()
    _add(found, job, pairs, size, patches.tried, TRIALS[0])
    grown = sorted(patches.match, key=lambda m: -(m >= 0).sum())
    for match in grown:
        _add_from(found, job, match, patches.tried)
        if len(_rivals(found, max_log10_nfa, max_rival)) >= ENOUGH:
            break
    if found and not _rivals(found, max_log10_nfa, max_rival):
        shifts = shifted(job.near, found[0].match)
        grown += shifts
        for match in shifts:
            _add_from(found, job, match, patches.tried)
    if not found:
        return found, 0
    best = found[0].match
    other = [m for m in grown if (m[m >= 0] == best[m >= 0]).sum() <= OTHER * (m >= 0).sum()]
    return found, max((int((m >= 0).sum()) for m in other), default=0)


def _rivals(found: list[Matching], max_log10_nfa: float, max_rival: float) -> list[Matching]:
    """Matchings that the best one, which is the first, cannot be told from."""
    return [
        m for m in found[1:]
        if m.count > max_rival * found[0].count and m.evidence.log10_nfa < max_log10_nfa
        and m.shared(found[0]) <= OTHER
    ]  # fmt: skip


def _add_from(found: list[Matching], job: Job, match: Ints, tried: int) -> None:
    """One more from a matching (A,) that grew from a seed."""
    a = np.flatnonzero(match >= 0)
    _add(found, job, np.stack([a, match[a]], axis=1), np.ones(len(a)), tried, TRIALS[1])


def _add(found: list[Matching], job: Job, pairs: Ints, weight: Array, tried: int, trials: int) -> None:
    """One more complete matching from (K, 2) pairs, unless these are too few or those of another one."""
    if len(pairs) < FEWEST or any(_known(pairs, m) for m in found):
        return
    matching = completed(job, pairs, weight, tried, trials)
    if matching is not None:
        found.append(matching)
        found.sort(key=lambda m: -m.score)


def _known(pairs: Ints, matching: Matching) -> bool:
    """Whether most of these pairs are those of a matching."""
    return bool((matching.match[pairs[:, 0]] == pairs[:, 1]).mean() > 1 - OTHER)


def _refusal(
    found: list[Matching], grown: int, max_log10_nfa: float, max_rival: float
) -> tuple[Cause, str] | None:  # fmt: skip
    """Why the best matching is refused; None if it is accepted."""
    best, nfa = found[0], found[0].evidence.log10_nfa
    if nfa > max_log10_nfa:
        return "weak", (
            f"the best matching has {best.count} pairs, which could be chance: false-alarm number 1e{nfa:+.1f} (limit "
            f"1e{max_log10_nfa:+.1f}); take the pictures closer to each other"
        )
    rivals = [m.count for m in _rivals(found, max_log10_nfa, max_rival)]
    if not rivals and best.count < SMALL and grown > GROWN * best.count:
        rivals = [grown]
    if rivals:
        return "ambiguous", (
            f"there are two matchings, of {best.count} and {rivals[0]} pairs, and neither is chance: a layout that "
            "looks like itself when it is shifted or turned"
        )
    return None
