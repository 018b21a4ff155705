"""The search plane: spots and markers as the kernels want them.

Lens distortion and aspect are undone once, for the spots; from there on a marker at (X, Y, Z) in the
camera frame is seen at f (X, Y) / Z. Markers are centred and scaled to unit size, so that no constant
depends on the length unit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera
from windmark.geometry.order import median
from windmark.registration._kernels.hypothesis import Picture
from windmark.registration._kernels.raster import raster_kernel
from windmark.registration.search.layout import Layout
from windmark.registration.search.near import nearest
from windmark.registration.task import Task

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

SPOT_NEIGHBOURS = 16
"""Neighbours of a spot that a search looks at, if it asks for no more."""
FIRST_SPOTS, PER_MARKER = 40, 1.25
"""Spots come best first: so many at least, and so many per marker, are searched, then twice as many, ..."""
_FINEST, _COARSEST = 1024, 128
"""Raster cells along the longer side at most and at least; between them a cell is as wide as the tolerance."""
_ALONG = np.linspace(0.0, 1.0, 33)
_BORDER = np.concatenate(
    [np.stack(np.broadcast_arrays(x, y), axis=-1) for x, y in ((_ALONG, 0), (_ALONG, 1), (0, _ALONG), (1, _ALONG))]
)
"""(132, 2) points all along the border of an image of size 1."""


class Plane:
    """A task in its search plane; ``radius`` is that of its spots (px, their median), 0 where unknown.

    ``layout``, ``model`` and ``frame`` are the markers, ``picture(n)`` the best n spots for the search.
    """

    def __init__(self, task: Task, layout: Layout | None = None) -> None:
        self.task, self.layout = task, layout or Layout(task.markers)
        self.model, self.frame = self.layout.model, self.layout.frame
        self._packed = task.camera.packed()
        self._size = np.array(task.camera.size_px, dtype=float)
        self._p = np.ascontiguousarray(to_plane(task.camera, task.xy))
        known = np.zeros(0) if task.radius_px is None else task.radius_px[np.isfinite(task.radius_px)]
        self.radius = median(known) if len(known) else 0.0
        self._bounds = _bounds(task.camera, self._p)
        self._pictures: dict[tuple[int, int], Picture] = {}
        self.leads = lead_sizes(len(task.xy), len(task.markers))

    @property
    def fixed_count(self) -> int:
        """Pairs that fix pose and camera."""
        return 4 if self.task.free_focal else 3

    def log_shares(self, leads: tuple[int, ...]) -> Array:
        """(L,) what priors and labels leave of the ways to begin with the best so many spots, as logarithms."""
        share = float(np.log(self.task.prior_share))
        return np.array([share + self.task.log_label_share(lead, self.fixed_count) for lead in leads])

    def picture(self, lead: int, neighbours: int = SPOT_NEIGHBOURS) -> Picture:
        """The best ``lead`` spots for the kernels, each with so many ``neighbours``."""
        if (lead, neighbours) not in self._pictures:
            self._pictures[lead, neighbours] = _picture(
                self._packed, self._size, self._p[:lead], self._bounds, 3 * self.task.tolerance_px, self.radius,
                neighbours,
            )  # fmt: skip
        return self._pictures[lead, neighbours]

    def part(self, spots: Ints) -> Picture:
        """Some of the spots for the kernels, numbered anew; as dense as among all."""
        part = _picture(
            self._packed, self._size, np.ascontiguousarray(self._p[spots]), self._bounds, 3 * self.task.tolerance_px,
            self.radius, SPOT_NEIGHBOURS,
        )  # fmt: skip
        return part._replace(density=self.picture(len(self._p)).density[spots])


def to_plane(camera: Camera, xy: Array) -> Array:
    """Ideal pixels (M, 2) of image points: principal point at the origin, square; NaN where the lens has no inverse."""
    return camera.focal_px * camera.unproject(xy)[:, :2]


def picture(camera: Camera, xy: Array, reach_px: float) -> Picture:
    """Spots (M, 2) of an image for the kernels; the raster knows the nearest spot up to ``reach_px`` away.

    Spots must have a finite `to_plane`.
    """
    p = np.ascontiguousarray(to_plane(camera, xy))
    size, bounds = np.array(camera.size_px, dtype=float), _bounds(camera, p)
    return _picture(camera.packed(), size, p, bounds, reach_px, 0.0, SPOT_NEIGHBOURS)


def _picture(
    packed: Array, size: Array, p: Array, bounds: tuple[Array, Array], reach: float, radius: float, neighbours: int
) -> Picture:
    low, high = bounds
    longest = float((high - low).max())
    cell = min(max(0.25 * reach, longest / _FINEST), longest / _COARSEST)
    columns, rows = np.maximum(1, np.ceil((high - low) / cell).astype(int)).tolist()
    raster = raster_kernel(packed, size, p, low, cell, columns, rows, reach, radius)
    near, distance = nearest(p, min(len(p) - 1, neighbours))
    return Picture(p, density_of(distance, size), near, raster, float(low[0]), float(low[1]), 1 / cell)


def density_of(distance: Array, size: Array) -> Array:
    """(M,) spots per px^2: round each spot (four neighbours) or on average, whichever is more.

    Dust and rivet rows come in clusters; with the average alone they would pass for evidence. From the distances
    of `nearest`.
    """
    average = len(distance) / (size[0] * size[1])
    k = min(4, distance.shape[1])
    if k < 1:
        return np.full(len(distance), average)
    return np.maximum(average, k / (np.pi * np.maximum(distance[:, k - 1], 1e-3) ** 2))


def lead_sizes(spots: int, markers: int) -> list[int]:
    """Numbers of best spots to look at: some, twice as many, ..., all."""
    sizes, n = [], max(FIRST_SPOTS, int(np.ceil(PER_MARKER * markers)))
    while 1.3 * n < spots:
        sizes.append(n)
        n *= 2
    return [*sizes, spots]


def _bounds(camera: Camera, p: Array) -> tuple[Array, Array]:
    """Rectangle of the plane that holds the image's border and all spots."""
    size = np.array(camera.size_px, dtype=float)
    border, low, high = to_plane(camera, _BORDER * size - 0.5), p.min(axis=0), p.max(axis=0)
    # A border where the lens model ends maps far out, or is NaN; the spots and a generous frame bound it.
    low2 = np.maximum(np.fmin(np.fmin.reduce(border), low), np.minimum(low, -1.5 * size))
    high2 = np.minimum(np.fmax(np.fmax.reduce(border), high), np.maximum(high, 1.5 * size))
    return low2 - 1.0, high2 + 1.0
