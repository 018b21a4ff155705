"""Settings that name files, by the types of a project's model; and names that a missing file may have meant."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from windmark.pipeline.deform.project import RECORDING
from windmark.pipeline.settings import has_path, model_in


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


_READ = ("markers.file", "grid.file")
"""Files that are not only looked for but read."""


def similar(path: Path) -> str:
    """", did you mean ...?" where a file with nearly this name is there."""
    from difflib import get_close_matches

    try:
        there = [p.name for p in path.parent.iterdir()]
    except (OSError, ValueError):  # no folder, or no name that a file can have
        return ""
    near = get_close_matches(path.name, there, 1, 0.6)
    return f", did you mean {near[0]}?" if near else ""
