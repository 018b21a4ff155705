"""What the other pairs say of each: its error there, with a sigma that repetition shows, also where it is decisive."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import fundamental_by_others, pose_by_others, refine_fundamental, relative_pose_refine

CAMERA = Camera((1600, 1200), 1700.0, 1.0, 799.5, 599.5)
A = Pose.look_at(np.array([-150.0, 20.0, 900.0]), np.zeros(3), [0.0, 1.0, 0.0])
B = Pose.look_at(np.array([160.0, -90.0, 880.0]), np.zeros(3), [0.1, 1.0, 0.0])


def pairs(n, seed, noise):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-220, 220, (n, 3)) * [1, 0.8, 0.6]
    return [CAMERA.project(p.apply(xyz))[0] for p in (A, B)], rng, noise


def fundamental(a, b):
    fit = refine_fundamental(a, b, sigma_px=0.2)
    assert fit
    return fundamental_by_others(a, b, fit.matrix, sigma_px=0.2)


def pose(a, b):
    cov = 0.04 * np.eye(2)
    fit = relative_pose_refine(B @ A.inverse(), a, b, CAMERA, CAMERA, cov_a=cov, cov_b=cov)
    return pose_by_others(a, b, CAMERA, CAMERA, fit.b_from_a, cov_a=cov, cov_b=cov)


@pytest.mark.slow
@pytest.mark.parametrize("by_others", [fundamental, pose])
def test_the_sigma_is_what_repetition_shows(by_others):
    clean, rng, noise = pairs(13, 4, 0.2)
    sigmas = []
    for _ in range(3):
        said = by_others(*[p + rng.normal(0, noise, p.shape) for p in clean])
        sigmas.append(said.distance_px / said.sigma_px)
        assert (said.sigma_px > said.own_px).all()
        assert said.own_px == pytest.approx(noise, rel=1e-6)
    assert 0.7 < np.sqrt((np.array(sigmas) ** 2).mean()) < 1.3


@pytest.mark.parametrize("by_others", [fundamental, pose])
def test_an_error_shows_in_full_where_the_others_predict_it(by_others):
    clean, rng, noise = pairs(16, 6, 0.2)
    a, b = (p + rng.normal(0, noise, p.shape) for p in clean)
    said = by_others(a, b)
    best = int(said.sigma_px.argmin())
    moved = b.copy()
    moved[best] += [0.5, -0.5]  # small enough that F of all still agrees
    change = by_others(a, moved).distance_px[best] - said.distance_px[best]
    turned = b.copy()
    turned[best] += [0.5, 0.5]
    other = by_others(a, turned).distance_px[best] - said.distance_px[best]
    assert np.hypot(change, other) == pytest.approx(0.5, rel=0.15)  # a line's share of both: a Sampson distance is half


def test_where_the_others_determine_nothing_the_sigma_is_infinite():
    (a, b), _, _ = pairs(8, 1, 0.0)
    assert np.isinf(fundamental(a, b).sigma_px).all()
    (a, b), _, _ = pairs(5, 1, 0.0)
    assert np.isinf(pose_by_others(a, b, CAMERA, CAMERA, B @ A.inverse()).sigma_px).all()


def test_some_pairs_alone():
    (a, b), _, _ = pairs(12, 3, 0.0)
    every = pose_by_others(a, b + 0.1, CAMERA, CAMERA, B @ A.inverse())
    some = pose_by_others(a, b + 0.1, CAMERA, CAMERA, B @ A.inverse(), which=[7, 2])
    assert some.sigma_px == pytest.approx(every.sigma_px[[7, 2]])
    with pytest.raises(ValueError, match="positive definite"):
        pose_by_others(a, b, CAMERA, CAMERA, B @ A.inverse(), cov_a=-np.eye(2))
