"""A sequence that can go on where it was stopped, however suddenly: a journal of its frames, and its state beside it.

The journal (`JOURNAL`) has one record before the first frame: what the run was made with. Then it has one for every
frame: its numbers, its state where the film keeps it, which pictures it was measured from, and how long every table was
when the frame was in it. What one frame hands on to the next (`STATE`) is replaced whole after every frame. Stopped
between the two, a run goes on one frame earlier.

Values are pickled; what is read back may be made of windmark's own nouns and of arrays only. The test itself (cameras,
markers, laws, which may be a user's functions) is not written but read from the project again, and referred to.
"""

from __future__ import annotations

import csv
import hashlib
import io as streams
import json
import pickle
import shutil
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

import windmark
from windmark import io
from windmark.deformation import Deformation
from windmark.deformation.volumes import placed_again
from windmark.io.atomic import replace_file, writing
from windmark.io.errors import reading
from windmark.io.journal import AppendedFile, Journal, read_journal
from windmark.pipeline.deform.project import RECORDING, DeformProject
from windmark.pipeline.deform.record import FrameRecord
from windmark.pipeline.deform.task import DeformationTest, DeformedFrame, FrameImages

HIDDEN = ".windmark-series"
"""Folder within that of the results; it is no part of these."""
JOURNAL, STATE = f"{HIDDEN}/journal", f"{HIDDEN}/state"
TITLE = "windmark: frames of a deformation test that is not finished; windmark deform PROJECT --resume goes on"
_STATE_HEAD = struct.Struct("<QI")
_ARRAYS = {
    "builtins": ("set", "frozenset", "slice", "complex"),
    "pathlib": ("PosixPath", "WindowsPath"),
    "numpy": ("ndarray", "dtype"),
    **dict.fromkeys(("numpy._core.multiarray", "numpy.core.multiarray"), ("_reconstruct", "scalar")),
    **dict.fromkeys(("numpy._core.numeric", "numpy.core.numeric"), ("_frombuffer",)),
}
"""What values are made of besides windmark's nouns: module -> names."""


@dataclass(frozen=True)
class Kept:
    """What the journal has of one frame.

    Parameters
    ----------
    row : its numbers
    state : its deformation where the film keeps it
    compared : the frame itself and its pictures where it is the most deformed one so far that was mapped; the pictures
        None where they are frames of a recording
    pictures : camera -> its pictures' name, size and checksum
    sizes : table -> its length in bytes
    """

    row: FrameRecord
    state: Deformation | None
    compared: tuple[DeformedFrame, FrameImages | None] | None
    pictures: Mapping[str, str]
    sizes: Mapping[str, int]


@dataclass
class Stopped:
    """What a run that was stopped has left.

    Parameters
    ----------
    made_with : see `made_with`
    sizes : table -> its length before the first frame
    frames : what is known of every frame
    end : of the journal, behind the last of them
    first : end of the journal before the first frame
    state : what the last frame hands on, pickled; None where that is not known: nothing more can be measured
    """

    made_with: dict[str, Any]
    sizes: Mapping[str, int]
    frames: list[Kept] = field(default_factory=list)
    end: int = 0
    first: int = 0
    state: bytes | None = None


class SequenceJournal:
    """The journal of a running sequence.

    Parameters
    ----------
    folder : where it is written
    test : what is referred to, not written
    stopped : what it goes on with; None for a new one
    """

    def __init__(self, folder: Path, test: DeformationTest, stopped: Stopped | None) -> None:
        self._folder, self._names = folder, _referred(test)
        self._count = 0 if stopped is None else len(stopped.frames)
        (folder / HIDDEN).mkdir(exist_ok=True)
        self._journal = Journal(folder / JOURNAL, TITLE, None if stopped is None else stopped.end)

    def begin(self, made: Mapping[str, Any], sizes: Mapping[str, int]) -> None:
        """The record before the first frame, to which nothing is handed on."""
        self._journal.add(dumped((dict(made), dict(sizes)), self._names))
        self._hand_on({})

    def add(self, kept: Kept, state: Mapping[str, Any]) -> None:
        """A frame that is in the tables, and what it hands on."""
        before = self._journal.size
        try:
            self._journal.add(dumped(kept, self._names))
            self._count += 1
            self._hand_on(state)
        except BaseException:
            self._journal.take_back(before)
            raise

    def _hand_on(self, state: Mapping[str, Any]) -> None:
        content = dumped(dict(state), self._names)
        replaced_file(self._folder, STATE, _STATE_HEAD.pack(self._count, zlib.crc32(content)) + content)

    def sync(self) -> None:
        """Make it outlast a power failure."""
        self._journal.sync()

    def close(self) -> None:
        """End writing."""
        self._journal.close()


def replaced_file(folder: Path, name: str, content: bytes) -> None:
    """Write a file anew and put it in its place whole; what a kill leaves of it is written over the next time."""
    path, new = folder / name, folder / HIDDEN / "new"
    file = AppendedFile(new)
    try:
        file.append(content)
    finally:
        file.close()
    with writing(path, path, new):
        replace_file(new, path)


def read_stopped(folder: Path, test: DeformationTest, *, to_go_on: bool = True) -> Stopped | None:
    """What a run that was stopped has left in a folder; None where there is none.

    Parameters
    ----------
    folder, test : where it was written; its test, read again
    to_go_on : with the state that the last frame hands on; without a frame that has its record, but not its state yet

    Raises
    ------
    FileError
        For a journal that cannot be understood.
    """
    if not (folder / JOURNAL).is_file():
        return None
    named = dict(_named(test))
    out: Stopped | None = None
    for content, end in read_journal(folder / JOURNAL, TITLE):
        try:
            value = loaded(content, named)
        except Exception as error:  # pickle fails in many ways, above all on what another version wrote
            raise io.FileError(
                folder / JOURNAL, f"written by another version of windmark, or damaged: {error}"
            ) from error
        if out is None:
            out = Stopped(value[0], value[1], first=end, end=end)
        else:
            out.frames.append(value)
            out.end = end
    if out is not None and to_go_on:
        _with_state(out, folder)
    return out


def _with_state(out: Stopped, folder: Path) -> None:
    """Take the state if it is that of the last frame or the one before, which is then the last one."""
    try:
        content = (folder / STATE).read_bytes()
        count, crc = _STATE_HEAD.unpack_from(content)
    except (OSError, struct.error):
        return
    content = content[_STATE_HEAD.size :]
    if zlib.crc32(content) == crc and len(out.frames) - 1 <= count <= len(out.frames):
        out.state = content
        ends = [out.first, *(end for _, end in read_journal(folder / JOURNAL, TITLE))][1:]
        out.end = ends[count]
        del out.frames[count:]


def loaded_state(stopped: Stopped, test: DeformationTest) -> dict[str, Any]:
    """What the last frame of a run that was stopped hands on, see `follow_deformation`."""
    return {} if stopped.state is None else dict(loaded(stopped.state, dict(_named(test))))


def files_told(folder: Path, sizes: Mapping[str, int]) -> dict[tuple[str, str], str]:
    """Camera and name of the files that the table of arrivals has -> what became of them."""
    name = "arrivals.csv"
    if name not in sizes:
        return {}
    with reading(folder / name):
        text = (folder / name).read_bytes()[: sizes[name]].decode()
    return {(row["camera"], row["file"]): row["fate"] for row in csv.DictReader(text.splitlines())}


def begun_with(folder: Path) -> dict[str, Any] | None:
    """What a run that was stopped was made with, see `made_with`; None where there is none."""
    if not (folder / JOURNAL).is_file():
        return None
    for content, _ in read_journal(folder / JOURNAL, TITLE):
        try:
            made: dict[str, Any] = loaded(content, {})[0]
        except Exception as error:
            raise io.FileError(
                folder / JOURNAL, f"written by another version of windmark, or damaged: {error}"
            ) from error
        return made
    return None


def measured(folder: Path) -> int:
    """How many frames a run that was stopped has left in a folder; 0 where there is none."""
    if not (folder / JOURNAL).is_file():
        return 0
    return max(sum(1 for _ in read_journal(folder / JOURNAL, TITLE)) - 1, 0)


def clear(folder: Path) -> None:
    """Take away what only a run that goes on needs."""
    shutil.rmtree(folder / HIDDEN, ignore_errors=True)


def made_with(project: DeformProject) -> dict[str, Any]:
    """Version, options and the SHA-256 of every file that a run is made with; where its results go is left out."""
    options = json.loads(project.model_dump_json(exclude={"path": True, "output": {"folder"}, "watch": True}))
    return {"version": windmark.__version__, "options": options, "files": {k: _sha256(p) for k, p in inputs(project)}}


def inputs(project: DeformProject) -> list[tuple[str, Path]]:
    """The files besides pictures that a project names, each with its key."""
    out: list[tuple[str, Path | None]] = [
        ("markers.file", project.markers.file),
        ("sequence.frames", project.sequence.frames),
    ]
    out.append(("grid.file", None if project.grid is None else project.grid.file))
    for camera in project.camera:
        times = None if camera.times == RECORDING else camera.times
        out += [
            (f"camera {camera.name}: {k}", p)
            for k, p in (("file", camera.file), ("mask", camera.mask), ("times", times))
        ]
    for volume in project.volume:
        named = [str(volume.options["table"])] if "table" in volume.options else []
        named += [f"{volume.law.partition('.py')[0]}.py"] if volume.law is not None and ".py" in volume.law else []
        out += [(f"volume {volume.name}: {name}", (project.path.parent / name).resolve()) for name in named]
    out += [(f"points {p.label}: file", p.file) for p in project.points]
    return [(key, path) for key, path in out if path is not None]


def changed(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """What a run was made with otherwise, in words; None where all is the same."""
    if before["version"] != now["version"]:
        return f"it was begun by windmark {before['version']}, this is {now['version']}"
    for key, digest in now["files"].items():
        if before["files"].get(key) != digest:
            return f"{key} has changed since"
    for key in sorted({*before["options"], *now["options"]}):
        if before["options"].get(key) != now["options"].get(key):
            return f"[{key}] of the project has changed since"
    return None if before == dict(now) else "other files take part now"


def pictures_of(frame: FrameImages) -> dict[str, str]:
    """Camera -> its pictures of an instant: name, size, checksum; of a recording its file's size, date and number."""
    out = {}
    for name, image in frame.images.items():
        shots = [shot.image for shot in frame.shots.get(name, ())]
        out[name] = " ".join(_print(item) for item in (image, *shots) if isinstance(item, io.PictureFile))
    return out


def _print(item: io.PictureFile) -> str:
    path = item if isinstance(item, Path) else item.path
    try:
        if isinstance(item, io.Frame):
            stat = path.stat()
            return f"{path.name}[{item.number}]:{stat.st_size}:{stat.st_mtime_ns}"
        content = path.read_bytes()
    except OSError:
        return f"{path.name}:gone"
    return f"{path.name}:{len(content)}:{zlib.crc32(content):08x}"


def _sha256(path: Path) -> str:
    with reading(path), open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


# --- values as bytes -------------------------------------------------------------------------
def _named(test: DeformationTest) -> list[tuple[str, Any]]:
    """What is the same object in all frames, by name: poses of cameras that stand still are told by that."""
    out: list[tuple[str, Any]] = [("markers", test.markers), ("volumes", test.volumes), ("marker_cov", test.marker_cov)]
    out += [(f"volume {part.name}", part) for part in test.volumes.parts]
    out += [(f"law {part.name}", part.law) for part in test.volumes.parts]
    for s in test.stations:
        out += [(f"camera {s.name}", s.camera), (f"pose {s.name}", s.cam_from_tunnel), (f"cov {s.name}", s.pose_cov)]
    return [(name, value) for name, value in out if value is not None]


def _referred(test: DeformationTest) -> dict[int, str]:
    return {id(value): name for name, value in _named(test)}


class _Pickler(pickle.Pickler):
    def __init__(self, stream: streams.BytesIO, names: Mapping[int, str]) -> None:
        super().__init__(stream, protocol=5)
        self._names = names

    def persistent_id(self, obj: Any) -> str | None:
        return self._names.get(id(obj))


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: streams.BytesIO, named: Mapping[str, Any]) -> None:
        super().__init__(stream)
        self._named = named

    def persistent_load(self, pid: str) -> Any:
        return self._named[pid]

    def find_class(self, module: str, name: str) -> Any:
        """Nothing but arrays, plain containers, and nouns: calling one of these only makes a value."""
        if module in _ARRAYS and name in _ARRAYS[module]:
            return super().find_class(module, name)
        if module.split(".")[0] == "windmark" and "." not in name:
            found = super().find_class(module, name)
            if found is placed_again or (
                isinstance(found, type) and (is_dataclass(found) or issubclass(found, tuple))
            ):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} has no place in a journal")


def dumped(value: Any, names: Mapping[int, str]) -> bytes:
    """A value as bytes; the objects of ``names`` (by id) are referred to."""
    stream = streams.BytesIO()
    _Pickler(stream, names).dump(value)
    return stream.getvalue()


def loaded(content: bytes, named: Mapping[str, Any]) -> Any:
    """A value from bytes, with the objects that it refers to."""
    return _Unpickler(streams.BytesIO(content), named).load()
