"""Lamps of a paint test that stand behind what the cameras show, or in another unit."""

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.pipeline.psp import PointRecord
from windmark.pipeline.verdict import BAD, DOUBTFUL
from windmark.pipeline.verdict.lamps import lamps_findings
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.scene import Mesh, structured_triangles

CAMERA = Camera((160, 120), 150.0)
ABOVE, BELOW = ((CAMERA, Pose.look_at([100.0, 50.0, z], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])) for z in (1500.0, -1500.0))
LAMPS = [(-350.0, 950.0, 1500.0), (800.0, 100.0, 1250.0)]


def body():
    """A flat ellipsoid of 1 m, 0.6 m and 40 mm."""
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, 31), np.linspace(-np.pi / 2, np.pi / 2, 16))
    unit = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1).reshape(-1, 3)
    return Mesh.make(unit * [500.0, 300.0, 20.0], structured_triangles(31, 16))


def turned(lamp):
    return (lamp[0], lamp[1], -lamp[2])


def test_lamps_that_light_what_cameras_show_are_right():
    assert lamps_findings(body(), LAMPS, [ABOVE], "mm") == []
    assert lamps_findings(body(), [LAMPS[0], turned(LAMPS[1])], [ABOVE, BELOW], "mm") == []  # one for each side
    assert lamps_findings(body(), [], [ABOVE], "mm") == []


def test_a_lamp_behind_what_cameras_show_is_named():
    (found,) = lamps_findings(body(), [LAMPS[0], turned(LAMPS[1])], [ABOVE], "mm")
    assert (found.word, found.cause) == (DOUBTFUL, "lamps")
    assert found.reason.startswith("lamp 2 at (800, 100, -1250) mm lights ")
    assert len(lamps_findings(body(), [turned(lamp) for lamp in LAMPS], [ABOVE], "mm")) == 2


def test_lamps_in_metres_are_the_reason_where_no_point_comes_out():
    found = lamps_findings(body(), [tuple(x / 1000 for x in lamp) for lamp in LAMPS], [ABOVE], "mm")
    assert [f.cause for f in found] == ["units", "units"]
    verdict = psp_verdict([PointRecord("p1", 0.0, {}, "failed", "the pictures contradict each other")], found)
    assert (verdict.word, verdict.cause) == (BAD, "units")
    assert verdict.reason.startswith("lamp 1 stands ")
