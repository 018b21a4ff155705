"""What a detector saw in one image, and which spot is which marker."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import g2, g3
from windmark.geometry.described import described
from windmark.scene.shown import pandas_table

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


def middle_sigma(cov: Array) -> float:
    """Median 1 sigma per coordinate of places with covariances (N, 2, 2); NaN without any."""
    return float(np.sqrt(np.median(np.trace(cov, axis1=1, axis2=2) / 2))) if len(cov) else float("nan")


def _figures(d: Detections) -> dict[str, object]:
    if not len(d):
        return {"spots": 0}
    sigma = middle_sigma(d.cov)
    return {
        "spots": len(d), "median radius px": f"{g3(np.median(d.radius_px))}", "median sigma px": f"{g2(sigma)}",
        "flagged": int((d.flags != 0).sum()),
    }  # fmt: skip


@described(_figures)
@dataclass(frozen=True)
class Detections:
    """M spots of one image as columns, best first (in the detector's order of quality).

    Parameters
    ----------
    xy : (M, 2) centres in pixels; (0, 0) is the centre of the top-left pixel
    cov : (M, 2, 2) covariance of xy in px^2
    merit : (M,) the paper's merit m, 0 is a perfect inverse top-hat
    radius_px : (M,) radius of the disc as seen (geometric mean of the half axes)
    axes_px : (M, 2) half axes of the imaged ellipse, largest first; NaN where not estimated
    angle : (M,) direction of the first axis from x towards y, radians; NaN where not estimated
    depth : (M,) contrast to the background in grey levels, positive for the chosen polarity
    flags : (M,) bit field, see `FLAGS`

    Examples
    --------
    >>> import windmark as wm
    >>> spots = wm.Detections.make([[10.0, 20.0], [30.0, 25.5]], sigma_px=0.05, radius_px=3.0)
    >>> len(spots), spots.cov[0].round(6).tolist()
    (2, [[0.0025, 0.0], [0.0, 0.0025]])
    >>> spots.take([1]).xy.tolist()
    [[30.0, 25.5]]
    """

    xy: Array
    cov: Array
    merit: Array
    radius_px: Array
    axes_px: Array
    angle: Array
    depth: Array
    flags: Ints

    def __post_init__(self) -> None:
        m = len(self.xy)
        shapes = {
            "xy": (m, 2), "cov": (m, 2, 2), "merit": (m,), "radius_px": (m,),
            "axes_px": (m, 2), "angle": (m,), "depth": (m,), "flags": (m,),
        }  # fmt: skip
        for name, shape in shapes.items():
            got = np.shape(getattr(self, name))
            if got != shape:
                raise ValueError(f"Detections: {name} must be {shape} for {m} spots, got {got}")
        if not np.isfinite(self.xy).all():
            raise ValueError("Detections: xy must be finite")

    @staticmethod
    def make(
        xy: ArrayLike,
        *,
        sigma_px: ArrayLike = 0.1,
        cov: ArrayLike | None = None,
        merit: ArrayLike = np.nan,
        radius_px: ArrayLike = np.nan,
        axes_px: ArrayLike | None = None,
        angle: ArrayLike = np.nan,
        depth: ArrayLike = np.nan,
        flags: ArrayLike = 0,
    ) -> Detections:
        """Spots from centres and whatever else is known; scalars are repeated."""
        p = np.array(xy, dtype=float).reshape(-1, 2)
        m = len(p)
        if cov is None:
            cov = np.broadcast_to(np.asarray(sigma_px, dtype=float), (m,))[:, None, None] ** 2 * np.eye(2)

        def column(values: ArrayLike) -> Array:
            return np.array(np.broadcast_to(np.asarray(values, dtype=float), (m,)))

        return Detections(
            xy=p,
            cov=np.array(cov, dtype=float).reshape(m, 2, 2),
            merit=column(merit),
            radius_px=column(radius_px),
            axes_px=np.full((m, 2), np.nan) if axes_px is None else np.array(axes_px, dtype=float).reshape(m, 2),
            angle=column(angle),
            depth=column(depth),
            flags=np.array(np.broadcast_to(np.asarray(flags, dtype=np.int64), (m,))),
        )

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: x, y, their sigmas and correlation, merit, radius, depth and flags of each spot."""
        sigma = np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))
        with np.errstate(invalid="ignore", divide="ignore"):
            rho = self.cov[:, 0, 1] / sigma.prod(axis=1)
        return pandas_table({
            "x": self.xy[:, 0], "y": self.xy[:, 1], "sigma_x": sigma[:, 0], "sigma_y": sigma[:, 1], "rho": rho,
            "merit": self.merit, "radius_px": self.radius_px, "depth": self.depth, "flags": self.flags,
        })  # fmt: skip

    def plot(self, image: ArrayLike | None = None, ax: Any = None) -> Any:
        """The spots' ellipses, over the image where it is given (H, W); the axes of matplotlib.

        Where no half axes were estimated the radius is drawn, without one a cross.
        """
        from windmark.scene import plots

        ax = plots.pixel_axes(ax, image, self.xy)
        unknown = np.isnan(self.axes_px.sum(axis=1))
        half = np.where(unknown[:, None], self.radius_px[:, None], self.axes_px)
        plots.ellipses(ax, self.xy, half, np.where(unknown, 0.0, self.angle), "tab:orange")
        ax.set_title(f"{len(self)} spots")
        return ax

    def __len__(self) -> int:
        return len(self.xy)

    @property
    def ellipses(self) -> Array:
        """(M, 3) half axes and angle in one array, NaN where not estimated."""
        return np.column_stack([self.axes_px, self.angle])

    def take(self, index: ArrayLike) -> Detections:
        """The spots of a boolean mask or an index array, in that order."""
        i = np.asarray(index)
        if not i.size and i.dtype != bool:
            i = i.astype(np.int64)  # an empty list is made of floats
        return Detections(**{f.name: getattr(self, f.name)[i] for f in fields(self)})


FLAGS = {1: "border", 2: "saturated", 4: "contaminated", 8: "touching", 16: "ill-conditioned"}
"""Meaning of the bits of `Detections.flags`."""


@described(lambda m: {"pairs": len(m.marker)})
@dataclass(frozen=True)
class Matching:
    """K pairs of a spot and a marker, one to one.

    Parameters
    ----------
    detection : (K,) index into the detections
    marker : (K,) index into the marker set
    distance_px : (K,) distance between projected and detected position

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b", "c"], np.eye(3))
    >>> matching = wm.Matching(np.array([4, 0]), np.array([0, 2]), np.array([0.03, 0.05]))
    >>> len(matching), dict(zip(matching.detection.tolist(), markers.name[matching.marker].tolist(), strict=True))
    (2, {4: 'a', 0: 'c'})
    """

    detection: Ints
    marker: Ints
    distance_px: Array

    def __post_init__(self) -> None:
        if not (np.shape(self.detection) == np.shape(self.marker) == np.shape(self.distance_px)):
            raise ValueError("Matching: detection, marker and distance_px must have the same length")
        # Sets are several times faster than np.unique on the few entries of one image.
        if any(len(set(np.asarray(c).tolist())) != len(c) for c in (self.detection, self.marker)):
            raise ValueError("Matching: every detection and every marker may appear only once")

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: detection, marker and distance of every pair."""
        return pandas_table({"detection": self.detection, "marker": self.marker, "distance_px": self.distance_px})

    def __len__(self) -> int:
        return len(self.detection)
