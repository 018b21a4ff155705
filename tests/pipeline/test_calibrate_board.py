"""Pictures of a dot board to a calibration, from spots as a detector reports them."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.calibration import Fixed, Free
from windmark.calibration.quality import SplitHalf
from windmark.geometry import Camera, Pose
from windmark.geometry.similarity import align
from windmark.pipeline.calibrate import Board, BoardPicture, CalibrateSettings, MatchOptions, calibrate_board, record
from windmark.pipeline.calibrate import from_board as boards
from windmark.pipeline.calibrate.outputs import datum_words
from windmark.pipeline.clock import Clock
from windmark.scene import Detections
from windmark.tasks.calibrate.rig import beside

SIZE = (2000, 1500)
COLUMNS, ROWS, PITCH, RADIUS = 12, 9, 5.0, 1.2
RINGS = ((3, 4), (8, 4), (3, 1))
CAMERAS = {"left": Camera(SIZE, 2600.0, 1.0, 1010.0, 745.0, k1=-0.1), "right": Camera(SIZE, 2700.0, 1.0, 995.0, 760.0)}
RIGHT_FROM_LEFT = Pose.from_rotvec([0.02, -0.4, 0.01], [46.0, 2.0, 10.0])
SETTINGS = CalibrateSettings(None, ("focal_px", "cx", "cy", "k1"))


def cells():
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    return np.stack([column.ravel(), row.ravel()], axis=1)


def printed(rng):
    """(N, 3) the board as it is: the dots are off their grid by some hundredths."""
    nominal = np.column_stack([cells() * PITCH, np.zeros(COLUMNS * ROWS)])
    return nominal + rng.normal(0, 0.02, nominal.shape)


def look(rng, xyz, camera, pose, hidden=0.05):
    """Spots of one picture, false ones among them; and those of the light holes of the rings."""
    at = pose.apply(xyz)
    xy = camera.project(at)[0]
    ring = np.array([tuple(c) in RINGS for c in cells().tolist()])
    seen = np.flatnonzero(camera.in_image(xy) & (ring | (rng.random(len(xy)) >= hidden)))
    radius = RADIUS * camera.focal_px * np.sqrt(np.abs(at @ pose.rotation[:, 2]) / at[:, 2] ** 3)
    false = rng.uniform(0, SIZE, (8, 2))
    spots = Detections.make(
        np.concatenate([xy[seen] + rng.normal(0, 0.05, (len(seen), 2)), false]), sigma_px=0.05,
        radius_px=np.concatenate([radius[seen], rng.uniform(4, 30, 8)]),
    )  # fmt: skip
    rings = seen[ring[seen]]
    return spots, Detections.make(np.concatenate([xy[rings], false[:2]]), sigma_px=0.1)


def poses(rng, count):
    """The board in front of the camera, tilted to all sides, at any roll."""
    out = []
    for k in range(count):
        tilt, around = np.radians(rng.uniform(15, 40)), 2 * np.pi * k / count
        turn = Pose.from_rotvec([0, 0, rng.uniform(-np.pi, np.pi)], np.zeros(3))
        lean = Pose.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0]), np.zeros(3))
        middle = Pose.from_rotvec(np.zeros(3), [-PITCH * (COLUMNS - 1) / 2, -PITCH * (ROWS - 1) / 2, 0])
        away = Pose.from_rotvec(np.zeros(3), [*rng.normal(0, 3, 2), rng.uniform(110, 130)])
        out.append(away @ lean @ turn @ middle)
    return out


@pytest.fixture
def session(monkeypatch, tmp_path):
    """``session(pictures={name: (spots, holes)}, board=..., ...)`` -> calibration and pictures."""

    def run(pictures, board, settings=SETTINGS, cameras=None, patterns=None):
        def fake(path, name, taken, board, options):
            spots, holes = pictures[name]
            return BoardPicture(name, taken.camera, SIZE, spots, taken.frame, holes=holes if board.marks else None)

        monkeypatch.setattr(boards, "_detect", fake)
        return calibrate_board(
            [tmp_path / f"{name}.png" for name in pictures], board, cameras or {"camera": None}, MatchOptions(),
            settings, Clock(), patterns=patterns,
        )  # fmt: skip

    return run


def marked(origin=(0, 0)):
    return Board(PITCH, tuple((c - origin[0], r - origin[1]) for c, r in RINGS))


@pytest.mark.slow
def test_a_rig_and_its_board_from_marked_pictures(session):
    """Two cameras of which nothing is known: their pose to each other and the dots as they were printed."""
    rng = np.random.default_rng(31)
    xyz, pictures = printed(rng), {}
    for k, pose in enumerate(poses(rng, 8)):
        pictures[f"p{k:02d}_0"] = look(rng, xyz, CAMERAS["left"], pose)
        pictures[f"p{k:02d}_1"] = look(rng, xyz, CAMERAS["right"], RIGHT_FROM_LEFT @ pose)
    out, seen = session(
        pictures, marked(), replace(SETTINGS, rig=True), {"left": None, "right": None}, {"left": "*_0", "right": "*_1"}
    )
    assert out, out.reason
    assert all(p.count > 60 for p in seen), [p.count for p in seen]
    result = out.result
    for name, true in CAMERAS.items():
        for p in SETTINGS.free:
            assert abs(getattr(result.cameras[name], p) - getattr(true, p)) < 4 * result.sigma(name, p)
    (one,) = beside(result)
    assert abs(one.angle_deg - np.degrees(np.linalg.norm(RIGHT_FROM_LEFT.log()[:3]))) < 4 * one.angle_sigma_deg
    assert one.distance == pytest.approx(np.linalg.norm(RIGHT_FROM_LEFT.translation), abs=0.1)
    place = {f"c{c:02d}r{r:02d}": p for (c, r), p in zip(cells().tolist(), xyz, strict=True)}
    known = np.array([place[n] for n in result.markers.name])
    off = align(result.markers.xyz, known, scale=True).apply(result.markers.xyz) - known
    assert np.sqrt((off**2).mean()) < 0.006  # printed with 0.02
    assert result.rms_px < 0.08
    assert 0.7 < out.halves.ratio < 1.4
    # Radius from the images, for the eccentricity of the discs.
    assert result.markers.radius[0] == pytest.approx(RADIUS, rel=0.02)


@pytest.mark.slow
def test_the_marked_dot_is_the_origin(session):
    rng = np.random.default_rng(32)
    xyz = np.column_stack([cells() * PITCH, np.zeros(COLUMNS * ROWS)])  # a print without a flaw
    pictures = {f"p{k}": look(rng, xyz, CAMERAS["left"], pose) for k, pose in enumerate(poses(rng, 6))}
    spots, _ = pictures["p5"]
    pictures["p5"] = spots, Detections.make(np.zeros((0, 2)))  # the rings did not show
    out, seen = session(pictures, marked((3, 4)))
    assert out, out.reason
    assert "c-3r-4" in out.result.markers.name
    assert seen[5].count == 0
    assert "marked dots were not found (a hole is seen in 0 dots, 3 are marked)" in seen[5].problem
    assert len(out.result.views) == 5


@pytest.mark.slow
def test_a_board_without_marks_is_held_as_it_should_be(session):
    """Each picture may count from another corner: cameras and poses are found, the dots are not."""
    rng = np.random.default_rng(33)
    nominal = np.column_stack([cells() * PITCH, np.zeros(COLUMNS * ROWS)])
    pictures = {f"p{k}": look(rng, nominal, CAMERAS["left"], pose) for k, pose in enumerate(poses(rng, 8))}
    out, _ = session(pictures, Board(PITCH))
    assert out, out.reason
    result = out.result
    true = CAMERAS["left"]
    for p in SETTINGS.free:
        assert abs(getattr(result.cameras["camera"], p) - getattr(true, p)) < 4 * result.sigma("camera", p)
    assert (result.marker_cov == 0).all()
    assert result.options["datum"] == Fixed()
    assert "All markers are held" in datum_words(result)[0]
    assert isinstance(out.halves, SplitHalf)
    assert out.halves.comparison is None
    assert 0.3 < out.halves.ratio < 2
    assert record(out, "mm")["halves"]["ratio"] == out.halves.ratio


def test_what_a_board_without_marks_cannot_do(session):
    rng = np.random.default_rng(34)
    xyz = printed(rng)
    pictures = {f"p{k}": look(rng, xyz, CAMERAS["left"], pose) for k, pose in enumerate(poses(rng, 4))}
    with pytest.raises(ValueError, match="dots of a board without marks are not the same"):
        session(pictures, Board(PITCH), replace(SETTINGS, datum=Free()))
    with pytest.raises(ValueError, match="rig: cameras side by side must see the same dots"):
        session(pictures, Board(PITCH), replace(SETTINGS, rig=True))


def test_no_board_says_why(session):
    rng = np.random.default_rng(35)
    nothing = Detections.make(rng.uniform(0, 1400, (60, 2)))
    out, seen = session({"p0": (nothing, nothing), "p1": (Detections.make(np.zeros((0, 2))), nothing)}, Board(PITCH))
    assert not out
    assert out.cause == "too_few"
    assert "no board was found in any of 2 pictures" in out.reason
    assert "too few for a board" in out.dropped["p1"]
    assert [p.count for p in seen] == [0, 0]


@pytest.mark.slow
def test_frontal_pictures_of_a_board_do_not_tell_the_focal_length(session):
    rng = np.random.default_rng(36)
    xyz = printed(rng)
    frontal = [Pose.from_rotvec([0, 0, a], [-27 + 5 * a, -20.0, 120.0]) for a in np.linspace(0, 0.3, 6)]
    pictures = {f"p{k}": look(rng, xyz, CAMERAS["left"], pose) for k, pose in enumerate(frontal)}
    out, _ = session(pictures, marked())
    assert not out
    assert "focal_px" in out.weak
    assert "all pictures face it" in out.reason


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pitch": 0.0}, "pitch must be positive"),
        ({"pitch": 1.0, "mark_kind": "square"}, "one of holes, large, small"),
    ],
)
def test_wrong_boards_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        Board(**options)


def hidden_marks(rng, pose_list, xyz, lost):
    """Pictures in the first ``lost`` of which one hole is hidden; and which dot each spot is, -1 for none."""
    pictures, dots = {}, {}
    for k, pose in enumerate(pose_list):
        spots, holes = look(rng, xyz, CAMERAS["left"], pose)
        away = np.linalg.norm(spots.xy[:, None] - CAMERAS["left"].project(pose.apply(xyz))[0], axis=2)
        name = f"p{k}"
        dots[name] = np.where(away.min(axis=1) < 1.0, away.argmin(axis=1), -1)
        pictures[name] = (spots, Detections.make(holes.xy[1:] if k < lost else holes.xy, sigma_px=0.1))
    return pictures, dots


def right_part(picture, dots):
    """Part of a picture's dots that have their own column and row."""
    own = dots[picture.name][picture.board.spot]
    index = np.stack([picture.board.column, picture.board.row], axis=1)
    return (index[own >= 0] == cells()[own[own >= 0]]).all(axis=1).mean()


@pytest.mark.slow
@pytest.mark.parametrize("size", [(None, None), (COLUMNS, ROWS)])
def test_where_a_mark_is_hidden_the_print_tells_how_the_board_lies(session, size):
    rng = np.random.default_rng(4)
    pictures, dots = hidden_marks(rng, poses(rng, 7), printed(rng), 2)
    done, out = session(pictures, Board(PITCH, RINGS, "holes", *size), cameras={"camera": CAMERAS["left"]})
    assert done
    assert 0.85 < done.result.sigma0 < 1.15
    assert [p.problem for p in out] == [""] * 7
    assert [p.round for p in out] == [2] * 2 + [1] * 5
    assert min(right_part(p, dots) for p in out) > 0.98


@pytest.mark.slow
def test_a_board_without_a_flaw_does_not_tell_how_it_lies(session):
    rng = np.random.default_rng(5)
    nominal = np.column_stack([cells() * PITCH, np.zeros(COLUMNS * ROWS)])
    pictures, _ = hidden_marks(rng, poses(rng, 6), nominal, 2)
    done, out = session(pictures, Board(PITCH, RINGS, "holes", COLUMNS, ROWS), cameras={"camera": CAMERAS["left"]})
    assert done
    assert all("the marked dots were not found" in p.problem for p in out[:2])
    assert [p.problem for p in out[2:]] == [""] * 4


@pytest.mark.slow
def test_a_false_mark_that_turns_the_board_is_found_by_the_print(session):
    """A hole is hidden, and a false one stands where the board turned by 180 degrees would have it."""
    rng = np.random.default_rng(6)
    xyz, views = printed(rng), poses(rng, 6)
    pictures, dots = hidden_marks(rng, views, xyz, 0)
    at = {tuple(c): n for n, c in enumerate(cells().tolist())}
    third = at[11 - 3, 8 - 1]  # the third mark, (3, 1), where the board is turned; (3, 4) and (8, 4) change places
    spots, holes = pictures["p0"]
    xy = CAMERAS["left"].project(views[0].apply(xyz))[0]
    hidden = np.linalg.norm(holes.xy - xy[at[3, 1]], axis=1) < 2.0
    assert hidden.sum() == 1
    pictures["p0"] = spots, Detections.make(np.concatenate([holes.xy[~hidden], xy[[third]]]), sigma_px=0.1)
    done, out = session(pictures, Board(PITCH, RINGS, "holes", COLUMNS, ROWS), cameras={"camera": CAMERAS["left"]})
    assert done
    assert right_part(out[0], dots) > 0.98
    assert 0.85 < done.result.sigma0 < 1.15
