"""Points that end together: what stops one of them takes none that is done with it."""

from concurrent.futures import Future

import pytest

from windmark.pipeline.psp import REDUCED, PointRecord, grouped
from windmark.pipeline.psp.each import _records


@pytest.mark.parametrize("draw", range(20))
def test_a_point_that_is_done_is_kept_whatever_stops_another(draw):
    """A set has no order: with the point that was stopped before the other one, half of such ends lost one."""
    done, stopped = Future(), Future()
    done.set_result(f"p{draw}")
    stopped.set_exception(KeyboardInterrupt())
    records = _records({done, stopped})
    assert next(records) == f"p{draw}"
    with pytest.raises(KeyboardInterrupt):
        next(records)


def test_remarks_about_pictures_are_told_apart_and_those_that_differ_by_figures_are_not():
    def record(name, *remarks):
        return PointRecord(name, 0.0, {}, REDUCED, remarks=remarks)

    said = "wind-on picture on-cam{0}-{0}.tif of cam{0} does not count: {1} % of the picture is saturated"
    found = grouped([
        record("a", said.format(1, 41), said.format(2, 40), "wing: 55.4 % of its area, a Cp of 0.1 makes CL +1.2e-05"),
        record("b", said.format(2, 39), "wing: 55.5 % of its area, a Cp of 0.1 makes CL -0.04"),
    ])  # fmt: skip
    assert list(found.values()) == [["a"], ["a", "b"], ["a", "b"]]
    assert list(found)[:2] == [said.format(1, 41), said.format(2, 40)]
