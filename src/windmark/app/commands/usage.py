"""What a command wants, in words: its usage line, the kinds of its values, and everything that a call lacks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

try:  # typer has a click of its own since 0.26
    from typer._click.exceptions import MissingParameter, UsageError
except ImportError:
    from click import MissingParameter, UsageError  # type: ignore[assignment]

WORDS = {
    "str": "text", "float": "number", "float range": "number", "int": "whole number", "int range": "whole number",
    "Path": "path",
}  # fmt: skip
"""Python's names of the kinds of values, which typer prints -> what they are called here."""
SEVERAL = "several times"
_KIND = re.compile(r"<(list\[)?([\w|.,+*/ -]*)\]?>(?:\.\.\.)?$")
_EXTRA = re.compile(r"\s*\[((?:default|required)[^\[\]]*)\]$")


def worded(record: tuple[str, str], of: Any) -> tuple[str, str]:
    """A line of the help with the kind of its value in words; of an option that may be given again, that it may."""
    name, text = record
    found = _KIND.search(name)
    if found is None:
        return record
    # Several values of one option stand side by side, as they are typed.
    kinds = " ".join(f"<{WORDS.get(kind.strip(), kind)}>" for kind in found[2].split(","))
    name = name[: found.start()] + kinds
    # Of an argument its name says so: images...
    if found[1] and of.param_type_name == "option" and not re.search("several times|twice|for each", text):
        extra = _EXTRA.search(text)
        text = f"{text[: extra.start()]}  [{SEVERAL}; {extra[1]}]" if extra else f"{text}  [{SEVERAL}]".lstrip()
    return name, text


def usage_pieces(params: Iterable[Any], ctx: Any, options: str | None) -> list[str]:
    """Arguments, the options that have to be given with the kinds of their values, and that there are others.

    Parameters
    ----------
    params : of the command
    ctx : of the call
    options : what stands for all that may be left out; None where the command says nothing of the kind
    """
    arguments: list[str] = []
    required: list[str] = []
    for param in params:
        if param.param_type_name == "argument":
            # Words of its own say how many there may be, and of what.
            arguments += [f"{{{param.metavar}}}"] if param.metavar else param.get_usage_pieces(ctx)
        elif param.required and (record := param.get_help_record(ctx)) is not None:
            name, _ = worded(record, param)
            kind = name[len(", ".join(param.opts)) :].strip()
            required.append(f"{min(param.opts, key=len)} {kind}".strip())
    return [*arguments, *required, *([options] if options else [])]


def refuse_again(order: Sequence[Any], ctx: Any) -> None:
    """Raise for an option that is given more than once and takes one value: which of them is meant nobody knows.

    ``order`` has the parameters as they came. A flag that has no opposite says the same however often it is there.
    """
    for param in dict.fromkeys(order):
        plain = param.param_type_name != "option" or param.multiple or param.count
        if plain or (param.is_flag and not param.secondary_opts):
            continue
        if (times := order.count(param)) > 1:
            names = " / ".join([*param.opts, *param.secondary_opts])
            raise UsageError(f"{names} is given {times} times; expected it once, with one value.", ctx)


def all_that_lacks(error: MissingParameter, params: Sequence[Any], ctx: Any, given: dict[str, Any]) -> UsageError:
    """The error of a call that lacks something, naming all that it lacks; the same where it is one thing.

    Parameters
    ----------
    error : of the first that lacks
    params, ctx : see `usage_pieces`
    given : name of the parameter -> its value as the parser found it
    """
    missing = [p for p in params if p.required and p.value_is_missing(p.consume_value(ctx, given)[0])]
    if len(missing) < 2:
        return error
    hints = []
    for kind in ("argument", "option"):
        names = [p.get_error_hint() for p in missing if p.param_type_name == kind]
        if names:
            hints.append(f"{kind}{'s' if len(names) > 1 else ''} {', '.join(names)}")
    return UsageError(f"Missing {' and '.join(hints)}.", ctx)
