"""Frames that are followed know discs as the first one does: their poses are as right as their sigmas say."""

import numpy as np
import pytest
from imaged_discs import centres

from windmark.geometry import Camera, Pose
from windmark.registration import track
from windmark.scene import Detections, MarkerSet

RADIUS, NOISE = 6.0, 0.02
CAMERA = Camera((640, 480), 600.0)
XYZ = np.random.default_rng(3).uniform([-110.0, -80.0, -15.0], [110.0, 80.0, 15.0], (24, 3))
NORMAL = np.tile([0.0, 0.0, -1.0], (24, 1))


def pose(k):
    a = np.radians(35.0 + 0.4 * k)
    eye = -320.0 * np.array([np.sin(a), 0.02 * k, np.cos(a)])
    return Pose.look_at(eye, [0.0, 0.0, 0.0], [0.0, -1.0, 0.0])


def followed(ratio, seed, frames=5, known=True):
    """Chi-square (6) of the poses of frames that are followed, by a table whose radii are off, and their answers."""
    rng, state, chi2, answers = np.random.default_rng(seed), None, [], []
    normal = NORMAL if known else None
    table = MarkerSet.make([f"m{k}" for k in range(24)], XYZ, radius=RADIUS * ratio, normal=normal, length_unit="mm")
    for k in range(frames):
        xy, size = centres(CAMERA, pose(k), XYZ, NORMAL, RADIUS)
        cov = np.tile(NOISE**2 * np.eye(2), (24, 1, 1))
        spots = Detections.make(xy + NOISE * rng.standard_normal((24, 2)), cov=cov, radius_px=size)
        answer, state = track(state, spots, table, CAMERA)
        assert len(answer.matching) == 24
        if k == 0:
            continue
        assert state.status == "tracked"
        off = (answer.cam_from_model @ pose(k).inverse()).log()
        chi2.append(off @ np.linalg.solve(answer.cov, off))
        answers.append(answer)
    return np.array(chi2), answers


def test_the_pose_of_a_frame_that_is_followed_has_the_eccentricity_of_its_discs():
    """They were points in all frames but the first: 4 to 6 sigmas off, each of six, and nothing was said."""
    chi2, answers = zip(*(followed(1.0, seed) for seed in range(5)), strict=True)
    # Of 20 frames, six degrees of freedom each: the mean is 6 with a sigma of 0.8.
    assert 3.5 < np.mean(chi2) < 9.0
    assert not any(a.unchecked for some in answers for a in some)
    bare = followed(1.0, 0, known=False)[0]
    assert bare.min() > 50.0  # without a normal nobody can know


@pytest.mark.parametrize("ratio", [1.25, 1 / 1.3])
def test_radii_that_the_images_contradict_are_in_the_sigma_of_frames_that_are_followed(ratio):
    chi2, answers = followed(ratio, 0)
    assert chi2.max() < 20.0
    factor, size = max(ratio, 1 / ratio), "large" if ratio > 1 else "small"
    for answer in answers:
        (told,) = answer.unchecked
        assert told.what == "radii"
        assert f"radii are {str(factor)[:3]}" in told.words
        assert f"times too {size}" in told.words
