"""Everything that is wrong with a project, all at once, without running it: settings, files, and how they fit."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from windmark.io.errors import FileError
from windmark.pipeline.check.begin import begun
from windmark.pipeline.check.files import Files
from windmark.pipeline.check.paths import MODELS, key_of_file, without_keys
from windmark.pipeline.check.problems import Checked, Problem, keys_of, noting
from windmark.pipeline.kinds import KINDS, kind_of
from windmark.pipeline.project import pictures_of
from windmark.pipeline.settings import explanation, read_settings
from windmark.pipeline.toml_lines import Key, line_of, toml_lines

_IMAGE = re.compile(r"^image\[(\d+)\]")


def check_project(path: Path, show: Callable[[str], None] = lambda _: None) -> Checked:
    """Check a project file of any kind.

    Parameters
    ----------
    show : is told what is being looked at

    Raises
    ------
    FileError
        When it cannot be read, or is no TOML: then there is nothing else to be said.
    """
    data = read_settings(path)
    lines = toml_lines(path.read_text(encoding="utf-8-sig"))
    kind = kind_of(data) or "run"
    out = Checked(path, kind)
    if kind_of(data) is None and data:
        out.problems.append(Problem(None, "", f"has keys of several kinds of projects, or of none; taken as that of "
                                    f"{KINDS[kind]} (windmark {kind})"))  # fmt: skip
    whole, numbers = _expanded(out, lines, data) if kind == "run" else (data, [])
    model = MODELS[kind]
    wrong = _settings(out, lines, model, whole, numbers)
    if wrong:  # what does not fit together is looked for only where every key is right: so without those that are not
        _settings(out, lines, model, without_keys(whole, wrong), numbers, certain=True)
    Files(out, lines, whole, show, numbers).look()
    if not out.problems:
        show("put everything together")
        try:
            for one in begun(kind, path):
                _refused(out, lines, one, data)
        except FileError as error:
            _refused(out, lines, error, data)
    out.problems.sort(key=lambda p: (p.line is None, p.line or 0))
    return out


def _settings(
    out: Checked, lines: dict[Key, int], model: type[BaseModel], whole: dict[str, Any], numbers: list[int],
    *, certain: bool = False,
) -> list[Key]:  # fmt: skip
    """What the project's own model has against its settings, added to the problems -> the keys that are wrong.

    ``certain``: only what no missing key can be to blame for.
    """
    try:
        model(path=out.path.resolve(), **{k: v for k, v in whole.items() if k != "path"})
    except ValidationError as error:
        errors = [one for one in error.errors() if not certain or one.get("ctx", {}).get("certain")]
        for one in errors:
            key, words = explanation(one, model)
            key = _IMAGE.sub(lambda found: f"image[{numbers[int(found[1])]}]", key or "") if numbers else key or ""
            if all(p.key != key and not key.startswith(f"{p.key}[") and not p.key.startswith(f"{key}[")
                   for p in out.problems if p.key):  # fmt: skip
                out.problems.append(Problem(line_of(lines, keys_of(key)), key, words))
        return [one["loc"] for one in errors]
    return []


def _expanded(out: Checked, lines: dict[Key, int], data: dict[str, Any]) -> tuple[dict[str, Any], list[int]]:
    """Settings with a table for each picture of a pattern, and of which ``[[image]]`` each is."""
    images = data.get("image")
    if not isinstance(images, list):
        return data, []
    every: list[Any] = []
    numbers: list[int] = []
    for n, entry in enumerate(images):
        with noting(out, lines, f"image[{n}].file"):
            some = pictures_of(out.path, n, entry)
            every += some
            numbers += [n] * len(some)
    return {**data, "image": every} if every else data, numbers


def _refused(out: Checked, lines: dict[Key, int], error: FileError, data: dict[str, Any]) -> None:
    """What the verb itself refuses; of another file it stands in the line that names that one."""
    if error.path.resolve() == out.path.resolve():
        key, words = error.where or "", error.what
    else:
        key, words = key_of_file(out.path, data, error.path), str(error)
    out.problems.append(Problem(line_of(lines, keys_of(key)), key, words))
