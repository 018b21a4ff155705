"""Reference pages from the program itself: every command, every project key, every public name.

    python docs/make_reference.py [FOLDER]

Written by the docs build (`conf.py`); nothing here is kept by hand.
"""

from __future__ import annotations

import inspect
import re
import sys
import typing
from pathlib import Path
from typing import Any, get_args, get_origin

HERE = Path(__file__).parent


def write_reference(folder: Path) -> list[Path]:
    """Write all pages; their paths."""
    folder.mkdir(exist_ok=True)
    pages = {"commands.md": commands(), "keys.md": keys(), "api.md": api()}
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    return [folder / name for name in pages]


def every_command() -> list[tuple[str, Any]]:
    """(words, command) of every verb, those of groups, too."""
    import typer

    from windmark.app.cli import app

    group: Any = typer.main.get_command(app)
    out: list[tuple[str, Any]] = []
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            out += [(f"{name} {inner}", one) for inner, one in command.commands.items()]
        else:
            out.append((name, command))
    return out


def commands() -> str:
    """The page of commands."""
    codes = "Exit codes: 0 done, 1 the data say no (with the reason), 2 wrong usage or bad file, 3 a fault of windmark,"
    head = "Every verb also takes `--json`, for machines, and `--help`."
    out = ["# Commands", "", f"{head} {codes} 130 interrupted.", ""]
    for words, command in every_command():
        out += [f"## {words}", "", _escaped(command.help or ""), ""]
        if command.epilog:
            out += ["```", *(f"{example}" for example in examples(command.epilog)), "```", ""]
        out += ["| option | meaning | default |", "|---|---|---|"]
        for param in command.params:
            if param.name == "help":
                continue
            names = ", ".join(f"`{o}`" for o in (*param.opts, *param.secondary_opts))
            if param.param_type_name == "argument":
                names = f"`{param.name.upper()}`" + ("" if param.required else " (optional)")
            default = param.default
            shown = "" if default in (None, False, ()) or callable(default) else f"`{default}`"
            required = "required" if param.required and param.param_type_name != "argument" else shown
            out.append(f"| {names} | {_escaped(getattr(param, 'help', None) or '')} | {required} |")
        out.append("")
    return "\n".join(out)


def examples(epilog: str) -> list[str]:
    """The command lines of an epilog ``Example: windmark ..., or windmark ...``."""
    text = re.sub(r"^Examples?:\s*", "", epilog.strip())
    parts = re.split(r"(?:;|,\s*or|,\s*then|\.)\s*(?:[A-Z]\w*:)?\s*(?=windmark )|\n(?=windmark )", text)
    return [part.strip().rstrip(".,;") for part in parts if part.strip().startswith("windmark ")]


def keys() -> str:
    """The page of project keys, by kind of project."""
    from windmark.pipeline.check.paths import MODELS
    from windmark.pipeline.kinds import KINDS

    out = ["# Project keys", "", "Project files are TOML. Paths are relative to the file. A key that is not listed is "
           "refused; `windmark check` lists everything that is wrong at once.", ""]  # fmt: skip
    for verb, model in MODELS.items():
        out += [f"## windmark {verb}: {KINDS[verb]}", "", *_table(model, top=True)]
        out += [line for name, about in model.model_fields.items() if (inner := _inner(about.annotation)) is not None
                for line in _tables(inner, verb, about.alias or name, about)]  # fmt: skip
    return "\n".join(out)


def _tables(model: Any, verb: str, key: str, about: Any) -> list[str]:
    """A table of a project, and those in it."""
    several = "list" in str(about.annotation) or "tuple" in str(about.annotation)
    out = [f"### {verb}: {'[[' if several else '['}{key}{']]' if several else ']'}", "", _intro(model), "",
           *_table(model)]  # fmt: skip
    for name, field in model.model_fields.items():
        if (inner := _inner(field.annotation)) is not None:
            out += _tables(inner, verb, f"{key}.{field.alias or name}", field)
    return out


def _table(model: Any, *, top: bool = False) -> list[str]:
    """Keys with what they mean; ``top``: of a whole project, whose tables have their own."""
    said = meanings(model)
    rows = ["| key | what it is | type | default |", "|---|---|---|---|"]
    for name, about in model.model_fields.items():
        if name == "path" or (top and _inner(about.annotation) is not None):
            continue
        key = about.alias or name
        default = "required" if about.is_required() else _default(about)
        meaning = _escaped(said[key]).replace("``", "`")
        rows.append(f"| `{key}` | {meaning} | {_type(about.annotation)} | {default} |")
    return [*rows, ""] if len(rows) > 2 else []


_SAID = re.compile(r"((?:``\w+``(?:, | and |,\n))*``\w+``):\s")
"""Keys and the colon behind which the docstring of their table says what they are."""


def meanings(model: Any) -> dict[str, str]:
    """What each key of a table is: as the docstring of its table says, else as the table of options has it.

    Raises
    ------
    KeyError
        For a key that neither tells.
    """
    from windmark.options import calibration, detection, registration

    told = {o.name: o.help for room in (detection, registration, calibration) for o in room.OPTIONS}
    for one in reversed(model.__mro__):
        for paragraph in inspect.cleandoc(one.__dict__.get("__doc__") or "").split("\n\n"):
            marks = list(_SAID.finditer(paragraph))
            for mark, after in zip(marks, [*marks[1:], None], strict=False):
                text = " ".join(paragraph[mark.end() : after.start() if after else len(paragraph)].split())
                told |= dict.fromkeys(re.findall(r"``(\w+)``", mark[1]), text.rstrip(".;, "))
    def nested(key: str) -> bool:
        return any(_inner(f.annotation) is not None for n, f in model.model_fields.items() if key in (n, f.alias))

    wanted = [about.alias or name for name, about in model.model_fields.items() if name != "path"]
    if lacking := [key for key in wanted if key not in told and not nested(key)]:
        raise KeyError(f"{model.__name__}: its docstring says nothing of {', '.join(lacking)}")
    return {key: told.get(key, "see its table below") for key in wanted}


def _intro(model: Any) -> str:
    """What the docstring says of the table as a whole: up to the first key in each paragraph."""
    parts = []
    for paragraph in inspect.cleandoc(model.__doc__ or "").split("\n\n"):
        first = _SAID.search(paragraph)
        parts.append(paragraph[: first.start()].rstrip() if first else paragraph)
    return _escaped("\n\n".join(filter(None, parts))).replace("``", "`")


def _default(about: Any) -> str:
    value = about.get_default(call_default_factory=True)
    return "" if value is None or value == () or value == {} else f"`{value}`"


def _type(annotation: Any) -> str:
    origin, args = get_origin(annotation), get_args(annotation)
    if annotation is type(None):
        return ""
    if origin is typing.Literal:
        return ", ".join(f'`"{a}"`' for a in args)
    if origin is typing.Annotated:
        return _type(args[0])
    if origin is tuple:
        return f"list of {_type(args[0])}" if args and args[-1] is Ellipsis else f"{len(args)} × {_type(args[0])}"
    if origin is dict:
        return f"table of {_type(args[1])}"
    if args:
        return " or ".join(filter(None, (_type(a) for a in args)))
    names = {"str": "text", "float": "number", "int": "whole number", "bool": "true or false", "Path": "file"}
    name = getattr(annotation, "__name__", str(annotation))
    return names.get(name, "table")


def _inner(annotation: Any) -> Any:
    from windmark.pipeline.settings import model_in

    return model_in(annotation)


def api() -> str:
    """The page of public names, by room."""
    import windmark

    out = ["# Python", "", "`import windmark as wm`; everything is loaded on first use.", ""]
    for room, names in windmark._HOME.items():
        out += [f"## {room}", ""]
        for name in names:
            kind = "autoclass" if inspect.isclass(getattr(windmark, name)) else "autofunction"
            if not callable(getattr(windmark, name)):
                kind = "autodata"
            members = ["   :members:"] if kind == "autoclass" else []
            out += ["```{eval-rst}", f".. {kind}:: windmark.{name}", *members, "```", ""]
    return "\n".join(out)


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


if __name__ == "__main__":
    for written in write_reference(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "reference"):
        print(written)
