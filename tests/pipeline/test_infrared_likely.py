"""A camera's numbers in another unit than is said, told by model and surroundings before anything is heated."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.geometry import Camera, Pose
from windmark.pipeline.infrared.likely import OddUnit, likely_unit_of, odd_units
from windmark.pipeline.verdict import DOUBTFUL
from windmark.pipeline.verdict.infrared import unit_findings
from windmark.tasks.deform.task import FrameImages, Station


@pytest.mark.parametrize(
    ("number", "unit", "around"),
    [(288.0, "K", 293.0), (20.0, "degC", 293.0), (68.0, "degF", 293.0), (110.0, "K", 110.0), (110.0, "K", 295.0),
     (340.0, "K", 293.0), (95.0, "degC", 293.0), (700.0, "K", 295.0), (500.0, "degC", 295.0)],
)  # fmt: skip
def test_temperatures_that_a_tunnel_has_are_left(number, unit, around):
    assert likely_unit_of(number, unit, around) is None


@pytest.mark.parametrize(
    ("number", "unit", "other"), [(293.0, "degC", "K"), (291.0, "degF", "K"), (22.0, "K", "degC"), (70.0, "K", "degF")]
)
def test_a_unit_that_cannot_be_is_told_with_the_likely_one(number, unit, other):
    found = likely_unit_of(number, unit, 295.0)
    assert found is not None
    assert found[1] == other


def test_the_first_picture_that_can_be_read_says_it(tmp_path):
    station = Station("a", Camera((4, 3), 9.0), Pose.identity())
    entries = [SimpleNamespace(name=n, quantity=q, unit="degC", scale=0.01, offset=0.0)
               for n, q in (("a", "temperature"), ("b", "counts"))]  # fmt: skip
    (tmp_path / "x.tif").write_bytes(b"nothing")
    warm = np.full((3, 4), 29300, np.uint16)
    frames = [FrameImages("0", 0.0, {"b": warm}), FrameImages("1", 1.0, {"a": tmp_path / "x.tif"}),
              FrameImages("2", 2.0, {"a": warm, "b": warm})]  # fmt: skip
    project = SimpleNamespace(camera=entries, surface=SimpleNamespace(surroundings_K=295.0))
    deforming = SimpleNamespace(test=SimpleNamespace(station=lambda name: station))
    run = SimpleNamespace(project=project, deforming=deforming, timeline=SimpleNamespace(frames=frames))
    (odd,) = odd_units(run)
    assert odd == OddUnit("a", "degC", pytest.approx(566.15), "K", pytest.approx(293.0))
    (finding,) = unit_findings([odd], 295.0)
    assert (finding.word, finding.cause) == (DOUBTFUL, "units")
    assert finding.reason == ("the middle of the first picture of a is 566 K in degC, the surroundings are 295 K: its "
                              "numbers are rather in K (293 K)")  # fmt: skip
