"""A marker that a place alone made a primary, which the others then put elsewhere, does not keep the primary's name."""

from types import SimpleNamespace

import numpy as np
import pytest

from windmark.scene import Doubt, MarkerSet
from windmark.tasks.reconstruct.reconstruct import _taken_for_primaries

TABLE = MarkerSet.make(["A", "B"], [[0, 0, 0], [100, 0, 0]], role="primary")


def found(place, labels=(), cause="control"):
    markers = MarkerSet.make(["A", "B", "s001"], [[0, 0, 0], place, [100, 80, 0]])
    doubts = (Doubt(("B",), "control point {} was left out", cause),)
    task = SimpleNamespace(primary=TABLE, labels=list(labels))
    return _taken_for_primaries(task, SimpleNamespace(markers=markers, doubts=doubts))


@pytest.mark.parametrize(
    ("place", "labels", "cause", "taken"),
    [
        ((100, 41, 0), (), "control", {"B": "s004"}),  # its neighbour is 39 from it: which of them is B?
        ((100, 12, 0), (), "control", {}),  # a primary that was measured wrongly, and is still the nearest
        ((100, 41, 0), ({5: 1},), "control", {}),  # a label says that it is B
        ((100, 41, 0), ({5: 0},), "control", {"B": "s004"}),
        ((100, 41, 0), (), "marker", {}),
    ],
)
def test_the_name_of_a_primary_is_kept_where_it_is_still_its_own(place, labels, cause, taken):
    assert found(np.array(place, float), labels, cause) == taken
