"""Framed views hold all points, tightly, whatever the direction and the field of view."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from windmark.pipeline.views import MARGIN, frame_view, units_per_px


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), fov=st.floats(0.5, 120), width=st.integers(50, 2000), height=st.integers(50, 2000))
def test_all_points_are_inside_and_one_border_is_reached(seed, fov, width, height):
    rng = np.random.default_rng(seed)
    xyz = rng.normal(size=(40, 3)) * rng.uniform(0.1, 10, 3) + rng.normal(size=3) * 50
    direction, up = rng.normal(size=(2, 3))
    camera, pose = frame_view(xyz, direction=direction, up=up, size_px=(width, height), fov_deg=fov)
    xy, valid = camera.project(pose.apply(xyz))
    assert valid.all()
    low = np.array([MARGIN * width, MARGIN * height]) - 0.5
    high = np.array([(1 - MARGIN) * width, (1 - MARGIN) * height]) - 0.5
    gap = np.concatenate([(xy - low).min(axis=0), (high - xy).min(axis=0)]) / max(width, height)
    assert gap.min() > -1e-6
    assert gap.min() < 2e-3 or fov > 60  # a near point may stop a wide camera from coming closer


def test_scale_of_a_narrow_view_is_the_scale_of_the_object():
    square = np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)])
    camera, pose = frame_view(square, direction=(0, 0, -1), up=(0, 1, 0), size_px=(1000, 1000), fov_deg=2)
    xy, _ = camera.project(pose.apply(square))
    assert np.ptp(xy[:, 0]) * units_per_px(camera, pose, square) == pytest.approx(2.0, rel=1e-9)
    assert xy[np.argmax(square[:, 1]), 1] < 500  # up is up


def test_nothing_to_frame_is_an_error():
    with pytest.raises(ValueError, match="no points"):
        frame_view(np.empty((0, 3)), direction=(0, 0, 1), up=(0, 1, 0), size_px=(10, 10))
    with pytest.raises(ValueError, match="parallel"):
        frame_view(np.zeros((1, 3)), direction=(0, 0, 1), up=(0, 0, 2), size_px=(10, 10))
