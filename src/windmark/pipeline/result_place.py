"""Where the results of a project go: into a folder of their own."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from windmark.io.errors import FileError
from windmark.pipeline.settings import COMMAND_LINE, naming


def result_place(settings: Path, folder: Path) -> Path:
    """The folder of the results, absolute.

    Raises
    ------
    FileError
        Where it is that of the project itself or one above it, the home folder or a whole disk, whose files would then
        stand among the results; or a file.
    """
    with naming(settings, "output.folder", "the path of a folder"):
        full, own = (settings.parent / folder).resolve(), settings.parent.resolve()
        is_file = full.exists() and not full.is_dir()
    why = None
    if full.parent == full:
        why = "is a whole disk"
    elif full == _home():
        why = "is your home folder"
    elif settings.name != COMMAND_LINE and full == own:
        why = "is the folder of the project itself"
    elif settings.name != COMMAND_LINE and full in own.parents:
        why = f"is {full}, above the folder of the project"
    elif is_file:
        why = f"is a file, {full}"
    if why is not None:
        raise FileError(settings, f"{folder} {why}; expected a folder for the results alone", "output.folder")
    return full


def _home() -> Path | None:
    """The user's home folder; None where the system names none."""
    with suppress(RuntimeError, OSError):
        return Path.home().resolve()
    return None
