"""A scene that changed between the pictures is the reason, and no focal length is; and what is no such change."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.calibration import Calibration, Free, self_calibrate
from windmark.calibration.changed_scene import FIRST, _by_place, _Divided, _field, _lots
from windmark.calibration.hypotheses import gathered
from windmark.calibration.view_changes import explained
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

CAMERA = Camera((1600, 1200), 1500.0, cx=805.0, cy=590.0, k1=-0.1)


def calibrated(change=None, *, first=5, views=10, cameras=None, seed=1):
    """10 pictures of 40 markers from all sides, whose places ``change`` makes others from the ``first`` picture on."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (40, 3)) * [200, 150, 20]
    later = xyz if change is None else change(xyz)
    xy = []
    for k in range(views):
        turn = 2.4 * k
        eye = [320 * np.cos(turn), 320 * np.sin(turn), 700 + 30 * (k % 3)]
        pose = Pose.look_at(eye, [0, 0, 0], [np.cos(1.3 * k), np.sin(1.3 * k), 0])
        camera = CAMERA if cameras is None else cameras(k)
        xy.append(camera.project(pose.apply(later if k >= first else xyz))[0])
    view, point = np.divmod(np.arange(40 * views), 40)
    marks = np.concatenate(xy) + rng.normal(0, 0.05, (len(view), 2))
    observations = Observations(view, point, marks, np.tile(0.0025 * np.eye(2), (len(view), 1, 1)))
    names = [f"m{k:02d}" for k in range(40)]
    markers = MarkerSet.make(names, xyz + rng.normal(0, 1.0, xyz.shape), length_unit="mm")
    shown = [View(f"v{k}") for k in range(views)]
    result = self_calibrate(observations, markers, {"camera": CAMERA}, shown, datum=Free(), free=())
    assert isinstance(result, Calibration)
    return result


def bent(size):
    return lambda xyz: xyz + np.column_stack([np.zeros((len(xyz), 2)), size * (xyz[:, 0] / 200 + 1) ** 2 / 4])


@pytest.mark.parametrize(("first", "views", "size"), [(5, 10, 1.0), (2, 6, 2.0)])
def test_a_model_that_bent_is_named_and_between_which_pictures(first, views, size):
    """By 1 mm at the tip, of which two thirds are a motion of all: the residuals grow by 14 %."""
    result = calibrated(bent(size), first=first, views=views)
    (doubt,) = (d for d in result.doubts if d.cause != "focus")
    assert doubt.cause == "scene"
    assert doubt.names[:2] == (f"v{first}", f"v{first - 1}")
    assert " mm (rms)" in str(doubt)
    assert result.sigma0 < 1.6


def test_so_it_is_with_so_many_pictures_that_their_poses_are_eliminated():
    """The markers' derivatives are among the dense ones then."""
    (doubt,) = (d for d in calibrated(bent(1.0), first=12, views=24).doubts if d.cause != "focus")
    assert doubt.cause == "scene"
    assert doubt.names[:2] == ("v12", "v11")
    assert not [d for d in calibrated(views=24).doubts if d.cause == "scene"]


def test_so_is_a_part_that_moved():
    def moved(xyz):
        return xyz + np.where(xyz[:, :1] > 50, [[0.0, 0.15, 0.1]], 0.0)

    assert [d.cause for d in calibrated(moved).doubts if d.cause != "focus"] == ["scene"]


def test_a_model_that_moved_as_a_whole_did_not_change():
    """Every picture has a pose of its own."""
    turn = Pose.from_rotvec([0.0, 0.0, 0.02], [3.0, 0.0, 1.0])
    assert not [d for d in calibrated(turn.apply).doubts if d.cause == "scene"]


@pytest.mark.parametrize("seed", range(1, 5))
def test_nothing_is_said_of_a_scene_that_stayed(seed):
    assert not [d for d in calibrated(seed=seed).doubts if d.cause == "scene"]


def test_another_focus_of_the_later_pictures_is_no_change_of_the_scene():
    other = replace(CAMERA, focal_px=1500.0 * 1.003)
    causes = [d.cause for d in calibrated(cameras=lambda k: other if k >= 5 else CAMERA).doubts]
    assert "scene" not in causes
    assert causes


def test_a_lens_that_is_not_the_given_one_is_no_change_of_the_scene():
    """Its errors differ from picture to picture, in one division of them as in another."""
    other = replace(CAMERA, k1=-0.11)
    assert "scene" not in [d.cause for d in calibrated(cameras=lambda _: other).doubts]


@pytest.mark.parametrize("picture", [0, 1, 18, 19])
@pytest.mark.parametrize(
    ("other", "cause"),
    [(replace(CAMERA, cx=809.0), "principal"), (replace(CAMERA, focal_px=1507.5), "focal"),
     (replace(CAMERA, shear=0.0015), "sheared"), (replace(CAMERA, k1=-0.085), "distorted")],
)  # fmt: skip
def test_one_odd_picture_at_either_end_is_no_change_of_the_scene(picture, other, cause):
    """As the first or last of 20 it is half of a division that no other one by lot resembles."""
    result = calibrated(views=20, cameras=lambda k: other if k == picture else CAMERA)
    (doubt,) = (d for d in result.doubts if d.cause != "focus")
    assert doubt.names[0] == f"v{picture}"
    assert doubt.cause == cause or (doubt.cause == "picture" and "by its " in str(doubt))


@pytest.mark.parametrize(("count", "later"), [(4, 2), (20, 18), (20, 2), (16, 14), (24, 22), (20, 10), (23, 20)])
def test_lots_are_other_divisions_and_leave_no_picture_out(count, later):
    asked = np.arange(count) >= later
    lots = np.array(_lots(asked))
    few = min(later, count - later)
    assert (lots.sum(axis=1) == few).all()
    assert len(lots) >= 2
    assert (np.abs([np.corrcoef(lot, asked)[0, 1] for lot in lots]) < 0.5).all()
    assert lots.any(axis=0).all()


def test_what_divisions_explain_is_that_of_their_pictures_taken_anew(monkeypatch):
    """Sums over blocks do for every division, and bounds leave out no split that explains more."""
    kept = []
    monkeypatch.setattr(_Divided, "splits", lambda every, splits=_Divided.splits: kept.append(every) or splits(every))
    calibrated(views=12, first=7, change=bent(0.5))
    every = kept[0]
    solved, blocks = every.solved, len(every.score)
    points = np.arange(40)
    field, view = _field(solved, points), solved.problem.marks.views
    b = np.einsum("oij,om->oijm", _by_place(solved), field[solved.problem.marks.points]).reshape(len(view), 2, -1)
    b[~solved.used[solved.problem.order]] = 0.0
    unknowns = np.arange(3 * field.shape[1]).reshape(3, -1)
    for kinds in (unknowns[:, :FIRST].ravel(), unknowns.ravel()):
        some, tests = every.some(kinds), []
        for k in range(1, blocks):
            of = b[..., kinds] * (view >= k)[:, None, None]
            cross = gathered(solved, of, np.zeros(len(view), int), 1)[:, 0]
            flat, r = of.reshape(-1, len(kinds)), solved.residual[solved.problem.order].ravel()
            left = flat.T @ flat - cross.T @ solved.covariance.product(cross)
            size = np.sqrt(np.diagonal(flat.T @ flat))
            change, test, count = explained(left / np.outer(size, size), flat.T @ r / size)
            tests.append(test)
            for found in (some.explained(np.arange(blocks) >= k), some.splits().explained(k)):
                assert found[1] == pytest.approx(test, rel=1e-6)
                assert found[2] == count
                np.testing.assert_allclose(found[0], -change / size, atol=1e-6 * np.abs(change / size).max())
        found, k = some.splits().most(list(range(2, blocks - 1)))
        assert k == 2 + int(np.argmax(tests[1:-1]))
        assert found[1] == pytest.approx(tests[k - 1])
