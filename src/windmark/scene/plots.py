"""What ``plot`` of nouns and results draws with: axes in pixels, as the picture lies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from windmark.errors import g2

LONGEST = 0.05
"""The longest arrow, as part of the longer side of what is shown."""


def pixel_axes(ax: Any, image: ArrayLike | None, xy: ArrayLike) -> Any:
    """Axes of matplotlib with x to the right and y down, over the image, or around the places (M, 2) without one.

    Parameters
    ----------
    ax : axes to draw into; None: new ones
    image : (H, W) or (H, W, 3); grey levels are shown from their 1st to their 99th percentile
    """
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(layout="constrained")
    ax.set_xlabel("x, pixels")
    ax.set_ylabel("y, pixels")
    ax.set_aspect("equal")
    if image is not None:
        pixels = np.asarray(image)
        low, high = np.nanpercentile(pixels, (1, 99))
        ax.imshow(pixels, cmap="gray", vmin=low, vmax=high if high > low else low + 1.0)
        return ax
    places = np.asarray(xy, dtype=float).reshape(-1, 2)
    if len(places):
        ax.set_xlim(places[:, 0].min() - 10, places[:, 0].max() + 10)
        ax.set_ylim(places[:, 1].max() + 10, places[:, 1].min() - 10)
    return ax


def space_axes(ax: Any, xyz: ArrayLike) -> Any:
    """Axes of matplotlib in space, all three at one scale, around the places (M, 3); ``ax`` None: new ones."""
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(subplot_kw={"projection": "3d"}, layout="constrained")
    places = np.asarray(xyz, dtype=float).reshape(-1, 3)
    ax.set(xlabel="x", ylabel="y", zlabel="z")
    if len(places):
        low, high = places.min(axis=0), places.max(axis=0)
        room = 0.55 * (float((high - low).max()) or 1.0)
        middle = 0.5 * (low + high)
        ax.set(**{f"{axis}lim": (m - room, m + room) for axis, m in zip("xyz", middle, strict=True)})
    return ax


def space_arrows(ax: Any, xyz: ArrayLike, delta: ArrayLike, color: str = "tab:red") -> None:
    """Displacements (M, 3) as arrows at their places (M, 3), enlarged by a round factor that the title says."""
    places, steps = (np.asarray(a, dtype=float).reshape(-1, 3) for a in (xyz, delta))
    ax.plot(*places.T, ".", color="tab:gray")
    longest = float(np.linalg.norm(steps, axis=1).max(initial=0.0))
    if not longest > 0:
        return
    factor = round_length(2 * LONGEST * abs(float(np.ptp(ax.get_xlim()))) / longest)
    ax.quiver(*places.T, *(factor * steps.T), color=color)
    ax.set_title(f"displacements x {factor:g}, the longest is {g2(longest)}")


def round_length(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1, 2, 5) if m <= value / power * (1 + 1e-12)) * power)


def arrows(ax: Any, xy: ArrayLike, delta: ArrayLike, color: str = "tab:red") -> None:
    """Residuals (M, 2) as arrows at their places (M, 2), enlarged by a round factor that the title says."""
    places, steps = (np.asarray(a, dtype=float).reshape(-1, 2) for a in (xy, delta))
    longest = float(np.hypot(*steps.T).max()) if len(steps) else 0.0
    if not longest > 0:
        return
    span = max(abs(float(np.ptp(limits))) for limits in (ax.get_xlim(), ax.get_ylim()))
    factor = round_length(LONGEST * span / longest)
    ax.quiver(
        places[:, 0], places[:, 1], factor * steps[:, 0], factor * steps[:, 1],
        color=color, angles="xy", scale_units="xy", scale=1.0, width=0.003,
    )  # fmt: skip
    ax.set_title(f"residuals x {factor:g}, the longest is {g2(longest)} px")


def ellipses(ax: Any, xy: ArrayLike, axes_px: ArrayLike, angle: ArrayLike, color: str) -> None:
    """Ellipses (M, 2) of half axes (M, 2) and angle (M,); where these are not known, crosses."""
    from matplotlib.collections import EllipseCollection

    places, half, turn = np.asarray(xy, float), np.asarray(axes_px, float), np.asarray(angle, float)
    known = np.isfinite(half).all(axis=1)
    ax.add_collection(
        EllipseCollection(
            2 * half[known, 0], 2 * half[known, 1], np.degrees(np.nan_to_num(turn[known])), units="xy",
            offsets=places[known], offset_transform=ax.transData, facecolors="none", edgecolors=color,
        )
    )  # fmt: skip
    ax.plot(*places[~known].T, "+", color=color)
