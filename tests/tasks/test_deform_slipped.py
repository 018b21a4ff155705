"""A part with rows of markers and a law of its own that moves by a spacing: its ends tell, and only where they do."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sliding_panel import BEYOND, BODY, CAMERA, END, PANEL, PITCH, followed, image, test_of, values

from windmark.geometry import Pose
from windmark.pipeline.deform import FrameImages, Station, follow_deformation
from windmark.tasks.deform.rival import Rival
from windmark.tasks.deform.slipped import Slips, _Seen


def test_a_jump_of_nearly_a_spacing_or_two_of_them_is_seen_by_the_ends_of_the_rows():
    frames = followed(image(0.0), image(23.0), image(46.0), image(-3.0))
    assert values(frames) == pytest.approx([0.0, 23.0, 46.0, -3.0], abs=0.05)
    assert all(len(f.observations) == len(BODY) + len(PANEL) for f in frames)
    # That it was moved on is said, and the frame after it, which is where it was to be expected, is none to be doubted;
    # nor is a jump in which most of its markers were gone: of the next best place two rows' ends lack.
    said = [[str(d) for d in f.state.doubts] for f in frames]
    assert [len(s) for s in said] == [0, 1, 0, 0]
    assert frames[3].reason == "panel was found set anew: panel.s = -3"
    words = "panel was found one spacing of 25 mm nearer than its ends show, and was moved on: with panel.s = 2"
    assert words in said[1][0]


def test_one_disc_more_beyond_a_row_that_is_hidden_in_part_moves_nothing_on():
    """A screw where the next marker would be, and a cover over the other end."""
    screw, covered = PANEL[[4]] + np.array([25.0, 0.0, 0.0]), np.delete(PANEL, END, axis=0)
    frames = followed(image(0.0), image(3.0), image(6.0, np.vstack([covered, screw])))
    assert values(frames) == pytest.approx([0.0, 3.0, 6.0], abs=0.05)


def test_rows_that_go_on_beyond_the_table_say_nothing_where_a_marker_is_lost():
    more, fewer = np.vstack([PANEL, BEYOND]), np.vstack([np.delete(PANEL, END, axis=0), BEYOND])
    test = test_of(wind_off=("0",))
    frames = followed(image(0.0, more), image(2.0, more), image(4.0, fewer), image(6.0, fewer), test=test)
    assert values(frames) == pytest.approx([0.0, 2.0, 4.0, 6.0], abs=0.05)
    assert all(f.state.doubts == () for f in frames)


@pytest.mark.parametrize("jump", [-23.0, 23.0])
@pytest.mark.parametrize("marks", [BEYOND[:1], BEYOND, np.vstack([BEYOND, BEYOND + PITCH])])
def test_a_part_that_slipped_towards_marks_beyond_its_rows_lacks_those(jump, marks):
    """The last marker was found on the first mark beyond it, and none lacked: 25 mm off and nothing said."""
    more = np.vstack([PANEL, marks])
    frames = followed(image(0.0, more), image(jump, more), image(jump + 1.0, more))
    assert values(frames)[1:] == pytest.approx([jump, jump + 1.0], abs=0.05)
    assert "panel was found one spacing of 25 mm nearer than its ends show" in str(frames[1].state.doubts[0])


@pytest.mark.parametrize(("s", "beyond"), [(0.0, BEYOND), (25.0, PANEL[END] - PITCH)])
def test_a_part_that_may_be_further_on_as_well_is_doubted_in_a_first_frame_and_taken_by_its_motion_after_it(s, beyond):
    """Rows of six of which the table has five: the first ones or the last ones, which only wind-off tells."""
    more = np.vstack([PANEL, beyond])
    first, second = followed(image(s, more), image(s + 1.0, more))
    (doubt,) = first.state.doubts
    assert doubt.cause == "layout"
    assert "panel may be slipped by one spacing of 25 mm: with panel.s = 25 in place of " in str(doubt)
    assert "as many of its spots are explained as well, and no motion before tells" in str(doubt)
    assert second.state.q[0] - first.state.q[0] == pytest.approx(1.0, abs=0.05)
    assert not second.state.doubts
    assert not followed(image(s, more), test=test_of(wind_off=("0",)))[0].state.doubts


def test_rows_that_are_not_quite_regular_tell_by_themselves_how_far_on_the_part_is():
    off = PANEL + 0.2 * np.random.default_rng(3).standard_normal(PANEL.shape) * [1.0, 1.0, 0.0]
    test = test_of(panel=off)
    sure = np.tile(1e-4 * np.eye(3), (len(test.markers), 1, 1))
    more = np.vstack([off, BEYOND])
    frames = followed(image(0.0, more), image(1.0, more), test=replace(test, marker_cov=sure))
    assert values(frames) == pytest.approx([0.0, 1.0], abs=0.05)
    assert all(f.state.doubts == () for f in frames)


def test_a_mark_beyond_a_row_that_is_hidden_for_a_while_is_not_forgotten():
    """Then seen again where the markers at the other end are hidden, it is no marker."""
    more, fewer = np.vstack([PANEL, BEYOND]), np.delete(PANEL, END, axis=0)
    frames = followed(image(0.0, more), image(1.0, PANEL[1:]), image(2.0, np.vstack([fewer, BEYOND])))
    assert values(frames) == pytest.approx([0.0, 1.0, 2.0], abs=0.05)
    assert not any(f.state.doubts for f in frames[1:])


def test_what_was_never_seen_whole_is_doubted_in_each_frame_with_its_values():
    fewer = np.vstack([np.delete(PANEL, END, axis=0), BEYOND])
    for frame in followed(image(0.0, fewer), image(2.0, fewer)):
        (doubt,) = frame.state.doubts
        assert doubt.cause == "layout"
        assert "panel may be slipped by one spacing of 25 mm: with panel.s = 2" in str(doubt)
        assert "2 more of its spots are explained" in str(doubt)


def test_a_part_that_was_in_doubt_is_so_where_as_many_spots_are_explained_in_the_next_frame():
    """The motion before said where it was, from a place that was in doubt itself: 25 mm off and nothing said."""
    fewer = np.delete(PANEL, END, axis=0)
    frames = followed(image(0.0, np.vstack([fewer, BEYOND])), image(2.0, fewer))
    assert [[d.cause for d in f.state.doubts] for f in frames] == [["layout"], ["layout"]]
    assert "as many of its spots are explained as well" in str(frames[1].state.doubts[0])


def test_a_part_that_moved_farther_than_expected_by_half_a_spacing_may_have_moved_to_either_place():
    middle = np.delete(PANEL, [0, 4, 5, 9], axis=0)
    still = [image(0.1 * k, PANEL) for k in range(6)]
    doubted = followed(*still, image(13.5, middle))[-1]
    (doubt,) = doubted.state.doubts
    assert "as many of its spots are explained as well" in str(doubt)
    # By a quarter of it, it went the shorter way.
    near = followed(*still, image(5.5, middle))[-1]
    assert values([near]) == pytest.approx([5.5], abs=0.05)
    assert not near.state.doubts


def test_a_marker_that_is_lost_elsewhere_is_no_question(monkeypatch):
    asked = []
    monkeypatch.setattr(Slips, "_there", lambda _, image, name, *__: asked.append(name) or _Seen.none())
    frames = followed(image(0.0), image(2.0), image(4.0, body=BODY[1:]))
    assert values(frames) == pytest.approx([0.0, 2.0, 4.0], abs=0.05)
    assert len(frames[-1].observations) == len(BODY) + len(PANEL) - 1
    assert len(asked) == 6  # ways on, at the first frame only


@pytest.mark.parametrize("jump", [48.0, 23.0])
def test_a_jump_of_about_two_spacings_between_marks_beyond_both_ends_is_right_in_each_frame_or_doubted(jump):
    """Other spots' sums of squares, and another texture's, told against the right place: 50 mm off, nothing said."""
    more = np.vstack([PANEL, BEYOND, PANEL[END] - PITCH])
    true = [0.0, 1.0, 2.0, 2.0 + jump, 3.0 + jump]
    frames = followed(*(image(s, more) for s in true), test=test_of(wind_off=("0",)))
    assert values(frames) == pytest.approx(true, abs=0.05)
    assert [[d.cause for d in f.state.doubts] for f in frames[:4]] == [[], [], [], ["layout"]]


@pytest.mark.parametrize("joins", [3, 4])
def test_of_a_camera_that_joins_late_the_ends_of_the_rows_are_asked_too(joins):
    """Of the second camera nothing was known beyond the rows: the part stayed 25 mm off, in doubt at best."""
    aside, true = Pose(np.eye(3), np.array([-30.0, 0.0, 800.0])), [0.0, 3.0, 1.0, 2.0, 25.0, 26.0]
    more = np.vstack([PANEL, BEYOND])
    frames = [FrameImages(str(k), float(k), {"cam": image(s, more)}) for k, s in enumerate(true)]
    for frame, s in zip(frames[joins:], true[joins:], strict=True):
        frame.images["aside"] = image(s, more, pose=aside)
    found = list(follow_deformation(frames, test_of(more=(Station("aside", CAMERA, aside),), wind_off=("0",))))
    assert values(found) == pytest.approx(true, abs=0.05)
    assert "panel was found one spacing of 25 mm nearer than its ends show" in str(found[4].state.doubts[0])


def test_sums_of_squares_of_spots_that_only_one_state_has_reject_the_right_one_in_one_of_a_hundred():
    rng = np.random.default_rng(4)
    rival, state = Rival(None, None, 4, 4, True), SimpleNamespace(used=np.ones(20), sigma0=1.0)
    good = []
    for few, many in rng.integers(0, 12, (4000, 2)):
        found, other = (replaced(state, 2 * n, rng.chisquare(2 * n) if n else 0.0) for n in (few, many))
        good.append(rival.as_good(other, found, few + many))
    assert 0.985 < np.mean(good) < 0.999


def replaced(state, redundancy, chi2):
    return SimpleNamespace(**vars(state), redundancy=int(redundancy), chi2=chi2)


def test_what_explains_more_spots_and_is_not_taken_is_doubted_with_both_values(monkeypatch):
    monkeypatch.setattr(Rival, "as_good", lambda *_: False)
    (doubt,) = followed(image(0.0), image(23.0))[-1].state.doubts
    assert doubt.cause == "layout"
    assert "panel may be slipped by one spacing of 25 mm: with panel.s = 23 in place of -2" in str(doubt)


def test_marks_beyond_both_ends_are_looked_for_once_in_a_frame_in_which_none_lacks(monkeypatch):
    """Those of each slide by itself took six times as long as the frame."""
    more, looks = np.vstack([PANEL, BEYOND, PANEL[END] - PITCH]), []
    was = Slips._near
    monkeypatch.setattr(Slips, "_near", lambda *given: looks.append(len(given[4])) or was(*given))
    followed(image(0.0, more), test=test_of(wind_off=("0",)))
    first, looks[:] = len(looks), []
    frames = followed(*(image(s, more) for s in (0.0, 1.0, 2.0, 1.0)), test=test_of(wind_off=("0",)))
    assert looks[first:] == [4, 4, 4]
    assert all(f.state.doubts == () for f in frames)
