"""What every camera saw of a frame and, where that is little, why: by what its good pictures are like."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.deformation import Deformation
from windmark.detection.fields import field_shift
from windmark.scene import Detections, MarkerSet
from windmark.scene.repeated import ONCE_MORE, is_repeated
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.spots import OWN_PX, Labelled
from windmark.tasks.deform.task import DeformationTest, Image, Sight, Station
from windmark.tasks.deform.why import Levels, few, levels_of, why_few
from windmark.tasks.odd import CHANCE, nearest_spots, together
from windmark.tasks.predictions import from_camera


@dataclass
class Usual:
    """What good pictures of each camera are like: their grey levels, and how many markers they show.

    ``odd`` is marker -> distance as `Sight` has it, of the last picture of each camera that was searched as a whole.
    """

    levels: dict[str, Levels] = field(default_factory=dict)
    markers: dict[str, int] = field(default_factory=dict)
    odd: dict[str, dict[int, tuple[float, float]]] = field(default_factory=dict)

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


    def learn_odd(
        self, spots: dict[str, Detections | str], test: DeformationTest, labelled: dict[str, Labelled],
        state: Deformation, hidden: dict[str, NDArray[np.bool_]],
    ) -> None:  # fmt: skip
        """Take up what images that were searched as a whole show beside the places of markers without a spot.

        That a spot is so near by chance has to be so in every camera that should see the marker.
        """
        placed, alone = displaced(test.markers, state), dict[int, dict[str, tuple[float, float]]]()
        chance: dict[int, list[float]] = {}
        for name, own in labelled.items():
            every = spots.get(name)
            if isinstance(every, Detections) and len(own.marker):
                for marker, px, length, p in _without_spot(
                    every, own, placed, test.station(name), state, hidden.get(name)
                ):
                    if px > OWN_PX:  # nearer it is the marker itself, which says nothing of another place
                        alone.setdefault(marker, {})[name] = px, length
                        chance.setdefault(marker, []).append(p)
        self.odd = {name: {} for name in labelled}
        for marker, of in alone.items():
            if len(alone) * together(chance[marker]) < CHANCE:
                for name, (px, length) in of.items():
                    if px < np.inf:
                        self.odd[name][marker] = px, length

    def forget_odd(self, labelled: dict[str, Labelled], used: NDArray[np.bool_]) -> None:
        """Markers whose spots (in the order of the cameras) count in the state are odd no longer."""
        last = np.cumsum([len(own.marker) for own in labelled.values()])[:-1]
        for (name, own), counts in zip(labelled.items(), np.split(used, last), strict=True):
            for marker in own.marker[counts].tolist():
                self.odd.get(name, {}).pop(marker, None)


def _without_spot(
    spots: Detections, seen: Labelled, placed: MarkerSet, station: Station, state: Deformation,
    hidden: NDArray[np.bool_] | None,
) -> list[tuple[int, float, float, float]]:  # fmt: skip
    """Markers that a camera should see and that have no spot, and of the nearest free one: px, length, chance."""
    camera = state.cameras.get(station.name, station.camera)
    pose = state.cam_from_tunnel.get(station.name, station.cam_from_tunnel)
    known = np.setdiff1d(np.arange(len(placed)) if hidden is None else np.flatnonzero(~hidden), seen.marker)
    alone = from_camera(camera, pose, placed.take(known), seen.radius_px)
    free = spots.xy[cKDTree(seen.xy).query(spots.xy)[0] > OWN_PX]
    far, chance = nearest_spots(alone.xy, free, camera.size_px)
    which = known[alone.row]
    length = far * pose.apply(placed.xyz[which])[:, 2] / camera.focal_px
    return list(zip(which.tolist(), far.tolist(), length.tolist(), chance.tolist(), strict=True))


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
    walls = (0, 0) if not count or known is None else _walls(test, station, spots, known)
    if not count or spots.known is None:
        return Sight(spots.expected, count, why, lag_s, walls=walls)
    odd = {str(test.markers.name[m]): far for m, far in usual.odd.get(name, {}).items()}
    fields = field_shift(image, spots.xy, spots.radius_px).sure_px
    return Sight(
        spots.expected, count, why, lag_s, spots.known.frame.blur_px, spots.radius_px, fields, odd, walls=walls
    )


def _walls(test: DeformationTest, station: Station, spots: Labelled, state: Deformation) -> tuple[int, int]:
    """Spots of markers on walls; and how many of these it should see, of a camera that moves and sees none."""
    wall = test.markers.role == "wall"
    found = int(wall[spots.marker].sum())
    if not station.moves or not wall.any() or found:
        return found, 0
    camera = state.cameras.get(station.name, station.camera)
    pose = state.cam_from_tunnel.get(station.name, station.cam_from_tunnel)
    expected = from_camera(camera, pose, test.markers.take(np.flatnonzero(wall)), spots.radius_px)
    if station.mask is None or not len(expected):
        return 0, len(expected)
    column, row = np.rint(expected.xy).astype(np.int64).T
    height, width = station.mask.shape
    return 0, int(np.count_nonzero(station.mask[row.clip(0, height - 1), column.clip(0, width - 1)]))


def once_more(before: Labelled | None, now: Labelled, *, copied: bool) -> str:
    """That a camera shows what it showed before, noise and all; empty where it does not.

    ``copied``: its picture is the same bit by bit as its last one. Spots of such a one may still differ by more than a
    part of their noise, as each was looked for from its own prediction; spots tell of a copy that was compressed once
    more. Those that are interpolated tell nothing: the picture may be one of those that they are between.
    """
    if before is None or not len(now.marker):
        return ""
    sigma = float(np.sqrt(np.median(np.trace(now.cov, axis1=1, axis2=2)) / 2))
    between = before.between_cov is not None
    if not copied and (between or not is_repeated(before.marker, before.xy, now.marker, now.xy, sigma)):
        return ""
    return f"the picture before once more ({ONCE_MORE}): it is of another instant"
