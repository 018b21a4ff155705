"""Cp along cuts of the surface, with the pressure taps that lie in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.errors import DataError, g3
from windmark.paint import LoadReference, NodeField, SectionProfile, SpanLoading, section_profile, span_loading
from windmark.paint.surface import joined_surface
from windmark.paint.unseen import guesses_of
from windmark.scene import Mesh
from windmark.scene.doubled import part_of
from windmark.tasks.psp.loads import seen_sides

Array = NDArray[np.float64]

IN_PLANE = 2e-3
"""A tap lies in a cut that is no farther away than this part of the grid's size."""
MOST_UNSEEN = 0.2
"""Part of what cameras show of a cut's length without a value (ends, markers at the edge) over which Cp may go on."""


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


@dataclass(frozen=True, eq=False)
class SectionLoads:
    """Loads of a cut.

    Parameters
    ----------
    name : of the section
    loads : of this one section; ``value``, ``sigma`` and ``cov`` are NaN where ``why`` is said
    shown : part of its length that is on a side that cameras show
    why : it has no loads, in words; "" where it has
    """

    name: str
    loads: SpanLoading
    shown: float
    why: str = ""


def section_loads(
    rest: Mesh,
    cp: NodeField,
    wanted: Sequence[SectionWanted],
    reference: LoadReference,
    *,
    seen: NDArray[np.bool_] | None = None,
) -> tuple[SectionLoads, ...]:
    """Loads of each section that meets the surface: of the side that cameras show, the other one at p_inf.

    As the loads of volumes are (`seen_loads`); coefficients are by the chord of the whole section. ``unseen`` of the
    result is the part of its length where Cp was taken to go on straight, not the side that no camera shows; what that
    may be wrong by is in sigma as it is in the loads of volumes (`paint.unseen.guesses_of`, cause ``unseen VOLUME``).
    A section without a value, or with more than `MOST_UNSEEN` of what cameras show of it without one, has no loads.
    ``seen`` (V,) nodes that decide which sides those are; by default those with a value.
    """
    seen = cp.known if seen is None else seen
    guesses: list[tuple[str, Array]] | None = None
    out = []
    for one in wanted:
        part = surface_of(rest, one.volume)
        on = np.asarray(seen[part.triangles].any(axis=1))
        shown = np.zeros(len(cp), bool)
        shown[part.triangles[on]] = True
        still = replace(
            cp, value=np.where(shown, cp.value, 0.0), white=np.where(shown, cp.white, 0.0),
            modes=np.where(shown[:, None], cp.modes, 0.0),
        )  # fmt: skip
        cut = resection.section(part, one.point, one.normal)
        try:
            loads = span_loading(part, still, [cut], one.normal, reference, most_unseen=MOST_UNSEEN)
        except DataError:  # said where it is cut for its profile
            continue
        share = _length_in(on, cut)
        why = _why_none(share, float(loads.unseen[0]))
        if why:
            none = {key: np.full_like(getattr(loads, key), np.nan) for key in ("value", "sigma", "cov")}
            loads = replace(loads, **none)
        elif loads.unseen[0] > 0:
            guesses = _guesses(rest, cp, seen) if guesses is None else guesses
            own = [(name, of) for name, of in guesses if one.volume in (None, name)]
            loads = _with_guesses(loads, part, cut, one, reference, own)
        out.append(SectionLoads(one.name, loads, share, why))
    return tuple(out)


def part_words(found: Sequence[SectionLoads]) -> list[str]:
    """What is to be said of sections' loads that are of one side: how much of the cuts cameras show."""
    shown = [100 * s.shown for s in found if not s.why]
    if not shown or min(shown) > 100 * (1 - 1e-9):
        return []
    return [f"loads of sections are those of the part of each cut's length that cameras show, {g3(min(shown))} to "
            f"{g3(max(shown))} % (column shown of span.csv), the rest counts as at p_inf"]  # fmt: skip


def _length_in(triangles: NDArray[np.bool_], cut: resection.Section) -> float:
    """Part of a cut's length that is in some triangles (T,)."""
    length = np.where(np.diff(cut.line) == 0, np.linalg.norm(np.diff(cut.xyz, axis=0), axis=1), 0.0)
    return float(length[triangles[cut.triangle[:-1]]].sum() / max(float(length.sum()), 1e-300))


def _why_none(shown: float, unseen: float) -> str:
    """Why a section has no loads, by the parts of its length that are shown, and that have no value though shown."""
    if not shown > 0:
        return "no camera shows any of it"
    if unseen > MOST_UNSEEN * shown:
        less = "nothing" if unseen > (1 - 1e-9) * shown else f"{g3(100 * (1 - unseen / shown))} %"
        return f"cameras look at {g3(100 * shown)} % of its length, and {less} of that has a Cp"
    return ""


def _guesses(rest: Mesh, cp: NodeField, seen: NDArray[np.bool_]) -> list[tuple[str, Array]]:
    """Volume and `guesses_of` its nodes that are beside what was seen: the error that their Cp is guessed with."""
    sides = seen_sides(rest, seen)
    surface = joined_surface(sides)
    names = [str(name) for name in dict.fromkeys(rest.volume.tolist())]
    return [(name, guesses_of(sides, cp, sides.volume == name, surface)) for name in names]


def _with_guesses(
    loads: SpanLoading, part: Mesh, cut: resection.Section, one: SectionWanted, reference: LoadReference,
    guesses: Sequence[tuple[str, Array]],
) -> SpanLoading:  # fmt: skip
    """The loads of a cut with the error of where Cp was taken to go on: a ring that no camera resolves, as the edge
    that the air meets first, is wrong alike all along, and by far more than the noise beside it.
    """
    cov, causes = loads.cov, dict(loads.causes)
    for volume, columns in guesses:
        none = np.zeros(len(columns))
        field = NodeField(none, none, columns, tuple(f"unseen:{k + 1}" for k in range(columns.shape[1])))
        error = span_loading(part, field, [cut], one.normal, reference).cov
        if error.any():
            cov = cov + error
            causes[f"unseen {volume}"] = np.diagonal(error).copy()
    return replace(loads, cov=cov, sigma=np.sqrt(np.diagonal(cov)).reshape(-1, 3), causes=causes)
