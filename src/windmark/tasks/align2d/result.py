"""What 2D alignment gives: the transformation with all that speaks for it, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g3
from windmark.geometry.described import described
from windmark.geometry.planar import PlanarTransform, Trial, hull_of, inside_hull
from windmark.scene import Detections, plots
from windmark.scene.detections import middle_sigma
from windmark.scene.shown import pandas_table
from windmark.tasks.align2d.apart import of_parts, parts_apart

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

CAUSES = {
    "no_spots": "no markers were found",
    "too_few": "fewer than three markers",
    "undetermined": "too few pairs, or on a line, for the transformation asked for",
    "nothing": "no piece of the reference's markers is found in the image",
    "weak": "the best matching could be chance",
    "ambiguous": "two different matchings explain the markers",
    "mirrored": "one picture is the other's mirror image",
}
"""Every cause of a `NotAligned`, in words."""
Cause = Literal["no_spots", "too_few", "undetermined", "nothing", "weak", "ambiguous", "mirrored"]


@described(lambda a: {
    "kind": a.kind, "pairs": len(a.pairs), "rejected": len(a.rejected), "rms px": g3(a.rms_px),
    "held out rms px": g3(a.held_out_px),
})  # fmt: skip
@dataclass(frozen=True)
class ImageAlignment:
    """An image aligned to a reference.

    Parameters
    ----------
    image : (H, W[, C]) float32 of the reference's size: the image recomputed on it; NaN where the image shows nothing
    transform : reference -> image, pixels
    reference_spots, image_spots : the markers of both pictures
    pairs : (K, 2) which spot of the reference is which of the image, those that the transformation is fitted to
    rejected : (R, 2) pairs that contradict the others
    still : (S, 2) pairs that stand still while the others move, taken for walls and left out
    residual : (K, 2) mapped - seen, image pixels
    held_out : (K, 2) the same from a fit without the pair: what to expect at a place between the markers
    trials : every kind with its fit, or why it has none
    choice : why this kind, in words
    log10_nfa : false-alarm number of the matching, decimal logarithm; NaN where the pairs were given
    rival : (pairs, sigma_px) of the best matching with other pairs; None where none came near
    options : everything it was made with, by name

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> wind_off = wm.synth.marker_scene(1, size_px=(160, 120), markers=12).image
    >>> aligned = wm.align_images(np.roll(wind_off, (2, 3), axis=(0, 1)), wind_off)
    >>> aligned.image.shape == wind_off.shape, len(aligned.pairs), aligned.rms_px < 0.05
    (True, 12, True)
    >>> bool(abs(aligned.held_out).max() < 0.1)  # pixels by which each marker is missed without its own help
    True
    """

    image: NDArray[np.float32]
    transform: PlanarTransform
    reference_spots: Detections
    image_spots: Detections
    pairs: Ints
    rejected: Ints
    still: Ints
    residual: Array
    held_out: Array
    trials: tuple[Trial, ...]
    choice: str
    log10_nfa: float
    rival: tuple[int, float] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return True

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: spots of both pictures, places, residual and held-out residual of every pair."""
        names = ("reference_x", "reference_y", "image_x", "image_y", "dx", "dy", "held_out_dx", "held_out_dy")
        values = np.hstack([self.reference_xy, self.image_xy, self.residual, self.held_out]).T
        spots = dict(zip(("reference_spot", "image_spot"), self.pairs.T, strict=True))
        return pandas_table(spots | dict(zip(names, values, strict=True)))

    def plot(self, ax: Any = None) -> Any:
        """The aligned image with the markers' held-out residuals as arrows; the axes of matplotlib."""
        ax = plots.pixel_axes(ax, self.image, self.reference_xy)
        ax.plot(*self.reference_xy.T, ".", color="tab:blue")
        plots.arrows(ax, self.reference_xy, self.held_out)
        return ax

    @property
    def kind(self) -> str:
        """Kind of the transformation."""
        return self.transform.kind

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals."""
        return float(np.sqrt((self.residual**2).sum(axis=1).mean()))

    @property
    def held_out_px(self) -> float:
        """Root mean square length of the held-out residuals."""
        return float(np.sqrt((self.held_out**2).sum(axis=1).mean()))

    @property
    def reference_xy(self) -> Array:
        """(K, 2) the paired markers in the reference."""
        return self.reference_spots.xy[self.pairs[:, 0]]

    @property
    def image_xy(self) -> Array:
        """(K, 2) the paired markers in the image."""
        return self.image_spots.xy[self.pairs[:, 1]]

    @property
    def shift_px(self) -> Array:
        """(K, 2) how far each marker moved in the picture."""
        return self.image_xy - self.reference_xy

    @property
    def apart(self) -> list[Ints]:
        """Parts that moved by themselves: for each the rows of ``rejected``, the largest part first."""
        if len(self.rejected) < 2:
            return []
        x, off, sigma = self._off()
        return parts_apart(x, off, sigma, self.reference_xy)

    def _off(self) -> tuple[Array, Array, Array]:
        """Places of the rejected markers, how far they are from where the transformation has them, and its sigma."""
        i, j = self.rejected.T
        x = self.reference_spots.xy[i]
        marks = middle_sigma(self.reference_spots.cov[i]) ** 2 + middle_sigma(self.image_spots.cov[j]) ** 2
        sigma = np.sqrt(np.nan_to_num(marks) + self.transform.sigma_px(x) ** 2)
        return x, self.image_spots.xy[j] - self.transform.apply(x), sigma

    @property
    def hull(self) -> Array:
        """(H, 2) corners of the convex hull of the reference's paired markers; fewer than three where they are flat."""
        return hull_of(self.reference_xy)

    def extrapolated(self) -> Mask:
        """(H, W) pixels of the reference outside the hull of its paired markers: no marker vouches for them."""
        height, width = self.image.shape[:2]
        inside = np.zeros((height, width), dtype=bool)
        corners = self.hull
        if len(corners) > 2:
            x0, y0 = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
            x1, y1 = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, [width, height])
            at = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1)
            inside[y0:y1, x0:x1] = inside_hull(corners, at, 1e-9)
        return ~inside

    def sigma_map(self) -> NDArray[np.float32]:
        """(H, W) 1 sigma per coordinate of the mapped place of every pixel, pixels; linear between nodes.

        Where a part moved by itself (`apart`) it holds how far that part is off.
        """
        height, width = self.image.shape[:2]
        step = max(2, round(max(width, height) / 128))
        x, y = (np.arange((n - 1) // step + 2) * float(step) for n in (width, height))
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        at = self.transform.sigma_px(places)
        if parts := self.apart:
            x_off, off, _ = self._off()
            at = np.sqrt(at**2 + of_parts(places, x_off, off, parts, self.reference_xy))
        at = at.reshape(len(y), len(x))
        rows = np.stack([np.interp(np.arange(height), y, column) for column in at.T], axis=1)
        return np.stack([np.interp(np.arange(width), x, row) for row in rows]).astype(np.float32)


@dataclass(frozen=True)
class NotAligned:
    """Why an image was not aligned; falsy.

    Parameters
    ----------
    reason : in words, with the numbers
    cause : one of `CAUSES`
    count : pairs of the best matching that was seen
    log10_nfa : its false-alarm number
    reference_spots, image_spots : the markers found, None where it did not come so far
    options : everything it was made with, by name

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> bare = np.full((80, 100), 120, dtype=np.uint8)
    >>> answer = wm.align_images(bare, bare)
    >>> bool(answer), answer.cause
    (False, 'no_spots')
    """

    reason: str
    cause: Cause
    count: int = 0
    log10_nfa: float = float("inf")
    reference_spots: Detections | None = None
    image_spots: Detections | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return False
