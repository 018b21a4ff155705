"""How far spots are from two-view geometry: in units of what their noise makes of it."""

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark.epipolar.band import distance
from windmark.geometry import Pose
from windmark.geometry.two_view import estimate_two_view
from windmark.scene import Detections

NOISE = 0.2


@pytest.mark.parametrize("turned", [True, False])
def test_distances_in_sigmas_are_those_of_the_noise(turned):
    """To a place they have two degrees of freedom, so the mean of their squares is 2; to a line it is 1."""
    rng = np.random.default_rng(5)
    xyz = rng.uniform(-300, 300, (900, 3)) * [1, 0.7, 0.5] + [0, 0, 1400]
    b_from_a = Pose.from_rotvec([0.02, 0.06, 0.1], np.zeros(3) if turned else np.array([220.0, 30.0, 0.0]))
    xy = [scenes.CAMERA.project(pose.apply(xyz))[0] for pose in (Pose.from_rotvec(np.zeros(3), np.zeros(3)), b_from_a)]
    a, b = (Detections.make(p + rng.normal(0, NOISE, p.shape), sigma_px=NOISE) for p in xy)
    view = estimate_two_view(a.xy, b.xy, scenes.CAMERA, scenes.CAMERA, cov_a=a.cov, cov_b=b.cov)
    assert (view.b_from_a is None) == turned
    px, sigmas = distance(a, b, scenes.CAMERA, scenes.CAMERA, view)
    freedom = 2 if turned else 1
    assert np.mean(sigmas**2) == pytest.approx(freedom, rel=0.15)
    if turned:
        assert np.mean(px**2) == pytest.approx(2 * 2 * NOISE**2, rel=0.15)
