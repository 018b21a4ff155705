"""Names and exclusions of spots written into a project file, as a person would: comments and order stay.

Before the file is replaced, the new text is read as a project and compared with what it must say.
"""

from __future__ import annotations

import copy
import json
import os
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windmark import io
from windmark.errors import UsageError
from windmark.io.errors import reading
from windmark.pipeline.project import make_project, pictures_of, with_pictures
from windmark.pipeline.settings import read_settings
from windmark.pipeline.toml_edit import block_of, statements, with_entry, with_item, without_entry, without_item

Record = dict[str, Any]
Place = tuple[float, float]
DECIMALS = 2
"""Of a pixel: a place only says which spot is meant."""


@dataclass(frozen=True)
class SpotEdit:
    """What is to be changed of one image's ``labels`` and ``exclude``; what goes away, goes first.

    Parameters
    ----------
    label : marker name and the (x, y) of its spot
    exclude : (x, y) of a spot that takes no part
    drop_labels : names whose label goes away
    drop_excluded : numbers of the items of ``exclude`` that go away
    """

    label: tuple[str, Place] | None = None
    exclude: Place | None = None
    drop_labels: Sequence[str] = ()
    drop_excluded: Sequence[int] = ()


def edit_spots(path: Path, image: str, edit: SpotEdit) -> None:
    """Write an edit of an image's spots into its project file; the file is replaced as a whole.

    A pattern (``file = "img*.tif"``) that stands for several images is first replaced by one ``[[image]]`` for each, as
    labels belong to one image.

    Raises
    ------
    FileError
        When the file cannot be read or written, or would be no project any more. It is left as it was.
    UsageError
        For an image that it has not, and where it is written in a way that cannot be edited safely.
    """
    before = read_settings(path)
    number, alone = _entry_of(path, before, image)
    with reading(path):
        text = path.read_bytes().decode("utf-8")
    new = text if alone else _split(path, text, before, number)
    if not alone:
        number, _ = _entry_of(path, _loaded(path, new), image)
    new = _changed_text(new, number, edit)
    _check(path, before, _loaded(path, new), image, edit)
    with io.atomic_path(path) as place:
        place.write_bytes(new.encode("utf-8"))


def _loaded(path: Path, text: str) -> Record:
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError as error:
        what = f"{path.name} is written in a way that cannot be edited here ({error}); edit it by hand"
        raise UsageError(what) from None


def _label(entry: Record) -> str:
    """As `ImageEntry.label`."""
    return str(entry.get("name") or io.picture_name(Path(entry["file"])))


def _entry_of(path: Path, data: Record, image: str) -> tuple[int, bool]:
    """Which ``[[image]]`` an image is of, and whether it is its only one."""
    for number, entry in enumerate(data.get("image", ())):
        made = pictures_of(path, number, entry)
        if image in (_label(one) for one in made):
            return number, len(made) == 1
    raise UsageError(f"{path.name} has no image {image} any more; read the project again (run again)")


def _split(path: Path, text: str, data: Record, number: int) -> str:
    """A pattern's ``[[image]]`` as one for each of its pictures, all with its other keys."""
    begin, end = block_of(text, ("image", number))
    block = text[begin:end]
    (own,) = (s for s in statements(block) if s.key == ("image", 0, "file"))
    assert own.value is not None
    blocks = []
    line = "\r\n" if "\r\n" in text else "\n"
    for one in pictures_of(path, number, data["image"][number]):
        file = os.path.relpath(one["file"], path.parent).replace(os.sep, "/")
        name = f"{line}name = {json.dumps(one['name'], ensure_ascii=False)}" if "name" in one else ""
        file = json.dumps(file, ensure_ascii=False)
        blocks.append(block[: own.value] + file + name + block[own.end :])
    return text[:begin] + (line + line).join(blocks) + text[end:]


def _changed_text(text: str, number: int, edit: SpotEdit) -> str:
    labels, exclude = ("image", number, "labels"), ("image", number, "exclude")
    for name in edit.drop_labels:
        text = without_entry(text, labels, name)
    for item in sorted(edit.drop_excluded, reverse=True):
        text = without_item(text, exclude, item)
    if edit.label is not None:
        text = with_entry(text, labels, edit.label[0], _place(edit.label[1]))
    if edit.exclude is not None:
        text = with_item(text, exclude, _place(edit.exclude))
    return text


def _place(xy: Place) -> str:
    return f"[{xy[0]:.{DECIMALS}f}, {xy[1]:.{DECIMALS}f}]"


def _changed(entry: Record, edit: SpotEdit) -> Record:
    """What the image's table must say afterwards."""
    labels, exclude = dict(entry.get("labels", {})), list(entry.get("exclude", []))
    for name in edit.drop_labels:
        labels.pop(name)
    exclude = [place for k, place in enumerate(exclude) if k not in edit.drop_excluded]
    if edit.label is not None:
        labels[edit.label[0]] = [round(v, DECIMALS) for v in edit.label[1]]
    if edit.exclude is not None:
        exclude.append([round(v, DECIMALS) for v in edit.exclude])
    return {**entry, "labels": labels, "exclude": exclude}


def _check(path: Path, before: Record, after: Record, image: str, edit: SpotEdit) -> None:
    """The new text must be a project and say what was wanted, and nothing else differently."""
    wanted = _comparable(path, before, lambda entry: _changed(entry, edit) if _label(entry) == image else entry)
    if _comparable(path, after, lambda entry: entry) != wanted:
        raise UsageError(f"{path.name} is written in a way that cannot be edited here without harm; add by hand, to "
                         f"image {image}: {_changed_words(edit)}")  # fmt: skip
    make_project(path, with_pictures(path, after))


def _changed_words(edit: SpotEdit) -> str:
    words = [f"labels.{name} removed" for name in edit.drop_labels]
    words += [f"item {k + 1} of exclude removed" for k in edit.drop_excluded]
    if edit.label is not None:
        words.append(f"labels.{edit.label[0]} = {_place(edit.label[1])}")
    if edit.exclude is not None:
        words.append(f"{_place(edit.exclude)} in exclude")
    return "; ".join(words)


def _comparable(path: Path, data: Record, change: Callable[[Record], Record]) -> Record:
    """Settings with patterns written out, files in full, empty labels and exclusions left out."""
    out = copy.deepcopy(with_pictures(path, data))
    images = []
    for entry in map(change, out["image"]):
        full = {**entry, "file": os.path.abspath(path.parent / entry["file"]), "name": _label(entry)}
        images.append({k: v for k, v in full.items() if k not in ("labels", "exclude") or v})
    return {**out, "image": images}
