"""Fixtures shared by all tests."""

import os
import signal
from pathlib import Path

# As the windmark command does: small matrices, so threads of BLAS only cost. Before numpy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# A shell starts what runs in the background with Ctrl-C ignored, and Python leaves it so: tests that press it wait
# for nothing. What they start then has it, too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import hypothesis  # noqa: E402
import pytest  # noqa: E402

# The same examples every time, so that a red run means a change; `--hypothesis-profile=explore` draws new ones.
# No deadline: machines are shared, and no test says how fast it has to be.
hypothesis.settings.register_profile("windmark", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", derandomize=False, deadline=None)
hypothesis.settings.load_profile("windmark")


SLOW_S = 5.0
"""CPU seconds of a test, its fixtures included, from which on it is to be marked slow."""
COSTS: dict[str, float] = {}


def pytest_addoption(parser):
    parser.addoption("--costs", metavar="FILE", help="write the CPU seconds of every test to FILE (CSV), dearest first")


def cpu_s():
    """CPU seconds of this process and of those that it started and that have ended."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    before = cpu_s()
    try:
        return (yield)
    finally:
        COSTS[item.nodeid] = cpu_s() - before


def pytest_sessionfinish(session):
    if path := session.config.getoption("--costs"):
        slow = {item.nodeid for item in session.items if item.get_closest_marker("slow")}
        lines = [f'"{name}",{cost:.2f},{name in slow}' for name, cost in sorted(COSTS.items(), key=lambda c: -c[1])]
        Path(path).write_text("\n".join(["test,cpu_s,slow", *lines, ""]), encoding="utf-8")


def pytest_terminal_summary(terminalreporter, config):
    if "not slow" in (config.option.markexpr or ""):
        terminalreporter.write_line("the tests marked slow were left out; `make test-all` runs them, too", yellow=True)
    if config.getoption("--costs"):
        dear = sum(cost > SLOW_S for cost in COSTS.values())
        terminalreporter.write_line(f"{dear} tests took over {SLOW_S:g} s of CPU time, compiling included")


@pytest.fixture(scope="session")
def virtual_test(tmp_path_factory):
    """The default virtual test as files, and the test itself: (folder, TunnelTest). Not to be written into."""
    from windmark.pipeline.simulate import simulate

    folder: Path = tmp_path_factory.mktemp("virtual-test")
    return folder, simulate(folder, seed=3)
