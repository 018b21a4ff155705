"""What is kept of a frame: which spots are doubtful, and whether its laws explain it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from swept_scenes import BEAM, CAMERAS, MARKERS, PARTS, VIEWS, observed, seen

from windmark.deformation import Volume, identify
from windmark.deformation.laws import Powers
from windmark.pipeline.deform import DeformedFrame
from windmark.pipeline.deform.record import DOUBTFUL, doubtful, record
from windmark.scene import Observations


def test_doubtful_spots_are_named_by_camera_and_marker():
    sigma = np.full(12, 0.01)
    sigma[[2, 5, 9]] = 0.01 * np.array([1.1, 0.9, 1.1]) * DOUBTFUL
    spots = Observations(
        np.repeat([0, 1], 6), np.tile(np.arange(6), 2), np.zeros((12, 2)), sigma[:, None, None] ** 2 * np.eye(2)
    )
    names = np.array([f"m{k}" for k in range(6)])
    used = np.ones(12, bool)
    frame = DeformedFrame(0, "0", 0.0, "tracked", "", SimpleNamespace(used=used), spots, ("left", "right"))
    assert doubtful(frame, names) == ("left/m2", "right/m3")
    used[2] = False  # an outlier is counted as such
    assert doubtful(frame, names) == ("right/m3",)
    assert doubtful(DeformedFrame(1, "1", 1.0, "lost", "dark", None), names) == ()


def test_a_frame_that_its_laws_do_not_explain_is_a_misfit_and_says_why():
    """The same spots with a beam that cannot bend twice."""
    spots = observed(seen(), np.random.default_rng(3))
    simple = (Volume("wing", replace(BEAM, bend=Powers((2,))), parent="body"), Volume("body"))
    rows = []
    for laws in (PARTS, simple):
        state = identify(spots, MARKERS, laws, CAMERAS, VIEWS)
        frame = DeformedFrame(4, "4", 4.0, "tracked", "camera: dark", state, spots, ("v0", "v1"))
        rows.append(record(frame, None, None, MARKERS, np.zeros(3), 0.0, float("nan"), len(state.q)))
        np.testing.assert_allclose(rows[-1].q_sigma, [state.sigma[n] for n in state.volumes.names])
    right, wrong = rows
    assert (right.status, right.reason, right.warnings) == ("tracked", "camera: dark", ())
    assert wrong.status == "misfit"
    assert wrong.reason.startswith("camera: dark; law of wing too simple: what is left looks like bending of")
    assert wrong.suspect == ("wing",)
