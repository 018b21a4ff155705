"""Paths as results tell them: from the test's folder on, or the name alone; never whose machine it was."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

_ABSOLUTE = re.compile(r"(?<![\w./~-])(?:[A-Za-z]:[\\/]|/)(?:[^\s/\\:;,\"'“”<>|]+[/\\])+(?=[^\s/\\])")
"""The folders of an absolute path, of either kind of system, that stands in a sentence."""


def bare(path: str | PurePath) -> str:
    """A path without what leads out of the test: steps upwards and the folders behind them, roots, drives."""
    parts = PurePath(path).parts
    if PurePath(path).is_absolute() or ".." in parts:
        return PurePath(path).name
    return PurePath(path).as_posix()


def told(text: str, *folders: Path) -> str:
    """A sentence without private paths: what is below one of ``folders`` (and below the working and the home folder)
    is told from there, of other absolute paths only the name is left.
    """
    for folder in (*folders, Path.cwd(), Path.home()):
        if len(folder.parts) > 1:
            text = text.replace(f"{folder}{os.sep}", "")
    return _ABSOLUTE.sub("", text)


def path_told(path: PurePath, *folders: Path) -> str:
    """A path from the first of ``folders`` that it is below; of one that is elsewhere only the name."""
    for folder in folders:
        if path.is_relative_to(folder):
            return path.relative_to(folder).as_posix()
    return bare(path)


def without_folders(value: Any, *folders: Path) -> Any:
    """A record in which no path and no sentence has a private folder; ``folders`` as in `told`."""
    if isinstance(value, Mapping):
        return {k: without_folders(v, *folders) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [without_folders(v, *folders) for v in value]
    if isinstance(value, PurePath):
        return path_told(value, *folders)
    return told(value, *folders) if isinstance(value, str) and ("/" in value or "\\" in value) else value
