"""A focal length from nothing: right where it can be known, refused where it cannot."""

from dataclasses import replace

import numpy as np
import pytest

from windmark.adjust import Loss
from windmark.calibration import start_focal
from windmark.calibration.focal_fit import problem_of
from windmark.calibration.start_focal import zhang_focal
from windmark.geometry import Camera, Pose
from windmark.geometry.two_view.homography import fit_homography
from windmark.synth import board_spots

SIZE = (2000, 1500)


def flat_views(seed, n, tilt_deg, focal, *, corner_px=12.0, wrong=0.0, noise=0.1, centre=(999.5, 749.5)):
    """Boards seen by one camera whose lens moves the corners."""
    rng = np.random.default_rng(seed)
    corner = np.hypot(*SIZE) / 2 / focal
    camera = Camera(SIZE, focal, cx=centre[0], cy=centre[1], k1=-corner_px / focal / corner**3)
    views = []
    for k in range(n):
        made = board_spots(
            rng, 12, 9, size_px=SIZE, focal_px=focal, tilt_deg=tilt_deg * (k + 1) / n, clutter=0.0, fill=0.8
        )
        xyz = np.column_stack([made.cell - [5.5, 4.0], np.zeros(len(made.cell))])
        xy, valid = camera.project(made.cam_from_board.apply(xyz))
        views.append((xyz[valid], mixed(rng, xy[valid] + rng.normal(0, noise, (int(valid.sum()), 2)), wrong)))
    return camera, views


def solid_views(seed, n, focal, *, rough=0.0, wrong=0.0):
    """Markers on a model of 600, seen from all over the front; the table may be rough."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-300, 300, (40, 3)) * [1, 0.7, 0.4]
    table = xyz + rng.normal(0, rough, xyz.shape)
    camera = Camera(SIZE, focal, k1=-0.01 * (focal / 1250) ** 2)
    views = []
    for _ in range(n):
        side = rng.uniform(-0.6, 0.6, 2)
        eye = np.array([np.sin(side[0]), np.sin(side[1]), -1.0]) * focal * 0.45
        pose = Pose.look_at(eye, np.zeros(3), np.array([rng.normal(), rng.normal(), 0.0]))
        xy, valid = camera.project(pose.apply(xyz))
        views.append((table[valid], mixed(rng, xy[valid] + rng.normal(0, 0.1, (int(valid.sum()), 2)), wrong)))
    return camera, views


def mixed(rng, xy, share):
    """Labels of a share of the marks exchanged."""
    out = np.flatnonzero(rng.random(len(xy)) < share)
    xy[out] = xy[rng.permutation(out)]
    return xy


@pytest.mark.parametrize("focal", [1500.0, 4000.0, 9000.0])
@pytest.mark.parametrize("wrong", [0.0, 0.2], ids=["right labels", "a fifth wrong"])
def test_flat_board(focal, wrong):
    _, views = flat_views(601, 8, 45.0, focal, wrong=wrong)
    got = start_focal(views, SIZE)
    assert got, got.reason
    assert got.focal_px == pytest.approx(focal, rel=0.01)
    assert abs(got.focal_px - focal) < 4 * got.sigma_px
    assert got.rms_px < 0.25
    for pose, (xyz, xy), used in zip(got.poses, views, got.used, strict=True):
        seen, _ = got.camera.project(pose.apply(xyz))
        assert np.hypot(*(seen - xy).T)[used].max() < 1.0
        assert used.mean() > 0.9 - wrong


def test_principal_point_off_the_middle_is_in_the_sigma():
    _, views = flat_views(602, 8, 45.0, 3000.0, centre=(1030.0, 730.0))
    got = start_focal(views, SIZE)
    assert abs(got.focal_px - 3000.0) < 4 * got.sigma_px
    assert got.focal_px == pytest.approx(3000.0, rel=0.03)


@pytest.mark.parametrize("focal", [1600.0, 6000.0])
@pytest.mark.parametrize("wrong", [0.0, 0.2], ids=["right labels", "a fifth wrong"])
def test_markers_in_space(focal, wrong):
    _, views = solid_views(603, 6, focal, wrong=wrong)
    got = start_focal(views, SIZE)
    assert got, got.reason
    assert got.focal_px == pytest.approx(focal, rel=0.01)


def test_rough_markers_in_space():
    _, views = solid_views(604, 8, 2500.0, rough=4.0)
    got = start_focal(views, SIZE)
    assert got, got.reason
    assert got.focal_px == pytest.approx(2500.0, rel=0.1)
    assert abs(got.focal_px - 2500.0) < 4 * got.sigma_px


@pytest.mark.parametrize("seed", [605, 606, 607])
def test_face_on_is_refused(seed):
    """A plane seen face-on looks the same with a longer lens from farther away."""
    _, views = flat_views(seed, 6, 0.0, 3000.0)
    got = start_focal(views, SIZE)
    assert not got
    assert got.cause == "perspective"
    assert "tilt the board" in got.reason


def test_labels_that_mean_nothing_are_refused():
    rng = np.random.default_rng(608)
    views = [(rng.uniform(-1, 1, (20, 3)), rng.uniform(0, 1500, (20, 2))) for _ in range(3)]
    assert not start_focal(views, SIZE)


def test_too_few_marks():
    got = start_focal([(np.eye(4, 3), np.zeros((4, 2)))], SIZE)
    assert got.cause == "too_few"


def test_a_picture_without_marks_has_no_pose():
    _, views = flat_views(609, 4, 45.0, 3000.0)
    got = start_focal([*views, (np.zeros((0, 3)), np.zeros((0, 2)))], SIZE)
    assert got.poses[-1] is None
    assert got.used[-1].shape == (0,)
    assert all(pose is not None for pose in got.poses[:-1])


def test_zhang_is_exact_without_noise_and_lens():
    camera, views = flat_views(610, 3, 40.0, 2600.0, corner_px=0.0, noise=0.0)
    homographies = [fit_homography(xyz[:, :2], xy) for xyz, xy in views]
    assert zhang_focal(homographies, camera) == pytest.approx(2600.0, rel=1e-6)
    camera, views = flat_views(611, 3, 0.0, 2600.0, corner_px=0.0, noise=0.0)
    face_on = [fit_homography(xyz[:, :2], xy) * [[1, 1, 1], [1, 1, 1], [0, 0, 1]] for xyz, xy in views]
    assert zhang_focal(face_on, camera) is None


@pytest.mark.parametrize(
    ("views", "word"),
    [([(np.zeros((5, 2)), np.zeros((5, 2)))], "xyz"), ([(np.full((5, 3), np.nan), np.zeros((5, 2)))], "finite")],
)
def test_wrong_input_is_named(views, word):
    with pytest.raises(ValueError, match=word):
        start_focal(views, SIZE)
    with pytest.raises(ValueError, match="max_sigma"):
        start_focal([], SIZE, max_sigma=0.0)


def test_two_hundredths_of_the_size_and_a_twentieth_of_the_corner_are_one_sigma_of_a_start():
    """Each alone adds half of its square to the cost; the corner's distortion is k1 r^2 of its distance."""
    camera, pose = Camera(SIZE, 1800.0), Pose(np.eye(3), np.array([0.0, 0.0, 5.0]))
    xyz = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    view = (pose, camera.project(pose.apply(xyz))[0], xyz)
    problem, state = problem_of(camera, [view], 0.1, Loss())
    assert problem.prior_cost(state) == pytest.approx(0.0, abs=1e-12)
    corner = (1000.0**2 + 750.0**2) / 1800.0**2
    for off in ({"cx": camera.cx + 0.02 * 2000}, {"cy": camera.cy - 0.02 * 1500}, {"k1": 0.05 / corner}):
        other = replace(state, cameras=(replace(camera, **off),))
        assert problem.prior_cost(other) == pytest.approx(0.5, rel=1e-6)
