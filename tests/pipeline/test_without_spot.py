"""Markers without a spot: what must be in view, what its own sigma or the user's word explains, and what is odd."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.locate import _expected
from windmark.pipeline.verdict.registered import Sighting, registered_findings
from windmark.registration import register
from windmark.scene import Detections, MarkerSet

CAMERA, POSE = Camera((640, 480), 800.0), Pose.look_at([0.5, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
COUNT, ODD = 24, 7
SURE = np.eye(2) * 1e-4


@pytest.fixture(scope="module")
def markers():
    xyz = np.random.default_rng(1).uniform(-1.0, 1.0, (COUNT, 3)) * [2.0, 1.5, 0.2]
    return MarkerSet.make([f"m{i}" for i in range(COUNT)], xyz)


def findings(markers, *, off=(0.0, 0.0), cov=SURE, flags=0, **options):
    """What is said where one marker's spot is off by so many pixels, with a covariance of its own."""
    xy = CAMERA.project(POSE.apply(markers.xyz))[0] + np.random.default_rng(2).normal(0, 0.01, (COUNT, 2))
    xy[ODD] += off
    covs = np.tile(SURE, (COUNT, 1, 1))
    covs[ODD] = cov
    flag = np.where(np.arange(COUNT) == ODD, flags, 0)
    answer = register(spots := Detections.make(xy, cov=covs, flags=flag), markers, CAMERA, **options)
    assert answer, answer.reason
    return answer, registered_findings(Sighting(answer, spots, markers, np.arange(COUNT), "mm"))


def test_all_at_their_places_is_good(markers):
    assert findings(markers)[1] == []


def test_a_marker_off_its_table_is_named(markers):
    said = findings(markers, off=(5.0, 0.0))[1]
    assert [f.cause for f in said] == ["marker"]
    assert said[0].reason.startswith(f"m{ODD} is 5")


def test_a_marker_whose_spot_is_half_in_a_highlight_is_not_blamed(markers):
    (said,) = findings(markers, off=(5.0, 0.0), flags=2)[1]
    assert said.cause == "saturated"
    assert said.reason.startswith(f"the spot of m{ODD} is saturated in part, and 5")
    assert "measure" not in said.next_step


def test_an_excluded_spot_is_not_judged_nor_is_its_marker(markers):
    assert findings(markers, off=(0.5, 0.0), cov=np.eye(2), excluded=[ODD])[1] == []
    assert findings(markers, off=(5.0, 0.0), excluded=[ODD])[1] == []
    answer, said = findings(markers, excluded=np.arange(10))  # 10 of 24 are more than the third that may be missing
    assert len(answer.matching) == COUNT - 10
    assert said == []


def test_what_is_within_the_sigma_of_its_spot_is_no_contradiction(markers):
    """The spot is free and the marker without one, as where a pair is left out that the others hardly check."""
    answer, _ = findings(markers, off=(0.5, 0.0))
    spot, kept = answer.matching.detection, answer.matching.marker != ODD
    answer = replace(
        answer, matching=replace(answer.matching, detection=spot[kept], marker=answer.matching.marker[kept],
                                 distance_px=answer.matching.distance_px[kept]), residuals=answer.residuals[kept],
    )  # fmt: skip
    xy = CAMERA.project(POSE.apply(markers.xyz))[0]
    xy[ODD, 0] += 2.0

    def said(sigma):
        covs = np.tile(SURE, (COUNT, 1, 1))
        covs[ODD] = np.eye(2) * sigma**2
        seen = Sighting(answer, Detections.make(xy, cov=covs), markers, np.arange(COUNT), "mm")
        return [f.cause for f in registered_findings(seen)]

    assert said(1.0) == []
    assert said(0.1) == ["marker"]


def test_markers_seen_at_a_grazing_angle_are_not_expected():
    """The detector finds discs at up to 72 degrees; a normal that is not known says nothing."""
    tilt = np.radians([0.0, 60.0, 70.0, 75.0, 85.0, 100.0])
    normal = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], axis=1)
    markers = MarkerSet.make([f"m{i}" for i in range(7)], np.zeros((7, 3)), normal=np.vstack([normal, [[np.nan] * 3]]))
    there = SimpleNamespace(camera=CAMERA, cam_from_model=Pose.look_at([0.0, 0.0, 6.0], [0, 0, 0], [0.0, 1.0, 0.0]))
    assert _expected(markers, there, None).tolist() == [0, 1, 2, 6]
