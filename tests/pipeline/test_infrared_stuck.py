"""Lines of a thermal camera that hang are no measurement: they are found at once, by their noise that stands still."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.infrared.stuck import stuck_lines, stuck_pixels, stuck_words
from windmark.tasks.deform.task import FrameImages, Station

SHAPE = (48, 64)


def picture(seed, noise=3.0):
    light = np.add.outer(np.linspace(0, 40, SHAPE[0]), np.linspace(0, 90, SHAPE[1])) + 2000
    return np.rint(np.random.default_rng(seed).normal(light, noise)).astype(np.uint16)


@pytest.mark.parametrize("noise", [0.5, 3.0])
def test_a_line_that_stands_while_the_others_go_on_hangs(noise):
    before, now = picture(1, noise), picture(2, noise)
    now[[7, 20]], now[:, 33] = before[[7, 20]], before[:, 33]
    rows, columns = stuck_lines(now, before)
    assert (np.flatnonzero(rows).tolist(), np.flatnonzero(columns).tolist()) == ([7, 20], [33])


def test_good_pictures_and_such_as_hardly_change_have_none():
    assert not any(m.any() for m in stuck_lines(picture(2), picture(1)))
    coarse = [(picture(k, 0.4) // 16).astype(np.uint16) for k in (1, 2)]  # most pixels are the same by accident
    assert (coarse[0] == coarse[1]).all(axis=1).any()
    assert not any(m.any() for m in stuck_lines(*coarse))
    assert not any(m.any() for m in stuck_lines(picture(2), picture(1)[:, :9]))


def test_the_frame_before_is_asked_and_lines_are_named_that_nodes_lie_on():
    test = SimpleNamespace(station=lambda name: Station(name, Camera(SHAPE[::-1], 90.0), Pose.identity()))
    first, second = picture(1), picture(2)
    second[10] = first[10]
    frames = [FrameImages("0", 0.0, {"a": first}), FrameImages("1", 1.0, {"a": second, "b": second})]
    run = SimpleNamespace(timeline=SimpleNamespace(frames=frames), deforming=SimpleNamespace(test=test))
    stuck = stuck_pixels(run, "a", 1, second)
    assert stuck[10].all()
    assert stuck.sum() == SHAPE[1]
    assert not stuck_pixels(run, "a", 0, first).any()
    assert not stuck_pixels(run, "b", 1, second).any()
    xy = np.array([[5.0, 10.2], [6.0, 11.0], [7.0, 9.8], [np.nan, np.nan], [8.0, 10.0]])
    (said,) = stuck_words("a", stuck, xy, np.array([True, True, True, True, False]))
    assert said.startswith("a: row 10 of its picture stand as in the frame before, bit by bit")
    assert stuck_words("a", stuck, xy[1:2], np.array([True])) == []
