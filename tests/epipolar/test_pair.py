"""`match_pair`: pairs of spots without labels or poses, or an honest refusal."""

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar import NotMatched, match_pair
from windmark.geometry import Camera, Pose
from windmark.scene import Detections


def two(seed, model, step=1):
    case = scenes.make(seed, model, views=1 + step)
    a, b = 0, step
    return case, case.detections[a], case.detections[b], case.labels[a], case.labels[b]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("model", ["plate", "model"])
def test_neighbouring_pictures_are_matched(model, seed):
    case, a, b, label_a, label_b = two(seed, model)
    pair = match_pair(a, b, case.camera)
    right = (label_a[pair.a] == label_b[pair.b]) & (label_a[pair.a] >= 0)
    common = np.intersect1d(label_a[label_a >= 0], label_b[label_b >= 0])
    assert (~right).sum() <= 1
    assert right.sum() >= 0.6 * len(common)
    assert pair.log10_nfa < -20
    assert pair.view.b_from_a is not None
    assert np.abs(pair.distance_px).max() < 1.0
    assert not np.isin(pair.open_a, pair.a).any()
    assert not np.isin(pair.open_b, pair.b).any()


def test_the_relative_pose_is_that_of_the_cameras():
    case, a, b, _, _ = two(5, "plate")
    pose = match_pair(a, b, case.camera).view.b_from_a
    first, second = (Pose(case.poses.rotation[v], case.poses.translation[v]) for v in (0, 1))
    truth = second @ first.inverse()
    assert np.linalg.norm(pose.log()[:3] - truth.log()[:3]) < 0.02
    direction = truth.translation / np.linalg.norm(truth.translation)
    assert pose.translation @ direction > 0.999


@pytest.mark.parametrize("seed", range(6))
def test_pictures_of_different_things_are_not_matched(seed):
    case, a, _, _, _ = two(seed, "plate")
    _, _, b, _, _ = two(100 + seed, ("plate", "model")[seed % 2])
    answer = match_pair(a, b, case.camera)
    assert isinstance(answer, NotMatched)
    assert not answer
    assert answer.cause in ("nothing", "weak")
    assert answer.reason


def test_a_mirrored_picture_is_not_matched():
    case, a, b, _, _ = two(7, "plate")
    mirrored = Detections.make(np.array([case.camera.size_px[0], 0.0]) + b.xy * [-1, 1], cov=b.cov)
    assert not match_pair(a, mirrored, case.camera)


def test_a_regular_grid_without_a_border_is_ambiguous_or_nothing():
    camera = Camera((1000, 1000), 1200.0, cx=499.5, cy=499.5)
    u, v = np.meshgrid(np.arange(30) * 40.0 - 100, np.arange(30) * 40.0 - 100)
    every = np.stack([u.ravel(), v.ravel()], axis=1)
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    rng = np.random.default_rng(0)
    pictures = []
    for xy in (every, (every - 500) @ turn.T + 517):
        seen = xy[((xy > 0) & (xy < 999)).all(axis=1)]
        pictures.append(Detections.make(seen + rng.normal(0, 0.1, seen.shape), sigma_px=0.1))
    assert not match_pair(*pictures, camera)


def test_too_few_spots_are_named():
    case, a, b, _, _ = two(8, "plate")
    answer = match_pair(a.take(np.arange(5)), b, case.camera)
    assert answer.cause == "too_few"
    assert "5" in answer.reason


def test_exchanging_the_pictures_exchanges_the_pairs():
    case, a, b, _, _ = two(9, "plate")
    ahead, back = match_pair(a, b, case.camera), match_pair(b, a, case.camera)
    both = set(zip(ahead.a.tolist(), ahead.b.tolist(), strict=True))
    assert len(both & set(zip(back.b.tolist(), back.a.tolist(), strict=True))) > 0.9 * len(both)
