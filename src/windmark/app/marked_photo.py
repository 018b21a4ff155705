"""Camera pictures of a report that zoom to their pixels, with the markers that took part drawn over them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.app.photo import FIRST, Overlay, Room, preview
from windmark.app.pictures import MISSING
from windmark.pipeline.deform.followed import Standing
from windmark.pipeline.deform.pictured import Pictured
from windmark.scene import MarkerSet

Array = NDArray[np.float64]

SERIES = Room(photo=140_000)
"""Of a picture that stands for a series."""
FRAME = Room(photo=120_000)
"""Of one of several pictures of a sequence; with what is drawn over it, below 150 kB."""


def marked_photo(
    image: NDArray[np.generic], xy: Array, residual: Array, names: Sequence[str], caption: str, room: Room = FIRST,
    missing: tuple[Array, Sequence[str]] = (np.zeros((0, 2)), ()),
) -> str:  # fmt: skip
    """A picture with its spots (K, 2), the residuals (projected − detected, px) of their markers, and these' names.

    ``missing``: places and names of markers that have no spot there.
    """
    over = Overlay((image.shape[1], image.shape[0]))
    over.missing(*missing, f"marker expected, no spot ({len(missing[1])})")
    return _with_matches(over, image, xy, residual, names, caption, room)


def _with_matches(
    over: Overlay, image: NDArray[np.generic], xy: Array, residual: Array, names: Sequence[str], caption: str,
    room: Room,
) -> str:  # fmt: skip
    """The figure, with the spots that took part over what is drawn already."""
    notes = [f"{n}: x {x:.2f}, y {y:.2f} px; residual {dx:+z.3f}, {dy:+z.3f} px".replace("-", "−")
             for n, (x, y), (dx, dy) in zip(names, xy.tolist(), residual.tolist(), strict=True)]  # fmt: skip
    over.rings(xy, np.full(len(xy), 6.0), np.ones(len(xy), dtype=bool), notes, (f"matched spot ({len(xy)})", ""))
    over.residuals(xy, residual, names, "residual")
    return over.html(preview(image, room.photo)[0], caption)


def pictured_photo(image: NDArray[np.generic], of: Pictured, camera: str, markers: MarkerSet, caption: str) -> str:
    """A camera's picture of an instant of a sequence: spots that took part, spots left out, markers without a spot."""
    marker, residual = of.standing.residuals.get(camera, (np.zeros(0, np.int64), np.zeros((0, 2))))
    lens, pose = of.standing.cameras[camera]
    predicted = lens.project(pose.apply(of.standing.xyz))[0]
    wrong, wrong_xy = of.left_out[camera]
    lost = of.lost[camera]
    over = Overlay((image.shape[1], image.shape[0]))
    if len(wrong):
        notes = [f"{markers.name[k]}: spot left out as a gross error" for k in wrong.tolist()]
        over.circles("out", wrong_xy, np.full(len(wrong), 7.0), notes, f"left out ({len(wrong)})", MISSING)
    over.missing(predicted[lost], [str(n) for n in markers.name[lost]], f"predicted, no spot ({len(lost)})")
    return _with_matches(over, image, predicted[marker] - residual, residual, [str(n) for n in markers.name[marker]],
                         caption, FRAME)  # fmt: skip


def standing_photo(
    image: NDArray[np.generic], standing: Standing, camera: str, markers: MarkerSet, caption: str
) -> str:  # fmt: skip
    """A camera's picture of an instant at which the model was found, with the spots that took part."""
    marker, residual = standing.residuals.get(camera, (np.zeros(0, np.int64), np.zeros((0, 2))))
    lens, pose = standing.cameras[camera]
    xy = lens.project(pose.apply(standing.xyz[marker]))[0] - residual
    return marked_photo(image, xy, residual, [str(n) for n in markers.name[marker]], caption, SERIES)
