"""Numba's cache beside the sources is dropped exactly where a kernel source has changed."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import windmark.geometry._jit as jit
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
    monkeypatch.setattr("windmark.geometry._jit.numba.__version__", "0.0")
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
    def refused(*_, **__):
        raise PermissionError(13, "read-only")

    monkeypatch.setattr(Path, "unlink", refused)
    assert not drop_stale_cache(package)
    assert cached(package) == ["_kernels"]


# --- a package that cannot be written to -----------------------------------------------------------


@pytest.fixture
def read_only(monkeypatch):
    """Folders in which nothing can be made (root may write anywhere)."""
    closed = []
    real = jit._writable
    monkeypatch.setattr(jit, "_writable", lambda f: not any(f.is_relative_to(c) for c in closed) and real(f))
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    return closed


def test_the_cache_is_beside_the_sources_or_in_the_users_folder(package, read_only, tmp_path, monkeypatch):
    home = tmp_path / "home"
    monkeypatch.setenv("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME", str(home))
    assert jit.cache_root(package) is None
    read_only.append(package / "room")
    assert jit.cache_root(package) == home / "windmark"
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "own"))
    assert jit.cache_root(package) == tmp_path / "own"


@pytest.mark.skipif(os.name == "nt", reason="temporary folders are a user's own on Windows")
def test_without_a_home_a_temporary_cache_is_said_once(package, read_only, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path))
    read_only += [package / "room", tmp_path / "home"]
    root = tmp_path / f"windmark-kernels-{os.getuid()}"
    assert jit.cache_root(package) == root
    assert stat.S_IMODE(root.stat().st_mode) == 0o700
    assert str(root) in capsys.readouterr().err
    assert jit.cache_root(package) == root
    assert not capsys.readouterr().err
    root.chmod(0o777)  # others may have put machine code into it
    with pytest.raises(PermissionError, match="is not ours alone"):
        jit.cache_root(package)
    assert not jit._ready(package).njit(cache=True)(lambda x: x).stats.cache_path
    assert "compiled anew every time" in capsys.readouterr().err


def test_without_any_cache_kernels_still_run():
    @jit._Numba(cached=False).njit(cache=True)
    def double(x):
        return 2 * x

    assert double(3) == 6
    assert jit._Numba(cached=False).__version__ == numba.__version__


KERNELS = {
    "__init__.py": "",
    "_low.py": "import numba as nb\n@nb.njit(cache=True)\ndef low():\n    return NUMBER\n",
    "_high.py": "import numba as nb\nfrom kernels._low import low\n@nb.njit(cache=True)\ndef high():\n"
    "    return low() + 0\n",
}
CALLED = (
    "import sys, numba\nfrom pathlib import Path\nfrom windmark.geometry._jit import drop_stale_cache\n"
    "package, root = map(Path, sys.argv[1:])\nnumba.config.CACHE_DIR = str(root)\n"
    "dropped = drop_stale_cache(package, root)\nsys.path.insert(0, str(package.parent))\n"
    "from kernels._high import high\nprint(high(), *dropped, len(list(root.rglob('*.nbi'))))\n"
)


@pytest.mark.slow
def test_a_changed_inlined_kernel_is_never_old_machine_code_in_the_users_cache(tmp_path):
    package, root = tmp_path / "kernels", tmp_path / "cache"
    package.mkdir()
    root.mkdir()

    def called(number):
        for name, text in KERNELS.items():
            (package / name).write_text(text.replace("NUMBER", str(number)))
        shutil.rmtree(package / "__pycache__", ignore_errors=True)
        done = subprocess.run([sys.executable, "-c", CALLED, str(package), str(root)], capture_output=True, text=True,
                              check=True)  # fmt: skip
        return done.stdout.split()

    assert called(1) == ["1", "2"]
    assert called(1) == ["1", "2"]
    assert called(2) == ["2", "_high.py", "_low.py", "2"]
