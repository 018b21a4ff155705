"""What is to be fitted: the scene, the markers asked for, and which of them are near each other."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.detection.measured import Lattice
from windmark.detection.pairs import close_pairs
from windmark.detection.template.crlb import window_radius

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

WINDOW_BLURS = 4.5  # the window reaches so many blurs beyond the disc
NO_MASK = np.zeros((0, 0), dtype=bool)


@dataclass(frozen=True)
class Scene:
    """What the fits of one image have in common.

    Parameters
    ----------
    image : (H, W) grey levels, any real type
    usable : (H, W) or None: pixels that may be used
    sign : 1 for dark markers, -1 for bright ones
    saturation : grey level from which on a pixel says nothing
    multiplicative : True where paint multiplies the light
    lattice : the pixels that were measured, where the others are interpolated from them; None: all were
    """

    image: NDArray[np.generic]
    usable: Flags | None
    sign: float
    saturation: float
    multiplicative: bool
    lattice: Lattice | None = None

    def pixels(self) -> tuple[Any, Flags, float, float]:
        """What the kernels want to know of the image: `Pixels`, the mask, sign and saturation."""
        return self._pixels, self._usable, self.sign, self.saturation

    def measured(self) -> tuple[Any, Flags, float, float]:
        """`pixels` without those that are interpolated from others."""
        image, usable, *levels = self.pixels()
        return image, self._measured if self.lattice is not None else usable, *levels

    @cached_property
    def _usable(self) -> Flags:
        return np.require(NO_MASK if self.usable is None else self.usable, requirements=("C", "W"))

    @cached_property
    def _measured(self) -> Flags:
        assert self.lattice is not None
        own = self.lattice.pixels()
        return own if self.usable is None else own & self.usable

    @cached_property
    def _pixels(self) -> Any:
        from windmark.detection.template._kernels.cut import Pixels

        held = {name: self.image.dtype == name for name in ("uint8", "uint16")}
        held["float32"] = self.image.dtype.kind == "f" and self.image.dtype.itemsize <= 4
        held["float64"] = not any(held.values())
        none = {name: np.zeros((0, 0), name) for name in Pixels._fields}
        # Whatever the type and how it lies in memory: the compiled kernels are the same.
        return Pixels(*(np.require(self.image, n, ("C", "W")) if held[n] else none[n] for n in Pixels._fields))


@dataclass(frozen=True)
class Request:
    """K markers to be fitted; positions in pixels of the image.

    Parameters
    ----------
    xy : (K, 2) start of the centre
    radius : (K,) radius of the disc, for the window and the prior of the shape
    blur, blur_spread : (K,) prior of the blur and its standard deviation
    shape : (K, 3) L_xx, L_xy, L_yy to be held together with the blur, or None where the shape is fitted
    scale : (K,) noise for Tukey's weights, inf for least squares
    states : (K, 10) states to start from, relative to `xy`; NaN where the start is taken from the image's moments
    window : (K,) radius of the windows, None for what disc and blur need
    colour : (K, 2, 2) what the noise's correlation does to the covariances, as `TemplateFits.colour` had it in a frame
        before: taken as it is. NaN: computed; None: of all
    """

    xy: Array
    radius: Array
    blur: Array
    blur_spread: Array
    shape: Array | None
    scale: Array
    states: Array
    window: Array | None = None
    colour: Array | None = None

    def take(self, index: Ints | Flags) -> Request:
        """The markers of an index."""
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        taken: dict[str, Any] = {name: None if value is None else value[index] for name, value in columns.items()}
        return Request(**taken)

    def reach(self) -> Array:
        """Radius of the windows (K,)."""
        return self.window if self.window is not None else window_radius(self.radius, self.blur, WINDOW_BLURS)


@dataclass(frozen=True)
class Neighbours:
    """For K markers the places and radii of those near them: their pixels are not used.

    Parameters
    ----------
    xy, radius : (N, 2), (N,) all markers
    index : (K, L) into them, -1 where there are fewer than L
    margin : (N,) how far beyond its radius a neighbour is seen
    """

    xy: Array
    radius: Array
    index: Ints
    margin: Array

    @staticmethod
    def find(request: Request) -> Neighbours:
        """Neighbours of all markers whose discs come into their windows; the same marker found twice is none."""
        # Views are of another type, for which the kernels would be compiled anew.
        xy, radius, reach = np.ascontiguousarray(request.xy), np.ascontiguousarray(request.radius), request.reach()
        count, margin = len(xy), 3.0 * request.blur + 0.5
        if count < 2:
            return Neighbours(xy, radius, np.empty((count, 0), np.int64), margin)
        pairs = close_pairs(xy, float((reach + (radius + margin).max()).max()))
        if not len(pairs):
            return Neighbours(xy, radius, np.empty((count, 0), np.int64), margin)
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        i, j = pairs.T
        distance = np.hypot(*(xy[i] - xy[j]).T)
        near = (distance < reach[i] + radius[j] + margin[j]) & (distance > 0.5 * np.minimum(radius[i], radius[j]))
        i, j = i[near], j[near]
        order = np.lexsort((distance[near], i))
        i, j = i[order], j[order]
        many = np.bincount(i, minlength=count)
        index = np.full((count, int(many.max(initial=0))), -1, dtype=np.int64)
        index[i, np.arange(i.size) - np.repeat(np.cumsum(many) - many, many)] = j
        return Neighbours(xy, radius, index, margin)

    def take(self, index: Ints) -> Neighbours:
        """The neighbours of some markers."""
        return replace(self, index=self.index[index])

    def touching(self) -> Flags:
        """Markers (K,) into whose window another one reaches."""
        return np.asarray((self.index >= 0).any(axis=1))
