"""For the tests of files: small meshes, a full disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from small_meshes import blocks_mesh, shell_mesh

from windmark.scene import Mesh

MakeMesh = Callable[..., Mesh]


@pytest.fixture(scope="session")
def make_mesh() -> MakeMesh:
    return blocks_mesh


@pytest.fixture
def blocks() -> Mesh:
    """Three blocks, one flat in each direction."""
    return blocks_mesh([(5, 4, 1), (1, 6, 3), (4, 1, 7)])


@pytest.fixture
def shell() -> Mesh:
    return shell_mesh()


@pytest.fixture(scope="module")
def one_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For files of many examples, each in the place of the one before: for a folder of its own for each of them pytest
    would look through the names of all that it has made.
    """
    return tmp_path_factory.mktemp("examples")


@contextmanager
def _full_disk(after_bytes: int) -> Iterator[None]:
    resource = pytest.importorskip("resource", reason="a file size limit stands for the full disk; not on Windows")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (after_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def full_disk() -> Callable[[int], AbstractContextManager[None]]:
    """``with full_disk(n)``: the operating system refuses to make any file longer than n bytes."""
    return _full_disk
