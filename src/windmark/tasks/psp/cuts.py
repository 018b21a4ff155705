"""Cp along cuts of the surface: over x / c, with sigma."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.paint import NodeField, interpolated
from windmark.scene import Mesh

Array = NDArray[np.float64]

IN_PLANE = 2e-3
"""A tap lies in a cut that is no farther away than this part of the grid's size."""


@dataclass(frozen=True)
class SectionWanted:
    """A plane that cuts the model at rest; ``volume`` alone, None: all. ``chord``: the direction of x / c."""

    name: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    volume: str | None = None
    chord: tuple[float, float, float] = (1.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class SurfaceSection:
    """Cp along a cut.

    Parameters
    ----------
    name : of the section
    xyz : (N, 3) on the model at rest
    x_c : (N,) 0 at the foremost point of the cut along the chord's direction, 1 at the last
    above : (N,) on the side of the chord that the third axis points to
    cp : (N) NaN where the surface was not seen
    line : (N,) number of the line that a point belongs to
    taps, tap_x_c, tap_above : (K,) indices of the points that lie in the cut (pressure taps), and where
    """

    name: str
    xyz: Array
    x_c: Array
    above: NDArray[np.bool_]
    cp: NodeField
    line: NDArray[np.int32]
    taps: NDArray[np.int64]
    tap_x_c: Array
    tap_above: NDArray[np.bool_]


def cut_sections(
    rest: Mesh, cp: NodeField, wanted: Sequence[SectionWanted], taps: Array | None = None
) -> tuple[SurfaceSection, ...]:
    """Cuts of the surface, each with those of some points (N, 3) that lie in it; a plane may miss: the cut is empty."""
    points = np.zeros((0, 3)) if taps is None else taps
    return tuple(_cut(rest, cp, one, points) for one in wanted)


def _cut(rest: Mesh, cp: NodeField, one: SectionWanted, points: Array) -> SurfaceSection:
    part = rest
    if one.volume is not None:
        own = rest.volume == one.volume
        part = Mesh(rest.vertices, rest.triangles[own], rest.volume[own], length_unit=rest.length_unit)
    cut = resection.section(part, one.point, one.normal)
    weights = np.column_stack([1 - cut.barycentric.sum(axis=1), cut.barycentric])
    field = interpolated(cp, part.triangles[cut.triangle].reshape(-1, 3), weights.reshape(-1, 3))
    if not len(cut.xyz):
        none = np.zeros(0)
        return SurfaceSection(one.name, cut.xyz, none, none > 0, field, cut.line, none.astype(int), none, none > 0)
    normal = np.asarray(one.normal, dtype=float) / np.linalg.norm(one.normal)
    near = np.flatnonzero(np.abs((points - one.point) @ normal) < IN_PLANE * rest.diagonal)
    x_c, above = _chordwise(cut.xyz, cut.xyz, one)
    tap_x_c, tap_above = _chordwise(points[near], cut.xyz, one)
    return SurfaceSection(one.name, cut.xyz, x_c, above, field, cut.line, near, tap_x_c, tap_above)


def _chordwise(points: Array, cut: Array, one: SectionWanted) -> tuple[Array, NDArray[np.bool_]]:
    """(N,) x / c of points, and whether they are above the straight line between the cut's foremost and last point.

    Above is where chord x normal points; for a chord that runs aft and a normal to starboard that is up.
    """
    chord = np.asarray(one.chord, dtype=float) / np.linalg.norm(one.chord)
    up = np.cross(chord, one.normal)
    up = up / max(float(np.linalg.norm(up)), 1e-300)
    along = cut @ chord
    first, last = cut[np.argmin(along)], cut[np.argmax(along)]
    x_c = (points - first) @ chord / max(float((last - first) @ chord), 1e-300)
    return x_c, np.asarray((points - first) @ up >= x_c * ((last - first) @ up))
