"""The paper's point of view: names, canonical angles, singular ones, standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from windmark.geometry import Pose, PoV

RIGHT = (-270, -180, -90, 0, 90, 180, 270, 360)


@given(rx=st.sampled_from(RIGHT), ry=st.sampled_from(RIGHT), rz=st.sampled_from(RIGHT))
def test_singular_angles_keep_the_pose(rx, ry, rz):
    pov = PoV(rx, ry, rz, 1.0, 2.0, 3.0, 20.0)
    again = pov.canonical
    np.testing.assert_allclose(again.pose.rotation, pov.pose.rotation, atol=1e-15)
    assert -90 <= again.ry_deg <= 90
    assert max(abs(again.rx_deg), abs(again.rz_deg)) <= 180
    assert again.singular == (ry % 180 == 90)
    assert again.fov_deg == 20.0


@pytest.mark.parametrize("fov", [0, 180, -5, float("nan"), 200])
def test_no_field_of_view(fov):
    with pytest.raises(ValueError, match="fov_deg must be between 0 and 180"):
        PoV(0, 0, 0, 0, 0, 1, fov).focal_px(100)


@pytest.mark.parametrize("angles", [(10, 20, 30), (-150, 80, 170), (0, 0, 0), (90, -45, 180), (0, 89.9, 5)])
def test_sigmas_are_those_of_many_poses(angles):
    rng = np.random.default_rng(1)
    a = rng.normal(size=(6, 6))
    cov = a @ a.T * np.outer(*[[1e-6] * 3 + [1e-3] * 3] * 2) * 1e4
    if angles[1] > 85:
        cov *= 1e-6
    pose = PoV(*angles, 30.0, -20.0, 900.0).pose
    draws = rng.multivariate_normal(np.zeros(6), cov, size=4000)
    seen = np.array([list(vars((Pose.exp(d) @ pose).to_pov()).values())[:6] for d in draws])
    centre = np.array(list(vars(pose.to_pov()).values())[:6])
    off = seen - centre
    off[:, :3] = (off[:, :3] + 180) % 360 - 180
    sigma = pose.pov_sigma(cov)
    np.testing.assert_allclose(off.std(axis=0), list(vars(sigma).values())[:6], rtol=0.05)


def test_sigma_at_the_singular_angle_and_of_the_field_of_view():
    pose = PoV(20, 90, 30, 0, 0, 500).pose
    sigma = pose.pov_sigma(np.eye(6) * 1e-8, 1000.0, 800, 2.0)
    assert np.isinf([sigma.rx_deg, sigma.rz_deg]).all()
    assert sigma.ry_deg == pytest.approx(np.degrees(1e-4))
    step = PoV(0, 0, 0, 0, 0, 1, pose.to_pov(1002.0, 800).fov_deg).fov_deg - pose.to_pov(1000.0, 800).fov_deg
    assert sigma.fov_deg == pytest.approx(abs(step), rel=3e-3)
    assert np.isnan(pose.pov_sigma(np.eye(6)).fov_deg)
    with pytest.raises(ValueError, match=r"cov \(6, 6\)"):
        pose.pov_sigma(np.eye(7))
