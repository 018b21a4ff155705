"""Regular layouts with a rough table: its errors must not pass for what tells the labellings apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.registration import register
from windmark.registration.options import default_tolerance
from windmark.scene import Detections, MarkerSet

CAMERA = Camera((1000, 800), 1500.0)
PITCH, ERROR = 40.0, 1.2
PLACES = PITCH * np.array([(i, j, 0.0) for i in range(8) for j in range(8)])
LOOSE = {"max_time_s": 2.0}


def plate(error: float, seed: int) -> MarkerSet:
    """An 8 x 8 grid whose table is off by so much (1 sigma per coordinate)."""
    xyz = PLACES + np.random.default_rng([seed, 0]).normal(0, error, PLACES.shape)
    normal = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    return MarkerSet.make([f"m{n}" for n in range(len(xyz))], xyz, normal=normal, sigma=ERROR)


def picture(xyz: np.ndarray, seed: int) -> Detections:
    """Spots in the order of the markers, 40 degrees from the normal, any roll."""
    rng = np.random.default_rng([seed, 1])
    roll, facing = (
        Pose.from_rotvec([0, 0, rng.uniform(0, 6)], np.zeros(3)),
        Pose.from_rotvec([np.pi, 0, 0], np.zeros(3)),
    )
    tilt = Pose.from_rotvec([0.7, 0, 0], np.zeros(3))
    turn = (tilt @ facing @ roll).rotation
    pose = Pose(turn, np.array([0.0, 0.0, 900.0]) - turn @ PLACES.mean(axis=0))
    return Detections.make(CAMERA.project(pose.apply(xyz))[0] + rng.normal(0, 0.1, (len(xyz), 2)), sigma_px=0.1)


def test_the_tolerance_follows_the_sigma_of_the_table():
    """5 sigma, as the spacing of markers and spots tells; no more than a fifth of that, and no less than without."""
    spots, exact = picture(PLACES, 0).xy, plate(0.0, 0)
    usual = 0.004 * np.hypot(1000, 800)
    apart = np.sort(np.linalg.norm(spots[:, None] - spots[None], axis=2), axis=1)
    nearest, fourth = np.median(apart[:, 1]), np.median(apart[:, 4])
    for sigma, expected in ((np.nan, usual), (ERROR, 5 * ERROR / PITCH * fourth), (9.0, 0.2 * nearest)):
        markers = replace(exact, sigma=np.full((len(exact), 3), sigma))
        assert default_tolerance(spots, CAMERA, markers) == pytest.approx(expected, rel=1e-9)
    assert default_tolerance(spots[:1], CAMERA, plate(ERROR, 0)) == pytest.approx(usual)


@pytest.mark.parametrize("seed", range(12))
def test_errors_of_the_table_do_not_choose_among_the_turns_of_a_regular_grid(seed):
    result = register(picture(PLACES, seed), plate(ERROR, seed), CAMERA, **LOOSE)
    assert not result
    assert result.cause == "ambiguous"


@pytest.mark.parametrize("seed", range(6))
def test_labels_decide_whatever_the_table_would_prefer(seed):
    markers = plate(ERROR, seed)
    result = register(picture(PLACES, seed), markers, CAMERA, fixed={0: "m0", 7: "m7"}, **LOOSE)
    assert result, result.reason
    assert (result.matching.marker == result.matching.detection).all()


@pytest.mark.parametrize("seed", range(3))
def test_irregularities_that_are_there_are_evidence(seed):
    markers = plate(ERROR, seed)  # this time the discs are where the table says
    result = register(picture(markers.xyz, seed), markers, CAMERA, **LOOSE)
    assert result, result.reason
    assert (result.matching.marker == result.matching.detection).all()
    assert len(result.matching) == len(markers)
