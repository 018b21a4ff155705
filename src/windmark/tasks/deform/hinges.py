"""Parts on hinges that are exchanged in the table: where the hinges lie along their lines tells, before any picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Held, Volumes
from windmark.deformation.laws.rigid import Hinge
from windmark.scene import MarkerSet

Array = NDArray[np.float64]


def exchanged_hinges(markers: MarkerSet, volumes: Volumes) -> dict[str, str]:
    """Volumes whose hinges lie beside their own markers and along those of another one, and the other way round.

    Two points anywhere on its line make a hinge, so one that lies beside its part says nothing by itself. That it lies
    along another part whose own hinge is beside it, too, and along this one or a third, is no chance.

    Returns
    -------
    dict
        Volume -> the one whose markers lie along its hinge.
    """
    hinges = {}
    for part in volumes.parts:
        law = part.law.law if isinstance(part.law, Held) else part.law
        own = markers.xyz[(markers.volume == part.name) & (markers.role != "wall")]
        if isinstance(law, Hinge) and len(own):
            hinges[part.name] = law, own
    beside = [name for name, (law, own) in hinges.items() if not _along(law, own)]
    at = {v: [w for w in beside if w != v and _along(hinges[v][0], hinges[w][1])] for v in beside}
    wanted = {w for some in at.values() for w in some}
    return {v: some[0] for v, some in at.items() if some and v in wanted}


def _along(law: Hinge, xyz: Array) -> bool:
    """Whether points (N, 3) reach a hinge between its two points, along its line."""
    start, axis = law.line()
    length = float((np.asarray(law.end) - start) @ axis)
    along = (xyz - start) @ axis
    return bool(along.max() >= 0.0 and along.min() <= length)
