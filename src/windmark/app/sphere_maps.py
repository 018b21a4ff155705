"""Maps of directions: equal-area discs of the sphere round the model, coloured by a value per direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark.tasks.marker_check.settings import CheckSettings, azimuth_elevation_deg, direction_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

PIXELS = 501
RIM, LINES, NOTHING = "0.35", "0.45", "0.88"
POLE_DEG = 60.0  # a region whose middle is higher is drawn with azimuth round its rim


@dataclass(frozen=True, eq=False)
class Disc:
    """Lambert's azimuthal equal-area projection of a cap of the sphere, seen from outside.

    Parameters
    ----------
    title : where it lies
    middle, right, up : (3,) unit vectors, right-handed in this order turned by one
    reach_deg : angle from the middle to the rim
    """

    title: str
    middle: Array
    right: Array
    up: Array
    reach_deg: float

    @property
    def radius(self) -> float:
        """Of the rim, in the plane."""
        return float(2 * np.sin(np.radians(self.reach_deg) / 2))

    def place(self, direction: Array) -> Array:
        """(..., 2) of unit vectors (..., 3)."""
        stretch = np.sqrt(2 / np.maximum(1 + direction @ self.middle, 1e-9))
        return np.stack([direction @ self.right, direction @ self.up], axis=-1) * stretch[..., None]

    def within(self, direction: Array) -> NDArray[np.bool_]:
        """Which unit vectors lie on it."""
        return np.asarray(direction @ self.middle >= np.cos(np.radians(self.reach_deg)) - 1e-9)

    def raster(self) -> tuple[Array, NDArray[np.bool_]]:
        """(P, P, 3) direction of each pixel, lower left first, and which lie on the disc."""
        side = np.linspace(-self.radius, self.radius, PIXELS)
        x, y = np.meshgrid(side, side)
        rho2 = x * x + y * y
        on = rho2 <= self.radius**2
        rho2 = np.minimum(rho2, 4.0)
        across = np.sqrt(1 - rho2 / 4)
        parts = ((1 - rho2 / 2, self.middle), (x * across, self.right), (y * across, self.up))
        return sum((value[..., None] * axis for value, axis in parts), np.zeros((PIXELS, PIXELS, 3))), on


def discs(settings: CheckSettings) -> list[Disc]:
    """Upper and lower half of the sphere, or the region that was asked for."""
    x, y, z = np.eye(3)
    if settings.view_from is None:
        return [Disc("camera above (z > 0)", z, x, y, 90.0), Disc("camera below (z < 0)", -z, x, -y, 90.0)]
    middle = direction_of(*settings.view_from)
    up = (y if middle[2] > 0 else -y) if abs(settings.view_from[1]) > POLE_DEG else z
    up = up - (up @ middle) * middle
    up /= np.linalg.norm(up)
    azimuth, elevation = settings.view_from
    title = f"{settings.within_deg:g}° about azimuth {azimuth:g}°, elevation {elevation:g}°"
    return [Disc(title, middle, np.cross(up, middle), up, min(settings.within_deg, 179.0))]


def draw_map(axes: Axes, disc: Disc, directions: Array, values: Array, **look: Any) -> AxesImage:
    """Colour each point of a disc as the nearest direction's value; grey where that is NaN."""
    from scipy.spatial import cKDTree

    pixel, on = disc.raster()
    shown = np.full(on.shape, np.nan)
    shown[on] = values[cKDTree(directions).query(pixel[on])[1]]
    r = disc.radius
    extent = (-r, r, -r, r)
    background = np.where(on, 1.0, np.nan)
    axes.imshow(background, origin="lower", extent=extent, cmap="Greys", vmin=0, vmax=8, interpolation="nearest")
    image = axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest", **look)
    _graticule(axes, disc)
    axes.set(xlim=(-1.17 * r, 1.17 * r), ylim=(-1.17 * r, 1.17 * r), aspect="equal")
    axes.set_axis_off()
    axes.set_title(disc.title, fontsize=10)
    return image


def _graticule(axes: Axes, disc: Disc) -> None:
    """Lines of equal azimuth and elevation, with their degrees."""
    step = 30 if disc.reach_deg > 50 else 15 if disc.reach_deg > 20 else 5
    fine = np.linspace(-180, 180, 721)
    for elevation in range(-90 + step, 90, step):
        _line(axes, disc, np.array([direction_of(a, elevation) for a in fine]))
    for azimuth in range(-180, 180, step):
        top = 90 if azimuth % 90 == 0 else 90 - step / 2
        _line(axes, disc, np.array([direction_of(azimuth, e) for e in np.linspace(-top, top, 361)]))
    turn = np.linspace(0, 2 * np.pi, 361)
    axes.plot(disc.radius * np.cos(turn), disc.radius * np.sin(turn), color=RIM, lw=1.2)
    middle = azimuth_elevation_deg(disc.middle)
    if abs(middle[1]) > 89.9:
        _polar_labels(axes, disc, step, float(np.sign(middle[1])))
    else:
        _local_labels(axes, disc, step, middle)


def _line(axes: Axes, disc: Disc, direction: Array) -> None:
    place = np.where(disc.within(direction)[:, None], disc.place(direction), np.nan)
    axes.plot(*place.T, color=LINES, lw=0.5, alpha=0.8)


def _polar_labels(axes: Axes, disc: Disc, step: int, side: float) -> None:
    """Azimuth round the rim, elevation along a line between two azimuths."""
    for azimuth in range(0, 360, max(step, 30)):
        outward = disc.place(direction_of(azimuth, side * (90 - disc.reach_deg)))
        outward = outward / np.linalg.norm(outward)
        x, y = 1.09 * disc.radius * outward
        axes.text(x, y, f"{azimuth}°", ha="center", va="center", fontsize=8, color=RIM)
    for away in range(step, int(disc.reach_deg), step):
        elevation = side * (90 - away)
        _tag(axes, disc.place(direction_of(45, elevation)), f"{elevation:.0f}°")


def _local_labels(axes: Axes, disc: Disc, step: int, middle: Array) -> None:
    """Elevation along the middle's meridian, azimuth where its line leaves the disc towards the equator."""
    for elevation in range(-90 + step, 90, step):
        direction = direction_of(middle[0], elevation)
        if disc.within(direction):
            _tag(axes, disc.place(direction), f"{elevation}°")
    away = np.sign(middle[1]) or 1.0
    for azimuth in range(-180, 180, step if abs(middle[1]) + disc.reach_deg < 90 else max(step, 30)):
        line = np.array([direction_of(azimuth, away * e) for e in np.linspace(-90, 89, 359)])
        line = line[disc.within(line)]
        if not len(line):
            continue
        x, y = disc.place(line[0])
        if np.hypot(x, y) > 0.9 * disc.radius:
            axes.text(1.09 * x, 1.07 * y, f"{azimuth % 360}°", ha="center", va="center", fontsize=8, color=RIM)


def _tag(axes: Axes, place: Array, text: str) -> None:
    box = {"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.75}
    axes.text(float(place[0]), float(place[1]), text, ha="center", va="center", fontsize=7, color="0.2", bbox=box)
