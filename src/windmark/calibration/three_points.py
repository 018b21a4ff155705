"""What no residual shows where three points hold the frame: an error of one of them across their plane.

Seven of the nine coordinates go into the similarity, and the two that are left check the lengths of the triangle's
sides. These change with the square of an error across the plane only: it turns the whole network about the line through
the other two points (external reliability, Baarda 1968).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from windmark.calibration.datum import Fixed, Weighted
from windmark.calibration.result import Calibration


@dataclass(frozen=True)
class Turn:
    """The largest effect of an error of one of three points across their plane.

    Parameters
    ----------
    names : of the three; the first is the one whose error has it
    marker : the marker that it moves most
    times : how many times as far as the point itself
    """

    names: tuple[str, str, str]
    marker: str
    times: float

    def __str__(self) -> str:
        one, *edge = self.names
        return (
            f"nothing checks the three known markers across their plane: an error of {one} there turns everything "
            f"about {' and '.join(edge)}, and moves {self.marker} {self.times:.2g} times as far"
        )


def turn_of_three(result: Calibration) -> Turn | None:
    """What nothing checks of a network that three known markers hold; None of one that more hold, or none."""
    datum = result.options["datum"]
    if not isinstance(datum, Fixed | Weighted):
        return None
    names = result.markers.name.tolist()
    if datum.markers is not None:
        held = [names.index(n) for n in datum.markers if n in names]
    elif isinstance(datum, Fixed):
        held = list(range(len(names)))
    else:
        return None
    if len(held) != 3:
        return None
    xyz, found = result.markers.xyz, []
    for one in held:
        a, b = (k for k in held if k != one)
        along = xyz[b] - xyz[a]
        along = along / np.linalg.norm(along)
        off = xyz - xyz[a]
        far = np.linalg.norm(off - np.outer(off @ along, along), axis=1)
        worst = int(far.argmax())
        found.append(Turn((names[one], names[a], names[b]), names[worst], float(far[worst] / far[one])))
    return max(found, key=lambda turn: turn.times)
