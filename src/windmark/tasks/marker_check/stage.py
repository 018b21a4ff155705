"""The stage of a virtual campaign: markers, camera, model; where a camera stands and what it would see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet, Mesh
from windmark.tasks.marker_check.settings import CheckSettings
from windmark.tasks.sight import sight

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

PLACED = 6  # steps in which the distance is found
OUTLINE = 2000  # nodes of the grid that stand for its outline
WIDENED = 0.1
OFF_MESH = 1e-3
"""A marker's table may put it so far under the grid (part of `Mesh.sizes`) and the grid does not hide it."""


@dataclass(frozen=True)
class Stage:
    """What is photographed and by what.

    Parameters
    ----------
    markers : the layout to check
    camera : its interior parameters
    mesh : surface of the model, which then hides markers and fills the image; None: the markers alone
    settings : what is assumed of views and spots
    """

    markers: MarkerSet
    camera: Camera
    mesh: Mesh | None
    settings: CheckSettings

    def with_markers(self, markers: MarkerSet) -> Stage:
        """The same stage with another layout; the camera still aims at the first one's outline."""
        other = replace(self, markers=markers)
        other.__dict__["outline"] = self.outline
        return other

    @cached_property
    def outline(self) -> Array:
        """(P, 3) points that have to be in the image: the markers that are not on walls, and the grid about them.

        Of the grid, what lies in the box of these markers widened by a part of its diagonal: it may hold walls too.
        """
        model = self.markers.role != "wall"
        points = self.markers.xyz[model] if model.sum() > 1 else self.markers.xyz
        if self.mesh is None:
            return points
        margin = WIDENED * np.linalg.norm(np.ptp(points, axis=0))
        nodes = self.mesh.vertices[self.mesh.used]
        near = ((nodes > points.min(axis=0) - margin) & (nodes < points.max(axis=0) + margin)).all(axis=1)
        nodes = nodes[near]
        return np.concatenate([points, nodes[:: max(1, len(nodes) // OUTLINE)]])

    @cached_property
    def middle(self) -> Array:
        """(3,) centre of the outline's box."""
        return np.asarray(0.5 * (self.outline.min(axis=0) + self.outline.max(axis=0)))

    @cached_property
    def size(self) -> float:
        """Diagonal of the outline's box."""
        return float(np.linalg.norm(np.ptp(self.outline, axis=0)))

    def pose(self, direction: Array, roll: float, fill: float) -> Pose:
        """A camera in this direction from the model, so far away that the outline fills so much of the image."""
        width, height = self.camera.size_px
        side = np.cross(direction, [1.0, 0.0, 0.0] if abs(direction[0]) < 0.9 else [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        up = np.cos(roll) * side + np.sin(roll) * np.cross(direction, side)
        distance = self.size * self.camera.focal_px / (fill * min(width, height))
        half = np.array([width, height]) / 2
        for _ in range(PLACED):
            distance = max(distance, 0.6 * self.size)
            pose = Pose.look_at(self.middle + distance * direction, self.middle, up)
            xy, ok = self.camera.project(pose.apply(self.outline))
            off = np.abs(xy - half + 0.5) / half
            distance *= float(off.max()) / fill if ok.all() else 1.5
        return pose

    def seen(self, pose: Pose) -> tuple[Array, Mask]:
        """(N, 2) images of the markers, and which ones a detector could find there."""
        xy, seen = in_sight(self.markers.xyz, self.markers.normal, self.camera, pose, self.settings.max_obliquity_deg)
        if self.mesh is not None and seen.any():
            off = OFF_MESH * self.mesh.sizes
            node = resection.see_points(self.markers.xyz[seen], self.camera, pose, mesh=self.mesh, tolerance=off)
            seen[seen] = node.visible
        return xy, seen

    @cached_property
    def visible(self) -> Callable[[Pose, Camera], Mask] | None:
        """What `register` is told of the grid, as in a run; None without one."""
        return None if self.mesh is None else sight(self.markers, self.mesh)

    def spots(self, rng: np.random.Generator, xy: Array, seen: Mask) -> tuple[Detections, Ints]:
        """What a detector would give of these markers, in random order, and the marker of each spot or -1."""
        s = self.settings
        index = np.flatnonzero(seen)
        false = rng.uniform(0, 1, (round(s.false_percent / 100 * len(index)), 2)) * self.camera.size_px - 0.5
        index = index[rng.uniform(0, 1, len(index)) >= s.hidden_percent / 100]
        spots = np.concatenate([xy[index] + rng.normal(0, s.noise_px, (len(index), 2)), false])
        label = np.concatenate([index, np.full(len(false), -1)])
        order = rng.permutation(len(spots))
        return Detections.make(spots[order], sigma_px=s.noise_px), label[order]


def in_sight(xyz: Array, normal: Array, camera: Camera, pose: Pose, max_obliquity_deg: float) -> tuple[Array, Mask]:
    """(..., N, 2) images, and which are in the picture and seen no more obliquely than that; no normal: from anywhere.

    ``pose`` may be a batch (...).
    """
    xy, ok = camera.project(pose.apply(xyz))
    to_eye = pose.center[..., None, :] - xyz
    cosine = (normal * to_eye).sum(axis=-1) / np.linalg.norm(to_eye, axis=-1)
    return xy, ok & camera.in_image(xy) & ~(cosine < np.cos(np.radians(max_obliquity_deg)))
