"""Settings that name files, by the types of a project's model; and names that a missing file may have meant."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from windmark.pipeline.deform.entries import RECORDING
from windmark.pipeline.deform.project import DeformProject
from windmark.pipeline.infrared import InfraredProject
from windmark.pipeline.project import Project
from windmark.pipeline.psp import PspProject
from windmark.pipeline.settings import has_path, key_parts, model_in
from windmark.pipeline.toml_lines import Key
from windmark.pipeline.typed import nearest


def other_paths(model: type[BaseModel], data: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Every other setting that names a file, by the model's own types -> its key and text."""
    for field_name, about in model.model_fields.items():
        name = about.alias or field_name
        if not isinstance(data, dict) or name not in data or name in ("output", "watch", "path"):
            continue
        here, value = f"{key}.{name}" if key else name, data[name]
        inner = model_in(about.annotation)
        if inner is not None:
            several = isinstance(value, list)
            for n, one in enumerate(value if several else [value]):
                yield from other_paths(inner, one, f"{here}[{n}]" if several else here)
        elif isinstance(value, str) and has_path(about.annotation) and value != str(RECORDING) and here not in _READ:  # noqa: SIM102
            if name != "file" or not key.startswith(("camera[", "image[")):
                yield here, value


MODELS: dict[str, type[BaseModel]] = {
    "run": Project, "deform": DeformProject, "psp": PspProject, "infrared": InfraredProject,
}  # fmt: skip
"""Verb -> the model of its projects."""
_READ = ("markers.file", "grid.file")
"""Files that are not only looked for but read."""


def without_keys(data: Any, keys: Iterable[Key]) -> Any:
    """Settings without some keys, which stay in ``data`` itself."""
    out = deepcopy(data)
    for *way, last in (key_parts(key) for key in keys if key_parts(key)):
        at = out
        with suppress(KeyError, IndexError, TypeError, AttributeError):  # of a table that is itself no table
            for part in way:
                at = at[part]
            at.pop(last)
    return out


def key_of_file(project: Path, data: Any, file: Path, key: str = "") -> str:
    """The setting that names a file; "" where none does."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for name, value in items:
        here = f"{key}[{name}]" if isinstance(name, int) else f"{key}.{name}".lstrip(".")
        with suppress(OSError, ValueError):  # a text that no file can be called
            if isinstance(value, str) and (project.parent / value).resolve() == file.resolve():
                return here
        if found := key_of_file(project, value, file, here):
            return found
    return ""


def similar(path: Path) -> str:
    """", did you mean ...?" where a file with nearly this name is there."""
    try:
        there = [p.name for p in path.parent.iterdir()]
    except (OSError, ValueError):  # no folder, or no name that a file can have
        return ""
    return nearest(path.name, there)
