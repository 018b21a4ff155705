"""The kernels against slow twins written with matrices, sets and loops."""

import epipolar_twins
import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar._kernels.choose import choose
from windmark.epipolar._kernels.grow import REPEATS
from windmark.epipolar.search import all_pairs, candidates, first_pairs, grown
from windmark.epipolar.views import ideal_spots, raster, stations

KINDS = {"params": [("plate", "walk", 0.02), ("model", "cloud", 0.2)], "ids": ["plate", "model"]}


@pytest.fixture(scope="module", **KINDS)
def scene(request):
    return made(*request.param, 25)


@pytest.fixture(scope="module", **KINDS)
def small(request):
    """For twins that look at every pair of spots."""
    return made(*request.param, 16)


def made(model, path, angle, points):
    case = scenes.make(41, model, path, views=5, points=points, false=0.3)
    poses, cov = case.perturbed(3, angle, 10 * angle)
    cameras = [case.camera] * 5
    xy, noise = ideal_spots(case.detections, cameras)
    count = np.array([len(d) for d in case.detections])
    free = np.random.default_rng(0).random(len(xy)) < 0.9
    stand, depth = stations(cameras, poses, cov, None, None)
    return stand, raster(xy, noise, count, free), free, depth


@pytest.mark.slow
def test_pairs(small):
    stand, spots, free, depth = small
    found, gain = candidates(stand, spots, free, all_pairs(5), 3.7, depth)
    expected = epipolar_twins.pairs(stand, spots, free, 3.7, depth)
    assert {(int(a), int(b)) for a, b in found} == set(expected)
    np.testing.assert_allclose(gain, [expected[int(a), int(b)] for a, b in found], rtol=0, atol=1e-4)


@pytest.mark.parametrize("patience", [1, 9])
def test_growing(scene, patience):
    stand, spots, free, depth = scene
    found, _ = candidates(stand, spots, free, all_pairs(5), 3.7, depth)
    rows, xyz, cov, gain = grown(stand, spots, free, found, 3.7, patience)
    many, given_up, double = 0, 0, 0
    for n in range(0, len(found), 7):
        row, x, c, g = epipolar_twins.grow(stand, spots, free, found[n], 3.7, patience)
        s, t = found[n]
        its = [h for h in range(n) if np.isfinite(gain[h]) and {s, t} <= set(rows[h])]
        if len(its) >= REPEATS and not np.isfinite(gain[n]):
            double += 1  # it was the same point as one of these, or could not be it
            assert not np.isfinite(g) or any((rows[h] == row).all() for h in its) or g < max(gain[h] for h in its)
            continue
        np.testing.assert_array_equal(rows[n], row)
        assert gain[n] == pytest.approx(g, rel=1e-6, abs=1e-6)
        if np.isfinite(g):
            np.testing.assert_allclose(xyz[n], x, rtol=1e-7, atol=1e-6)
            np.testing.assert_allclose(cov[n], c, rtol=1e-5, atol=1e-9 * np.abs(c).max())
            many += (row >= 0).sum() > 2
        given_up += not np.isfinite(g)
    assert many > 5
    assert double > 5
    assert (given_up > 0) == (patience < 5)


def test_choice():
    """Random hypotheses with many spots in common and near ties."""
    rng = np.random.default_rng(5)
    for _ in range(30):
        rows = np.where(rng.random((40, 4)) < 0.7, rng.integers(0, 6, (40, 4)) + 6 * np.arange(4), -1)
        score = rng.uniform(0, 40, 40)
        owner, verdict = np.full(24, -1), np.zeros(40, dtype=np.int64)
        choose(rows, score, np.argsort(-score), 10.0, 4.0, owner, verdict)
        expected_owner, expected = epipolar_twins.choose(rows, score, 10.0, 4.0, 24)
        np.testing.assert_array_equal(verdict, expected)
        np.testing.assert_array_equal(owner, expected_owner)


def test_every_pair_once():
    case = scenes.make(42, views=9, points=10)
    stand, _ = stations([case.camera] * 9, case.poses, np.zeros((9, 6, 6)), None, None)
    few, every = first_pairs(stand), all_pairs(9)
    assert len(np.unique(few, axis=0)) == len(few) < len(every) == 36
    assert (few[:, 0] < few[:, 1]).all()
    assert set(few.ravel()) == set(range(9))
