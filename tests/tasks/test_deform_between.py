"""Spots between two pictures of a camera: polynomials through what was seen, and what they cannot know."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.tasks.deform.between import UNKNOWN, interpolated
from windmark.tasks.deform.spots import Labelled


def spots(marker, xy, sigma=0.1, **fields):
    n = len(marker)
    return replace(
        Labelled(np.array(marker), np.array(xy, float).reshape(-1, 2), np.tile(sigma**2 * np.eye(2), (n, 1, 1)),
                 np.ones((n, 2)) * np.array(marker)[:, None], np.zeros(n), np.zeros((n, 3))), **fields,
    )  # fmt: skip


def track(marker, t, power):
    """Where markers are at a time: a course of their own, polynomial in time."""
    rng = np.random.default_rng(7)
    course = rng.normal(size=(10, 4, 2))[:, : power + 1]
    return np.einsum("mkd,k->md", course[marker], np.power(t, np.arange(power + 1)))


@pytest.mark.parametrize("count", [2, 3, 4])
def test_courses_are_met_as_far_as_the_pictures_tell(count):
    times, instant = [0.0, 0.4, 0.7, 1.0][4 - count :], 0.85
    marker = np.array([2, 5, 7])
    seen = {t: spots(marker, track(marker, t, count - 1), 0.1 * (1 + t)) for t in times}
    got = interpolated(seen, instant)
    np.testing.assert_allclose(got.xy, track(marker, instant, count - 1), atol=1e-9)
    weight = [np.prod([(instant - u) / (t - u) for u in times if u != t]) for t in times]
    variance = sum((w * 0.1 * (1 + t)) ** 2 for w, t in zip(weight, times, strict=True))
    np.testing.assert_allclose(got.cov, np.tile(variance * np.eye(2), (3, 1, 1)))
    if count == 2:
        change = UNKNOWN * (seen[1.0].xy - seen[0.7].xy)
    else:  # what the first picture added by a degree
        fewer = interpolated({t: seen[t] for t in times[1:]}, instant)
        change = got.xy - fewer.xy
    # Common to all spots: as a covariance of each it counts with their number.
    np.testing.assert_allclose(got.between_cov, np.tile((change**2).mean() * 3 * np.eye(2), (3, 1, 1)))


def test_a_marker_counts_where_it_was_seen_without_a_gap():
    """Just before and just after, and further back as long as no picture lacks it."""
    times, instant = [0.0, 0.4, 0.7, 1.0], 0.85
    who = {0.0: [1, 2, 3, 4], 0.4: [2, 3, 4], 0.7: [1, 2, 3], 1.0: [1, 2, 3, 4, 6]}
    seen = {t: spots(np.array(m), track(np.array(m), t, 3)) for t, m in who.items()}
    got = interpolated(seen, instant)
    assert got.marker.tolist() == [1, 2, 3]
    np.testing.assert_allclose(got.xy[1:], track(np.array([2, 3]), instant, 3), atol=1e-9)
    straight = (seen[0.7].xy[0] + seen[1.0].xy[0]) / 2
    np.testing.assert_allclose(got.xy[0], straight)  # of 1 there is a gap: the first picture does not count
    assert times[0] < instant


def test_what_else_is_known_is_that_of_the_nearest_picture():
    one = spots([1, 2], np.zeros((2, 2)), expected=7, off_px=0.4, radius_px=3.0, reason="")
    other = spots([2, 3], np.ones((2, 2)), expected=9, off_px=0.2, radius_px=4.0)
    other = replace(other, axes_px=np.array([[20.0, 10.0], [30.0, 15.0]]))
    for instant, nearest in ((0.4, one), (0.6, other)):
        got = interpolated({0.0: one, 1.0: other}, instant)
        assert (got.expected, got.radius_px, got.off_px) == (nearest.expected, nearest.radius_px, 0.4)
        np.testing.assert_array_equal(got.axes_px, nearest.axes_px[nearest.marker == 2])
        assert got.marker.tolist() == [2]
    none = interpolated({0.0: one, 1.0: spots([5], [[0.0, 0.0]], expected=4)}, 0.9)
    assert not len(none.marker)
    assert none.expected == 4
    assert none.reason == "no marker was seen both before and after"
    why = interpolated({0.0: Labelled.none("too dark"), 1.0: other}, 0.1)
    assert why.reason == "too dark"
