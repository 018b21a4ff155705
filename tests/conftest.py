"""Fixtures shared by all tests."""

import contextlib
import os
import shutil
import signal
import time
from pathlib import Path

# As the windmark command does: small matrices, so threads of BLAS only cost. Before numpy is imported.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# A shell starts what runs in the background with Ctrl-C ignored, and Python leaves it so: tests that press it wait
# for nothing. What they start then has it, too. `nohup` does the same to the signal of a closing terminal.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

import hypothesis  # noqa: E402
import pytest  # noqa: E402
import scipy.linalg  # noqa: E402, F401
from threadpoolctl import threadpool_limits  # noqa: E402

# A plugin of pytest may have imported numpy before this file was read.
threadpool_limits(limits=1, user_api="blas")

# The same examples every time, so that a red run means a change; `--hypothesis-profile=explore` draws new ones.
# No deadline: machines are shared, and no test says how fast it has to be.
hypothesis.settings.register_profile("windmark", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", derandomize=False, deadline=None)
hypothesis.settings.load_profile("windmark")


SLOW_S = 1.5
"""CPU seconds of a test, its fixtures included, from which on it is to be marked slow."""
COSTS: dict[str, tuple[float, float, bool]] = {}
"""CPU and wall seconds of each test, and whether it is marked slow."""


def pytest_addoption(parser):
    parser.addoption("--costs", metavar="FILE", help="CPU and wall seconds of every test to FILE (CSV)")


def cpu_s():
    """CPU seconds of this process and of those that it started and that have ended."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    before = cpu_s(), time.monotonic()
    try:
        return (yield)
    finally:
        slow = item.get_closest_marker("slow") is not None
        COSTS[item.nodeid] = cpu_s() - before[0], time.monotonic() - before[1], slow


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Of xdist: what one of several processes has run."""
    COSTS.update(getattr(node, "workeroutput", {}).get("costs", {}))


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session):
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["costs"] = COSTS


def pytest_terminal_summary(terminalreporter, config):
    if "not slow" in (config.option.markexpr or ""):
        terminalreporter.write_line("the tests marked slow were left out; `make test-all` runs them, too", yellow=True)
    if path := config.getoption("--costs"):
        dearest = sorted(COSTS.items(), key=lambda cost: -cost[1][0])
        lines = [f'"{name}",{cpu:.2f},{wall:.2f},{slow}' for name, (cpu, wall, slow) in dearest]
        Path(path).write_text("\n".join(["test,cpu_s,wall_s,slow", *lines, ""]), encoding="utf-8")
        dear = sum(cpu > SLOW_S and not slow for cpu, _, slow in COSTS.values())
        terminalreporter.write_line(f"{dear} tests that are not marked slow took over {SLOW_S:g} s of CPU time")


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """``made_once(name, make)``: a folder that ``make(folder)`` has filled, for all modules. Not to be written into.

    Of several processes that share the tests the first one that asks makes it, the others wait for that.
    """
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def folder(name, make):
        made, making = base / f"once-{name}", base / f"once-{name}-making"
        while not made.exists():
            try:
                making.mkdir()
            except FileExistsError:
                time.sleep(0.1)
                continue
            try:
                make(making)
                making.rename(made)
            finally:
                shutil.rmtree(making, ignore_errors=True)  # of one that failed: who asks next tries again
        return made

    return folder


@pytest.fixture(scope="session")
def coarse_grids():
    """``with coarse_grids():`` the virtual models' grids have a third of their nodes: nothing that is tried needs more,
    and jobs take two thirds of their time.
    """
    from windmark.synth.wing import HalfModel

    whole = HalfModel.patches

    def patches(self, nodes=60_000):
        return whole(self, nodes if nodes < 20_000 else round(nodes / 3))

    @contextlib.contextmanager
    def context():
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(HalfModel, "patches", patches)
            yield

    return context


@pytest.fixture(scope="session")
def virtual_test(tmp_path_factory, coarse_grids):
    """The default virtual test as files, and the test itself: (folder, TunnelTest). Not to be written into."""
    from windmark.pipeline.simulate import simulate

    folder: Path = tmp_path_factory.mktemp("virtual-test")
    with coarse_grids():
        return folder, simulate(folder, seed=3)
