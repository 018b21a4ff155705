"""Parts that come to lie on themselves by their own law: rows that slide or turn, and laws that can do neither."""

import numpy as np
import pytest

from windmark.deformation import Volume, Volumes, law
from windmark.deformation.slides import slides_of

ROWS = np.array([[32.0 * a, 25.0 * b, 15.0] for a in range(2) for b in range(7)])


@law(s="mm")
def slide(X, s):
    return X + np.array([0.0, s, 0.0])


@law(tip="mm")
def bend(X, tip):
    return X + np.outer((X[:, 1] / 150.0) ** 2, [0.0, 0.0, tip])


@law(angle="deg")
def turn(X, angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return X @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def slides(xyz, own):
    placed = Volumes.of([Volume("part", own)]).bind(xyz, "part")
    return slides_of(placed, np.zeros(len(xyz), bool))


def changes(found):
    return sorted(round(float(s.change[0]), 3) for s in found)


def test_rows_that_slide_lie_on_themselves_one_spacing_further_on_and_more():
    found = slides(ROWS, slide)
    assert changes(found) == [k * 25.0 for k in (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5)]
    one = next(s for s in found if s.change[0] == pytest.approx(25.0))
    assert (one.spacing, sorted(one.entering), sorted(one.vacated)) == (pytest.approx(25.0), [6, 13], [0, 7])
    assert one.of(np.array([3.0])) == pytest.approx([28.0])


def test_one_row_and_a_ring_that_turns_do_too():
    assert changes(slides(ROWS[:7], slide)) == [k * 25.0 for k in (-4, -3, -2, -1, 1, 2, 3, 4)]
    angle = np.radians(np.arange(0.0, 100.0, 12.0))
    ring = np.column_stack([90.0 * np.cos(angle), 90.0 * np.sin(angle), 0.0 * angle])
    assert {-12.0, 12.0} <= set(changes(slides(ring, turn)))


def test_rows_whose_law_cannot_take_them_there_and_places_without_rows_do_not():
    assert slides(ROWS, bend) == ()
    assert slides(np.random.default_rng(4).uniform(0, 150, (14, 3)), slide) == ()


def test_a_bound_or_a_law_that_has_no_place_there_is_no_way_on():
    @law(s={"unit": "mm", "upper": 30.0})
    def stopped(X, s):
        if s > 26.0:
            raise ValueError("the rail ends")
        return X + np.array([0.0, s, 0.0])

    found = slides(ROWS, slide)
    one = next(s for s in found if s.change[0] == pytest.approx(25.0))
    same = next(s for s in slides(ROWS, law(s={"unit": "mm", "upper": 30.0})(slide.function)) if s.change[0] > 24.0)
    assert same.of(np.array([4.0])) is not None
    assert same.of(np.array([6.0])) is None
    assert one.of(np.array([6.0])) is not None
