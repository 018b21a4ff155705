"""What is kept of a frame: which spots are doubtful."""

from types import SimpleNamespace

import numpy as np

from windmark.pipeline.deform import DeformedFrame
from windmark.pipeline.deform.record import DOUBTFUL, doubtful
from windmark.scene import Observations


def test_doubtful_spots_are_named_by_camera_and_marker():
    sigma = np.full(12, 0.01)
    sigma[[2, 5, 9]] = 0.01 * np.array([1.1, 0.9, 1.1]) * DOUBTFUL
    seen = Observations(
        np.repeat([0, 1], 6), np.tile(np.arange(6), 2), np.zeros((12, 2)), sigma[:, None, None] ** 2 * np.eye(2)
    )
    names = np.array([f"m{k}" for k in range(6)])
    used = np.ones(12, bool)
    frame = DeformedFrame(0, "0", 0.0, "tracked", "", SimpleNamespace(used=used), seen, ("left", "right"))
    assert doubtful(frame, names) == ("left/m2", "right/m3")
    used[2] = False  # an outlier is counted as such
    assert doubtful(frame, names) == ("right/m3",)
    assert doubtful(DeformedFrame(1, "1", 1.0, "lost", "dark", None), names) == ()
