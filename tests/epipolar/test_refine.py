"""One adjustment of poses and points: who takes part, what stays, and how sure the poses are among themselves."""

from dataclasses import replace

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar.refine import LEAST, refine_poses
from windmark.scene import Observations


def marked(seed, *, views=5, points=30, noise=0.1):
    """All true spots of a case, the points where they are."""
    case = scenes.make(seed, "plate", "cloud", views=views, points=points, false=0.0, missing=0.0, noise=noise)
    view = np.repeat(np.arange(views), [len(label) for label in case.labels])
    xy = np.concatenate([d.xy for d in case.detections])
    return case, Observations(view, np.concatenate(case.labels), xy, np.tile(noise**2 * np.eye(2), (len(xy), 1, 1)))


def some(observations, kept):
    return Observations(*(getattr(observations, n)[kept] for n in ("view", "point", "xy", "cov")))


def refined(case, observations, seed=1):
    poses, cov = case.perturbed(seed, angle_deg=0.05, shift=0.5)
    return poses, cov, refine_poses((case.camera,) * len(cov), poses, cov, case.xyz, observations)


@pytest.mark.parametrize(("count", "moves"), [(LEAST - 1, False), (LEAST, True)])
def test_a_view_needs_six_points_for_a_new_pose(count, moves):
    case, observations = marked(3)
    last = np.flatnonzero(observations.view == 4)
    kept = np.ones(len(observations), bool)
    kept[last[count:]] = False
    poses, cov, found = refined(case, some(observations, kept))
    assert found.moved.tolist() == [True] * 4 + [moves]
    assert (found.pose_cov[4] == cov[4]).all() != moves
    assert (found.poses.translation[4] == poses.translation[4]).all() != moves
    assert (found.poses.translation[:4] != poses.translation[:4]).any(axis=1).all()


@pytest.mark.parametrize(("share", "moves"), [(0.25, True), (0.55, False)])
def test_a_view_whose_spots_contradict_the_others_keeps_its_pose(share, moves):
    case, observations = marked(4)
    xy, own = observations.xy.copy(), np.flatnonzero(observations.view == 2)
    wrong = np.random.default_rng(2).permutation(own)[: round(share * len(own))]
    xy[wrong] += np.random.default_rng(3).choice([-40, -20, 20, 40], (len(wrong), 2))
    poses, cov, found = refined(case, Observations(observations.view, observations.point, xy, observations.cov))
    assert found.moved[2] == moves
    assert found.moved[[0, 1, 3, 4]].all()
    assert (found.pose_cov[2] == cov[2]).all() != moves
    assert (found.poses.rotation[2] == poses.rotation[2]).all() != moves


def test_too_little_is_no_answer():
    case, observations = marked(5, views=3)
    one = observations.view == 0
    assert refined(case, some(observations, one))[2] is None
    alone = one | ((observations.view == 1) & (np.cumsum(observations.view == 1) < LEAST))
    assert refined(case, some(observations, alone))[2] is None
    point = np.isin(observations.point, np.unique(observations.point)[: LEAST + 2])
    assert refined(case, some(observations, point))[2] is not None


@pytest.mark.parametrize("louder", [1.0, 2.0])
def test_poses_differ_from_the_truth_among_themselves_as_their_covariance_says(louder):
    """Also where the noise is more than stated. 100 poses know a mean square of six numbers to 6 %."""
    ratio = []
    for seed in range(20):
        case, observations = marked(100 + seed, noise=0.1 * louder)
        found = refined(case, replace(observations, cov=observations.cov / louder**2), seed)[2]
        # The frame is that of the points: these began at the truth, so the poses would be the truth's.
        delta = (found.poses @ case.poses.inverse()).log()
        ratio += [delta[v] @ np.linalg.solve(found.pose_cov[v], delta[v]) / 6 for v in range(5)]
    assert 0.7 < np.mean(ratio) < 1.25
