"""`find_board` on virtual boards: no wrong index, and a reason where there is none."""

import numpy as np
import pytest

from windmark.calibration import board_marker_set, find_board, find_boards
from windmark.calibration.board.axes import symmetries
from windmark.scene import Detections
from windmark.synth import board_spots

MARKS = ((1, 1), (4, 1), (1, 3))
SIZES = [(7, 5), (9, 9), (12, 9), (30, 20)]


def compared(made, view, *, exact=False, aspect=1.0):
    """Dots with the right index, dots with a wrong one, false spots; by the best turn and shift unless ``exact``."""
    true, index = made.cell[view.spot], np.stack([view.column, view.row], axis=1)
    dot = true[:, 0] >= 0
    right = 0
    for turn in [np.eye(2, dtype=int)] if exact else symmetries(aspect):
        shift, count = np.unique(true[dot] - index[dot] @ turn.T, axis=0, return_counts=True)
        if exact:
            count = count[(shift == 0).all(axis=1)]
        right = max(right, int(count.max(initial=0)))
    return right, int(dot.sum()) - right, int((~dot).sum())


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("fill", [0.8, 1.3], ids=["whole", "in part"])
@pytest.mark.parametrize("seed", [501, 502])
def test_indices_of_boards_with_clutter_and_missing_dots(size, fill, seed):
    made = board_spots(np.random.default_rng(seed), *size, fill=fill, max_tilt_deg=50.0)
    view = find_board(made.detections, size_px=made.camera.size_px)
    assert view, view.reason
    right, wrong, false = compared(made, view)
    assert wrong == 0
    assert false <= 2
    assert right >= 0.8 * (made.cell[:, 0] >= 0).sum()
    assert view.log10_nfa < -3


@pytest.mark.parametrize("seed", range(510, 518))
def test_false_spots_alone_are_no_board(seed):
    rng = np.random.default_rng(seed)
    spots = Detections.make(rng.uniform(0, 1000, (int(rng.integers(5, 600)), 2)))
    found = find_board(spots)
    assert not found
    assert found.cause in ("too_few", "no_lattice", "weak")
    assert found.reason


@pytest.mark.parametrize(("seed", "tilt_deg"), [(521, 10.0), (522, 35.0), (523, 55.0)])
def test_origin_discs_fix_every_index(seed, tilt_deg):
    """Also where perspective makes near dots larger than the marks that are far."""
    made = board_spots(np.random.default_rng(seed), 9, 7, missing=0.0, tilt_deg=tilt_deg, focal_px=2400.0, large=MARKS)
    view = find_board(made.detections, marks=MARKS, mark_spots="large", size_px=made.camera.size_px)
    assert view, view.reason
    assert view.freedom == ()
    right, wrong, _ = compared(made, view, exact=True)
    assert wrong == 0
    assert right >= 61
    assert (view.marker(9, 7) == view.row * 9 + view.column).all()


def test_origin_discs_given_as_places_may_have_no_spot_of_their_own():
    """Ring dots: the detector of full discs misses them, their holes are found with the other polarity."""
    made = board_spots(np.random.default_rng(530), 9, 7, missing=0.0, clutter=0.2, max_tilt_deg=45.0)
    ring = (made.cell[:, None] == np.array(MARKS)).all(axis=2).any(axis=1)
    holes = made.detections.take(ring)
    view = find_board(made.detections.take(~ring), marks=MARKS, mark_spots=holes)
    assert view.freedom == ()
    index = made.cell[np.flatnonzero(~ring)[view.spot]]
    dot = index[:, 0] >= 0
    assert (np.stack([view.column, view.row], axis=1)[dot] == index[dot]).all()


def test_mirrored_origin_discs_are_named():
    made = board_spots(np.random.default_rng(531), 9, 7, missing=0.0, max_tilt_deg=30.0)
    places = [made.places[r, c] for c, r in MARKS]
    got = find_board(made.detections, marks=[(c, -r) for c, r in MARKS], mark_spots=places)
    assert got.cause == "mirrored"


def test_without_the_origin_discs_the_freedom_is_said():
    made = board_spots(np.random.default_rng(532), 9, 7, missing=0.0, clutter=0.0, max_tilt_deg=30.0, fill=0.6)
    view = find_board(made.detections, marks=MARKS, mark_spots="large")
    assert view.freedom == ("quarter turns", "columns", "rows")
    view = find_board(made.detections, columns=9, rows=7, size_px=made.camera.size_px)
    assert view.freedom == ("half turn",)
    assert all(view.closed)
    square = board_spots(np.random.default_rng(533), 7, 7, missing=0.0, clutter=0.0, max_tilt_deg=30.0)
    assert find_board(square.detections, columns=7, rows=7).freedom == ("quarter turns",)


@pytest.mark.parametrize("seed", [541, 542, 543])
@pytest.mark.parametrize("aspect", [1.0, 3**0.5], ids=["asymmetric", "hexagonal"])
def test_staggered_boards(seed, aspect):
    made = board_spots(
        np.random.default_rng(seed), 16, 9, staggered=True, aspect=aspect, missing=0.05, clutter=0.3, max_tilt_deg=30.0
    )
    size = (16, 9)
    view = find_board(
        made.detections, layout="staggered", aspect=aspect, columns=16, rows=9, size_px=made.camera.size_px
    )
    assert view, view.reason
    assert ((view.column + view.row) % 2 == 0).all()
    right, wrong, _ = compared(made, view, aspect=aspect)
    assert wrong == 0
    assert right >= 0.9 * (made.cell[:, 0] >= 0).sum()
    markers = board_marker_set(*size, 10.0, aspect=aspect, layout="staggered")
    assert np.allclose(markers.xyz[view.marker(*size)], view.xyz(10.0))


def test_rows_farther_apart_than_columns():
    made = board_spots(np.random.default_rng(551), 8, 6, aspect=1.5, missing=0.0, clutter=0.2, max_tilt_deg=25.0)
    view = find_board(made.detections, aspect=1.5, columns=8, rows=6, size_px=made.camera.size_px)
    assert view.freedom == ("half turn",)
    assert compared(made, view, aspect=1.5)[1] == 0
    assert np.ptp(view.xyz(2.0)[:, 1]) == pytest.approx(5 * 2.0 * 1.5)


def test_two_boards_in_one_picture_are_not_joined():
    """The second board goes on where the first ends, half a spacing off: no index leads from one to the other."""
    i, j = (w.ravel() for w in np.meshgrid(np.arange(12.0), np.arange(8.0)))
    x, y = 40.0 * i, 40.0 * j
    spots = Detections.make(np.concatenate([np.column_stack([x, y]), np.column_stack([x + 480, y + 18])[8:]]))
    view = find_board(spots)
    assert len(np.unique(view.spot < 96)) == 1
    assert len(view) >= 86


def test_dots_left_out_are_noticed():
    """Steps twice as long fit a board just as well, if nobody asks what is between."""
    i, j = (w.ravel() for w in np.meshgrid(np.arange(14.0), np.arange(10.0)))
    rng = np.random.default_rng(0)
    xy = np.column_stack([40 * i, 40 * j])[rng.random(140) > 0.25]
    view = find_board(Detections.make(xy + rng.normal(0, 0.1, xy.shape)))
    assert view.size == (14, 10)
    assert (np.rint(xy[view.spot] / 40) == np.stack([view.column, view.row], axis=1)).all()


def test_size_is_learnt_from_pictures_that_show_the_whole_board():
    rng = np.random.default_rng(560)
    made = [
        board_spots(rng, 11, 8, missing=0.0, clutter=0.2, max_tilt_deg=35.0, fill=f, size_px=(1600, 1200))
        for f in (0.6, 0.6, 0.6, 1.8)
    ]
    views = find_boards([m.detections for m in made], size_px=(1600, 1200))
    for view in views[:3]:
        assert view.freedom == ("half turn",)
        assert view.size == (11, 8)
    assert {"columns", "rows"} & set(views[3].freedom)


def test_more_columns_than_the_board_has_are_refused():
    made = board_spots(np.random.default_rng(570), 9, 7, missing=0.0, clutter=0.0, max_tilt_deg=20.0)
    got = find_board(made.detections, columns=6, rows=6)
    assert got.cause == "size"
    assert "6" in got.reason


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"columns": 0}, "columns"),
        ({"rows": 2.5}, "rows"),
        ({"layout": "round"}, "layout"),
        ({"aspect": -1.0}, "aspect"),
        ({"marks": [(0, 0)]}, "mark_spots"),
        ({"mark_spots": "large"}, "marks"),
        ({"marks": [(0, 0)], "mark_spots": "blue"}, "mark_spots"),
        ({"marks": [0, 1], "mark_spots": "large"}, "marks"),
        ({"max_tilt_deg": 95.0}, "max_tilt_deg"),
    ],
)
def test_wrong_options_are_named(options, word):
    with pytest.raises(ValueError, match=word):
        find_board(Detections.make(np.zeros((20, 2))), **options)


def test_board_marker_set():
    markers = board_marker_set(3, 2, 10.0, radius=2.0)
    assert markers.name.tolist() == ["c00r00", "c01r00", "c02r00", "c00r01", "c01r01", "c02r01"]
    assert markers.xyz.tolist() == [[0, 0, 0], [10, 0, 0], [20, 0, 0], [0, 10, 0], [10, 10, 0], [20, 10, 0]]
    assert (markers.normal == [0, 0, -1]).all()
    with pytest.raises(ValueError, match="spacing"):
        board_marker_set(3, 2, 0.0)
    made = board_spots(np.random.default_rng(571), 9, 7, missing=0.0, clutter=0.0, max_tilt_deg=20.0)
    with pytest.raises(ValueError, match="expected columns"):
        find_board(made.detections).marker(4, 4)
