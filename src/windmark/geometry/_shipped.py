"""Kernels that came with the package: machine code made when its wheel was built, so that a first use compiles nothing.

Numba's cache is of one processor: its key has the name and all features of the one that compiled. Machine code for
x86-64-v3 (Haswell and Zen: AVX2, FMA, BMI) runs on nearly every machine of the last ten years, so a wheel that is built
by ``packaging/compiled_wheel.py`` brings its cache in ``windmark/compiled``, made for that. It is taken where Python,
numba, system and the sources of all kernels are those that it was made with, and the processor has what it needs; what
is not in it is compiled as ever. What this processor compiled itself comes first.
"""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba

__all__ = ["FOLDER", "NAME", "PROCESSOR", "Shipped", "manifest", "shipped"]

FOLDER, NAME = "compiled", "kernels.json"
PROCESSOR = ("x86-64-v3", "")
"""As ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` have it."""
_NEEDS = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")  # x86-64 psABI, level v3


class Shipped:
    """The compiled kernels that came with a package.

    Parameters
    ----------
    package : the folder of the sources
    folder : the folder of the compiled kernels, laid out as the sources are
    """

    def __init__(self, package: Path, folder: Path) -> None:
        self._package, self._folder = package, folder

    def load(self, source: str, name: str, stamp: Any, key: Any) -> Any:
        """What numba kept of one function, or None.

        ``source``: path of its module; ``name``, ``stamp``: numba's name of its files and mark of the source's state;
        ``key``: numba's, whose processor is exchanged. A file that is damaged counts as missing.
        """
        from numba.core.caching import IndexDataCacheFile

        if not Path(source).is_relative_to(self._package):
            return None
        place = self._folder / Path(source).parent.relative_to(self._package)
        signature, (triple, *_), code = key
        with suppress(OSError, EOFError, pickle.UnpicklingError):
            return IndexDataCacheFile(str(place), name, stamp).load((signature, (triple, *PROCESSOR), code))
        return None


def manifest(sources: dict[str, str]) -> dict[str, Any]:
    """What compiled kernels depend on; ``sources``: hashes of all files with kernels."""
    return {
        "python": f"{sys.implementation.name} {sys.version_info[0]}.{sys.version_info[1]}",
        "numba": numba.__version__,
        "llvmlite": ".".join(llvmlite.__version__.split(".")[:2]),  # which is of one version of LLVM
        "system": llvm.get_process_triple(),
        "sources": sources,
    }


def shipped(package: Path, hashed: Callable[[Path], dict[str, str]]) -> tuple[Shipped | None, str]:
    """The kernels that came with a package, or None, and why they cannot be used ("": none came).

    ``hashed`` gives the hashes of a package's files with kernels.
    """
    folder = package / FOLDER
    if not (folder / NAME).exists():
        return None, ""
    try:
        made = json.loads((folder / NAME).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        return None, f"{folder / NAME} cannot be read ({error})"
    for what, now in manifest(hashed(package)).items():
        was = made.get(what) if isinstance(made, dict) else None
        if was != now:
            detail = "have been changed" if what == "sources" else f"was {was}, is {now}"
            return None, f"{what} {detail}"
    features = llvm.get_host_cpu_features()
    if lacking := [name for name in _NEEDS if not features.get(name)]:
        return None, f"this processor lacks {', '.join(lacking)}"
    return Shipped(package, folder), ""
