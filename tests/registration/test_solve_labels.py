"""A solution that has the labels and leaves most of the rest alone is not shown before more was searched."""

from types import SimpleNamespace

import pytest

from windmark.registration.solve import _leaves_most


@pytest.mark.parametrize(
    ("count", "fixed", "binding", "poor"),
    [(38, ((0, 1),), False, True), (50, ((0, 1),), False, False), (38, (), False, False), (38, ((0, 1),), True, False)],
)
def test_a_labelled_solution_of_few_is_doubted(count, fixed, binding, poor):
    """A regular sheet turned about its labelled marker has that one and a third of the others."""
    task = SimpleNamespace(markers=range(400), xy=range(100), fixed=fixed, binding=binding)
    best = SimpleNamespace(count=count, expected=100, views=SimpleNamespace(planes=[SimpleNamespace(task=task)]))
    assert _leaves_most(best) == poor
    few = SimpleNamespace(count=count, expected=60, views=best.views)  # of those in view it has most
    assert not _leaves_most(few)
    close = SimpleNamespace(count=30, expected=30, views=best.views)  # all in view, and less than a third of the spots
    assert _leaves_most(close) == (bool(fixed) and not binding)
