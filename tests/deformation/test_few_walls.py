"""Three markers on walls that alone hold cameras which move: one that was displaced, and what nothing tells of it."""

import numpy as np
import pytest
from swept_scenes import CAMERAS, MARKERS, PARTS, VIEWS, WALL, observed, seen

from windmark.deformation import identify
from windmark.geometry import Pose

MOTION = seen.__defaults__[1]
ON_WALL = np.flatnonzero(WALL)
KNOWN = {v.name: np.diag([3.5e-3**2] * 3 + [4.0] * 3) for v in VIEWS}


def found_with(walls, by=(0.0, 0.0, 0.0), seed=1, free=True, second=(0.0, 0.0, 0.0), **options):
    """A frame with these markers on walls, the first of them displaced by so many mm, and the second."""
    rng, xyz, keep = np.random.default_rng(seed), MARKERS.xyz.copy(), ON_WALL[walls]
    xyz[keep[:2]] += by, second
    poses = [Pose.exp(np.r_[rng.normal(0, 1e-3, 3), rng.normal(0, 1, 3)]) @ v.cam_from_model for v in VIEWS]
    truth = seen(xyz=xyz, poses=poses if free else None, wall=True)
    spots = observed(truth, rng, only=lambda t: np.isin(t.point, keep) | ~WALL[t.point])
    given = {"free_poses": True, "pose_cov": KNOWN} if free else {}
    found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, **given, **options)
    assert found, found.reason
    return found


def sigmas_off(found):
    """(6,) the motion's error in its sigmas."""
    error = (found.tunnel_from_model @ MOTION.inverse()).log()
    return np.abs(error / np.sqrt(np.diag(found.cov)[found.slices["motion"]]))


@pytest.mark.parametrize("seed", [1, 2])
def test_one_of_three_walls_that_was_displaced_is_named_with_those_that_may_be(seed):
    """One that was not was said to be, or a spot was left out: 12 to 20 sigmas off."""
    found = found_with([0, 1, 2], (0.5, 0.3, 0.4), seed)
    doubt = next(d for d in found.doubts if "hardly tell which" in d.words)
    assert MARKERS.name[ON_WALL[0]] in doubt.names
    assert doubt.cause == "marker"
    assert "3 markers on walls are all that holds them" in str(doubt)
    assert sigmas_off(found).max() < 3
    assert not [d for d in found.doubts if d.cause == "marker" and d is not doubt]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_small_displacement_that_the_triangle_alone_tells_is_in_the_sigmas(seed):
    found = found_with([3, 5, 7], (0.14, 0.1, 0.1), seed)
    assert any("hardly tell which" in d.words and len(d.names) > 1 for d in found.doubts)
    assert sigmas_off(found).max() < 3


def test_a_spot_that_was_left_out_while_its_marker_still_pulls_is_in_the_sigmas():
    """The other spot of the displaced marker turned the model, and nothing contradicted that: 10 sigmas."""
    for seed in (1, 2, 3):
        found = found_with([6, 9, 5], (0.3, -0.2, 0.0), seed)
        (doubt,) = (d for d in found.doubts if d.cause == "marker")
        assert doubt.names == (MARKERS.name[ON_WALL[6]],)
        assert "or one of its spots is something else's" in str(doubt)
        assert sigmas_off(found).max() < 3
        assert not found.unchecked  # that no sigma contains it is no longer so


def test_three_walls_in_order_are_said_not_to_check_each_other_and_nothing_else_changes():
    for seed in (1, 2):
        found = found_with([3, 5, 7], seed=seed)
        assert not found.doubts
        (said,) = (str(u) for u in found.unchecked)
        assert "would go unnoticed here, or which one" in said
        assert "a fourth would" in said
        assert all(str(MARKERS.name[n]) in said for n in ON_WALL[[3, 5, 7]])
        assert sigmas_off(found).max() < 4
    assert not found_with([3, 5, 7], free=False).unchecked  # cameras that stand still hold the tunnel themselves


@pytest.mark.parametrize("walls", [[0, 3, 6, 9], [1, 2, 4, 5, 8]])
def test_four_walls_and_more_name_the_one(walls):
    clean, found = found_with(walls), found_with(walls, (0.5, 0.3, 0.4))
    assert not clean.doubts
    assert not clean.unchecked
    (doubt,) = found.doubts
    assert doubt.names == (MARKERS.name[ON_WALL[walls[0]]],)
    assert "mm from where its table has it" in doubt.words
    assert sigmas_off(found).max() < 3


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("size", [0.4, 0.8])
@pytest.mark.parametrize("walls", [[3, 9, 0, 6], [2, 1, 4, 5, 8]])
def test_two_of_four_or_five_that_were_displaced_are_both_named_with_the_others_that_may_be(walls, size, seed):
    """One that was not was said to be, or a spot was left out: 10 to 19 sigmas off."""
    found = found_with(walls, (-0.6 * size, 0.4 * size, 0.7 * size), seed, second=(0.6 * size, 0.8 * size, 0.0))
    assert set(MARKERS.name[ON_WALL[walls[:2]]]) <= {n for d in found.doubts if d.cause == "marker" for n in d.names}
    assert sigmas_off(found).max() < 3
    if len(walls) == 4:
        (doubt,) = found.doubts
        assert "m60 and m63, or m63 and m69, are not where their table has them, and these pictures" in str(doubt)
        assert "4 markers on walls are all that holds them" in str(doubt)


@pytest.mark.parametrize("walls", [[0, 3, 6, 9], [1, 2, 4, 5, 8, 11]])
def test_a_gross_error_of_one_spot_of_a_wall_is_no_second_marker(walls):
    rng, keep = np.random.default_rng(3), ON_WALL[walls]
    spots = observed(seen(wall=True), rng, only=lambda t: np.isin(t.point, keep) | ~WALL[t.point])
    spots.xy[np.flatnonzero(spots.point == keep[0])[0]] += [3.0, -2.0]
    found = identify(spots, MARKERS, PARTS, CAMERAS, VIEWS, free_poses=True, pose_cov=KNOWN)
    assert (~found.used).sum() == 1
    assert not found.doubts
