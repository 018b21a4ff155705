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


@pytest.fixture(scope="session")
def virtual_test(tmp_path_factory):
    """The default virtual test as files, and the test itself: (folder, TunnelTest). Not to be written into."""
    from windmark.pipeline.simulate import simulate

    folder: Path = tmp_path_factory.mktemp("virtual-test")
    return folder, simulate(folder, seed=3)
