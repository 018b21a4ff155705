"""Paint against pressure taps: where they are on the grid, the fit to them, and the comparison in Cp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark import resection
from windmark.paint import InSitu, NodeField, TunnelConditions, in_situ, interpolated
from windmark.scene import Mesh

Array = NDArray[np.float64]

OFF_GRID, UNSEEN = "outside the grid", "not seen"
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


@dataclass(frozen=True, eq=False)
class TapTable:
    """Paint against taps: (N,) each, NaN where the paint has no value.

    Parameters
    ----------
    names : of all taps with readings
    cp, cp_sigma : of the taps
    paint, paint_sigma : Cp of the paint there
    words : why a tap does not count; "" where it does
    """

    names: tuple[str, ...]
    cp: Array
    cp_sigma: Array
    paint: Array
    paint_sigma: Array
    words: tuple[str, ...]

    @property
    def rms(self) -> float:
        """Root mean square difference in Cp of the taps that count; NaN without any."""
        good = np.array([not w for w in self.words], bool) & np.isfinite(self.paint)
        return float(np.sqrt(np.mean((self.paint - self.cp)[good] ** 2))) if good.any() else float("nan")


def at_taps(
    rest: Mesh, prior: NodeField, taps: Readings | None, how: str, remarks: list[str]
) -> tuple[NodeField, InSitu | None, TapTable | None]:
    """Pressure fitted to the taps, the fit, and the table of taps, whose columns are pressures still (see `in_cp`).

    ``how``: "offset-slope", "offset", or "compare" (nothing is fitted). Where taps cannot be used ``remarks`` say why.
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
    if how == "compare":
        return prior, None, table
    if not len(good):
        remarks.append("no tap lies on what was seen: the pressure is that of the calibration alone")
        return prior, None, table
    x = interpolated(prior, at[0][good], at[1][good])
    fit = in_situ(
        [taps.names[k] for k in good], taps.value[good], x, pressure_sigma=taps.sigma[good],
        free="offset" if how == "offset" else "both",
    )  # fmt: skip
    if not isinstance(fit, InSitu):
        remarks.append(f"not fitted to the taps, the pressure is that of the calibration alone: {fit.reason}")
        return prior, None, table
    blocked = {**fit.blocked}
    words = tuple(blocked.get(n, w) for n, w in zip(taps.names, words, strict=True))
    remarks += [f"tap {name} does not count: {why}" for name, why in blocked.items()]
    remarks += fit.warnings
    return fit.applied(prior), fit, replace(table, words=words)


def _on_surface(
    rest: Mesh, taps: Readings, field_: NodeField
) -> tuple[tuple[NDArray[np.int32], Array], tuple[str, ...]]:
    """Nodes (N, 3) and weights (N, 3) of the taps, and why a tap has no value of the paint."""
    found = resection.nearest_on_surface(rest, taps.xyz, normal=taps.normal)
    off: NDArray[np.bool_] = np.asarray(found.triangle < 0)
    nodes = rest.triangles[np.maximum(found.triangle, 0)]
    weights = np.column_stack([1 - found.barycentric.sum(axis=1), found.barycentric])
    weights[off] = 0.0
    seen: NDArray[np.bool_] = np.asarray(field_.known[nodes].all(axis=1))
    words = tuple(OFF_GRID if o else "" if s else UNSEEN for o, s in zip(off, seen, strict=True))
    return (nodes, weights), words


def in_cp(table: TapTable, taps: Readings, stream: TunnelConditions, cp: NodeField, rest: Mesh) -> TapTable:
    """The table of `at_taps` with its readings as Cp, and the paint's Cp at them."""
    at, words = _on_surface(rest, taps, cp)
    there = interpolated(cp, *at)
    seen = np.array([not w for w in words], bool)
    return replace(
        table, cp=(table.cp - stream.p_inf) / stream.q_inf, cp_sigma=table.cp_sigma / stream.q_inf,
        paint=np.where(seen, there.value, np.nan), paint_sigma=np.where(seen, there.sigma, np.nan),
    )  # fmt: skip
