"""Spots of many pictures linked, the poses being roughly known."""

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar import WHY, associate
from windmark.epipolar.associate import PASSES
from windmark.geometry import Pose, align
from windmark.scene import Detections


def judged(case, result):
    label = np.array(
        [case.labels[v][s] for v, s in zip(result.tracks.view, result.tracks.detection, strict=True)], dtype=int
    )
    return scenes.judge(result.tracks.track, label, case.views_of)


@pytest.mark.parametrize(
    ("model", "path"), [("plate", "walk"), ("plate", "cloud"), ("model", "walk"), ("model", "cloud")]
)
def test_rough_poses(model, path):
    """Poses wrong by 0.2 degrees and 2 mm (12 px): every marker with three spots has a track, none is wrong."""
    case = scenes.make(31, model, path, views=12, points=60)
    poses, cov = case.perturbed(1)
    result = associate(case.detections, case.camera, poses, pose_cov=cov)
    count = judged(case, result)
    assert (count.wrong, count.lost, count.false) == (0, 0, 0)
    assert count.missed <= 0.005 * count.right


def test_poses_and_points_improve():
    """Points agree with the truth, up to a common motion, as their covariances say."""
    case = scenes.make(32, "plate", "cloud", views=10, points=60)
    poses, cov = case.perturbed(2)
    result = associate(case.detections, case.camera, poses, pose_cov=cov)
    label = np.array([case.labels[v][s] for v, s in zip(result.tracks.view, result.tracks.detection, strict=True)])
    own = label[np.searchsorted(result.tracks.track, np.arange(len(result)))]
    fit = align(result.xyz, case.xyz[own])
    error = fit.apply(result.xyz) - case.xyz[own]
    sigma = np.sqrt(np.diagonal(result.cov, axis1=1, axis2=2))
    assert 0.7 < np.sqrt(((error / sigma) ** 2).mean()) < 1.5
    assert np.sqrt((result.residuals**2).mean()) < 0.12
    assert result.passes < PASSES  # the links have settled
    assert np.sqrt(np.diagonal(result.pose_cov, axis1=1, axis2=2))[:, :3].max() < 0.2 * np.radians(0.2)


def test_exact_poses_stay():
    """Without a covariance the poses are what they are, and one search is enough."""
    case = scenes.make(33, "model", "walk", views=8, points=40)
    result = associate(case.detections, case.camera, case.poses)
    count = judged(case, result)
    assert (count.wrong, count.lost) == (0, 0)
    assert result.passes == 1
    np.testing.assert_array_equal(result.poses.translation, case.poses.translation)


@pytest.mark.parametrize("what", ["depth_range", "points_near"])
def test_points_are_where_they_are_looked_for(what):
    """All where the markers are known to be; none where they are not."""
    case = scenes.make(33, "plate", "walk", views=5, points=30)
    depth = (case.poses.rotation @ case.xyz.T + case.poses.translation[:, :, None])[:, 2]
    near, far = 0.9 * depth.min(), 1.1 * depth.max()
    behind = case.xyz - [0.0, 0.0, 3 * far]
    about, elsewhere = ((near, far), (3 * far, 4 * far)) if what == "depth_range" else (case.xyz[::7], behind)
    free = associate(case.detections, case.camera, case.poses)
    found = associate(case.detections, case.camera, case.poses, **{what: about})
    assert len(found) == len(free) > 20
    sets = [np.sort(a.xyz.round(6), axis=0) for a in (found, free)]  # in the order of their evidence, which is others'
    np.testing.assert_allclose(*sets, atol=1e-4)
    assert len(associate(case.detections, case.camera, case.poses, **{what: elsewhere})) == 0


def test_every_spot_has_an_answer():
    case = scenes.make(34, "plate", "cloud", views=6, points=40, false=0.3)
    result = associate(case.detections, case.camera, case.poses)
    assert {str(w) for each in result.why for w in each} <= set(WHY)
    for v, why in enumerate(result.why):
        linked = np.zeros(len(why), bool)
        linked[result.tracks.detection[result.tracks.view == v]] = True
        np.testing.assert_array_equal(linked, why == "")
    np.testing.assert_array_equal(result.views, np.bincount(result.observations.point))


def test_chance_gives_no_point():
    """Pictures of nothing but false spots."""
    rng = np.random.default_rng(0)
    poses = scenes.make(35, "plate", "cloud", views=8).poses
    size = np.array(scenes.CAMERA.size_px)
    spots = [Detections.make(rng.uniform(0, size - 1, (60, 2))) for _ in range(8)]
    result = associate(spots, scenes.CAMERA, poses)
    assert len(result) == 0
    assert len(result.observations) == 0


def test_order_does_not_matter():
    """Pictures and spots in another order give the same tracks."""
    case = scenes.make(36, "model", "cloud", views=7, points=40)
    result = associate(case.detections, case.camera, case.poses)
    rng = np.random.default_rng(1)
    views = rng.permutation(7)
    spots = [rng.permutation(len(d)) for d in case.detections]
    other = associate(
        [case.detections[v].take(spots[v]) for v in views], case.camera,
        Pose(case.poses.rotation[views], case.poses.translation[views]),
    )  # fmt: skip

    def links(r, view, spot):
        sets = {}
        for t, v, s in zip(r.tracks.track, r.tracks.view, r.tracks.detection, strict=True):
            sets.setdefault(int(t), set()).add((int(view(v)), int(spot(v, s))))
        return {frozenset(s) for s in sets.values()}

    assert links(result, lambda v: v, lambda v, s: s) == links(
        other, lambda v: views[v], lambda v, s: spots[views[v]][s]
    )


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"min_views": 2}, r"min_views must be 3 \.\.\. 4, got 2"), ({"min_views": 5}, r"min_views .* got 5"),
        ({"max_nfa": 0.0}, "max_nfa must be > 0, got 0.0"), ({"max_nfa": np.nan}, "max_nfa"),
        ({"model_px": np.nan}, "model_px"), ({"depth_range": (1.0, 1.0)}, "depth_range"),
        ({"depth_range": (0.0, 1.0)}, "depth_range"), ({"pose_cov": np.full((6, 6), np.inf)}, "pose_cov"),
        ({"model_px": -1.0}, "model_px"), ({"depth_range": (2.0, 1.0)}, "depth_range"),
        ({"points_near": np.zeros((2, 2))}, "points_near"), ({"pose_cov": np.eye(5)}, "pose_cov"),
        ({"depth_range": (1.0, 2.0), "points_near": np.zeros((1, 3))}, "not both"),
    ],
)  # fmt: skip
def test_bad_options(options, word):
    case = scenes.make(37, views=4, points=10)
    with pytest.raises(ValueError, match=word):
        associate(case.detections, case.camera, case.poses, **options)


def test_bounds_that_may_be_reached():
    case = scenes.make(37, views=4, points=10)
    few = associate(case.detections, case.camera, case.poses, min_views=4, model_px=0.0, max_nfa=1.0)
    assert len(few) > 0
    assert (few.views == 4).all()


def test_bad_numbers():
    case = scenes.make(37, views=4, points=10)
    with pytest.raises(ValueError, match="one per view"):
        associate(case.detections, [case.camera] * 3, case.poses)
    with pytest.raises(ValueError, match="poses must be 3"):
        associate(case.detections[:3], case.camera, case.poses)
    with pytest.raises(ValueError, match="match_known_pair"):
        associate(case.detections[:2], case.camera, Pose(case.poses.rotation[:2], case.poses.translation[:2]))
