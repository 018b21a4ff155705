"""What a table says against itself: parts on hinges that are exchanged, walls that no camera ever saw."""

import numpy as np
import pytest

from windmark.deformation import Volume, Volumes, with_parameters
from windmark.deformation.laws.rigid import Hinge
from windmark.pipeline.deform.record import FrameRecord
from windmark.pipeline.verdict.table import hinge_findings, walls_findings
from windmark.scene import MarkerSet
from windmark.tasks.deform.task import Sight

FLAP = np.array([[320, 120, 10], [350, 135, 10], [380, 120, 10], [325, 200, 10], [352, 215, 10], [385, 205, 10]], float)
INNER, OUTER = Hinge((305, 100, 8), (305, 230, 8)), Hinge((305, 320, 8), (305, 450, 8))


def flaps(first, second, a=INNER, b=OUTER):
    xyz = np.vstack([FLAP, FLAP + np.array([0.0, 220.0, 0.0])])
    markers = MarkerSet.make([f"m{k}" for k in range(12)], xyz, volume=np.repeat([first, second], 6))
    held = with_parameters(b, {"angle": {"sigma": 5.0}})
    return hinge_findings(markers, Volumes.of([Volume("inner", a), Volume("outer", held)]))


def test_flaps_on_one_line_whose_volumes_are_exchanged_are_doubted():
    (found,) = flaps("outer", "inner")
    assert (found.word, found.cause) == ("doubtful", "swapped")
    assert found.reason.startswith(
        "the hinge of inner (start to end) lies beside the markers of inner and along those of outer, whose hinge is "
        "elsewhere, too: are they exchanged?; the hinge of outer (start to end) lies beside"
    )


def test_right_flaps_and_hinges_by_two_points_anywhere_on_their_lines_are_not():
    assert flaps("inner", "outer") == []
    short = Hinge((305, 80, 8), (305, 90, 8)), Hinge((305, 300, 8), (305, 310, 8))
    assert flaps("inner", "outer", *short) == []
    assert flaps("inner", "outer", INNER, Hinge((305, 150, 8), (305, 200, 8))) == []  # beside its own, not exchanged


def record(**cameras):
    nan = np.zeros(0)
    return FrameRecord(0, "0", 0.0, 0.0, "cold", "", 0.1, 70, 0, 0.02, 1.0, *(nan,) * 4, cameras=cameras)


def table(scale):
    model = np.random.default_rng(1).uniform(0.0, 500.0, (20, 3)) * [1.0, 1.0, 0.1]
    angle = np.arange(6) * np.pi / 3
    walls = 250.0 + 400.0 * np.column_stack([np.cos(angle), np.sin(angle), -1.0 + 0.0 * angle])
    names = [f"m{k}" for k in range(20)] + [f"T{k}" for k in range(6)]
    return MarkerSet.make(names, np.vstack([model, scale * walls]), role=["model"] * 20 + ["wall"] * 6)


def test_walls_that_no_camera_ever_saw_are_said_with_their_likely_unit():
    unseen, blind = Sight(26, 20, walls=(0, 5)), Sight(26, 0)
    frames = [record(cam1=unseen, cam2=Sight(26, 20, walls=(0, 6))), record(cam1=unseen, cam2=blind)]
    (found,) = walls_findings(table(1e-3), frames, "mm")
    assert "none of the 6 markers on walls was seen in any frame, though 6 of them should be" in found.reason
    assert "in the pictures of cam1 and cam2" in found.reason
    assert found.reason.endswith("these rows of the table are rather in m")
    (found,) = walls_findings(table(1.0), frames, "mm")
    assert "rather in" not in found.reason


@pytest.mark.parametrize("other", [Sight(26, 22, walls=(2, 0)), Sight(26, 20)])
def test_walls_that_were_seen_once_or_need_not_be_seen_are_not_said(other):
    unseen = Sight(26, 20, walls=(0, 5))
    assert walls_findings(table(1.0), [record(cam1=unseen), record(cam1=other)], "mm") == []
    assert walls_findings(table(1.0), [record(cam1=other)], "mm") == []
    some = Sight(26, 22, walls=(2, 0))
    assert walls_findings(table(1.0), [record(cam1=unseen, cam2=some)], "mm") == []  # another one is held by them
