"""Times that are reported are those of the work, not of compiling."""

import threading
import time

import pytest

from windmark import compiling
from windmark.pipeline.clock import Clock


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    monkeypatch.setattr(compiling, "_process", compiling._Process())
    monkeypatch.setattr(compiling, "_here", compiling._Here())


@pytest.fixture
def wall(monkeypatch):
    """A clock on the wall that is set by hand."""
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])

    def passes(seconds):
        now[0] += seconds

    return passes


def test_a_stage_is_timed_without_what_its_thread_waits_for(wall):
    clock = Clock()
    with clock("find markers"):
        wall(1.0)
        with compiling.waiting():
            wall(50.0)
            with compiling.waiting():  # a kernel that the other one calls
                wall(10.0)
        wall(0.5)
    assert clock.seconds == {"find markers": pytest.approx(1.5)}


def test_a_thread_that_does_not_wait_is_timed_in_full(wall):
    def other():
        with compiling.waiting():
            wall(50.0)

    start = compiling.working_time()
    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert compiling.working_time() - start == pytest.approx(50.0)


def test_a_job_is_timed_without_what_any_thread_compiles(wall):
    start = compiling.job_time()
    wall(52.0)
    thread = threading.Thread(target=compiling.compiled, args=(50.0,))
    thread.start()
    thread.join()
    assert compiling.job_time() - start == pytest.approx(2.0)
    assert compiling.compiling_seconds() == 50.0


def test_compiling_is_said_once_and_not_for_a_single_small_kernel():
    said = []
    compiling.announce(lambda: said.append("compiling"))
    compiling.compiled(0.5 * compiling.WORTH_A_WORD)
    assert not said
    for _ in range(3):
        compiling.compiled(compiling.WORTH_A_WORD)
    assert said == ["compiling"]
