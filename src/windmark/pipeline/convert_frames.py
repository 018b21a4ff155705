"""One recording into another: any camera's files into a TIFF stack, a folder, HDF5, NetCDF or a lossless film."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from windmark import io
from windmark.errors import UsageError

Record = dict[str, Any]


@dataclass(frozen=True)
class FrameOptions:
    """What is wanted of a conversion.

    Parameters
    ----------
    frames : which ones, ``first:stop:step`` as Python has it, or one number; None for all
    pictures : "png" or "tif", of a folder; None takes "tif"
    """

    frames: str | None = None
    pictures: str | None = None


def convert_frames(
    sources: Sequence[Path], target: Path, options: FrameOptions | None = None, *,
    progress: Callable[[str], None] = lambda _: None, say: Callable[[str], None] = lambda _: None,
    about: Mapping[str, Any] | None = None,
) -> Record:  # fmt: skip
    """Write a recording as another one, and read back what was written.

    Parameters
    ----------
    sources : whatever `io.frames` takes; several, all of one size, become one recording
    target : see `io.write_frames`; or ``.png``, ``.jpg``, ``.bmp`` for a single frame
    options : see `FrameOptions`
    progress : told the name of every frame
    say, about : see `io.write_frames`

    Returns
    -------
    ``input, from, output, frames, size_px, dtype, bits, time, notes`` and ``read_back``: how many frames were found in
    the target, each with the very numbers of the source

    Raises
    ------
    ValueError
        For frames or a target that cannot be.
    FileError
        When something cannot be read or written; then there is no target.
    """
    options = options or FrameOptions()
    for source in sources:
        if source.exists() and target.exists() and source.samefile(target):
            raise UsageError(f"{target} is the source itself; expected another file as the target")
    with io.gathered(sources) as recording:
        chosen = choose(recording, options.frames)
        single = target.suffix.lower() in (".png", ".jpg", ".jpeg", ".bmp")
        if single:
            if len(chosen) > 1:
                raise UsageError(f"{target} holds one picture, {sources[0]} {len(chosen)}: say which, as in "
                                 f"{sources[0]}[0]")  # fmt: skip
            io.write_image(target, chosen[0])
            lost: list[str] = [] if chosen.time_s is None else ["the time stamp"]
        else:
            lost = io.write_frames(
                target, chosen, pictures=options.pictures or "tif", each=progress, say=say, about=about
            )
        notes = [part for part in chosen.note.split("; ") if part] + [f"left out: {what}" for what in lost]
        times = chosen.time_s
        return {
            "input": sources[0] if len(sources) == 1 else list(sources), "from": chosen.kind, "output": target,
            "frames": len(chosen), "size_px": chosen.size_px,
            "dtype": chosen.dtype.name, "bits": chosen.bits, "start": chosen.start,
            "time_s": None if times is None else [float(times[0]), float(times[-1])], "notes": notes,
            "read_back": _read_back(chosen, target, options.pictures or "tif"),
        }  # fmt: skip


def choose(recording: io.Frames, text: str | None) -> io.Frames:
    """The frames that ``--frames`` names: ``0:100:2``, ``-10:``, ``7``.

    Raises
    ------
    ValueError
        When it is no such range, or names none.
    """
    if text is None:
        return recording
    parts = text.split(":")
    try:
        numbers = [int(p) if p.strip() else None for p in parts]
        if len(parts) == 1:
            number = int(parts[0])
            which = slice(number, number + 1 or None)
        else:
            which = slice(*numbers)
        chosen = recording[which]
    except (TypeError, ValueError):  # also a fourth part
        raise UsageError(f"--frames must be first:stop:step, as in 0:100:2, or one number, got {text!r}") from None
    if not len(chosen):
        raise UsageError(f"--frames {text} names none of the {len(recording)} frames of {recording.path}")
    return chosen


def lines(record: Record) -> list[str]:
    """A conversion in a few lines."""
    width, height = record["size_px"]
    many = record["frames"]
    found, same = record["read_back"]["frames"], record["read_back"]["same"]
    held = "every pixel is the same" if same == found else f"{found - same} differ: the format loses grey levels"
    name = record["input"] if isinstance(record["input"], Path) else f"{record['input'][0]} and others"
    return [
        f"{name} ({record['from']}): {many} frame{'s' if many > 1 else ''} of {width} x {height} px, "
        f"{record['dtype']}, {record['bits']} bits",
        *record["notes"],
        f"written: {record['output']}; read back, {found} frame{'s' if found > 1 else ''}: {held}",
    ]


def _read_back(chosen: io.Frames, target: Path, pictures: str) -> Record:
    """Frames of the target, and how many of them are those of the source to the last bit."""
    again = io.frames(target) if not target.is_dir() else None
    same = 0
    for k, picture in enumerate(chosen):
        other = again[k] if again is not None else io.read_image(target / f"{chosen.name(k)}.{pictures}")
        same += bool(other.shape == picture.shape and other.dtype == picture.dtype
                     and np.array_equal(other, picture, equal_nan=picture.dtype.kind == "f"))  # fmt: skip
    count = len(chosen) if again is None else len(again)
    if again is not None:
        again.close()
    return {"frames": count, "same": same}
