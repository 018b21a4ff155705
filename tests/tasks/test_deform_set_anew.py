"""A part that its law moved farther than it was looked for: found by most of its markers, or in doubt."""

from dataclasses import replace

import numpy as np
import pytest
from sliding_panel import BEYOND, BODY, PANEL, PITCH, followed, image, test_of, values

from windmark.deformation import law
from windmark.tasks.deform import set_anew

UNEVEN = PANEL + np.c_[np.random.default_rng(5).uniform(-4.0, 4.0, (len(PANEL), 2)), np.zeros(len(PANEL))]
MARKS = BEYOND + (UNEVEN - PANEL)[[4, 9]]


@pytest.mark.parametrize("marks", [MARKS, MARKS[:0]])
def test_a_part_that_jumps_by_about_the_distance_of_its_uneven_markers_is_right_in_each_frame(marks):
    """One or two of them came near a spot of another one: 25 mm off at a sigma of 0.003 mm, and nothing said."""
    true = [0.0, 24.0, 0.0, -24.0, -23.0]
    frames = followed(*(image(s, np.vstack([UNEVEN, marks])) for s in true), test=test_of(panel=UNEVEN))
    assert values(frames) == pytest.approx(true, abs=0.05)
    assert all(len(f.observations) == 22 and not f.state.doubts for f in frames)


def test_a_single_row_that_jumped_far_and_is_known_by_one_spot_is_in_doubt_with_both_values():
    """A screw beyond one end, the other one hidden: the spot that is one more is no marker's."""
    rows = np.r_[np.arange(len(BODY) + 5)]
    whole = test_of(wind_off=("0",))
    test = replace(whole, markers=whole.markers.take(rows))
    row, screw = PANEL[:5], PANEL[4:5] + PITCH
    frames = followed(image(0.0, row), image(80.0, np.vstack([row[1:], screw])), test=test)
    (doubt,) = frames[1].state.doubts
    assert "panel may be set otherwise: with panel.s = 80" in str(doubt) or "in place of panel.s = 80" in str(doubt)
    assert "its markers come onto just one spot fewer" in str(doubt)


def test_a_first_frame_with_a_part_that_is_set_otherwise_is_found_where_its_markers_are():
    """It was refused: give the parameter a start."""
    frames = followed(image(40.0, UNEVEN), image(41.0, UNEVEN), test=test_of(panel=UNEVEN))
    assert values(frames) == pytest.approx([40.0, 41.0], abs=0.05)
    assert [f.status for f in frames] == ["cold", "tracked"]
    assert [f.reason for f in frames] == ["panel was found set anew: panel.s = 40", ""]


@law(angle="deg")
def turn(X, angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    hinge = UNEVEN[2]
    return hinge + (X - hinge) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])


def test_an_angle_that_comes_round_is_asked_for_one_turn_and_taken_the_shorter_way():
    """Its markers have the same spots a turn further on, and eight turns further on."""
    panel, true = UNEVEN[[2, 3, 4, 7, 8, 9]], [0.0, -110.0, 60.0]
    rows = np.r_[np.arange(len(BODY)), len(BODY) + np.array([2, 3, 4, 7, 8, 9])]
    whole = test_of(panel=UNEVEN, law=turn)
    test = replace(whole, markers=whole.markers.take(rows))
    frames = followed(*(image(0.0, turn.function(panel, angle)) for angle in true), test=test)
    assert values(frames) == pytest.approx(true, abs=0.05)


def test_a_part_that_is_covered_for_the_most_part_is_where_the_rest_of_it_is_and_in_no_doubt():
    seen = [UNEVEN, UNEVEN[:3], UNEVEN[:3], UNEVEN]
    frames = followed(*(image(k, p) for k, p in enumerate(seen)), test=test_of(panel=UNEVEN))
    assert values(frames) == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=0.05)
    assert not any(f.state.doubts for f in frames)


def test_a_part_most_of_which_is_where_its_law_puts_it_nowhere_is_in_doubt_as_long_as_it_is_so():
    """Two markers stay at the hinge, and the others turned away from the table's plane as no slide can."""
    turned = np.vstack([UNEVEN[:2], UNEVEN[2:] @ np.diag([1.0, -1.0, 1.0]) + [11.0, 7.0, 0.0]])
    frames = followed(*(image(k, p) for k, p in enumerate([UNEVEN, turned, turned])), test=test_of(panel=UNEVEN))
    for frame in frames[1:]:
        (doubt,) = (d for d in frame.state.doubts if "set otherwise" in str(d))
        assert "panel may be set otherwise: " in str(doubt)
        assert "of its 10 markers in view have a spot with panel.s = " in str(doubt)
        assert "more spots than before are no marker's" in str(doubt)
        assert "panel" in frame.state.suspect


def test_spots_that_lie_at_random_put_a_part_nowhere(monkeypatch):
    """Eight markers that are gone, and forty other spots: on 1,200 steps some markers come onto some of them."""
    rng, asked = np.random.default_rng(2), []
    was = set_anew.whereabouts
    monkeypatch.setattr("windmark.tasks.deform.finding.whereabouts", lambda *a: asked.append(was(*a)) or asked[-1])
    dust = np.c_[rng.uniform(-170, 170, 40), rng.uniform(-130, 130, 40), np.zeros(40)]
    away = np.linalg.norm(dust[:, None] - UNEVEN[None], axis=2).min(axis=1) > 14
    images = [image(0.0, UNEVEN), image(0.0, np.vstack([UNEVEN[:2], dust[away]]))]
    followed(*images, test=test_of(panel=UNEVEN))
    assert asked
    assert all(q is None for q in asked)
