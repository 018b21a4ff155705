"""What the viewer holds: a project, its last run, what has been changed since; one job at a time."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from windmark import io
from windmark.app import verbs
from windmark.app.viewer.spots import Told, exclude_spot, free_spot, name_spot
from windmark.errors import UsageError, WindmarkError
from windmark.io.manifest import relative
from windmark.pipeline.changes import Change, Seen, changes, seen
from windmark.pipeline.job import run_project
from windmark.pipeline.project import Project, read_project
from windmark.pipeline.results import RunResult

_AS_RUN = {"roles": [], "no_occlusion": False, "binding": False}
"""Options of `windmark run` that the manifest of a run without any has."""


class Ended(BaseException):
    """The viewer ends: the job at work stops at its next stage, and nothing of it is written."""


@dataclass(frozen=True)
class Shown:
    """A run as the page has it.

    Parameters
    ----------
    result : of the job
    number : of the run, from 1
    page : whole, as HTML
    written : whether it was written into the result folder
    changed : against the run before; empty for the first one
    """

    result: RunResult
    number: int
    page: str
    written: bool
    changed: tuple[Change, ...] = ()


@dataclass
class Session:
    """State of one viewer. Requests come from several threads: what they change is changed under ``lock``."""

    path: Path
    draw: Callable[[Shown], str]
    shown: Shown | None = None
    stage: str = ""
    problem: str = ""
    """Why the last run gave nothing."""
    said: list[str] = field(default_factory=list)
    """Of the last run: what was kept, what had to be done."""
    edits: list[str] = field(default_factory=list)
    """What was written into the project since the last run."""
    lock: threading.RLock = field(default_factory=threading.RLock)
    _job: threading.Thread | None = None
    _ending: bool = False

    @property
    def busy(self) -> bool:
        """Whether a job is at work."""
        return self._job is not None and self._job.is_alive()

    def start(self, *, write: bool) -> None:
        """Begin a run in a thread of its own; ``write``: into the result folder, as `windmark run`.

        Raises
        ------
        UsageError
            While another run is at work.
        """
        with self.lock:
            if self.busy:
                raise UsageError("a run is at work; wait until it is done")
            self.stage, self.problem, self.said = "start", "", []
            self._job = threading.Thread(target=self._work, args=(write,), name="run")
            self._job.start()

    def end(self) -> None:
        """Stop the job at work, if any, and wait for it."""
        self._ending = True
        if self._job is not None:
            self._job.join()

    def _show(self, stage: str) -> None:
        if self._ending:
            raise Ended
        self.stage = stage

    def _work(self, write: bool) -> None:
        try:
            self._run(write)
        except Ended:
            pass
        except WindmarkError as error:
            self.problem = str(error)
        except OSError as error:
            of = "" if error.filename is None else f"{error.filename}: "
            self.problem = f"{of}{io.reason(error)}"
        except MemoryError:
            self.problem = "not enough memory for these images or this grid"
        except Exception as error:
            traceback.print_exc()
            self.problem = f"a fault of windmark, not of your data ({type(error).__name__}: {error})"

    def _run(self, write: bool) -> None:
        before: Seen | None = None if self.shown is None else seen(self.shown.result)
        number = 1 if self.shown is None else self.shown.number + 1
        with self.lock:
            edits = list(self.edits)
        with io.witness():
            project = read_project(self.path)
            if write:
                folder = project.output.folder
                with io.result_folder(folder, self._about(folder), say=self.said.append) as out:
                    result, _ = verbs.carry_out_in(out, project, self._show)
            else:
                result = run_project(project, progress=self._show)
        self._show("draw the page")
        changed = () if before is None else tuple(changes(before, seen(result)))
        shown = Shown(result, number, "", write, changed)
        shown = replace(shown, page=self.draw(shown))
        with self.lock:
            self.shown = shown
            self.edits = self.edits[len(edits) :]

    def _about(self, folder: Path) -> dict[str, Any]:
        """The manifest's head, so that `windmark verify` can repeat the run."""
        return {"verb": "run", "options": {"project": relative(self.path, folder), **_AS_RUN}}

    def of_run(self, number: Any) -> RunResult:
        """The result that a page of this number shows; a page of an earlier run is refused, its spots are others."""
        if self.shown is None or number != self.shown.number:
            raise UsageError("this page is of an earlier run; reload it")
        return self.shown.result

    def edit(self, what: str, said: dict[str, Any]) -> None:
        """Name, exclude or free a spot: written into the project file at once.

        Raises
        ------
        UsageError
            While a run reads the project, for a page of an earlier run, an unknown image, spot or marker.
        WindmarkError
            Where the project file cannot be edited, see `edit_spots`.
        """
        with self.lock:
            if self.busy:
                raise UsageError("a run is at work and reads the project; wait until it is done")
            result, image, spot = self.of_run(said.get("run")), said.get("image"), said.get("spot")
            project = read_project(self.path)
            if what == "name":
                words = name_spot(result, project, str(image), spot, said.get("marker"))
            elif what == "exclude":
                words = exclude_spot(result, project, str(image), spot)
            else:
                words = free_spot(result, project, str(image), spot)
            self.edits.append(words)

    def state(self) -> dict[str, Any]:
        """What the page asks for again and again, and after each edit."""
        with self.lock:
            out = {
                "run": 0 if self.shown is None else self.shown.number, "busy": self.busy, "stage": self.stage,
                "problem": self.problem, "edits": self.edits, "images": {}, "unread": "",
            }  # fmt: skip
            if self.shown is not None:
                try:
                    out["images"] = _told(self.shown.result, read_project(self.path))
                except WindmarkError as error:  # being edited by hand at this moment
                    out["unread"] = str(error)
            return out


def _told(result: RunResult, project: Project) -> dict[str, Any]:
    """What the project file says of the spots, by image."""
    entries = {entry.label: entry for entry in project.image}
    within = project.register_.label_distance_px
    return {
        item.name: Told.of(entries[item.name], item.detections, within).record()
        for item in result.images
        if item.name in entries
    }
