"""What cameras show without a value is a hole in a seen side, not the side that no camera shows."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.paint import LoadReference, NodeField, SensorModel
from windmark.pipeline.verdict.paint import flat_findings
from windmark.scene import Mesh, structured_triangles
from windmark.tasks.psp import Lamp, ModelPicture, Reference, ratio_of, seen_loads, shown_areas
from windmark.tasks.psp.flats import clipped_part
from windmark.tasks.psp.loads import hole_words

CAMERA = Camera((160, 120), 200.0)
ABOVE = Pose.look_at(np.array([0.0, 0.0, 100.0]), np.zeros(3), [0.0, 1.0, 0.0])


def plate(n=21, size=40.0):
    x, y = np.meshgrid(np.linspace(-size / 2, size / 2, n), np.linspace(-size / 2, size / 2, n))
    xyz = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    return Mesh.make(xyz, structured_triangles(n, n), "wing")


def picture(mesh, hole=False):
    light = np.full((120, 160), 1000.0)
    if hole:
        light[45:75, 65:95] = np.nan
    return ModelPicture("a", "cam", light, np.full(light.shape, 1e-4), CAMERA, ABOVE, mesh,
                        np.zeros((len(mesh.vertices), 3, 1)))  # fmt: skip


def test_nodes_of_saturated_pixels_are_shown_and_have_no_value():
    mesh = plate()
    inner = (np.abs(mesh.vertices[:, :2]) < 5).all(axis=1)
    whole = ratio_of([picture(mesh)], [picture(mesh)])
    assert (whole.shown == whole.ratio.known).all()
    for on, off in ((True, True), (False, True), (True, False)):
        holed = ratio_of([picture(mesh, on)], [picture(mesh, off)])
        assert not holed.ratio.known[inner].any()
        assert (holed.shown == whole.shown).all()
    parts = [Reference([picture(mesh, hole)], 0.5) for hole in (True, False)]
    assert (ratio_of([picture(mesh)], parts).shown == whole.shown).all()
    below = Lamp((0.0, 0.0, -100.0))
    beside = Lamp((100.0, 0.0, 50.0))
    assert (ratio_of([picture(mesh)], [picture(mesh)], lamps=[beside, below]).shown == whole.shown).all()


def test_a_hole_is_filled_and_the_sigma_of_the_loads_has_it():
    mesh = plate(41)
    x, y = mesh.vertices[:, :2].T
    true = -0.5 - 0.4 * np.exp(-(x**2 + y**2) / 80)
    hole = (np.abs(mesh.vertices[:, :2]) < 7).all(axis=1)
    cp, reference = NodeField.make(np.where(hole, np.nan, true), 0.001), LoadReference(1600.0, 40.0, 40.0)
    everywhere = np.ones(len(hole), bool)
    assert shown_areas(mesh, everywhere) == {"wing": 1.0, "all": 1.0}
    remarks: list[str] = []
    loads = seen_loads(mesh, cp, reference, 0.5, remarks, seen=everywhere)
    whole = seen_loads(mesh, NodeField.make(true, 0.001), reference, 0.5, remarks)
    assert remarks == []  # no side is unseen
    (lift, sigma), (right, without) = loads.row("wing")["CL"], whole.row("wing")["CL"]
    assert sigma > 10 * without
    assert abs(lift - right) < 2 * sigma
    (said,) = hole_words(mesh, everywhere, ~hole)
    assert said.startswith("wing: ")
    assert "is shown by cameras, but has no value: pixels that are saturated" in said
    assert hole_words(mesh, everywhere, everywhere) == []
    one = everywhere.copy()
    one[800] = False
    assert hole_words(mesh, everywhere, one) == []  # no triangle is without a corner that has a value


def test_overexposed_flat_pictures_are_said_with_the_part_of_the_models_pixels():
    mesh, station = plate(), SimpleNamespace(camera=CAMERA, cam_from_tunnel=ABOVE)
    flats = np.random.default_rng(3).integers(8000, 9000, (3, 120, 160)).astype(np.uint16)
    sensor = SensorModel(100.0, 16383.0, 0.5, 1.0)
    assert clipped_part(flats, sensor, station, mesh) == 0
    flats[1, :, :80] = 16383  # half of the picture, and of the plate in its middle
    part = clipped_part(flats, sensor, station, mesh)
    assert part == pytest.approx(0.5, abs=0.02)
    dead = np.zeros((120, 160), bool)
    dead[:, :80] = True
    assert clipped_part(flats, SensorModel(100.0, 16383.0, 0.5, 1.0, dead=dead), station, mesh) == 0
    (found,) = flat_findings({"cam1": 0.0, "cam2": part}, 0.02)
    assert found.reason.startswith("the flat pictures of cam2 are saturated on 5")
    assert flat_findings({"cam1": 0.0}, 0.02) == []
