"""Where the results of a project go: into a folder of their own."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from windmark.errors import UsageError
from windmark.io.errors import FileError
from windmark.pipeline.settings import COMMAND_LINE, naming

KEY = "output.folder"


def result_place(settings: Path, folder: Path) -> Path:
    """The folder of the results, absolute.

    Raises
    ------
    FileError
        Where it is that of the project itself or one above it, the home folder or a whole disk, whose files would then
        stand among the results; or a file.
    """
    with naming(settings, KEY, "the path of a folder"):
        full = (settings.parent / folder).resolve()
        why = _unfit(settings, full)
    if why is not None:
        raise FileError(settings, f"{folder}: {why}", KEY)
    return full


def check_output(settings: Path, folder: Path, option: str = "--output") -> None:
    """The same of a folder that was typed, before the settings file is read, whose key it replaces.

    Raises
    ------
    UsageError
        As `result_place`; names the option.
    """
    with naming(settings, KEY, "the path of a folder"):
        why = _unfit(settings, folder.resolve())
    if why is not None:
        raise UsageError(f"{option} {folder}: {why}")


def _unfit(settings: Path, full: Path) -> str | None:
    """Why no results go there; None where they may."""
    own, what = settings.parent.resolve(), None
    if full.parent == full:
        what = "a whole disk"
    elif full == _home():
        what = "your home folder"
    elif settings.name != COMMAND_LINE and full == own:
        what = "the folder of the project itself"
    elif settings.name != COMMAND_LINE and full in own.parents:
        what = f"{full}, above the folder of the project"
    elif full.exists() and not full.is_dir():
        what = "a file"
    return None if what is None else f"this is {what}; expected a folder for the results alone"


def _home() -> Path | None:
    """The user's home folder; None where the system names none."""
    with suppress(RuntimeError, OSError):
        return Path.home().resolve()
    return None
