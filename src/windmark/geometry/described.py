"""How nouns and results look in a session and a notebook: a few figures, not their arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

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


def numbers(values: ArrayLike) -> str:
    """A few numbers in brackets, with five digits; no 1e-16 for nothing."""
    v = np.atleast_1d(np.asarray(values, dtype=float))
    plain = np.where(np.abs(v) < 1e-12 * np.abs(v).max(initial=0.0), 0.0, v) + 0.0
    return f"({', '.join(f'{x:.5g}' for x in plain)})"
