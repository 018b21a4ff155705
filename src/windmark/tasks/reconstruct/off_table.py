"""Primaries that a finished reconstruction does not have where their table does, and which of them may be wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.calibration import Calibration, Weighted
from windmark.errors import g3
from windmark.geometry import Camera, DegenerateGeometry, align
from windmark.scene import Doubt, MarkerSet, View
from windmark.tasks.reconstruct.doubts import CHANCE, Sight, in_field
from windmark.tasks.reconstruct.primaries import with_sigma

FITS_SIGMAS = 4.0
"""Corners of a triangle of markers are at their places in the table if none is farther off in its own sigma."""


def off_their_table(
    primary: MarkerSet, calibration: Calibration, sight: Sight, views: Sequence[View], cameras: Mapping[str, Camera]
) -> tuple[dict[str, str], list[Doubt]]:
    """{primary: why} of the primaries that were not recognised, and doubts of those that should have been.

    One should have been where pictures that show its nearest neighbour, and have its place in their field, would have
    missed it with too small a chance. Where three alone hold the frame, it may be one of them that is wrong: all are
    named without which the other two and the missing one have a triangle of markers.
    """
    markers = calibration.markers
    why: dict[str, str] = {}
    doubts: list[Doubt] = []
    missing = [k for k, n in enumerate(primary.name) if str(n) not in set(markers.name.tolist())]
    if not missing or not len(markers):
        return why, doubts
    gap, near = cKDTree(markers.xyz).query(primary.xyz[missing])
    for k, far, j in zip(missing, gap.tolist(), near.tolist(), strict=True):
        name = str(primary.name[k])
        those = [v for v in np.flatnonzero(sight.seen[:, j]).tolist() if views[v].cam_from_model is not None]
        shows = [v for v in those if in_field(primary.xyz[k : k + 1], views[v], cameras)[0]]
        place = f"the nearest marker, {markers.name[j]}, is {g3(far)} from the place in its table"
        why[name] = f"{place}; {len(shows)} pictures that show that one have the place in their field"
        if sight.rate > 0 and (1 - sight.rate) ** len(shows) * len(missing) < CHANCE:
            rivals = _as_well(with_sigma(primary), calibration, k)
            said = f"{len(shows)} pictures show no spot there; {place}"
            if rivals:
                one_of = ", ".join(["{}"] * len(rivals)) + " or {}"
                words = f"{one_of} is not where its table says, and nothing tells which: by the others {said}"
            else:
                words = f"{{}} is not where its table says: {said}"
            doubts.append(Doubt((*rivals, name), words, "control" if rivals else "marker"))
    return why, doubts


def _as_well(primary: MarkerSet, calibration: Calibration, missing: int) -> list[str]:
    """Of three primaries that hold the frame those whose error explains as well that another one was not found."""
    datum, markers = calibration.options["datum"], calibration.markers
    held = list(datum.markers or ()) if isinstance(datum, Weighted) else []
    at, table = {str(n): k for k, n in enumerate(markers.name)}, {str(n): k for k, n in enumerate(primary.name)}
    if len(held) != 3 or not all(n in at and n in table for n in held):
        return []
    free = np.setdiff1d(np.arange(len(markers)), [at[n] for n in held])
    return [
        name for name in held
        if _has_triangle(primary, calibration, [table[n] for n in held if n != name] + [missing],
                         [at[n] for n in held if n != name], free)
    ]  # fmt: skip


def _has_triangle(
    primary: MarkerSet, calibration: Calibration, corners: list[int], two: list[int], free: NDArray[np.int64]
) -> bool:
    """Whether two markers and any of the others have the places of three primaries, moved, turned and scaled as one: it
    is the primaries that say how large the network is.
    """
    markers, wanted, spread = calibration.markers, primary.xyz[corners], np.square(primary.sigma[corners]).sum(axis=1)
    for third in free.tolist():
        rows = [*two, third]
        own = spread + calibration.marker_cov[rows].trace(axis1=1, axis2=2)
        try:
            fit = align(markers.xyz[rows], wanted, weights=1 / own)
        except DegenerateGeometry:
            continue
        off = np.linalg.norm(fit.apply(markers.xyz[rows]) - wanted, axis=1)
        if (off < FITS_SIGMAS * np.sqrt(own)).all():
            return True
    return False
