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
from windmark.registration._kernels.growth import Gates
from windmark.registration._kernels.hypothesis import Picture, Rules
from windmark.registration._kernels.near import nearest
from windmark.registration._kernels.raster import raster_kernel
from windmark.registration.search.layout import Layout
from windmark.registration.task import Task, ideal_pixels, is_bent

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

SPOT_NEIGHBOURS = 16
"""Neighbours of a spot that a search looks at, if it asks for no more."""
FIRST_SPOTS, PER_MARKER = 40, 1.25
"""Spots come best first: so many at least, and so many per marker, are searched, then twice as many, ..."""
P_SEEN, REJECT_AT, GROW_AT = (0.6, 0.35), (-4.0, -8.0), (9.0, 3.0)
"""What the neighbourhood must say for a solution to be grown, of one camera and of a rig's: there most markers may be
hidden in one camera, and the others will judge."""
MIN_SCORE = 8.0
"""A grown solution worth less (nats) is given up."""
FOCAL_SLACK = 1.3
"""How far beyond the starting values a growing solution may take the focal length."""
_FINEST, _COARSEST = 1024, 128
"""Raster cells along the longer side at most and at least; between them a cell is as wide as the tolerance."""
_WIDEST = 0.5
"""Side of a cell at most, in reaches, where the plane is as wide as a lens makes it."""
_ALONG = np.linspace(0.0, 1.0, 33)
_BORDER = np.concatenate(
    [np.stack(np.broadcast_arrays(x, y), axis=-1) for x, y in ((_ALONG, 0), (_ALONG, 1), (0, _ALONG), (1, _ALONG))]
)
_CORNERS = np.array([[0.0, 0.0], [1.0, 1.0]])
"""(132, 2) points all along the border of an image of size 1, and two opposite corners."""


class Plane:
    """A task in its search plane; ``radius`` is that of its spots (px, their median), 0 where unknown.

    ``packed`` and ``size`` (2,) are the camera's and the image's.
    ``layout``, ``model`` and ``frame`` are the markers, ``picture(n)`` the best n spots for the search.
    """

    def __init__(self, task: Task, layout: Layout | None = None) -> None:
        self.task, self.layout = task, layout or Layout(task.markers)
        self.model, self.frame = self.layout.model, self.layout.frame
        self.packed, self.size = task.camera.packed(), np.array(task.camera.size_px, dtype=float)
        self._p = task.plane_xy
        known = np.zeros(0) if task.radius_px is None else task.radius_px[np.isfinite(task.radius_px)]
        self.radius = median(known) if len(known) else 0.0
        self._bounds = _bounds(task.camera, self._p)
        self._pictures: dict[tuple[int, int], Picture] = {}
        self.leads = lead_sizes(len(task.xy), len(task.markers))

    @property
    def fixed_count(self) -> int:
        """Pairs that fix pose and camera."""
        return 4 if self.task.free_focal else 3

    def log_shares(self, leads: list[int]) -> Array:
        """(L,) what priors and labels leave of the ways to begin with the best so many spots, as logarithms."""
        if self.task.prior is None and not self.task.fixed:
            return np.zeros(len(leads))
        share = float(np.log(self.task.prior_share))
        return np.array([share + self.task.log_label_share(lead, self.fixed_count) for lead in leads])

    def picture(self, lead: int, neighbours: int = SPOT_NEIGHBOURS) -> Picture:
        """The best ``lead`` spots for the kernels, each with so many ``neighbours``."""
        if (lead, neighbours) not in self._pictures:
            self._pictures[lead, neighbours] = self._picture(self._p[:lead], neighbours)
        return self._pictures[lead, neighbours]

    def part(self, spots: Ints) -> Picture:
        """Some of the spots for the kernels, numbered anew; as dense as among all."""
        part = self._picture(np.ascontiguousarray(self._p[spots]), SPOT_NEIGHBOURS)
        return part._replace(density=self.picture(len(self._p)).density[spots])

    def _picture(self, p: Array, neighbours: int) -> Picture:
        """With a raster that knows the nearest spot up to three times the tolerance away."""
        (low, high), reach = self._bounds, 3 * self.task.tolerance_px
        # A spot at nearly 90 degrees from the axis of a wide lens is anywhere in the plane: one of them must not make
        # all cells as large as a neighbourhood. What is left out here is labelled once the pose is known.
        most = np.maximum(0.5 * _FINEST * _WIDEST * reach, 1.5 * self.size)
        low, high = np.maximum(low, -most), np.minimum(high, most)
        longest = float((high - low).max())
        cell = min(max(0.25 * reach, longest / _FINEST), longest / _COARSEST)
        columns, rows = np.maximum(1, np.ceil((high - low) / cell).astype(int)).tolist()
        raster = raster_kernel(self.packed, self.size, p, low, cell, columns, rows, reach, self.radius)
        near, distance = nearest(p, min(len(p) - 1, neighbours))
        return Picture(p, density_of(distance, self.size), near, raster, float(low[0]), float(low[1]), 1 / cell)

    def rules(self, *, wide: bool = False) -> Rules:
        """What a hypothesis must pass."""
        task, n = self.task, len(self.model.xyz)
        rotation, cosine, depth = np.zeros((3, 3)), -2.0, np.ones(n)
        if task.prior is not None:
            rotation, translation = self.frame.unit(task.prior)
            cosine = float(np.cos(task.prior_max_angle_rad))
            depth = (self.model.xyz @ rotation.T + translation)[:, 2] / task.camera.focal_px
        return Rules(
            task.tolerance_px, P_SEEN[wide], REJECT_AT[wide], GROW_AT[wide],
            np.ascontiguousarray(rotation), cosine, np.ascontiguousarray(depth), task.prior_max_scale,
        )  # fmt: skip

    def gates(self) -> Gates:
        """Constants of growth."""
        task = self.task
        sigma = max(task.typical_sigma_px, task.tolerance_px / 8)
        low, high = task.focal_factors[0] / FOCAL_SLACK, task.focal_factors[-1] * FOCAL_SLACK
        low, high = task.camera.focal_px * low, task.camera.focal_px * high
        return Gates(task.tolerance_px, sigma, MIN_SCORE, low, high if task.free_focal else low)


def to_plane(camera: Camera, xy: Array) -> Array:
    """Ideal pixels (M, 2) of image points: principal point at the origin, square; NaN where the lens has no inverse."""
    return ideal_pixels(camera, camera.unproject(xy))


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
    size, low, high = np.array(camera.size_px, dtype=float), p.min(axis=0), p.max(axis=0)
    if is_bent(camera):
        border = to_plane(camera, _BORDER * size - 0.5)
    else:  # straight borders are where their corners are
        border = (_CORNERS * size - 0.5 - (camera.cx, camera.cy)) / (1.0, camera.aspect)
    # A border where the lens model ends maps far out, or is NaN; the spots and a generous frame bound it.
    low2 = np.maximum(np.fmin(np.fmin.reduce(border), low), np.minimum(low, -1.5 * size))
    high2 = np.minimum(np.fmax(np.fmax.reduce(border), high), np.maximum(high, 1.5 * size))
    return low2 - 1.0, high2 + 1.0
