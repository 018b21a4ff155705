"""Points that end together: what stops one of them takes none that is done with it."""

from concurrent.futures import Future

import pytest

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
