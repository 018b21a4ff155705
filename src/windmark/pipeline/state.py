"""What this installation is made of and can do: for `windmark doctor`, and for reports of faults."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import windmark
from windmark.geometry._jit import kernel_sources, nb
from windmark.geometry._shipped import FOLDER, shipped

PACKAGES = (
    "numpy", "scipy", "numba", "llvmlite", "pydantic", "typer", "pyvista", "vtk", "xarray", "h5netcdf", "h5py",
    "tifffile", "imageio", "pillow", "matplotlib", "rich",
)  # fmt: skip
EXTRAS = {"cluster": "distributed", "fits": "astropy", "video": "av"}
"""Extra -> a module that it brings."""
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox", "microsoft-edge", "safari")
LEAST_FREE = 1e9
"""Bytes of a disk below which a run may not end."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at: its name, what it is, and what is wrong with it ("" nothing)."""

    what: str
    words: str
    trouble: str = ""


def findings(folder: Path) -> list[Finding]:
    """Look at everything; ``folder`` is where results would be written."""
    return [
        Finding("windmark", f"{windmark.__version__}, {Path(windmark.__file__).parent}"),
        Finding("python", f"{platform.python_version()}, {sys.executable}", _python()),
        Finding("system", f"{platform.platform()}, {platform.machine()}"),
        *_packages(), _extras(), _threads(), _kernels(), _display(), _browser(), _encoding(),
        _writable("working folder", folder), _writable("folder for temporary files", Path(tempfile.gettempdir())),
    ]  # fmt: skip


def _python() -> str:
    return "" if sys.version_info >= (3, 11) else "windmark needs Python 3.11 or newer"


def _packages() -> list[Finding]:
    found, gone = [], []
    for name in PACKAGES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            gone.append(name)
    trouble = f"not installed: {', '.join(gone)} (pip install windmark)" if gone else ""
    return [Finding("packages", ", ".join(found), trouble)]


def _extras() -> Finding:
    there = [extra for extra, module in EXTRAS.items() if importlib.util.find_spec(module) is not None]
    rest = [extra for extra in EXTRAS if extra not in there]
    more = f"; not there: {', '.join(rest)} (pip install 'windmark[{','.join(rest)}]')" if rest else ""
    return Finding("extras", f"{', '.join(there) or 'none'}{more}")


def _threads() -> Finding:
    said = ", ".join(f"{name}={os.environ[name]}" for name in THREADS if name in os.environ)
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Finding("threads", f"{allowed} of {os.cpu_count()} processors may be used{f'; {said}' if said else ''}")


def _kernels() -> Finding:
    """How much is compiled: numba keeps an index file for each function that was."""
    from numba import config

    root = Path(windmark.__file__).parent
    brought, why_not = shipped(root, kernel_sources)
    came = sum(1 for _ in (root / FOLDER).rglob("*.nbi")) if brought else 0
    kept = Path(config.CACHE_DIR) if config.CACHE_DIR else root
    count = sum(1 for path in kept.rglob("*.nbi") if root / FOLDER not in path.parents)
    folder = kept if config.CACHE_DIR else root / "geometry" / "__pycache__"
    trouble = ""
    if not _can_write(folder if folder.is_dir() else kept):
        trouble = f"{kept} cannot be written: every run compiles anew; set NUMBA_CACHE_DIR to a folder that can"
    none = "none is compiled here" if came else "none is compiled yet: windmark warmup does it at once"
    words = [f"{came} compiled functions came with the package"] if came else []
    words += [f"those that came with the package are of no use here: {why_not}"] if why_not else []
    words += [f"{count} compiled functions are kept ({kept})" if count else f"{none} ({kept})"]
    if not nb.linked_once:
        words += [f"numba {importlib.metadata.version('numba')} is not as windmark knows it: compiling takes longer, "
                  "results are the same"]  # fmt: skip
    return Finding("kernels", "; ".join(words), trouble)


def _display() -> Finding:
    if sys.platform in ("win32", "darwin"):
        return Finding("display", "the system's own")
    name = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    return Finding("display", name or "none; pictures and reports are drawn without one")


def _browser() -> Finding:
    found = [name for name in BROWSERS if shutil.which(name)]
    told = found or sys.platform in ("win32", "darwin")
    return Finding("browser", ", ".join(found) or ("the system's own" if told else "none found on the path"),
                   "" if told else "reports are HTML files: open them on another machine")  # fmt: skip


def _encoding() -> Finding:
    name = sys.stdout.encoding or "unknown"
    return Finding("terminal", f"{name}, {shutil.get_terminal_size().columns} columns wide")


def _writable(what: str, folder: Path) -> Finding:
    if not _can_write(folder):
        return Finding(what, str(folder), "cannot be written: say another one with --output")
    free = shutil.disk_usage(folder).free
    trouble = "little room: results may not fit" if free < LEAST_FREE else ""
    return Finding(what, f"{folder}, {free / 1e9:.1f} GB free", trouble)


def _can_write(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
