"""How nouns and results look in a session and a notebook: a few figures, not their arrays; as tables and datasets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import Any, TypeVar

from windmark.errors import UsageError

T = TypeVar("T")


def described(figures: Callable[[Any], Mapping[str, object]]) -> Callable[[type[T]], type[T]]:
    """A class whose ``repr`` and notebook table have ``figures(self)`` alone. Goes above ``@dataclass``."""

    def put(cls: type[T]) -> type[T]:
        def text(self: T) -> str:
            return f"{cls.__name__}({', '.join(f'{k}={v}' for k, v in figures(self).items())})"

        def table(self: T) -> str:
            rows = "".join(
                f"<tr><th align='left'>{escape(k)}</th><td align='left'>{escape(str(v))}</td></tr>"
                for k, v in figures(self).items()
            )
            return f"<table><caption>{cls.__name__}</caption>{rows}</table>"

        cls.__repr__ = text  # type: ignore[method-assign,assignment]
        cls._repr_html_ = table  # type: ignore[attr-defined]
        return cls

    return put


def pandas_table(columns: Mapping[str, Any]) -> Any:
    """A ``pandas.DataFrame`` of columns.

    Raises
    ------
    UsageError
        Where pandas is not installed; it is no part of windmark.
    """
    try:
        import pandas
    except ImportError as error:
        raise UsageError("to_pandas needs pandas: pip install pandas") from error
    return pandas.DataFrame(dict(columns))


def xarray_dataset(
    variables: Mapping[str, tuple[tuple[str, ...], Any, str]], coords: Mapping[str, Any] | None = None, **attrs: str
) -> Any:
    """An ``xarray.Dataset``; ``variables``: name -> names of its dimensions, values, unit ("" for none)."""
    import xarray

    data = {name: (dims, value, {"units": unit} if unit else {}) for name, (dims, value, unit) in variables.items()}
    return xarray.Dataset(data, coords=dict(coords or {}), attrs=attrs)


def check_kinds(verb: str, **given: tuple[object, type]) -> None:
    """Refuse arguments of other kinds than expected, and name those that are swapped.

    Raises
    ------
    UsageError
        ``register: detections is a MarkerSet, markers is a Detections: they are swapped; expected ...``.
    """
    wrong = {name: (value, kind) for name, (value, kind) in given.items() if not isinstance(value, kind)}
    if not wrong:
        return
    got = ", ".join(f"{name} is a {type(value).__name__}" for name, (value, _) in wrong.items())
    order = ", ".join(f"{name}: {kind.__name__}" for name, (_, kind) in given.items())
    values = [value for value, _ in wrong.values()]
    swapped = len(wrong) > 1 and all(any(isinstance(v, kind) for v in values) for _, kind in wrong.values())
    raise UsageError(f"{verb}: {got}{': they are swapped' if swapped else ''}; expected {verb}({order})")
