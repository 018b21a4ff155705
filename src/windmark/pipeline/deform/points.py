"""Values of every frame's pictures at taps that move with the deformed grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.deformation import Deformation, bound_vertices
from windmark.pipeline.deform.load import Loaded
from windmark.pipeline.deform.pictures import read_light
from windmark.pipeline.points import PointSet
from windmark.resection import Picture, PointValues
from windmark.resection.sources import prepare
from windmark.tasks.deform.task import DeformedFrame, FrameImages

Array = NDArray[np.float64]

OBLIQUITY_DEG, INTERPOLATION = 75.0, "cubic"
"""Where the project has no [values] that say otherwise."""
COLUMNS = ("frame", "camera", "name", "x", "y", "z", "value", "sigma", "ratio", "sigma_ratio", "reason")
"""Of a table of points over frames; x, y, z: where the point is in this frame, in the tunnel's axes."""


@dataclass(frozen=True)
class FramePoints:
    """One camera's values at one set of points in one frame; ratio: wind-off over this frame, NaN without wind-off."""

    of: PointSet
    camera: str
    values: PointValues
    ratio: Array
    sigma_ratio: Array


@dataclass
class _Off:
    """Wind-off values and their variance, summed over frames."""

    values: list[Array] = field(default_factory=list)
    variances: list[Array] = field(default_factory=list)

    def mean(self) -> tuple[Array, Array]:
        return np.mean(self.values, axis=0), np.mean(self.variances, axis=0) / len(self.variances)


class PointMapper:
    """Takes values at the project's points in every frame.

    A point keeps its place on the grid (its triangle and weights there) and so moves with the law of the volume that
    it belongs to.

    Parameters
    ----------
    loaded : a project with points and a grid
    """

    def __init__(self, loaded: Loaded) -> None:
        assert loaded.mesh is not None
        project = loaded.project
        self._test, self._mesh = loaded.test, loaded.mesh
        self._placed = bound_vertices(loaded.test.volumes, loaded.mesh)
        how = project.values
        self._black = 0.0 if how is None else how.black
        self._oblique = OBLIQUITY_DEG if how is None else how.max_obliquity_deg
        self._interpolation = INTERPOLATION if how is None else how.interpolation
        self.sets = loaded.places
        self._off: dict[tuple[str, str], _Off] = {}

    def reference(self, frames: Sequence[tuple[DeformedFrame, FrameImages]]) -> None:
        """Take wind-off frames as what later ones are compared with."""
        for frame, images in frames:
            for found in self._taken(frame, images):
                off = self._off.setdefault((found.of.name, found.camera), _Off())
                off.values.append(found.values.value)
                off.variances.append(found.values.sigma**2)

    def frame(self, frame: DeformedFrame, images: FrameImages) -> list[FramePoints]:
        """Values of all cameras at all sets, with their ratio to the wind-off ones; none where the frame is lost."""
        return [self._divided(found) for found in self._taken(frame, images)]

    def _taken(self, frame: DeformedFrame, images: FrameImages) -> list[FramePoints]:
        if frame.state is None:
            return []
        moved = frame.state.mesh(self._mesh, placed=self._placed)
        out = []
        for name in frame.views:
            if name not in images.images:
                continue
            station = self._test.station(name)
            camera = frame.state.cameras.get(name, station.camera)
            pose = frame.state.cam_from_tunnel.get(name, station.cam_from_tunnel)
            levels, light = read_light(images.images[name], station)
            noise = resection.noise_law(levels.grey, apart=None if levels.apart == 1 else levels.apart)
            source = prepare(Picture(name, light, camera, pose, noise), moved, self._interpolation, "values at points")
            for s in self.sets:
                values = resection.point_values(
                    source, moved, s.asked, s.surface, max_obliquity_deg=self._oblique,
                    place_cov=self._place_cov(frame.state, s),
                )  # fmt: skip
                values = PointValues(values.value - self._black, values.sigma, values.reason, values.xy, values.xyz,
                                     values.moved)  # fmt: skip
                unknown = np.full(len(values), np.nan)
                out.append(FramePoints(s, name, values, unknown, unknown))
        return out

    def _place_cov(self, state: Deformation, s: PointSet) -> Array:
        """(N, 3, 3) covariance of the points' places by that of the laws' parameters and the motion."""
        on = s.surface.triangle >= 0
        cov = np.zeros((len(on), 3, 3))
        cov[on] = state.place(s.surface.xyz[on], np.asarray(self._mesh.volume)[s.surface.triangle[on]])[1]
        return cov

    def _divided(self, found: FramePoints) -> FramePoints:
        off = self._off.get((found.of.name, found.camera))
        if off is None:
            return found
        still, variance = off.mean()
        value, sigma = found.values.value, found.values.sigma
        good = (value > 0) & (still > 0)
        ratio = np.divide(still, value, out=np.full(len(value), np.nan), where=good)
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.abs(ratio) * np.sqrt(variance / still**2 + (sigma / value) ** 2)
        return FramePoints(found.of, found.camera, found.values, ratio, np.where(good, spread, np.nan))
