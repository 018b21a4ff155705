"""What a finished reconstruction says against itself: who sees what, radii and labels that differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.geometry import Camera
from windmark.scene import Doubt, MarkerSet, Tracks, View
from windmark.tasks.reconstruct.task import Task

Mask = NDArray[np.bool_]

ALIKE_DEG = 20.0
"""Two pictures whose directions differ by less see the same side of a marker: what one shows the other should."""
LEAST_EXPECTED = 20
"""Expected spots from which the rate of those that are found is known."""
LEAST_OFTEN = 3
"""Pictures that should show a marker whose own rate is asked."""
LEAST_RADII, OTHER_UNIT = 3, 2.5
"""Primaries whose discs say whether radii and places of the table have one unit, and by how much that is another one:
diameters for radii, blur and printing are less."""
CHANCE = 1e-3
"""How often, in a whole reconstruction, chance may look like a doubt."""


@dataclass(frozen=True)
class Sight:
    """Which picture shows which marker, and which should.

    Parameters
    ----------
    seen, inside : (V, N) the marker has a spot in the picture; its place is within the picture
    alike : (V, V) pictures from nearly one direction
    place : (V, 3) where each picture was taken, NaN of one without a pose
    rate : part of the expected spots that is found, of a marker in the middle (one that moved is found half as often);
        NaN where too few are expected
    """

    seen: Mask
    inside: Mask
    alike: Mask
    place: NDArray[np.float64]
    rate: float

    @classmethod
    def of(cls, markers: MarkerSet, tracks: Tracks, views: Sequence[View], cameras: Mapping[str, Camera]) -> Sight:
        """From a reconstruction; pictures without a pose show nothing."""
        seen = np.zeros((len(views), len(markers)), dtype=np.bool_)
        seen[tracks.view, tracks.track] = True
        inside, way, place = np.zeros_like(seen), np.zeros((len(views), 3)), np.full((len(views), 3), np.nan)
        centre = markers.xyz.mean(axis=0)
        for v, view in enumerate(views):
            if view.cam_from_model is not None:
                inside[v] = in_field(markers.xyz, view, cameras)
                place[v] = view.cam_from_model.center
                way[v] = place[v] - centre
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), np.finfo(float).tiny)
        alike = way @ way.T > np.cos(np.radians(ALIKE_DEG))
        others = alike & ~np.eye(len(views), dtype=np.bool_)
        expected = inside & (others.astype(int) @ seen.astype(int) > 0)
        often = expected.sum(axis=0) >= LEAST_OFTEN
        found = (seen & expected).sum(axis=0)[often] / expected.sum(axis=0)[often]
        enough = len(found) and expected.sum() >= LEAST_EXPECTED
        return cls(seen, inside, alike, place, float(np.median(found)) if enough else np.nan)


def radii_differ(task: Task, markers: MarkerSet, tracks: Tracks, views: Sequence[View]) -> list[Doubt]:
    """Whether the primaries' discs are as large as their table says; a table in another unit has them a hundredfold.

    What a disc is across where it is seen: its larger half axis times depth over focal length.
    """
    table = {str(n): float(r) for n, r in zip(task.primary.name, task.primary.radius, strict=True) if r > 0}
    of: dict[str, list[float]] = {}
    for v, track, spot in zip(tracks.view.tolist(), tracks.track.tolist(), tracks.detection.tolist(), strict=True):
        name, pose = str(markers.name[track]), views[v].cam_from_model
        if name in table and pose is not None:
            depth = float(pose.apply(markers.xyz[track])[2])
            spots = task.detections[v]
            px = float(np.fmax(spots.radius_px[spot], np.fmax(*spots.axes_px[spot])))
            if px > 0:  # spots that were given may have no radius
                of.setdefault(name, []).append(px * depth / task.camera(v).focal_px / table[name])
    if len(of) < LEAST_RADII:
        return []
    ratio = float(np.median([np.median(each) for each in of.values()]))
    if 1 / OTHER_UNIT < ratio < OTHER_UNIT:
        return []
    size = f"{g3(1 / ratio)} times smaller" if ratio < 1 else f"{g3(ratio)} times larger"
    words = f"by their places the primary markers' discs are {size} than the radii of their table: another unit?"
    return [Doubt((), words, "units")]


def in_field(xyz: NDArray[np.float64], view: View, cameras: Mapping[str, Camera]) -> Mask:
    """(N,) which places a view with a pose has within its picture."""
    assert view.cam_from_model is not None
    camera = cameras[view.camera]
    return camera.in_image(camera.project(view.cam_from_model.apply(xyz))[0])


def labels_that_differ(task: Task, tracks: Tracks, markers: MarkerSet) -> list[Doubt]:
    """Labels whose spots are other markers by all pictures together; two that are exchanged in a picture as one."""
    out = []
    names, primary = markers.name, task.primary.name
    for v, labels in enumerate(task.labels):
        mine = tracks.view == v
        is_now = dict(zip(tracks.detection[mine].tolist(), names[tracks.track[mine]].tolist(), strict=True))
        wrong = {str(primary[p]): is_now[s] for s, p in labels.items() if is_now.get(s, primary[p]) != primary[p]}
        for said, now in wrong.items():
            picture = task.views[v].name
            if wrong.get(now) == said:
                if said < now:
                    out.append(Doubt((said, now, picture), "{} and {} are exchanged in the labels of {}", "swapped"))
            else:
                out.append(Doubt((said, picture, now), "the spot that is labelled {} in {} is {}", "swapped"))
    return out
