"""A command as it can be typed, or copied from what was said."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path


def typed(*words: str | Path) -> str:
    """The words of a command line, quoted where the shell of this system needs it; patterns stay patterns."""
    return " ".join(_quoted(str(word)) for word in words)


def _quoted(word: str) -> str:
    if os.name == "nt":
        return subprocess.list2cmdline([word])
    folder, slash, pattern = word.rpartition("/")
    if "*" in pattern:  # quoted it would be a name
        return f"{shlex.quote(folder) if folder else ''}{slash}{pattern}"
    return shlex.quote(word)
