"""Paint against pressure taps: where they are on the grid, the fit to them, and the comparison in Cp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.paint import InSitu, NodeField, TunnelConditions, in_situ, interpolated
from windmark.scene import Mesh
from windmark.tasks.psp.plausible import other_unit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OFF_GRID, UNSEEN = "outside the grid", "not seen"
EITHER_SIDE = "as near to the other side of a thin part"
"""Why a tap has no value of the paint."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What sensors on the model say at one point: N of them.

    Parameters
    ----------
    names : (N,)
    xyz, normal : (N, 3) on the model at rest; rows of NaN for normals that are not known
    value, sigma : (N,) readings, and their standard deviations
    """

    names: tuple[str, ...]
    xyz: Array
    normal: Array
    value: Array
    sigma: Array


MEDIAN = 0.6745
"""Of the absolute value of a normal variable."""


@dataclass(frozen=True, eq=False)
class TapTable:
    """Paint against taps: (N,) each, NaN where the paint has no value.

    Parameters
    ----------
    names : of all taps with readings
    cp, cp_sigma : of the taps
    paint, paint_sigma : Cp of the paint there
    words : why a tap does not count; "" where it does
    unfitted : why the pressure was not fitted to them, though it was to be; "" where it was
    """

    names: tuple[str, ...]
    cp: Array
    cp_sigma: Array
    paint: Array
    paint_sigma: Array
    words: tuple[str, ...]
    unfitted: str = ""

    @property
    def rms(self) -> float:
        """Root mean square difference in Cp of the taps that count; NaN without any."""
        good = self.counting
        return float(np.sqrt(np.mean((self.paint - self.cp)[good] ** 2))) if good.any() else float("nan")

    @property
    def typical(self) -> float:
        """Typical difference of these in sigmas (median over that of chance: 1 where sigmas are right); NaN without."""
        good = self.counting
        z = np.abs(self.paint - self.cp)[good] / np.hypot(self.paint_sigma, self.cp_sigma)[good]
        return float(np.median(z)) / MEDIAN if good.any() else float("nan")

    @property
    def counting(self) -> Mask:
        """(N,) taps that count and at which the paint has a value."""
        return np.array([not w for w in self.words], bool) & np.isfinite(self.paint)


def at_taps(
    rest: Mesh, prior: NodeField, filled: Mask, taps: Readings | None, how: str, remarks: list[str]
) -> tuple[NodeField, InSitu | None, TapTable | None]:
    """Pressure fitted to the taps, the fit, and the table of taps, whose columns are pressures still (see `in_cp`).

    ``how``: "offset-slope", "offset", or "compare" (nothing is fitted). Where taps cannot be used ``remarks`` say why.
    ``filled``: (V,) nodes whose values are those of their surroundings.
    """
    if taps is None or not len(taps.names):
        return prior, None, None
    at, words = _on_surface(rest, taps, prior)
    count = len(taps.names)
    table = TapTable(taps.names, taps.value, taps.sigma, np.full(count, np.nan), np.full(count, np.nan), words)
    good = np.flatnonzero([not w for w in words])
    outside = [n for n, w in zip(taps.names, words, strict=True) if w == OFF_GRID]
    if outside:
        some = ", ".join(outside[:5]) + (", ..." if len(outside) > 5 else "")
        remarks.append(f"{len(outside)} of {count} taps lie outside the grid and do not count: {some}")
    sideless = [n for n, w in zip(taps.names, words, strict=True) if w == EITHER_SIDE]
    if sideless:
        some = ", ".join(sideless[:5]) + (", ..." if len(sideless) > 5 else "")
        remarks.append(f"{len(sideless)} of {count} taps are as near to the other side of a thin part, and do not "
                       f"count without their normals: {some}")  # fmt: skip
    if how == "compare":
        return prior, None, table
    if not len(good):
        return prior, None, _unfitted(table, "no tap lies on what was seen", remarks)
    x = field_at(rest, prior, filled, taps.xyz[good], (at[0][good], at[1][good]))
    if why := other_unit(taps.value[good], x.value):
        return prior, None, _unfitted(table, why, remarks)
    fit = in_situ(
        [taps.names[k] for k in good], taps.value[good], x, pressure_sigma=taps.sigma[good],
        free="offset" if how == "offset" else "both",
    )  # fmt: skip
    why = other_unit(taps.value[good], x.value, fit) if isinstance(fit, InSitu) else fit.reason
    if why or not isinstance(fit, InSitu):
        return prior, None, _unfitted(table, why, remarks)
    blocked = {**fit.blocked}
    words = tuple(blocked.get(n, w) for n, w in zip(taps.names, words, strict=True))
    remarks += fit.warnings  # names those that do not count
    return fit.applied(prior), fit, replace(table, words=words)


def _unfitted(table: TapTable, why: str, remarks: list[str]) -> TapTable:
    remarks.append(f"not fitted to the taps, the pressure is that of the calibration alone: {why}")
    return replace(table, unfitted=why)


def field_at(
    rest: Mesh, field_: NodeField, filled: Mask, xyz: Array, at: tuple[NDArray[np.int32], Array]
) -> NodeField:
    """The field at points (N, 3) in triangles, see `interpolated`, with what a triangle leaves open in its noise.

    Nodes that were filled into one hole err alike; and between nodes the field is not straight (`_bow`).
    """
    nodes, weights = at
    out = interpolated(field_, nodes, weights)
    alike = filled[nodes]
    spread = np.where(weights > 0, weights * np.sqrt(field_.white[nodes]), 0.0)
    white = np.where(alike, 0.0, spread**2).sum(axis=1) + np.where(alike, spread, 0.0).sum(axis=1) ** 2
    return replace(out, white=white + _bow(rest, field_, xyz, at) ** 2)


def _bow(rest: Mesh, field_: NodeField, xyz: Array, at: tuple[NDArray[np.int32], Array]) -> Array:
    """(N,) by how much the field bends away from the plane of a triangle at points in it.

    By a quadric through the nodes of all triangles that touch it (a suction peak near the leading edge is a few nodes
    wide); 0 where these are too few for one.
    """
    nodes, weights = at
    out = np.zeros(len(nodes))
    wanted = np.zeros(len(field_), bool)
    wanted[nodes.ravel()] = True
    near = rest.triangles[wanted[rest.triangles].any(axis=1)]
    normals = rest.vertex_normals()
    for k, corners in enumerate(nodes):
        ring = np.unique(near[np.isin(near, corners).any(axis=1)])
        ring = ring[field_.known[ring] & (normals[ring] @ normals[corners[0]] > 0)]
        place = rest.vertices[ring] - xyz[k]
        along = np.linalg.svd(place - place.mean(axis=0), full_matrices=False)[2][:2] if len(ring) > 6 else None
        if along is None:
            continue

        def rows(of: Array, axes: Array = along) -> Array:
            u, v = axes @ of.T
            return np.stack([0 * u + 1, u, v, u * u, u * v, v * v], axis=1)

        design = rows(place)
        scale = np.abs(design).max(axis=0)
        quadric, _, rank, _ = np.linalg.lstsq(design / scale, field_.value[ring], rcond=1e-6)
        if rank == design.shape[1]:
            plane = weights[k] @ (rows(rest.vertices[corners] - xyz[k]) / scale @ quadric)
            out[k] = quadric[0] / scale[0] - plane
    return out


def _on_surface(
    rest: Mesh, taps: Readings, field_: NodeField
) -> tuple[tuple[NDArray[np.int32], Array], tuple[str, ...]]:
    """Nodes (N, 3) and weights (N, 3) of the taps, and why a tap has no value of the paint."""
    found = resection.nearest_on_surface(rest, taps.xyz, normal=taps.normal)
    nodes, weights = found.corners(rest)
    seen: NDArray[np.bool_] = np.asarray(field_.known[nodes].all(axis=1))
    words = np.select([found.triangle < 0, found.either_side, ~seen], [OFF_GRID, EITHER_SIDE, UNSEEN], default="")
    return (nodes, weights), tuple(words.tolist())


def in_cp(
    table: TapTable, taps: Readings, stream: TunnelConditions, cp: NodeField, filled: Mask, rest: Mesh
) -> TapTable:
    """The table of `at_taps` with its readings as Cp, and the paint's Cp at them."""
    at, words = _on_surface(rest, taps, cp)
    there = field_at(rest, cp, filled, taps.xyz, at)
    seen = np.array([not w for w in words], bool)
    return replace(
        table, cp=(table.cp - stream.p_inf) / stream.q_inf, cp_sigma=table.cp_sigma / stream.q_inf,
        paint=np.where(seen, there.value, np.nan), paint_sigma=np.where(seen, there.sigma, np.nan),
    )  # fmt: skip
