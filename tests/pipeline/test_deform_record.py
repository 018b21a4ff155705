"""What is kept of a frame: which spots are doubtful, and whether its laws explain it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from swept_scenes import BEAM, CAMERAS, MARKERS, PARTS, VIEWS, VOLUMES, Q, observed, seen

from windmark.deformation import Volume, identify
from windmark.deformation.laws import Powers
from windmark.errors import plus_minus
from windmark.pipeline.deform import DeformedFrame
from windmark.pipeline.deform.record import DOUBTFUL, Zero, doubtful, record
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


def test_a_wind_off_zero_says_how_far_it_is_from_the_tables_shape():
    """A frame that had a load on it is no zero; a picture cannot tell, but the size of it can be read."""
    rng = np.random.default_rng(4)
    still, bent = (
        Zero.of([identify(observed(seen(q=q), rng), MARKERS, PARTS, CAMERAS, VIEWS) for _ in range(2)], None, MARKERS)
        for q in (0 * Q, Q)
    )
    size = np.linalg.norm(VOLUMES.bind(MARKERS.xyz, MARKERS.volume).place(Q) - MARKERS.xyz, axis=1)
    assert (bent.frames, bent.marker) == (2, MARKERS.name[size.argmax()])
    assert abs(bent.deformed - size.max()) < 4 * bent.deformed_sigma < 0.02 * size.max()
    assert still.deformed < 4 * still.deformed_sigma
    assert bent.words("mm").startswith(f"by the laws up to {plus_minus(bent.deformed, bent.deformed_sigma)} mm")
    assert "no other shape" in replace(still, deformed=2 * still.deformed_sigma).words("mm")
    assert "or a load" in replace(still, deformed=4 * still.deformed_sigma).words("mm")
