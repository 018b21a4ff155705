"""Lists of points that are on no surface, or that no camera shows anywhere, are told by every job that has them."""

from types import SimpleNamespace

import numpy as np

from windmark import io
from windmark.paint import NodeField
from windmark.pipeline.infrared.outputs import PointHistories
from windmark.pipeline.points import on_grid
from windmark.pipeline.psp import PointRecord
from windmark.pipeline.psp.places import without_places
from windmark.pipeline.verdict import DOUBTFUL
from windmark.pipeline.verdict.paint import psp_verdict
from windmark.pipeline.verdict.wanted import far_findings, valueless_findings
from windmark.pipeline.wanted import PointsEntry
from windmark.scene import Mesh, structured_triangles


def plate(n=11, size=100.0):
    x, y = np.meshgrid(np.linspace(0, size, n), np.linspace(0, size, n))
    return Mesh.make(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), structured_triangles(n, n), "wing")


MESH = plate()


def wanted(tmp_path, *xyz):
    """A list of points as a project has it, on the grid."""
    rows = [f"p{k},{x},{y},{z}" for k, (x, y, z) in enumerate(xyz)]
    (tmp_path / "list.csv").write_text("\n".join(["name,x,y,z", *rows]) + "\n")
    return on_grid(PointsEntry(file=tmp_path / "list.csv"), io.read_points(tmp_path / "list.csv"), MESH)


def reduced(known):
    field = NodeField.make(np.where(known, -0.4, np.nan), 0.01)
    return SimpleNamespace(cp=field, pressure=field, temperature=field, ratio=field,
                           filled=np.zeros(len(field), bool))  # fmt: skip


def test_lists_beside_the_surface_are_told_and_single_points_are_not(tmp_path):
    places = ((20.0, 20.0, 0.0), (40.0, 40.0, 0.0), (60.0, 20.0, 30.0))
    assert far_findings([wanted(tmp_path, *places)], "mm") == []
    (found,) = far_findings([wanted(tmp_path, *(1000 * np.array(places)))], "mm")
    assert (found.word, found.cause) == (DOUBTFUL, "units")
    assert found.reason.startswith("3 of 3 points of list are farther than ")


def test_a_list_on_a_side_that_is_not_seen_is_told_at_every_point_of_a_paint_test(tmp_path):
    left = MESH.vertices[:, 0] < 50
    one = wanted(tmp_path, (75.0, 20.0, 0.0), (85.0, 40.0, 0.0))
    (words,) = without_places([one], MESH, reduced(left))
    assert words == "no value at any of the points of list (2): not seen"
    point = PointRecord("p1", 0.0, {}, "reduced", remarks=(words,), seen=0.9, median_sigma_cp=0.01, flicker=0.0)
    verdict = psp_verdict([point])
    assert (verdict.word, verdict.cause, verdict.reason) == (DOUBTFUL, "lost", words)
    assert without_places([wanted(tmp_path, (75.0, 20.0, 0.0), (25.0, 40.0, 0.0))], MESH, reduced(left)) == []
    assert without_places([wanted(tmp_path, (75e3, 0.0, 0.0))], MESH, reduced(left)) == []  # told by its unit


def test_a_list_that_no_frame_shows_is_told_of_an_infrared_run(tmp_path):
    one = wanted(tmp_path, (75.0, 20.0, 0.0), (85.0, 40.0, 0.0))
    left = NodeField.make(np.where(MESH.vertices[:, 0] < 50, 300.0, np.nan), 0.1)
    fields = SimpleNamespace(temperature=left, flux=None, flags=np.zeros(len(left), np.uint8))
    histories = PointHistories(SimpleNamespace(points=(one,), mesh=MESH))
    for key in ("0", "1"):
        histories.add(SimpleNamespace(key=key, time_s=0.1), fields)
    (words,) = histories.valueless()
    assert words == "no value at any of the points of list (2): no frame has a temperature there"
    assert [f.reason for f in valueless_findings([words])] == [words]
    fields.temperature = NodeField.make(np.full(len(left), 300.0), 0.1)
    histories.add(SimpleNamespace(key="2", time_s=0.2), fields)
    assert histories.valueless() == []
