"""Cp along cuts of the surface, with the pressure taps that lie in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.errors import DataError
from windmark.paint import LoadReference, NodeField, SectionProfile, SpanLoading, section_profile, span_loading
from windmark.scene import Mesh
from windmark.scene.doubled import part_of

Array = NDArray[np.float64]

IN_PLANE = 2e-3
"""A tap lies in a cut that is no farther away than this part of the grid's size."""
MOST_UNSEEN = 0.2
"""Part of a cut's length beside what cameras show (its ends, markers at the edge) over which Cp may go on straight."""


@dataclass(frozen=True)
class SectionWanted:
    """A plane that cuts the model at rest; ``volume`` alone, None: all."""

    name: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    volume: str | None = None


@dataclass(frozen=True, eq=False)
class SurfaceSection:
    """Cp along a cut.

    Parameters
    ----------
    name : of the section
    profile : Cp over x / c
    taps, tap_x_c : (K,) indices of the points (pressure taps) that lie in the cut, and where
    """

    name: str
    profile: SectionProfile
    taps: NDArray[np.int64]
    tap_x_c: Array


def cut_sections(
    rest: Mesh,
    cp: NodeField,
    wanted: Sequence[SectionWanted],
    reference: LoadReference,
    taps: Array | None = None,
    remarks: list[str] | None = None,
) -> tuple[SurfaceSection, ...]:
    """Cuts of the surface, each with those of some points (N, 3) that lie in it.

    A plane that misses the surface gives none, and ``remarks`` say so. ``reference`` has the axes.
    """
    points, said = np.zeros((0, 3)) if taps is None else taps, [] if remarks is None else remarks
    out = []
    for one in wanted:
        try:
            out.append(_cut(rest, cp, one, reference, points))
        except DataError as error:
            said.append(f"section {one.name}: {error}")
    return tuple(out)


def _cut(rest: Mesh, cp: NodeField, one: SectionWanted, reference: LoadReference, points: Array) -> SurfaceSection:
    part = surface_of(rest, one.volume)
    cut = resection.section(part, one.point, one.normal)
    profile = section_profile(part, cp, cut, reference)
    normal = np.asarray(one.normal, dtype=float) / np.linalg.norm(one.normal)
    near = np.flatnonzero(np.abs((points - one.point) @ normal) < IN_PLANE * rest.size)
    aft = reference.body_axes[0]
    return SurfaceSection(one.name, profile, near, (points[near] @ aft - (cut.xyz @ aft).min()) / profile.chord)


def surface_of(rest: Mesh, volume: str | None) -> Mesh:
    """What a section cuts: all of the grid, or the volume of this name alone."""
    if volume is None:
        return rest
    return part_of(rest, rest.volume == volume)


def section_loads(
    rest: Mesh,
    cp: NodeField,
    wanted: Sequence[SectionWanted],
    reference: LoadReference,
    *,
    seen: NDArray[np.bool_] | None = None,
) -> tuple[tuple[str, SpanLoading], ...]:
    """Name and loads of each section that meets the surface: of the side that cameras show, the other one at p_inf.

    As the loads of volumes are (`seen_loads`); coefficients are by the chord of the whole section. ``unseen`` of the
    result is the part of its length where Cp was taken to go on straight, not the side that no camera shows.
    ``seen`` (V,) nodes that decide which sides those are; by default those with a value.
    """
    seen = cp.known if seen is None else seen
    out = []
    for one in wanted:
        part = surface_of(rest, one.volume)
        shown = np.zeros(len(cp), bool)
        shown[part.triangles[seen[part.triangles].any(axis=1)]] = True
        still = replace(
            cp, value=np.where(shown, cp.value, 0.0), white=np.where(shown, cp.white, 0.0),
            modes=np.where(shown[:, None], cp.modes, 0.0),
        )  # fmt: skip
        cut = resection.section(part, one.point, one.normal)
        try:
            out.append((one.name, span_loading(part, still, [cut], one.normal, reference, most_unseen=MOST_UNSEEN)))
        except DataError:  # said where it is cut for its profile
            continue
    return tuple(out)
