"""Fixtures shared by all tests."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def virtual_test(tmp_path_factory):
    """The default virtual test as files, and the test itself: (folder, TunnelTest). Not to be written into."""
    from windmark.pipeline.simulate import simulate

    folder: Path = tmp_path_factory.mktemp("virtual-test")
    return folder, simulate(folder, seed=3)
