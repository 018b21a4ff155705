"""Corrections of the table from wind-off frames: the normal equations of all of them, and how sure the places are."""

import numpy as np
import pytest

import windmark as wm

CAMERA = wm.Camera((640, 480), 800.0)
POSES = [wm.Pose.look_at(eye, [40, 200, 0], [0, 1, 0]) for eye in ([300, 200, 700], [-300, 150, 650])]


@wm.law(tip={"unit": "mm", "sigma": 20.0})
def bend(xyz, tip):
    return xyz + np.outer((xyz[:, 1] / 400.0) ** 2, [0.0, 0.0, tip])


def frames(sigma, off, noises, seed=0):
    """Wind-off frames of one wing seen by one camera each."""
    rng = np.random.default_rng(seed)
    x, y = (v.ravel() for v in np.meshgrid([0.0, 40.0, 80.0], np.linspace(50.0, 400.0, 8)))
    markers = wm.MarkerSet.make([f"m{i}" for i in range(24)], np.c_[x, y, 0 * x], sigma=sigma, volume="wing")
    out = []
    for k, noise in enumerate(noises):
        pose = POSES[k % 2]
        xy = CAMERA.project(pose.apply(markers.xyz + off))[0] + rng.normal(0, noise, (24, 2))
        seen = wm.Observations(np.zeros(24, int), np.arange(24), xy, np.tile(noise**2 * np.eye(2), (24, 1, 1)))
        views = [wm.View("cam1", cam_from_model=pose)]
        state = wm.identify(seen, markers, [wm.Volume("wing", bend)], CAMERA, views, free_motion=False)
        assert state, state.reason
        out.append((state, seen, views))
    return markers, *zip(*out, strict=True)


def precision_of(states, observations, views, markers):
    """Sum of J^T W J, and what the residuals pull, by differences of the projection; lengths of J, too."""
    precision, pull, scale = np.zeros((24, 3, 3)), np.zeros((24, 3)), []
    for state, seen, (view,) in zip(states, observations, views, strict=True):
        own = np.flatnonzero(state.used)
        pose = state.cam_from_tunnel[view.name] @ state.tunnel_from_model
        place = state.volumes.bind(markers.xyz, markers.volume).place(state.q)
        h = 1e-3
        j = np.stack([(CAMERA.project(pose.apply(place + d))[0] - CAMERA.project(pose.apply(place - d))[0]) / (2 * h)
                      for d in h * np.eye(3)], axis=2)  # fmt: skip
        for n in own:
            w = np.linalg.inv(seen.cov[n])
            precision[seen.point[n]] += j[n].T @ w @ j[n]
            pull[seen.point[n]] -= j[n].T @ w @ state.residuals_px[n]
            scale.append(np.sqrt((j[n] ** 2).sum() / 2))
    return precision, pull, np.array(scale)


def test_places_and_covariance_are_those_of_all_frames_and_the_table():
    off = np.random.default_rng(4).normal(0.0, 0.5, (24, 3))
    markers, states, observations, views = frames(0.5, off, (0.1, 0.2, 0.1))
    got = wm.zero_markers(states, observations, views, markers)
    precision, pull, _ = precision_of(states, observations, views, markers)
    cov = np.linalg.inv(precision + np.eye(3) / 0.5**2)
    np.testing.assert_allclose(got.cov, cov, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(got.shift, np.einsum("nij,nj->ni", cov, pull), atol=1e-6)
    np.testing.assert_allclose(got.markers.xyz, markers.xyz + got.shift)
    np.testing.assert_allclose(got.markers.sigma, np.sqrt(np.diagonal(cov, axis1=1, axis2=2)), rtol=1e-5)
    assert got.seen.all()
    # Two cameras tell all three coordinates: the rest is within its sigma, and no less.
    rest = off - got.shift
    rest -= rest.mean(axis=0)  # where the wing is and how it is bent is the frames' own
    assert np.sqrt(np.mean(rest[:, :2] ** 2)) < 0.3


def test_where_the_table_says_no_sigma_the_residuals_do():
    """The root mean square of all frames' residuals, in the lengths of the model."""
    off = np.random.default_rng(6).normal(0.0, 0.6, (24, 3))
    markers, states, observations, views = frames(np.nan, off, (0.1, 0.4))
    assert len({round(s.rms_px, 3) for s in states}) == 2
    got = wm.zero_markers(states, observations, views, markers)
    precision, _, scale = precision_of(states, observations, views, markers)
    rms = np.sqrt(np.mean([max(s.rms_px, 0.1) ** 2 for s in states]))
    cov = np.linalg.inv(precision + np.eye(3) * (np.median(scale) / rms) ** 2)
    np.testing.assert_allclose(got.cov, cov, rtol=1e-4, atol=1e-9)


def test_as_many_of_each_and_at_least_one():
    markers, states, observations, views = frames(0.5, np.zeros((24, 3)), (0.1, 0.1))
    for wrong in ((states[:1], observations, views), (states, observations, views[:1]), ((), (), ())):
        with pytest.raises(ValueError, match="as many states, observations and views, at least one"):
            wm.zero_markers(*wrong, markers)
