"""What every camera saw of a frame and, where that is little, why: by what its good pictures are like."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.task import DeformationTest, Image, Sight, Station
from windmark.tasks.deform.why import Levels, few, levels_of, why_few


@dataclass
class Usual:
    """What good pictures of each camera are like: their grey levels, and how many markers they show."""

    levels: dict[str, Levels] = field(default_factory=dict)
    markers: dict[str, int] = field(default_factory=dict)

    def learn(
        self, images: dict[str, Image], test: DeformationTest, labelled: dict[str, Labelled], sights: dict[str, Sight],
        *, anew: bool,
    ) -> None:  # fmt: skip
        """Take up pictures that nothing is wrong with; ``anew`` for those that were read without expectations."""
        for name, spots in labelled.items():
            if not sights[name].reason and name in images:
                self.markers[name] = spots.expected
                if anew or name not in self.levels:
                    self.levels[name] = levels_of(images[name], test.station(name).mask, spots.xy, spots.radius_px)


def sight(
    image: Image, test: DeformationTest, station: Station, spots: Labelled, usual: Usual, lost: bool,
    known: Deformation | None, hidden: NDArray[np.bool_] | None, lag_s: float,
) -> Sight:  # fmt: skip
    """What a camera saw.

    ``lost``: its spots made no state; ``known``: the state, or the one that was expected; ``lag_s``: as `Sight` has it.
    """
    name, count = station.name, 0 if lost else len(spots.marker)
    before, why = usual.markers.get(name, 0), ""
    if few(count, spots.expected, before):
        placed = None if known is None else displaced(test.markers, known)
        pose = (known.cam_from_tunnel if known else {}).get(name, station.cam_from_tunnel)
        if lost:
            spots = replace(Labelled.none(spots.reason), not_found=spots.not_found, expected=spots.expected)
        why = why_few(
            image, test, station, spots, usual.levels.get(name), before, placed, station.camera, pose, hidden
        )  # fmt: skip
    return Sight(spots.expected, count, why, lag_s)
