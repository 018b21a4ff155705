"""What the data refuse: a falsy answer with its reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class NotFitted:
    """The data do not determine what was asked for. Falsy.

    Parameters
    ----------
    reason : why, in words for the user
    details : figures that belong to it, by name

    Examples
    --------
    >>> import windmark as wm
    >>> answer = wm.fit_paint([1e4, 1e4, 1e4], [300.0, 300.0, 300.0], [0.5, 0.5, 0.5], p_ref=1e5, t_ref=300.0)
    >>> bool(answer)
    False
    >>> answer.reason
    'fit_paint: order 1 in pressure, 0 in temperature needs 2 different pressures, the table has 1'
    """

    reason: str
    details: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
