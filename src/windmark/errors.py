"""What windmark says on purpose. Every other error that comes out of a command is a fault of windmark.

- `UsageError`: wrong use, that is options and settings, and what they ask for together.
- `io.FileError`: a bad file.
- `DataError`: sound files whose content does not allow what is asked; `geometry.DegenerateGeometry` is one.
- `deformation.LawError`: a deformation law, the user's own or one of the catalogue, that cannot be what it says.

What the data refuse (no pose, no matching) is a falsy result, no error. A plain ``ValueError`` is left to what one
function demands of another, such as the shapes of arrays: wrong use in Python, a fault where windmark made the call.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import SupportsFloat


class WindmarkError(ValueError):
    """Something that the user can change: its message says what came and what was expected."""


class UsageError(WindmarkError):
    """An option, a setting or a combination of them that is not one of those that there are."""


class DataError(WindmarkError):
    """What is in the files, each of them sound, does not allow what is asked for."""


def g2(value: SupportsFloat) -> str:
    """A number in a message: two significant digits as the format ``.2g``, without powers of ten below a million."""
    return _plain(f"{value:.2g}")


def g3(value: SupportsFloat) -> str:
    """`g2` with three digits."""
    return _plain(f"{value:.3g}")


def g1(value: SupportsFloat) -> str:
    """`g2` with one digit, as an estimate deserves."""
    return _plain(f"{value:.1g}")


def earned_decimals(sigmas: Iterable[float]) -> int:
    """Decimals that numbers with these sigmas have earned: two digits of the least; 4 where none is known."""
    known = [s for s in sigmas if 0 < s < math.inf]
    # The power of ten of the rounded sigma: 0.000997 is 0.0010, not 0.00100.
    return min(max(1 - int(f"{min(known):.1e}".partition("e")[2]), 0), 9) if known else 4


def plus_minus(value: float, sigma: float) -> str:
    """A number with as many digits as its sigma, which has two, earns: ``0.007 ± 0.014``."""
    if not 0.0 < sigma < math.inf:
        return g3(value)
    decimals = earned_decimals([sigma])
    return f"{value:z.{decimals}f} ± {sigma:.{decimals}f}"


def _plain(text: str) -> str:
    text = "0" if text == "-0" else text
    return f"{float(text):.0f}" if "e+0" in text and abs(float(text)) < 1e6 else text
