"""What people type: commands as they can be copied from what was said, and words that were mistyped."""

from __future__ import annotations

import os
import shlex
import subprocess
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


def typed(*words: str | Path) -> str:
    """The words of a command line, quoted where the shell of this system needs it; patterns stay patterns."""
    return " ".join(_quoted(str(word)) for word in words)


def nearest(word: str, words: Iterable[str]) -> str:
    """", did you mean ...?" where one of these looks like the given one; "" otherwise."""
    near = get_close_matches(word, list(words), 1, 0.6)
    return f", did you mean {near[0]}?" if near else ""


def _quoted(word: str) -> str:
    if os.name == "nt":
        return subprocess.list2cmdline([word])
    folder, slash, pattern = word.rpartition("/")
    if "*" in pattern:  # quoted it would be a name
        return f"{shlex.quote(folder) if folder else ''}{slash}{pattern}"
    return shlex.quote(word)
