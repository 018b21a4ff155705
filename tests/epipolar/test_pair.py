"""`match_pair`: pairs of spots without labels or poses, or an honest refusal."""

from types import SimpleNamespace

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar import NotMatched, match_pair
from windmark.epipolar.pair import _known, _refusal
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


KINDS = ("flat", "ridges", "stairs", "staggered", "wave")


def block(seed, kind):
    """Two views of a regular block of dots, some of them missing, the block perhaps larger than the pictures."""
    rng, camera = np.random.default_rng(seed), Camera((1024, 1024), 1800.0, cx=511.5, cy=511.5)
    i, j = (
        k.ravel().astype(float) for k in np.meshgrid(np.arange(rng.integers(8, 12)), np.arange(rng.integers(7, 11)))
    )
    height = {"ridges": np.abs(j % 8 - 4), "stairs": np.floor(j / 3), "wave": np.sin(i)}
    z = rng.uniform(0.3, 1.5) * height.get(kind, 0 * i)
    xyz = np.stack([i + 0.5 * (j % 2) * (kind == "staggered"), j, z], axis=1)
    xyz -= xyz.mean(axis=0)
    away = np.ptp(xyz, axis=0).max() * 1800 / 1024 / rng.choice([0.7, 1.0, 1.4])
    first, way, roll = rng.normal(0, 0.2, 2), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    spots = []
    for turn in (0.0, np.radians(rng.uniform(6, 22))):
        off = first + turn * np.array([np.cos(way), np.sin(way)])
        pose = Pose.look_at(
            away * np.array([*np.sin(off), 1.0]), np.zeros(3), np.array([np.sin(roll), np.cos(roll), 0])
        )
        xy, _ = camera.project(pose.apply(xyz))
        seen = rng.permutation(np.flatnonzero(camera.in_image(xy) & (rng.random(len(xyz)) > 0.04)))
        spots.append(Detections.make(xy[seen] + rng.normal(0, 0.1, (len(seen), 2)), sigma_px=0.1))
    return camera, spots


@pytest.mark.parametrize("kind", KINDS)
def test_a_regular_block_is_ambiguous_and_never_shifted(kind):
    """A shifted or turned matching of a block may well grow farther than the right one: none is taken."""
    camera, spots = block(1, kind)
    answer = match_pair(*spots, camera)
    assert not answer
    assert answer.cause == "ambiguous"
    assert "looks like itself" in answer.reason


@pytest.mark.parametrize("seed", range(2))
def test_rows_that_are_not_quite_regular_are_matched(seed):
    """Markers off their rows by a tenth of the pitch: no shifted matching goes far."""
    rng, camera = np.random.default_rng(seed), Camera((1024, 1024), 1800.0, cx=511.5, cy=511.5)
    xyz = np.stack([*(k.ravel().astype(float) for k in np.meshgrid(np.arange(8), np.arange(5))), np.zeros(40)], axis=1)
    xyz[:, :2] += rng.normal(-np.array([3.5, 2]), 0.1, (40, 2))
    spots = []
    for turn in (0.0, 0.15):
        pose = Pose.look_at(22 * np.array([np.sin(turn), 0.1, 1.0]), np.zeros(3), np.array([0.0, 1, 0]))
        xy = camera.project(pose.apply(xyz))[0] + rng.normal(0, 0.1, (40, 2))
        spots.append(Detections.make(xy, sigma_px=0.1))
    pair = match_pair(*spots, camera)
    assert pair, pair.reason
    assert len(pair) > 30
    assert (pair.a == pair.b).all()


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


def matching(pairs, nfa=-20.0, score=1.0, shift=0):
    """A matching of so many pairs, each with the partner ``shift`` places on."""
    match = np.where(np.arange(100) < pairs, np.arange(100) + shift, -1)
    out = SimpleNamespace(match=match, count=pairs, score=score, evidence=SimpleNamespace(log10_nfa=nfa))
    out.shared = lambda other: float((match[match >= 0] == other.match[match >= 0]).mean())
    return out


@pytest.mark.parametrize(
    ("others", "grown", "nfa", "cause"),
    [
        ([], 0, -6.0, None), ([], 0, -5.9, "weak"),
        ([matching(26, shift=1)], 0, -20.0, "ambiguous"), ([matching(25, shift=1)], 0, -20.0, None),
        ([matching(26, nfa=-6.0, shift=1)], 0, -20.0, None), ([matching(26, nfa=-6.1, shift=1)], 0, -20.0, "ambiguous"),
        ([matching(60)], 0, -20.0, None),  # the same pairs, some of them
        ([], 100, -20.0, None),  # a large matching is no piece that only grew
    ],
)  # fmt: skip
def test_a_matching_is_refused_for_chance_and_for_another_one_that_is_none(others, grown, nfa, cause):
    refusal = _refusal([matching(100, nfa), *others], grown, -6.0, 0.25)
    assert (refusal and refusal[0]) == cause
    if cause == "ambiguous":
        assert "two matchings, of 100 and 26 pairs" in refusal[1]


@pytest.mark.parametrize(
    ("count", "grown", "refused"), [(29, 22, True), (29, 21, False), (30, 30, False), (20, 15, False), (20, 16, True)]
)
def test_in_a_small_matching_a_piece_that_only_grew_is_a_rival(count, grown, refused):
    """Three quarters of the pairs of one with fewer than thirty."""
    assert bool(_refusal([matching(count)], grown, -6.0, 0.25)) == refused


@pytest.mark.parametrize(("kept", "known"), [(80, False), (81, True)])
def test_pairs_of_which_four_fifths_are_those_of_a_matching_are_known(kept, known):
    pairs = np.column_stack([np.arange(100), np.where(np.arange(100) < kept, np.arange(100), 99)])
    pairs[99] = 99, 98 if kept < 100 else 99
    assert _known(pairs, matching(100)) == known
