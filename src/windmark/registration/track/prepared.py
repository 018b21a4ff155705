"""What tracking needs of markers and camera, found once and handed on in the state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.registration.judge.first_order import PRIOR
from windmark.registration.options import roughness
from windmark.registration.search.layout import Layout
from windmark.registration.settle.views import known_camera
from windmark.registration.track.discs import Discs
from windmark.scene import MarkerSet

Array = NDArray[np.float64]


BENT = 0.05
"""Largest displacement of a marker, as part of the model's size, that is asked for; the default of `register`."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """Markers and camera as the kernels want them; ``layout`` and ``camera`` are the nouns they come from.

    ``rough`` is the table's `roughness`, which the search must bridge; ``sigma`` and ``modes`` are of the unit model,
    ``modes`` what a bow may look like; ``loose`` is how the camera may vary, see `settle.views.known_camera`; ``discs``
    are the markers of known radius and normal.
    """

    layout: Layout
    camera: Camera
    sigma: Array
    modes: Array
    packed: Array
    loose: Array
    size: Array
    rough: float
    discs: Discs | None

    @staticmethod
    def of(markers: MarkerSet, camera: Camera, layout: Layout | None = None) -> Prepared:
        """Prepare; ``layout`` saves its milliseconds."""
        layout = (layout or Layout(markers)).ready()
        modes = PRIOR * BENT * layout.size * layout.bows
        return Prepared(
            layout, camera, layout.sigma_of(markers), np.ascontiguousarray(modes), camera.packed(),
            np.ascontiguousarray(known_camera(camera, 0.0)[None]), np.array(camera.size_px, dtype=float),
            roughness(markers), Discs.of(markers),
        )  # fmt: skip

    def fits(self, markers: MarkerSet, camera: Camera) -> bool:
        """Whether it was made from these; the same objects are known without a look."""
        if self.layout.markers is not markers:
            mine = self.layout.markers.sigma
            if not (self.layout.is_of(markers) and np.array_equal(mine, markers.sigma, equal_nan=True)):
                return False
        if self.camera is camera:
            return True
        same = self.camera.size_px == camera.size_px and np.array_equal(self.packed, camera.packed())
        return same and np.array_equal(self.loose[0], known_camera(camera, 0.0))
