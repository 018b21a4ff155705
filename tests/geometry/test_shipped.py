"""Kernels that came with the package are taken where they fit, and nowhere else."""

import json
import os
import shutil
import subprocess
import sys

import pytest

import windmark.geometry._shipped as shipping
from windmark.geometry._shipped import FOLDER, NAME, PROCESSOR, Shipped, manifest, shipped

KERNEL = '''
def kernel(x):
    total = 0.0
    for k in range(x.size):
        total += (k + 1) * x[k]
    return total
'''
RUN = '''
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, sys.argv[1])
from package._kernels import kernel

from windmark.compiling import compiling_seconds
from windmark.geometry import _link
from windmark.geometry._shipped import Shipped

_link.install()
here = Path(sys.argv[1]) / "package"
made = _link.Kernel(kernel, targetoptions={"nopython": True, "boundscheck": None})
made.enable_caching(Shipped(here, here / "compiled") if "brought" in sys.argv else None)
print(made(np.array([1.0, 2.0, 4.0])), compiling_seconds() > 0)
'''


def run(place, cache, *words, **env):
    command = [sys.executable, "-c", RUN, str(place), *words]
    done = subprocess.run(command, env={**os.environ, "NUMBA_CACHE_DIR": str(cache), **env}, check=True,
                          capture_output=True, text=True)  # fmt: skip
    return done.stdout.split()


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A folder with a package whose one kernel came compiled for the processor of wheels."""
    place = tmp_path_factory.mktemp("place")
    (place / "package").mkdir()
    (place / "package" / "_kernels.py").write_text(KERNEL)
    cache = tmp_path_factory.mktemp("cache")
    name, features = PROCESSOR
    assert run(place, cache, NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=features) == ["17.0", "True"]
    (place / "package" / FOLDER).mkdir()
    for path in cache.rglob("*.nb[ic]"):
        shutil.move(path, place / "package" / FOLDER / path.name)
    return place


@pytest.mark.slow
def test_what_came_with_the_package_is_not_compiled(package, tmp_path):
    assert run(package, tmp_path, "brought") == ["17.0", "False"]
    assert not list(tmp_path.rglob("*.nbc"))
    assert run(package, tmp_path) == ["17.0", "True"]  # that it is not taken from elsewhere


def test_a_damaged_file_counts_as_missing(package, tmp_path):
    copy = shutil.copytree(package, tmp_path / "copy")
    (code,) = (copy / "package" / FOLDER).glob("*.nbc")
    code.write_bytes(code.read_bytes()[:100])
    assert run(copy, tmp_path / "cache", "brought") == ["17.0", "True"]


def test_a_changed_kernel_is_compiled(package, tmp_path):
    copy = shutil.copytree(package, tmp_path / "copy")
    (copy / "package" / "_kernels.py").write_text(KERNEL.replace("k + 1", "k + 2"))
    assert run(copy, tmp_path / "cache", "brought") == ["24.0", "True"]


SOURCES = {"room/_kernels.py": "a hash"}


@pytest.fixture
def brought(tmp_path):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / NAME).write_text(json.dumps(manifest(SOURCES)))
    return tmp_path


def test_a_package_that_fits(brought, monkeypatch):
    monkeypatch.setattr(shipping.llvm, "get_host_cpu_features", lambda: dict.fromkeys(shipping._NEEDS, True))
    found, why = shipped(brought, lambda _: SOURCES)
    assert isinstance(found, Shipped)
    assert not why


def test_none_came(tmp_path):
    assert shipped(tmp_path, lambda _: SOURCES) == (None, "")


@pytest.mark.parametrize(
    ("what", "was", "reason"),
    [
        ("numba", "0.1", "numba was 0.1, is"),
        ("python", "cpython 3.9", "python was cpython 3.9, is"),
        ("system", "riscv", "system was riscv, is"),
        ("sources", {}, "sources have been changed"),
    ],
)
def test_why_those_that_came_are_of_no_use(brought, what, was, reason):
    (brought / FOLDER / NAME).write_text(json.dumps({**manifest(SOURCES), what: was}))
    found, why = shipped(brought, lambda _: SOURCES)
    assert found is None
    assert why.startswith(reason)


def test_a_processor_that_is_too_old(brought, monkeypatch):
    monkeypatch.setattr(shipping.llvm, "get_host_cpu_features", lambda: {"avx2": False, "fma": True})
    found, why = shipped(brought, lambda _: SOURCES)
    assert found is None
    assert why.startswith("this processor lacks avx2, bmi")


@pytest.mark.parametrize("text", ["", "[1]", '{"python"'])
def test_a_list_that_cannot_be_read(brought, text):
    (brought / FOLDER / NAME).write_text(text)
    found, why = shipped(brought, lambda _: SOURCES)
    assert found is None
    assert why
