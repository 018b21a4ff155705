"""Numba's cache beside the sources is dropped exactly where a kernel source has changed."""

import pytest

from windmark.geometry._jit import drop_stale_cache, kernel_sources


@pytest.fixture
def package(tmp_path):
    add_kernel(tmp_path, "room/_kernels.py")
    (tmp_path / "room" / "verb.py").write_text("b = 1\n")
    (tmp_path / "room" / "__pycache__" / "verb.cpython-311.pyc").write_bytes(b"python's own")
    return tmp_path


def add_kernel(package, name, text="a = 1\n"):
    path = package / name
    cache = path.parent / "__pycache__"
    cache.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    (cache / f"{path.stem}.f-1.py311.nbi").write_bytes(b"index")
    (cache / f"{path.stem}.f-1.py311.1.nbc").write_bytes(b"code")


def cached(package):
    return sorted({p.name.split(".")[0] for p in package.rglob("*.nb[ic]")})


def test_a_changed_kernel_drops_its_cache_once(package):
    assert drop_stale_cache(package) == ["room/_kernels.py"]  # of unknown origin
    assert [p.name for p in (package / "room" / "__pycache__").iterdir()] == ["verb.cpython-311.pyc"]
    add_kernel(package, "room/_kernels.py")
    assert not drop_stale_cache(package)
    assert cached(package) == ["_kernels"]
    add_kernel(package, "room/_kernels.py", "a = 2\n")
    assert drop_stale_cache(package)
    assert not drop_stale_cache(package)
    assert not cached(package)


def test_kernels_in_a_private_folder_count(package):
    add_kernel(package, "room/part/_kernels/fit.py")
    drop_stale_cache(package)
    add_kernel(package, "room/part/_kernels/fit.py", "a = 2\n")
    assert drop_stale_cache(package) == ["room/part/_kernels/fit.py"]


def test_who_imports_a_changed_kernel_is_dropped_too_and_nobody_else(package):
    name = package.name
    sources = {
        "a/_kernels/low.py": "a = 1\n",
        "a/_kernels/other.py": "a = 1\n",
        "a/_kernels/middle.py": f"from {name}.a._kernels.low import a\n",
        "b/_high.py": f"def f():\n    from {name}.a._kernels import middle, other\n",
        "b/_plain.py": f"import {name}.a._kernels.middle\n",
    }
    for path, text in sources.items():
        add_kernel(package, path, text)
    drop_stale_cache(package)
    for path, text in sources.items():
        add_kernel(package, path, text)
    add_kernel(package, "a/_kernels/low.py", "a = 2\n")
    drop_stale_cache(package)
    assert cached(package) == ["other"]


def test_a_kernel_that_is_gone_takes_its_cache_and_its_users_along(package):
    add_kernel(package, "room/_user.py", f"from {package.name}.room._kernels import a\n")
    drop_stale_cache(package)
    add_kernel(package, "room/_user.py", f"from {package.name}.room._kernels import a\n")
    add_kernel(package, "room/_kernels.py")
    (package / "room" / "_kernels.py").unlink()
    drop_stale_cache(package)
    assert not cached(package)


def test_another_numba_drops_all(package, monkeypatch):
    drop_stale_cache(package)
    add_kernel(package, "room/_kernels.py")
    monkeypatch.setattr("windmark.geometry._jit.nb.__version__", "0.0")
    assert drop_stale_cache(package) == ["room/_kernels.py"]


@pytest.mark.parametrize("text", ["", "{", "[1]", "\x00"])
def test_a_damaged_mark_drops_all(package, text):
    drop_stale_cache(package)
    add_kernel(package, "room/_kernels.py")
    (package / "__pycache__" / "kernels.json").write_text(text)
    assert drop_stale_cache(package) == ["room/_kernels.py"]


def test_other_sources_do_not_count(package):
    before = kernel_sources(package)
    (package / "room" / "verb.py").write_text("b = 2\n")
    (package / "room" / "__init__.py").write_text("from room.verb import b\n")
    assert kernel_sources(package) == before


def test_where_nothing_can_be_written_nothing_happens(package, monkeypatch):
    from pathlib import Path

    def refused(*_, **__):
        raise PermissionError(13, "read-only")

    monkeypatch.setattr(Path, "unlink", refused)
    assert not drop_stale_cache(package)
    assert cached(package) == ["_kernels"]
