"""Numba's cache beside the sources is dropped exactly when a kernel source has changed."""

import pytest

from windmark.geometry._jit import drop_stale_cache, fingerprint


@pytest.fixture
def package(tmp_path):
    cache = tmp_path / "room" / "__pycache__"
    cache.mkdir(parents=True)
    (tmp_path / "room" / "_kernels.py").write_text("a = 1\n")
    (tmp_path / "room" / "verb.py").write_text("b = 1\n")
    (cache / "_kernels.f-1.py311.nbi").write_bytes(b"index")
    (cache / "_kernels.f-1.py311.1.nbc").write_bytes(b"code")
    (cache / "verb.cpython-311.pyc").write_bytes(b"python's own")
    return tmp_path


def names(package):
    return sorted(p.name for p in (package / "room" / "__pycache__").iterdir())


def test_a_changed_kernel_drops_the_cache_once(package):
    assert drop_stale_cache(package)  # of unknown origin
    assert names(package) == ["verb.cpython-311.pyc"]
    (package / "room" / "__pycache__" / "new.nbi").touch()
    assert not drop_stale_cache(package)
    assert "new.nbi" in names(package)
    (package / "room" / "_kernels.py").write_text("a = 2\n")
    assert drop_stale_cache(package)
    assert "new.nbi" not in names(package)


def test_kernels_in_a_private_folder_count(package):
    inner = package / "room" / "part" / "_kernels"
    (inner / "__pycache__").mkdir(parents=True)
    (inner / "fit.py").write_text("a = 1\n")
    drop_stale_cache(package)
    (inner / "__pycache__" / "fit.f-1.py311.nbi").touch()
    (inner / "fit.py").write_text("a = 2\n")
    assert drop_stale_cache(package)
    assert not any((inner / "__pycache__").iterdir())


def test_other_sources_do_not_count(package):
    before = fingerprint(package)
    (package / "room" / "verb.py").write_text("b = 2\n")
    (package / "room" / "__init__.py").write_text("from room.verb import b\n")
    assert fingerprint(package) == before


def test_where_nothing_can_be_written_nothing_happens(package, monkeypatch):
    from pathlib import Path

    def refused(*_, **__):
        raise PermissionError(13, "read-only")

    monkeypatch.setattr(Path, "unlink", refused)
    assert not drop_stale_cache(package)
    assert len(names(package)) == 3
