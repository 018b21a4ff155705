"""The Python files that a law's file imports: with them a run that goes on is another one, as with the file itself."""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import windmark


def imported_files(text: str) -> list[Path]:
    """The user's own files among what Python code imports, and what these import; after it was run.

    Told by the code's import statements, which say the same whether the modules were loaded now or before. What belongs
    to Python, to windmark or to an installed package is none of them.

    Parameters
    ----------
    text : the code, which has no fault
    """
    out: dict[Path, None] = {}
    left = [text]
    while left:
        for name in _imports(left.pop()):
            file = getattr(sys.modules.get(name), "__file__", None)
            path = None if file is None else Path(file).resolve()
            if path is None or path in out or path.suffix != ".py" or _installed(path):
                continue
            out[path] = None
            with suppress(OSError, ValueError, SyntaxError):
                left.append(path.read_text(encoding="utf-8"))
    return list(out)


def _imports(text: str) -> Iterator[str]:
    """Names of modules, and of what may be one: ``from a import b`` may mean a.b."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[: k + 1]) for k in range(len(parts)))


def _installed(path: Path) -> bool:
    places = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    homes = [Path(place).resolve() for place in places if place] + [Path(windmark.__file__).resolve().parent]
    return any(path.is_relative_to(home) for home in homes)
