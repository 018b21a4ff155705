"""Two pictures with known poses or labels, and frames without primary markers; truth known."""

import sys
from pathlib import Path

import numpy as np
import pytest

from windmark.calibration import Distance
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet, View
from windmark.tasks.reconstruct import reconstruct

sys.path.insert(0, str(Path(__file__).parents[1] / "epipolar"))
import reconstruct_scenes as scenes


def pair(seed, n, base_deg, model, noise=0.2):
    """Two pictures so many degrees apart: places, poses, spots and their markers."""
    rng = np.random.default_rng(seed)
    xyz, normal = (scenes.plate if model == "plate" else scenes.wing_body_walls)(rng, 3 * n)
    kept = scenes._apart(xyz)[:n]
    xyz, normal = xyz[kept], normal[kept]
    reach, half, way = float(np.abs(xyz[:, :2]).max()), np.radians(base_deg / 2), rng.uniform(0, 2 * np.pi)
    place = rng.uniform(-0.3, 0.3, 2)
    poses = [scenes._station(rng, reach, *(place + s * half * np.array([np.cos(way), np.sin(way)])), rng.normal(0, 0.1))
             for s in (-1, 1)]  # fmt: skip
    spots, labels = zip(
        *[scenes._seen(rng, scenes.CAMERA, p, xyz, normal, model, 0.1, 0.1, noise) for p in poses], strict=True
    )
    return xyz, poses, spots, labels


def count(result, labels):
    """Right and wrong links."""
    right = wrong = 0
    for m in range(len(result.markers)):
        mine = result.tracks.track == m
        spot = dict(zip(result.tracks.view[mine].tolist(), result.tracks.detection[mine].tolist(), strict=True))
        same = labels[0][spot[0]] == labels[1][spot[1]] >= 0
        right, wrong = right + same, wrong + (not same)
    return right, wrong


def both_of(labels):
    return np.intersect1d(labels[0][labels[0] >= 0], labels[1][labels[1] >= 0])


def primaries(xyz, which):
    return MarkerSet.make([f"m{i}" for i in which], xyz[which], role="primary")


@pytest.mark.parametrize(("model", "n", "base", "least"), [("plate", 25, 6, 0.95), ("model", 25, 15, 0.4),
                                                           ("plate", 67, 15, 0.9), ("model", 67, 6, 0.6)])  # fmt: skip
def test_exact_poses_give_what_is_unambiguous_and_nothing_wrong(model, n, base, least):
    xyz, poses, spots, labels = pair(1, n, base, model)
    both = both_of(labels)
    views = [View(f"v{k}", "cam", "", p) for k, p in enumerate(poses)]
    result = reconstruct(spots, {"cam": scenes.CAMERA}, primaries(xyz, both[:6]), views=views)
    assert result, result.reason
    right, wrong = count(result, labels)
    assert wrong == 0
    assert right >= least * len(both)
    linked = [set(result.tracks.detection[result.tracks.view == v].tolist()) for v in (0, 1)]
    for v, name in enumerate(("v0", "v1")):  # what is open is in no track
        assert not linked[v] & set(result.open_spots[name].tolist())


def test_a_primary_without_a_point_does_not_take_its_neighbours():
    """150 markers: some primaries' links stay open, and the next point is another marker."""
    xyz, poses, spots, labels = pair(8, 150, 6, "plate", noise=0.1)
    both = both_of(labels)
    far = both[np.argsort(-np.linalg.norm(xyz[both] - xyz[both].mean(axis=0), axis=1))[:6]]
    views = [View(f"v{k}", "cam", "", p) for k, p in enumerate(poses)]
    result = reconstruct(spots, {"cam": scenes.CAMERA}, primaries(xyz, far), views=views)
    assert result, result.reason
    assert count(result, labels)[1] == 0


def test_labels_in_both_pictures_are_enough():
    xyz, _, spots, labels = pair(2, 67, 12, "model")
    both = both_of(labels)
    table = primaries(xyz, both[np.argsort(-np.linalg.norm(xyz[both], axis=1))[:6]])
    said = {f"v{k}": {int(np.flatnonzero(mine == int(n[1:]))[0]): n for n in table.name}
            for k, mine in enumerate(labels)}  # fmt: skip
    views = [View(f"v{k}", "cam") for k in range(2)]
    result = reconstruct(spots, {"cam": scenes.CAMERA}, table, views=views, labels=said)
    assert result, result.reason
    right, wrong = count(result, labels)
    assert (wrong, right > 0.6 * len(both)) == (0, True)


@pytest.mark.slow
def test_poses_two_degrees_off_give_nothing_wrong():
    for seed in range(3):
        _, poses, spots, labels = pair(seed, 67, 12, "plate")
        off = [poses[0], Pose.exp(np.radians([1.4, -1.4, 0, 0, 0, 0])) @ poses[1]]
        views = [View(f"v{k}", "cam", "", p) for k, p in enumerate(off)]
        result = reconstruct(spots, {"cam": scenes.CAMERA}, None, views=views)
        assert not result or count(result, labels)[1] == 0


def test_pictures_from_one_place_and_spots_on_a_line_are_refused():
    xyz, poses, _, _ = pair(0, 40, 12, "plate")
    turned = Pose.exp(np.array([0.0, 0.03, 0, 0, 0, 0])) @ poses[0]
    xy = [scenes.CAMERA.project(p.apply(xyz))[0] for p in (poses[0], turned)]
    from windmark.scene import Detections

    alike = [Detections.make(p[scenes.CAMERA.in_image(p)], sigma_px=0.2) for p in xy]
    no = reconstruct(alike, scenes.CAMERA, None)
    assert not no
    assert no.cause in ("baseline", "no_pair")
    x = np.linspace(200, 2800, 30)
    line = [Detections.make(np.column_stack([x, 700 + s * x]), sigma_px=0.2) for s in (0.1, 0.12)]
    assert not reconstruct(line, scenes.CAMERA, None)


def test_a_regular_grid_with_known_poses_has_no_wrong_link():
    grid = np.stack(np.meshgrid(np.arange(9) * 60.0 - 240, np.arange(7) * 60.0 - 180, [0.0]), -1).reshape(-1, 3)
    rng = np.random.default_rng(0)
    poses = [scenes._station(rng, 250.0, s, 0.1, 0.0) for s in (-0.1, 0.1)]
    from windmark.scene import Detections

    spots, labels = [], []
    for p in poses:
        order = rng.permutation(len(grid))
        spots.append(Detections.make(scenes.CAMERA.project(p.apply(grid[order]))[0] + rng.normal(0, 0.1, (63, 2)),
                                     sigma_px=0.1))  # fmt: skip
        labels.append(order)
    views = [View(f"v{k}", "cam", "", p) for k, p in enumerate(poses)]
    result = reconstruct(spots, {"cam": scenes.CAMERA}, None, views=views)
    assert not result or count(result, labels)[1] == 0


# --- free frames -----------------------------------------------------------------------------
@pytest.fixture(scope="module")
def many():
    return scenes.make(3, "plate", views=6, points=60)


def shape_error(result, case, scale):
    """RMS distance of the markers from the truth after a rigid motion, in the result's unit."""
    track = result.tracks
    label = np.array([case.labels[v][s] for v, s in zip(track.view, track.detection, strict=True)])
    every = [label[(track.track == m) & (label >= 0)] for m in range(len(result.markers))]
    votes = [np.bincount(some).argmax() for some in every]
    a, b = result.markers.xyz, scale * case.xyz[votes]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return float(np.sqrt(((a @ turn - b) ** 2).sum(axis=1).mean())), float(np.sqrt((b**2).sum(axis=1).mean()))


def test_a_free_frame_has_the_shape_and_says_its_frame(many):
    result = reconstruct(many.detections, many.camera, None)
    assert result, result.reason
    assert result.free_scale
    assert "free scale" in result.frame
    xyz = result.markers.xyz
    assert xyz.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-4)
    assert np.sqrt((xyz**2).sum(axis=1).mean()) == pytest.approx(1.0, abs=1e-4)
    assert np.abs(xyz[:, 2]).mean() < 0.03  # the plate is flat, and z is its normal
    assert all(v.cam_from_model.center[2] > 1 for v in result.views if v.cam_from_model is not None)
    error, size = shape_error(result, many, 1 / 1.0)
    scaled = shape_error(result, many, 1 / size)[0]
    assert scaled < 2e-3
    assert error > 10  # millimetres are not the unit


def test_a_known_distance_or_poses_give_the_scale(many):
    a, b = (int(m) for m in many.primary[:2])
    said = {"0": {int(np.flatnonzero(many.labels[0] == m)[0]): n for m, n in ((a, "A"), (b, "B"))
                  if (many.labels[0] == m).any()}}  # fmt: skip
    assert len(said["0"]) == 2
    bar = Distance("A", "B", float(np.linalg.norm(many.xyz[a] - many.xyz[b])), 0.01)
    result = reconstruct(many.detections, many.camera, None, labels=said, distances=[bar])
    assert result, result.reason
    assert not result.free_scale
    assert shape_error(result, many, 1.0)[0] < 0.5
    views = [View(str(k), "cam", "", Pose(many.poses.rotation[k], many.poses.translation[k])) for k in range(6)]
    posed = reconstruct(many.detections, {"cam": many.camera}, None, views=views)
    assert posed
    assert "given poses" in posed.frame
    assert shape_error(posed, many, 1.0)[0] < 0.5
    centre = np.stack([v.cam_from_model.center for v in posed.views])
    assert np.abs(centre - many.poses.center).max() < 3.0


@pytest.mark.parametrize("turn_deg", [0.0, 0.5])
def test_two_given_poses_give_frame_and_scale_with_the_sigma_that_they_have_there(turn_deg):
    """The relative pose is what the pictures show, not what is given: its error is in the frame and in the scale."""
    rng = np.random.default_rng(4)
    xyz, camera = rng.uniform(-1, 1, (40, 3)) * [2, 1.5, 0.3], Camera((640, 480), 800.0)
    poses = [Pose.look_at(eye, [0, 0, 0], [0, 1, 0]) for eye in ((-1, 0, 6), (1, 0.3, 6))]
    spots = [
        Detections.make(camera.project(p.apply(xyz))[0] + rng.normal(0, 0.02, (40, 2)), sigma_px=0.02) for p in poses
    ]
    turned = Pose.exp([0, np.radians(turn_deg), 0, 0, 0, 0]) @ poses[1]
    views = [View(str(k), cam_from_model=p) for k, p in enumerate((poses[0], turned))]
    result = reconstruct(spots, camera, None, views=views)
    first = result.tracks.view == 0
    off = result.markers.xyz[result.tracks.track[first]] - xyz[result.tracks.detection[first]]
    z2 = (off[:, None] @ np.linalg.inv(result.marker_cov[result.tracks.track[first]]) @ off[:, :, None]).ravel()
    assert np.median(z2) / 2.37 < 2  # the median of chi squared with three degrees of freedom
    said = [str(d) for d in result.doubts if "given poses" in str(d)]
    if turn_deg:
        assert "0.17 degrees each" in said[0]
        assert np.abs(off).max() > 0.01  # the half of it: nothing says which of the two is wrong
    else:
        assert not said
        assert np.linalg.norm(off, axis=1).max() < 0.03


def test_a_distance_of_unknown_markers_is_refused(many):
    no = reconstruct(many.detections, many.camera, None, distances=[Distance("A", "B", 100.0, 0.1)])
    assert not no
    assert "marker A of the known distance" in no.reason
    with pytest.raises(ValueError, match="with primaries leave them out"):
        reconstruct(many.detections, many.camera, primaries(many.xyz, many.primary),
                    distances=[Distance("A", "B", 1.0, 0.1)])  # fmt: skip
