"""The hidden folder in which a result is made before it is put in its place: where it stands, who holds it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from windmark.io.errors import FileError, reason
from windmark.io.interrupts import interrupts_wait
from windmark.io.lock import TRIES, being_removed, claimed, holder, let_go, locked, unlocked

HIDDEN = ".windmark"
"""Name of the hidden folder inside a target; beside it, the target's own name follows."""
_LOCK, _PROBE = "lock", ".windmark-probe"
_LONGEST = 200

Say = Callable[[str], None]


def silent(_text: str) -> None:
    """Say nothing."""


@dataclass
class Staging:
    """A hidden folder that this process holds: ``new`` is written to, ``old`` takes what is replaced.

    Parameters
    ----------
    target : the folder that the result is for
    hidden : beside the target, or inside of it where it is on another disk or its parent cannot be written to
    lock : descriptor of the locked file
    made : folders above the target that were made for it, the highest first
    keep : `release` leaves what is in it, as it can be gone on with
    """

    target: Path
    hidden: Path
    lock: int
    made: tuple[Path, ...] = ()
    keep: bool = False

    @property
    def beside(self) -> bool:
        """Whether it stands beside the target."""
        return self.hidden.parent == self.target.parent

    @property
    def new(self) -> Path:
        """Where the result is written."""
        return self.hidden / "new"

    @property
    def old(self) -> Path:
        """What was taken out of the target."""
        return self.hidden / "old"

    @property
    def journal(self) -> Path:
        """What the exchange of old and new has to do; there from the moment on when the new result is whole."""
        return self.hidden / "exchange.json"

    @property
    def draft(self) -> Path:
        """The journal while it is written."""
        return self.hidden / "exchange.new"

    def clear(self) -> None:
        """Remove what is in it, not the lock."""
        for part in (self.new, self.old):
            shutil.rmtree(part, ignore_errors=True)
        for note in (self.draft, self.journal):
            note.unlink(missing_ok=True)

    def release(self) -> None:
        """Remove it and let go of the lock; folders made for a target that did not come are removed, too."""
        if not self.keep:
            with suppress(OSError):
                self.clear()
        _release(self.hidden, self.lock)
        for folder in reversed(self.made):
            with suppress(OSError):  # not empty: the target is there
                folder.rmdir()


def hidden_places(target: Path) -> tuple[Path, ...]:
    """Where the hidden folder of a target may stand: beside it, inside of it."""
    if not target.name:  # the top of a disk
        return (target / HIDDEN,)
    return target.with_name(f"{HIDDEN}-{target.name[:_LONGEST]}"), target / HIDDEN


def checked_folder(path: str | os.PathLike[str]) -> Path:
    """The folder meant by ``path``, links followed; it need not be there.

    Raises
    ------
    FileError
        Where it can never be a folder that is written to: a file, links in a circle, below a file.
    """
    target = resolved(path)
    if target.exists() and not target.is_dir():
        raise FileError(path, "this is a file; expected a folder")
    return target


def resolved(path: str | os.PathLike[str]) -> Path:
    """What ``path`` stands for, links followed; it need not be there.

    Raises
    ------
    FileError
        Where nothing can ever be there: links in a circle, below a file, a name that is too long.
    """
    try:
        os.stat(path)
    except FileNotFoundError:
        pass
    except OSError as error:
        raise FileError(path, f"cannot be written: {reason(error)}") from error
    return Path(os.path.realpath(path))


def stage(path: str | os.PathLike[str], say: Say = silent, *, parents: bool = True) -> Staging:
    """Hold a hidden folder for a target, and try that the result can be put into its place from there.

    A file is really moved from it into the target, or the target made and removed, so that a bad output is known
    before the work. What a killed run left in the folder is still there: see `result_folder`.

    Parameters
    ----------
    path : the folder of the result
    say : takes a sentence for the user
    parents : make missing folders above the target

    Raises
    ------
    FileError
        When another run holds the target (names its process), or nothing can be written there (says why).
    """
    target = checked_folder(path)
    made = _make_parents(path, target, parents)
    try:
        return _stage(path, target, made, say)
    except BaseException:
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()
        raise


@contextmanager
def staged(path: str | os.PathLike[str], say: Say = silent, *, parents: bool = True) -> Iterator[Staging]:
    """`stage` for a block; what the block leaves in it is removed unless it says `Staging.keep`.

    What asks the process to end waits while it is taken and while it is let go of, so that no half of it is left.
    """
    held: Staging | None = None
    try:
        with interrupts_wait():
            held = stage(path, say, parents=parents)
        yield held
    finally:
        if held is not None:
            with interrupts_wait():
                held.release()


def busy(path: str | os.PathLike[str], process: str) -> FileError:
    """The refusal of a folder that another run holds."""
    what = f"another run writes into this folder ({process}); wait for it to end, or choose another one"
    return FileError(path, what)


def check_free(path: str | os.PathLike[str]) -> None:
    """`FileError` where another run holds a folder."""
    for hidden in hidden_places(checked_folder(path)):
        if process := in_use(hidden):
            raise busy(path, process)


def _stage(path: str | os.PathLike[str], target: Path, made: tuple[Path, ...], say: Say) -> Staging:
    first: OSError | None = None
    for hidden in hidden_places(target):
        if hidden.parent == target and not target.is_dir():
            continue
        try:
            lock = _take(hidden, path, say)
        except OSError as error:
            first = first or error
            continue
        staging = Staging(target, hidden, lock, made)
        try:
            _try(target, hidden)
        except OSError as error:  # another disk: what stands beside the target cannot be moved into it
            first = first or error
            _release(hidden, lock)
            continue
        return staging
    assert first is not None
    raise FileError(path, f"cannot be written: {reason(first)}") from first


def _make_parents(path: str | os.PathLike[str], target: Path, wanted: bool) -> tuple[Path, ...]:
    missing = []
    for folder in target.parents:
        if folder.exists():
            break
        missing.append(folder)
    if missing and not wanted:
        raise FileError(path, f"the folder {target.parent} does not exist")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.filename or target.parent}: {reason(error)}") from error
    return tuple(reversed(missing))


def _try(target: Path, hidden: Path) -> None:
    """Move something from the hidden folder to where the result will be."""
    probe = hidden / _PROBE
    if not target.exists():
        target.mkdir()
        target.rmdir()
        return
    try:
        probe.write_bytes(b"?")
        os.replace(probe, target / _PROBE)
        (target / _PROBE).unlink()
    finally:
        probe.unlink(missing_ok=True)


def in_use(hidden: Path) -> str:
    """The process, in words, that holds this hidden folder; "" where none does."""
    try:
        lock = os.open(hidden / _LOCK, os.O_RDWR)
    except OSError:
        return ""
    try:
        return "" if locked(lock) else holder(lock)
    except NotImplementedError:
        return ""
    finally:
        unlocked(lock)


def _take(hidden: Path, path: str | os.PathLike[str], say: Say) -> int:
    """Descriptor of the hidden folder's lock file, locked by us."""
    for k in range(TRIES):
        try:
            # Made by us alone or left by a killed run; a run that just ends removes it at any moment.
            with suppress(FileExistsError):
                hidden.mkdir()
            lock = os.open(hidden / _LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:
            continue
        except PermissionError:
            being_removed(k)
            continue
        except OSError:  # no room for one more file
            with suppress(OSError):
                hidden.rmdir()
            raise
        try:
            if not locked(lock):
                raise busy(path, holder(lock))
        except NotImplementedError:
            say("this disk has no locks: a second run into the same folder would not be noticed")
            return lock
        except BaseException:
            os.close(lock)
            raise
        try:
            if claimed(lock, hidden / _LOCK):
                return lock
        except BaseException:  # the disk is too full to sign it
            with suppress(OSError):
                hidden.rmdir()
            raise
    raise FileError(path, "other runs come and go in this folder; choose another one")


def _release(hidden: Path, lock: int) -> None:
    let_go(lock, hidden / _LOCK)
    with suppress(OSError):
        hidden.rmdir()
