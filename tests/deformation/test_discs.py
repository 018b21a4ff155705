"""Discs of another size than the table's: a pose that is off by them is within its sigma, or they are found out."""

from dataclasses import replace

import numpy as np
import pytest
from imaged_discs import centres

from windmark.deformation import identify
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View
from windmark.scene.units import CommonRatio
from windmark.tasks.deform.zero import Zero, discs_of, since_wind_off

RADIUS, NOISE = 6.0, 0.02
CAMERA = Camera((640, 480), 600.0)
X, Y = (v.ravel() for v in np.meshgrid(np.linspace(-90.0, 90.0, 6), np.linspace(-60.0, 60.0, 4)))
XYZ = np.c_[X, Y, 25.0 * np.cos(X / 50.0)]
NORMAL = np.tile([0.0, 0.0, -1.0], (24, 1))


def views(*degrees):
    eyes = (-320.0 * np.array([np.sin(a), 0.0, np.cos(a)]) for a in np.radians(degrees))
    return [View(f"cam{k}", f"cam{k}", "0", Pose.look_at(eye, [0, 0, 0], [0, -1, 0])) for k, eye in enumerate(eyes)]


def seen(sides, motion=None, seed=0):
    motion, rng, n = motion or Pose.identity(), np.random.default_rng(seed), len(XYZ)
    xy = [centres(CAMERA, v.cam_from_model, motion.apply(XYZ), motion.rotate(NORMAL), RADIUS)[0] for v in sides]
    xy = np.concatenate(xy) + NOISE * rng.standard_normal((n * len(sides), 2))
    return Observations(np.repeat(np.arange(len(sides)), n), np.tile(np.arange(n), len(sides)), xy,
                        np.tile(NOISE**2 * np.eye(2), (len(xy), 1, 1)))  # fmt: skip


def found(sides, ratio, size, motion=None, seed=0):
    """The state by a table whose radii are ``ratio`` times too large, where they are known to be of a ``size``."""
    table = MarkerSet.make([f"m{k}" for k in range(24)], XYZ, radius=RADIUS * ratio, normal=NORMAL, length_unit="mm")
    known = None if size is None else CommonRatio(size, 0.02)
    return identify(seen(sides, motion, seed), table, [], {v.name: CAMERA for v in sides}, sides, disc_size=known)


def off(state, true=None):
    """(6,) and its covariance (6, 6): the motion's error."""
    own = state.slices["motion"]
    return (state.tunnel_from_model @ (true or Pose.identity()).inverse()).log(), state.cov[own, own]


def chi2(state, true=None):
    error, cov = off(state, true)
    return error @ np.linalg.solve(cov, error)


def test_one_camera_has_in_its_sigmas_what_radii_change_that_no_residual_tells():
    sides, many = views(40.0), range(12)
    bare = [chi2(found(sides, 1.25, None, seed=k)) for k in many]
    assert min(bare) > 100.0  # 4 sigmas of each of six, and nothing else says so
    states = [found(sides, 1.25, 1 / 1.25, seed=k) for k in many]
    # Six of noise and one that is the radii's, of which the sigma is the size.
    assert 4.0 < np.mean([chi2(s) for s in states]) < 10.0
    assert all(s.unchecked[0].words.startswith("the table's radii are 1.2 times too large") for s in states)
    assert not any(s.doubts for s in states)


def test_two_cameras_tell_the_size_of_the_discs_and_the_table_is_doubted():
    """What the radii left over was taken for a stretch of the model, or a camera that moved."""
    sides = views(-35.0, 35.0)
    for seed in range(4):
        state = found(sides, 1.5, 1 / 1.5, seed=seed)
        (doubt,) = state.doubts
        assert "the table's radii are 1.5 times too large" in str(doubt)
        own = replace(state, cov=state.cov_of_own_discs)
        assert 0.5 < chi2(own) < 20.0  # of six: as right as with the right table
        assert np.allclose(own.cov, found(sides, 1.0, None, seed=seed).cov, rtol=0.05, atol=1e-12)
        assert chi2(state) < chi2(own)


@pytest.mark.parametrize("ratio", [0.98, 1.02])
def test_discs_as_large_as_the_table_says_are_not_spoken_of(ratio):
    sides = views(-35.0, 35.0)
    state, bare = found(sides, 1.0, ratio), found(sides, 1.0, None)
    assert not state.doubts
    assert not state.unchecked
    assert np.array_equal(state.tunnel_from_model.log(), bare.tunnel_from_model.log())
    assert state.q.size == 0
    assert (np.diag(state.cov) >= np.diag(bare.cov)).all()


def test_a_difference_from_wind_off_has_of_other_discs_what_the_motion_between_changes():
    sides, moved = views(40.0), Pose.from_rotvec(np.radians([0.0, 2.0, 1.0]), [4.0, -2.0, 1.0])
    still, state = found(sides, 1.25, 1 / 1.25), found(sides, 1.25, 1 / 1.25, moved, seed=1)
    first = discs_of([still])
    relative = since_wind_off(state, first, "mm")
    absolute, bare = (np.sqrt(np.diag(c)) for c in (state.cov, state.cov_of_own_discs))
    left = np.sqrt(np.diag(relative.cov))
    assert (absolute > 1.5 * bare).sum() == 2
    assert (left < 1.5 * bare).all()
    assert (left >= bare * (1 - 1e-9)).all()
    assert state.unchecked
    assert not relative.unchecked
    # The error of the difference, which has the still one's noise, too.
    error = off(relative, moved)[0] - off(still)[0]
    assert (np.abs(error) < 4.5 * np.hypot(left, bare)).all()
    zero = Zero.of([still], None, MarkerSet.make([f"m{k}" for k in range(24)], XYZ), share=0.0)
    assert np.allclose(np.sqrt(np.diag(zero.more)), bare, rtol=0.2)
