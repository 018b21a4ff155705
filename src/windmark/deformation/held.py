"""What a project file says about a law's parameters: start, what is known before, bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import BoundLaw, FunctionLaw, Law, LawError
from windmark.deformation.parameter import Parameter
from windmark.errors import WindmarkError

Array = NDArray[np.float64]

SETTINGS = ("start", "sigma", "lower", "upper")
"""What can be set for a parameter."""


@dataclass(frozen=True, eq=False)
class Held:
    """A law whose parameters start, are known and are bounded otherwise.

    Parameters
    ----------
    law : the law
    parameters : its parameters, same names in the same order
    """

    law: Law
    parameters: tuple[Parameter, ...]

    def bind(self, xyz: Array) -> BoundLaw:
        """See `Law`."""
        return self.law.bind(xyz)


def with_parameters(law: Law, settings: Mapping[str, Mapping[str, Any]]) -> Law:
    """A law with settings of its parameters changed.

    Parameters
    ----------
    law : any law
    settings : parameter -> any of `SETTINGS`, numbers in the parameter's unit; such as ``{"tip": {"sigma": 20.0}}``

    Raises
    ------
    LawError
        For a parameter or a setting that does not exist, and numbers that contradict each other.
    """
    names = [p.name for p in law.parameters]
    for name, given in settings.items():
        if name not in names:
            raise LawError(f"parameter {name}: the law has {', '.join(names)}")
        if not isinstance(given, Mapping):
            raise LawError(f"parameter {name}: expected some of {', '.join(SETTINGS)}, got {given!r}")
        for key, value in given.items():
            if key not in SETTINGS:
                raise LawError(f"parameter {name}: has no setting {key}; expected some of {', '.join(SETTINGS)}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise LawError(f"parameter {name}: {key}: expected a number, got {value!r}")
    try:
        changed = tuple(replace(p, **settings.get(p.name, {})) for p in law.parameters)
    except WindmarkError as error:
        raise LawError(str(error)) from None
    # A function's numerical derivatives take their steps from its parameters.
    return replace(law, parameters=changed) if isinstance(law, FunctionLaw) else Held(law, changed)
