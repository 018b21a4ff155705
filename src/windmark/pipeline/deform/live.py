"""Instants from pictures that appear in a folder: which are complete, in which order, and what became of the others."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from windmark import io
from windmark.io.interrupts import interrupts_wait
from windmark.pipeline.deform.inbox import Arrival, Arriving, Inbox
from windmark.pipeline.deform.names import instant_of, is_number, kind_of, order
from windmark.pipeline.deform.project import DeformProject
from windmark.tasks.deform.task import FrameImages

POLL_S = 0.005
"""How often a watched folder is looked at."""
OVERTAKEN_S = 0.1
"""An instant that lacks a picture though a later one is complete waits so long for it: files overtake each other."""


@dataclass
class _Waiting:
    """An instant whose pictures arrive.

    Parameters
    ----------
    whole : camera -> the picture
    bad : camera -> why it has none
    odd : camera -> what is odd about its picture
    pending : files that are not known to be whole yet
    seen_s : when its newest file was seen
    overtaken_s : since when a later one is complete; None before
    told : its files, and what became of them
    """

    whole: dict[str, Path] = field(default_factory=dict)
    bad: dict[str, str] = field(default_factory=dict)
    odd: dict[str, str] = field(default_factory=dict)
    pending: set[Path] = field(default_factory=set)
    seen_s: float = 0.0
    overtaken_s: float | None = None
    told: list[Arrival] = field(default_factory=list)

    @property
    def is_gone(self) -> bool:
        """Whether nothing is left of it, as of a file that had another name while it was written: it is in no hurry.

        Its number may be any; were it the last one dealt with, all that follow could be too late.
        """
        return not self.pending and all(a.fate == "gone" for a in self.told)


class Watch:
    """Images as they arrive in a folder; iterate over it once.

    An instant is handed on when every camera has it; or when a later one is complete and nothing of it is on its way;
    or when nothing more of it has come for as long as patience lasts. Every frame that is seen is handed on once: with
    its pictures, or with the reason why it is not measured (`FrameImages.skipped`): it came after a later one had been
    measured, or the run ended first.

    Parameters
    ----------
    project : names the cameras and their patterns; only the file names of these count
    folder : where images appear, sub-folders included when the patterns name them
    idle_s : end when nothing has come for so long; None waits for ever (Ctrl-C ends)
    stop_after : end after so many frames that were measured

    Raises
    ------
    FileError
        When there is no such folder.
    """

    def __init__(
        self, project: DeformProject, folder: Path, *, idle_s: float | None = None, stop_after: int | None = None
    ) -> None:
        if not folder.is_dir():
            raise io.FileError(folder, "is no folder; expected one that images are written to")
        self._cameras, self._patience_s = len(project.camera), project.watch.patience_s
        self._idle_s, self._stop_after = idle_s, stop_after
        self._inbox = Inbox(project, folder)
        self._waiting: dict[str, _Waiting] = {}
        self._late: list[FrameImages] = []
        self._current: FrameImages | None = None
        self._done: dict[str, tuple[str, ...]] = {}
        self._last: str | None = None
        self._first: str | None = None
        self._measured = 0
        self.told: list[Arrival] = []
        """Files whose fate is known; whoever writes them down takes them out of the list."""

    def go_on(
        self, done: Collection[str], known: Mapping[tuple[str, str], tuple[int, int] | None], measured: int
    ) -> None:
        """Begin behind a run that was stopped.

        Parameters
        ----------
        done : the frames that it has dealt with, in that order
        known : cameras and names of the files that it has dealt with; size and date of those that it has measured
        measured : how many of the frames it has measured
        """
        self._done, self._measured = dict.fromkeys(done, ()), measured
        self._last, self._first = max(done, key=order, default=None), next(iter(done), None)
        self._inbox.known = dict(known)

    @property
    def foreign(self) -> list[str]:
        """Names of files that match no camera's pattern."""
        return self._inbox.foreign

    def prints(self, frame: FrameImages) -> dict[str, str]:
        """Camera -> name, size and date of its picture of a frame that was handed on."""
        return {camera: self._inbox.print_of(path) for camera, path in frame.images.items()}

    def changed_since(self) -> list[str]:
        """Names of files that were changed after they had been read."""
        return self._inbox.changed_since()

    def __iter__(self) -> Iterator[FrameImages]:
        last_new = time.monotonic()
        while not self._enough:
            now = time.monotonic()
            with interrupts_wait():  # or a file amid two lists would be in neither of them
                last_new = now if self._look(now) else last_new
            for frame in self._due(now):
                yield from self._handed(frame)
                last_new = time.monotonic()
                if self._enough:
                    break
            idle = 0.0 if self._inbox.waiting else time.monotonic() - last_new
            if self._idle_s is not None and idle > self._idle_s and not self._enough:
                waiting = sorted(self._waiting, key=order)  # what never became complete
                if any(self._is_written_again(key, now) for key in waiting):
                    continue
                for key in waiting:
                    yield from self._handed(self._taken(key))
                return
            time.sleep(POLL_S)
        with interrupts_wait():
            self._late = self.left(f"the run ended after {self._stop_after} frames, as asked for")
        for unmeasured in self._too_late():
            yield from self._handed(unmeasured)

    def left(self, why: str) -> list[FrameImages]:
        """The frames that were seen and not handed on, as such that are not measured; to be asked for at the end."""
        with interrupts_wait():
            current = [] if self._current is None else [self._current]
            late, self._late = self._late, []
            waiting = [self._taken(key) for key in sorted(self._waiting, key=order)]
            self._current = None
            left = {f.key for f in (*current, *waiting) if f.skipped is None}
            self.told[:] = [
                replace(a, fate="left", reason=why) if a.fate == "measured" and a.key in left else a for a in self.told
            ]
        return [f if f.skipped else replace(f, skipped=("left", why)) for f in (*current, *late, *waiting)]

    # --- parts -----------------------------------------------------------------------------
    @property
    def _enough(self) -> bool:
        return self._stop_after is not None and self._measured >= self._stop_after

    @property
    def _kind(self) -> str:
        """What says when frames were, see `kind_of`: the first file decides."""
        return kind_of([] if self._first is None else [self._first])

    def _handed(self, frame: FrameImages) -> Iterator[FrameImages]:
        """Hand the current frame on; it counts as dealt with when the next one is asked for."""
        yield frame
        self._current = None
        self._measured += frame.skipped is None

    def _look(self, now: float) -> bool:
        """Take up what is new in the folder and what has become whole; whether there was anything."""
        new = self._inbox.look(now)
        for file in new:
            self._new(file, now)
        for file, fate, reason in self._inbox.settled(now):
            new.append(file)
            if (of := self._waiting.get(file.key)) is not None and file.path in of.pending:
                of.pending.discard(file.path)
                self._settled(of, file, fate, reason, now)
        return bool(new)

    def _new(self, file: Arriving, now: float) -> None:
        self._first = file.key if self._first is None else self._first
        if file.key in self._done:
            self._dealt_with(file)
        elif kind_of([file.key]) != self._kind:
            self._not_measured(file, f"its name is not of the kind of {self._first}: when it was is not known")
        elif self._last is not None and is_number(file.key) and order(file.key) < order(self._last):
            self._not_measured(file, f"it arrived after frame {self._last} had been measured")
        else:
            of = self._waiting.setdefault(file.key, _Waiting())
            of.pending.add(file.path)
            of.seen_s = now

    def _dealt_with(self, file: Arriving) -> None:
        """A file of a frame that has its row already."""
        self._inbox.waiting.pop(file.path, None)
        had = file.camera in self._done[file.key]
        why = f"frame {file.key} was measured with another file of this camera" if had else (
            f"it arrived after frame {file.key} had been dealt with")  # fmt: skip
        self.told.append(Arrival(file.path.name, file.camera, file.key, "duplicate" if had else "late", why))

    def _not_measured(self, file: Arriving, why: str) -> None:
        """A file of a frame that gets its row at once, unmeasured."""
        self._inbox.waiting.pop(file.path, None)
        self.told.append(Arrival(file.path.name, file.camera, file.key, "late", why))
        same = kind_of([file.key]) == self._kind
        instant = instant_of(file.key, self._kind, str(self._first), len(self._done)) if same else float("nan")
        self._done[file.key] = ()
        self._late.append(FrameImages(file.key, instant, {}, skipped=("late", why)))

    def _settled(self, of: _Waiting, file: Arriving, fate: str, reason: str, now: float) -> None:
        of.seen_s = max(of.seen_s, file.seen_s)
        had = of.whole.get(file.camera)
        if fate == "measured" and had is not None and self._inbox.is_as_taken(had):
            fate, reason = "duplicate", f"{had.name} is the same frame of this camera"
            of.odd[file.camera] = f"{had.name}: {file.path.name} is the same frame"
        elif fate == "measured" and had is not None:  # it was renamed, or is written again
            self._look_again(of, file.camera, had, now)
            of.whole[file.camera] = file.path
        elif fate == "measured":
            of.whole[file.camera] = file.path
            if reason:
                of.odd[file.camera] = f"{file.path.name}: {reason}"
        else:
            of.bad[file.camera] = f"{file.path.name}: {reason}"
        of.told.append(Arrival(file.path.name, file.camera, file.key, fate, reason))

    def _due(self, now: float) -> Iterator[FrameImages]:
        """Frames whose turn it is, in order; what came too late first."""
        yield from self._too_late()
        keys = sorted(self._waiting, key=order)
        complete = [k for k in keys if len(self._waiting[k].whole) == self._cameras and not self._waiting[k].pending]
        for key in keys:
            of = self._waiting[key]
            if complete and order(key) < order(complete[-1]) and of.overtaken_s is None:
                of.overtaken_s = now
            settled = not of.pending and (
                key in complete
                or (of.overtaken_s is not None and now - of.overtaken_s >= OVERTAKEN_S)
                or (now - of.seen_s >= self._patience_s and not of.is_gone)
            )
            if not settled or self._is_written_again(key, now):
                return  # the later ones wait for it: instants go on
            yield self._taken(key)

    def _is_written_again(self, key: str, now: float) -> bool:
        """Look again at those of its pictures that are not what they were when they were whole."""
        of = self._waiting[key]
        with interrupts_wait():
            for camera, path in list(of.whole.items()):
                if not self._inbox.is_as_taken(path):
                    self._look_again(of, camera, path, now)
        return bool(of.pending)

    def _look_again(self, of: _Waiting, camera: str, path: Path, now: float) -> None:
        del of.whole[camera]
        of.odd.pop(camera, None)
        of.told = [a for a in of.told if (a.camera, a.file) != (camera, path.name)]
        of.pending.add(path)
        self._inbox.again(path, camera, now)

    def _too_late(self) -> Iterator[FrameImages]:
        """Frames that are not measured, out of those that were put aside; each is the current one then."""
        while self._late:
            with interrupts_wait():
                frame = self._current = self._late.pop(0)
            yield frame

    def _taken(self, key: str) -> FrameImages:
        """A frame with what there is of it, out of the waiting ones; it is the current one then."""
        with interrupts_wait():  # an interrupted run found files told of whose frame was in no list any more
            self._current = self._made_of(key, self._waiting.pop(key))
            return self._current

    def _made_of(self, key: str, of: _Waiting) -> FrameImages:
        for path in sorted(of.pending):
            file = self._inbox.waiting.pop(path, None)
            if file is not None:
                why = "the run ended before it was known to be whole"
                of.told.append(Arrival(path.name, file.camera, key, "left", why))
        self.told += of.told
        kind = self._kind
        instant = instant_of(key, kind, str(self._first), len(self._done))
        self._done[key], self._last = tuple(of.whole), key
        missing = {name: why for name, why in of.bad.items() if name not in of.whole}
        return FrameImages(
            key, instant, of.whole, missing=missing, time_s=instant if kind == "stamp" else float("nan"),
            seen_s=of.seen_s, odd=of.odd,
        )  # fmt: skip


def watch(
    project: DeformProject, folder: Path, *, idle_s: float | None = None, stop_after: int | None = None
) -> Iterator[FrameImages]:
    """Images as they arrive in a folder: `Watch`, for those who need no more than the frames."""
    return iter(Watch(project, folder, idle_s=idle_s, stop_after=stop_after))
