"""What tracking needs of markers and camera, found once and handed on in the state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.registration._kernels.fit import Markers
from windmark.registration.register import roughness
from windmark.registration.search.layout import Layout
from windmark.scene import MarkerSet

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prepared:
    """Markers and camera as the kernels want them; ``layout`` and ``camera`` are the nouns they come from.

    ``rough`` is the table's `roughness`, which the search must bridge.
    """

    layout: Layout
    camera: Camera
    markers: Markers
    packed: Array
    size: Array
    rough: float

    @staticmethod
    def of(markers: MarkerSet, camera: Camera, layout: Layout | None = None) -> Prepared:
        """Prepare; ``layout`` saves its milliseconds."""
        layout = (layout or Layout(markers)).ready()
        sigma = np.where(np.isfinite(markers.sigma), markers.sigma, 0.0) / layout.frame.scale
        unit = Markers(layout.model.xyz, layout.model.normal, np.ascontiguousarray(sigma))
        return Prepared(
            layout, camera, unit, camera.packed(), np.array(camera.size_px, dtype=float), roughness(markers)
        )

    def fits(self, markers: MarkerSet, camera: Camera) -> bool:
        """Whether it was made from these; the same objects are known without a look."""
        if self.layout.markers is not markers:
            mine = self.layout.markers.sigma
            if not (self.layout.is_of(markers) and np.array_equal(mine, markers.sigma, equal_nan=True)):
                return False
        same = self.camera is camera or np.array_equal(self.packed, camera.packed())
        return same and self.camera.size_px == camera.size_px
