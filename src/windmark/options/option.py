"""What an option is: its name, default, range, unit and help, said once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from windmark.errors import UsageError

T = TypeVar("T")


@dataclass(frozen=True)
class Option(Generic[T]):
    """One option of a verb, wherever it is typed.

    Parameters
    ----------
    name : keyword in Python, and key in a project file
    default : what holds where nothing is said
    help : one sentence, for `--help` and docs/options.md
    unit : of a number, in words; "" for a pure one
    choices : what a text may be; () for anything
    above, least, most : range of a number: > above, >= least, <= most; None leaves it open
    flag : on the command line, where that is not the name with dashes; None for an option that is not typed there
    otherwise : what holds where the default is None, in words
    """

    name: str
    default: T
    help: str
    unit: str = ""
    choices: tuple[str, ...] = ()
    above: float | None = None
    least: float | None = None
    most: float | None = None
    flag: str | None = ""
    otherwise: str = ""

    @property
    def flags(self) -> str:
        """As it is typed on the command line; "" where it is not."""
        return "" if self.flag is None else self.flag or "--" + self.name.replace("_", "-")

    @property
    def range(self) -> str:
        """What it may be, in words; "" for anything."""
        if self.choices:
            return " or ".join(", ".join(self.choices).rsplit(", ", 1))
        ends = ((">", self.above), (">=", self.least), ("<=", self.most))
        return " and ".join(f"{sign} {end:g}" for sign, end in ends if end is not None)

    @property
    def sentence(self) -> str:
        """The help with what holds where nothing is said, if that is not the default itself."""
        return f"{self.help} [default: {self.otherwise}]" if self.otherwise else self.help

    def allows(self, value: Any) -> bool:
        """Whether a value is in the range; None is where that is the default."""
        if value is None:
            return self.default is None
        if self.choices:
            return value in self.choices
        if not self.range:
            return True
        number = float(value)
        return (
            not math.isnan(number)
            and (self.above is None or number > self.above)
            and (self.least is None or number >= self.least)
            and (self.most is None or number <= self.most)
        )

    def check(self, value: Any, verb: str = "") -> None:
        """Raise for a value that is out of range.

        Raises
        ------
        ValueError
            Names the option, what was expected and what came.
        """
        if not self.allows(value):
            expected = f"one of {', '.join(self.choices)}" if self.choices else self.range
            or_none = "None or " if self.default is None else ""
            head = f"{verb}: " if verb else ""
            raise UsageError(f"{head}{self.name} must be {or_none}{expected}, got {value!r}")

    def but(self, default: T, **changes: Any) -> Option[T]:
        """The same option of a verb that has another default, or other words."""
        return replace(self, default=default, **changes)
