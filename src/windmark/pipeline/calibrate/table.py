"""Matched marks from a table of matches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.io import MatchTable
from windmark.scene import MarkerSet, Observations, View
from windmark.tasks.calibrate.marks import Marks, taken_by, with_sigma

CUT = 0.01
"""How far outside of a picture a mark may be, in parts of its size."""


def from_table(
    table: MatchTable,
    markers: MarkerSet,
    cameras: Mapping[str, Camera],
    *,
    sigma_px: float,
    poses: Mapping[str, Pose] | None = None,
    patterns: Mapping[str, str] | None = None,
) -> Marks:
    """Marks of a table of matches.

    Parameters
    ----------
    table : image, marker's name, place; camera and frame where there are several
    markers : rough coordinates
    cameras : start values by name
    sigma_px : standard deviation per coordinate of marks without one
    poses : start values of poses by image; elsewhere they are found
    patterns : camera -> pattern of its images' names, see `taken_by`

    Raises
    ------
    ValueError
        For names that the table of markers does not have; names a few. For a mark outside its camera's picture.
    """
    place = {str(name): n for n, name in enumerate(markers.name)}
    unknown = sorted(set(table.name.tolist()) - set(place))
    if unknown:
        raise UsageError(
            f"the matches name {len(unknown)} markers that are not in the table of markers: {', '.join(unknown[:5])}"
        )
    names, first, view = np.unique(table.image, return_index=True, return_inverse=True)
    who = taken_by(names.tolist(), list(cameras), patterns, table.camera[first].tolist())
    views = tuple(
        View(str(n), by.camera, str(table.frame[k]) or by.frame, (poses or {}).get(str(n)))
        for n, by, k in zip(names, who, first, strict=True)
    )
    for v, of in enumerate(views):
        camera, own = cameras[of.camera], np.flatnonzero(view == v)
        # A disc that the border cuts may have its centre outside.
        middle = (np.array(camera.size_px) - 1) / 2
        near = middle + (table.xy[own] - middle) / (1 + 2 * CUT)
        for k in own[~camera.in_image(near)][:1].tolist():
            raise UsageError(
                f"{table.name[k]} in {of.name or 'the picture'} is at {table.xy[k, 0]:.1f}, {table.xy[k, 1]:.1f} px, "
                f"outside the {camera.size_px[0]} x {camera.size_px[1]} px of its camera (--size, or the camera's file)"
            )
    cov = with_sigma(table.cov, sigma_px)
    point = np.array([place[str(n)] for n in table.name], dtype=np.int64)
    return Marks(Observations(view.astype(np.int64), point, table.xy, cov), markers, cameras, views)
