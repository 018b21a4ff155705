"""Where markers are expected: ellipses from camera and pose, or from a frame before."""

import numpy as np
import pytest

from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.scene import Detections, MarkerSet
from windmark.tasks.predictions import COLOUR_FRAMES, Predictions, from_camera, from_detections, look_again

CAMERA = Camera((400, 300), 500.0, k1=-0.1)
POSE = Pose(np.eye(3), np.array([0.0, 0.0, 50.0]))


def markers(**columns):
    return MarkerSet.make(
        ["a", "away", "round", "outside", "behind"],
        [[2, 1, 0], [0, 0, 0], [-3, 2, 1], [60, 0, 0], [0, 0, -80.0]],
        normal=[[0.5, 0, -0.8660254], [0, 0, 1], [np.nan] * 3, [0, 0, -1], [0, 0, -1]],
        **columns,
    )


def test_ellipses_of_those_that_face_the_camera():
    known = markers(radius=np.full(5, 0.4))
    got = from_camera(CAMERA, POSE, known)
    assert got.name == ("a", "round")
    exact = imaged_ellipse(CAMERA, POSE.apply(known.xyz[:1]), known.normal[:1], 0.4)
    np.testing.assert_allclose(got.xy[0], exact.xy[0])
    np.testing.assert_allclose(got.axes_px[0], exact.axes_px[0])
    assert got.axes_px[1, 1] / got.axes_px[1, 0] > 0.98
    np.testing.assert_allclose(got.eccentricity_px, [exact.eccentricity_px[0], [0, 0]])
    assert np.abs(got.eccentricity_px[0]).max() > 1e-3
    assert (got.take(np.array([1])).eccentricity_px == 0).all()


def test_without_a_radius_discs_are_round_and_as_given():
    got = from_camera(CAMERA, POSE, markers(), 3.5)
    np.testing.assert_allclose(got.axes_px, 3.5)
    with pytest.raises(ValueError, match="no radius"):
        from_camera(CAMERA, POSE, markers())


def test_from_a_frame_before():
    spots = Detections.make(
        [[10, 20], [30, 40.0]], radius_px=[3.0, 4.0], axes_px=[[3.5, 2.5], [np.nan, np.nan]], angle=[0.3, np.nan]
    )
    got = from_detections(spots, ["a", ""])
    np.testing.assert_allclose(got.axes_px, [[3.5, 2.5], [4.0, 4.0]])
    np.testing.assert_allclose(got.angle, [0.3, 0.0])
    bare = Detections.make([[10, 20.0]])
    np.testing.assert_allclose(from_detections(bare, [""], 2.0).axes_px, 2.0)
    with pytest.raises(ValueError, match="neither"):
        from_detections(bare, [""])


def test_what_one_image_tells_the_next():
    """Colours are kept by marker for some frames, also of one that is hidden for a frame, and then found anew."""
    rng = np.random.default_rng(5)
    xy = 25.0 + 40.0 * np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2)
    y, x = np.mgrid[:210, :210]
    paint = np.kron(rng.normal(0, 4.0, (70, 70)), np.ones((3, 3)))  # coarse grain: neighbours have the same noise
    clean = 180.0 + paint
    for cx, cy in xy:
        clean -= 50.0 * (1.0 - np.tanh(2.0 * (np.hypot(x - cx, y - cy) - 4.0)))
    expected = Predictions(("",) * 25, np.arange(25), xy, np.full((25, 2), 4.0), np.zeros(25))
    known, ages, colours = None, [], []
    for k in range(COLOUR_FRAMES + 2):
        image = clean + rng.normal(0, 0.5, clean.shape)
        seen = np.arange(25) if k != 3 else np.arange(1, 25)
        found, known = look_again(image, expected.take(seen), 30 - seen, 31, known, search_px=1.0, reshape=False)
        assert found.found.mean() > 0.8
        ages.append(known.age)
        colours.append(known.colour)
    assert not known.frame.noise.is_white
    assert ages == [*range(COLOUR_FRAMES), 0, 1]
    assert np.isnan(known.colour[:6]).all()
    kept = np.isfinite(colours[0][:, 0, 0])
    np.testing.assert_allclose(colours[COLOUR_FRAMES - 1][kept], colours[0][kept], rtol=1e-9, atol=1e-12)
    both = kept & np.isfinite(known.colour[:, 0, 0])
    assert not np.array_equal(known.colour[both], colours[0][both])
    np.testing.assert_allclose(known.colour[both][:, [0, 1], [0, 1]], colours[0][both][:, [0, 1], [0, 1]], rtol=0.2)
