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
    """

    reason: str
    details: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
