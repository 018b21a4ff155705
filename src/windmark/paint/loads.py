"""Forces and moments of a pressure field by volume, with their covariance, and what was not seen of the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError, UsageError, g2, g3
from windmark.geometry.described import described
from windmark.paint.axes import COEFFICIENTS, LoadReference
from windmark.paint.carry import Carried, carried
from windmark.paint.filling import fill_smoothly
from windmark.paint.modes import NodeField
from windmark.paint.surface import Surface, joined_surface
from windmark.paint.unseen import guesses_of
from windmark.scene import Mesh
from windmark.scene.doubled import TWICE, doubled, doubled_zones, part_of
from windmark.scene.shown import check_kinds, pandas_table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLOSED = 1e-4
"""A surface is closed where it has no border, or where the area vectors of its triangles add up to no more than this
part of its area."""


@described(lambda loads: {
    name: ", ".join(f"{k} {g3(v)} ± {g2(s)}" for k, v, s in zip(COEFFICIENTS[:3], row, sigma, strict=False))
    for name, row, sigma in zip(loads.names, loads.value, loads.sigma, strict=True)
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class Loads:
    """Forces and moments of the pressure on a surface; of the paint's side of it alone, no base, no friction.

    Parameters
    ----------
    names : of the rows: the volumes, in order, and "all"
    value : (G, 9) the `COEFFICIENTS` of each row; of what was seen, and of what was filled in for what was not
    sigma : (G, 9) standard deviations
    cov : (G, 9, 9)
    causes : for each row the variance (9,) of each cause, see `Carried`
    unseen : (G,) part of the row's area without a value
    filled : (G, 9) how much of ``value`` is from filled-in values of unseen nodes
    opening : (G, 3) sum of the area vectors over the area: 0 for a closed surface. Loads of an open one depend on the
        pressure that is taken as zero, which is p_inf for Cp
    closed : (G,)
    warnings : what is to be said of it, in words

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], "wing")
    >>> cp = wm.NodeField.make([-0.5, -0.5, -0.5, -0.5], 0.01).with_mode("calibration", [0.03, 0.03, 0.03, 0.03])
    >>> loads = wm.integrate_loads(plate, cp, wm.LoadReference(area=2.0, chord=2.0, span=1.0))
    >>> loads.names
    ('wing', 'all')
    >>> lift, sigma = loads.row("wing")["CL"]
    >>> round(lift, 6), round(sigma, 3)
    (0.5, 0.03)
    >>> loads.dominant("wing", "CL")[0][0]  # what most of the uncertainty comes from
    'calibration'
    """

    names: tuple[str, ...]
    value: Array
    sigma: Array
    cov: Array
    causes: tuple[Mapping[str, Array], ...]
    unseen: Array
    filled: Array
    opening: Array
    closed: Mask
    warnings: tuple[str, ...] = ()

    def row(self, name: str) -> dict[str, tuple[float, float]]:
        """Value and sigma of each coefficient of a volume, or of "all"."""
        if name not in self.names:
            raise UsageError(f"Loads: there is no row {name}; expected one of {', '.join(self.names)}")
        k = self.names.index(name)
        return {c: (float(self.value[k, j]), float(self.sigma[k, j])) for j, c in enumerate(COEFFICIENTS)}

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: volume, coefficient, value and sigma, a row for each."""
        return pandas_table({
            "volume": np.repeat(self.names, len(COEFFICIENTS)), "coefficient": np.tile(COEFFICIENTS, len(self.names)),
            "value": self.value.ravel(), "sigma": self.sigma.ravel(),
        })  # fmt: skip

    def dominant(self, name: str, coefficient: str) -> list[tuple[str, float]]:
        """What the variance of a coefficient is made of: causes with their share, the largest first."""
        k, j = self.names.index(name), COEFFICIENTS.index(coefficient)
        total = max(float(self.cov[k, j, j]), 1e-300)
        return sorted(((c, float(v[j]) / total) for c, v in self.causes[k].items()), key=lambda item: -item[1])


def integrate_loads(
    mesh: Mesh, cp: NodeField, reference: LoadReference, *, volumes: Sequence[str] | None = None,
    least_seen: float = 0.5,
) -> Loads:  # fmt: skip
    """Forces and moments of Cp on the surface.

    Parameters
    ----------
    mesh : where the surface was (the deformed one, for loads in the wind), triangles counter-clockwise from the air
    cp : (V) pressure coefficients, NaN where the surface was not seen
    reference : areas, lengths, moment point and axes
    volumes : that take part; None: all of the mesh
    least_seen : part of a volume's area that must have been seen; 0 to 1

    Returns
    -------
    Loads. Unseen nodes get the smooth continuation of what was seen of their volume, with an error that the seen rim
    shows when it is hidden and filled alike (`unseen.guesses_of`), in common and linear (cause ``unseen VOLUME``);
    their share is ``unseen``, ``filled``.

    Raises
    ------
    DataError
        Where less than ``least_seen`` of a volume has a value: a guess would be the larger part of its loads. Where
        more than `TWICE` of an area is in the mesh twice, see `scene.doubled`: it would count twice.
    ValueError
        For an unknown volume or one that is named twice, or a field that is not the mesh's.

    Notes
    -----
    Cp is linear in each triangle, so force and moment are exact sums: F = -sum A n (Cp_a + Cp_b + Cp_c) / 3, and the
    moment's integrals of r Cp over a triangle have the weights 1/6 and 1/12 (Zienkiewicz and Taylor, The Finite
    Element Method 1, section 9.8).

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], "wing")
    >>> suction = wm.NodeField.make([-0.5, -0.5, -0.5, -0.5])
    >>> loads = wm.integrate_loads(plate, suction, wm.LoadReference(area=2.0, chord=2.0, span=1.0, alpha_deg=60.0))
    >>> row = loads.row("wing")
    >>> [round(float(row[name][0]), 6) for name in ("CN", "CL")]
    [0.5, 0.25]
    >>> loads.closed.tolist()  # an open surface: its loads depend on the zero of the pressure
    [False, False]
    """
    check_kinds("integrate_loads", mesh=(mesh, Mesh), cp=(cp, NodeField), reference=(reference, LoadReference))
    if len(cp) != len(mesh.vertices):
        raise ValueError(f"integrate_loads: cp must have {len(mesh.vertices)} nodes, got {len(cp)}")
    if not 0 <= least_seen <= 1:
        raise UsageError(f"integrate_loads: least_seen must be 0 to 1, got {least_seen}")
    names = tuple(dict.fromkeys(mesh.volume.tolist())) if volumes is None else tuple(volumes)
    missing = [name for name in names if name not in mesh.volume]
    if missing or not names:
        raise UsageError(f"integrate_loads: the mesh has no volume {', '.join(missing) or 'at all'}")
    if again := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise UsageError(f"integrate_loads: volumes names {', '.join(again)} more than once; expected each once")
    twice = _twice(mesh, names)
    surface = joined_surface(mesh)
    whole, unseen = _completed(mesh, cp, names, surface, least_seen)
    operators = [load_operator(mesh, reference, mesh.volume == name) for name in names]
    groups = [mesh.volume == name for name in names]
    if len(names) > 1:
        operators.append(sum(operators[1:], operators[0]))
        groups.append(np.isin(mesh.volume, names))
    else:
        operators, groups = operators * 2, groups * 2
    guesses = [guesses_of(mesh, cp, mesh.volume == name, surface) for name in names]
    rows = [_with_guesses(carried(whole, op), op, names, guesses) for op in operators]
    gap = np.where(cp.known, 0.0, whole.value)
    filled = np.stack([op @ np.where(np.isfinite(gap), gap, 0.0) for op in operators])
    opening = np.stack([_opening(mesh, g) for g in groups])
    closed = np.array([_closed(surface, g) or np.linalg.norm(o) <= CLOSED
                       for g, o in zip(groups, opening, strict=True)])  # fmt: skip
    done = _as_loads((*names, "all"), rows, np.append(unseen, _share(mesh, groups[-1], cp.known)), filled, opening,
                     closed)  # fmt: skip
    return replace(done, warnings=(*twice, *done.warnings)) if twice else done


def _twice(mesh: Mesh, names: Sequence[str]) -> list[str]:
    """What is to be said of area that is in some volumes twice; refused where it is more than a rim."""
    part = part_of(mesh, np.isin(mesh.volume, names))
    found = doubled(part)
    if not found:
        return []
    area = 0.5 * np.linalg.norm(part.triangle_normals(), axis=1)
    on = {**{name: part.volume == name for name in names}, "all": np.ones(len(area), bool)}
    share = {name: float(found.extra[rows].sum() / area[rows].sum()) for name, rows in on.items()}
    most = max(share, key=lambda name: share[name])
    words = f"{doubled_zones(part, found)}: {g3(100 * share[most])} % of the area of {most} is in the grid twice"
    if share[most] <= TWICE:
        return [f"{words} and counts twice in the loads"]
    raise DataError(f"integrate_loads: {words} and would count twice; leave a zone that is there twice out of its "
                    "volume, and blank what overlaps of overset zones (IBLANK = 0)")  # fmt: skip


def _as_loads(names: tuple[str, ...], rows: list[Carried], unseen: Array, filled: Array, opening: Array, closed: Mask
              ) -> Loads:  # fmt: skip
    words = [f"{n}: {g3(100 * u)} % of its area was not seen; filled in from what was" for n, u in
             zip(names, unseen, strict=True) if u > 0]  # fmt: skip
    for n, o in ((n, o) for n, o, c in zip(names, opening, closed, strict=True) if not c):
        size = float(np.linalg.norm(o))
        along = ", ".join(f"{x:.2f}" for x in o / max(size, 1e-300))
        words.append(f"{n}: its surface is open ({g3(100 * size)} % of its area, along {along}): its loads are those "
                     "against p_inf")  # fmt: skip
    return Loads(
        names, np.stack([r.value for r in rows]), np.stack([r.sigma for r in rows]), np.stack([r.cov for r in rows]),
        tuple(r.causes for r in rows), unseen, filled, opening, closed, tuple(words),
    )  # fmt: skip


def load_operator(mesh: Mesh, reference: LoadReference, triangles: Mask) -> Array:
    """(9, V) the weights of nodes' Cp in the `COEFFICIENTS` of some triangles."""
    t = mesh.triangles[triangles]
    area = 0.5 * mesh.triangle_normals()[triangles]
    r = mesh.vertices[t] - reference.moment_point
    out = np.zeros((6, len(mesh.vertices)))
    for k in range(3):
        # The integral of (position times the node's share) over the triangle is its area times this.
        arm = (2 * r[:, k] + r[:, (k + 1) % 3] + r[:, (k + 2) % 3]) / 12
        weights = np.concatenate([-area / 3, -np.cross(arm, area)], axis=1)
        for row in range(6):
            out[row] += np.bincount(t[:, k], weights[:, row], minlength=len(mesh.vertices))
    return reference.coefficients(out)


def _completed(mesh: Mesh, cp: NodeField, names: Sequence[str], surface: Surface, least: float
               ) -> tuple[NodeField, Array]:  # fmt: skip
    """The field with unseen nodes filled in, volume by volume, and the unseen part of each volume's area."""
    shares, out = [], cp
    for name in names:
        own = mesh.volume == name
        share = _share(mesh, own, cp.known)
        shares.append(share)
        if share > 1 - least:
            raise DataError(
                f"integrate_loads: only {g3(100 * (1 - share))} % of the area of {name} has a value; expected at least "
                f"{g3(100 * least)} %"
            )
        nodes = np.zeros(len(cp), bool)
        nodes[mesh.triangles[own].ravel()] = True
        missing = nodes & ~cp.known
        if missing.any():
            out = fill_smoothly(mesh, out, missing, surface=surface)
    return out, np.array(shares)


def _with_guesses(row: Carried, operator: Array, names: Sequence[str], guesses: Sequence[Array]) -> Carried:
    """A row of loads with the error of what was filled in for the unseen parts of volumes."""
    cov, causes = row.cov.copy(), dict(row.causes)
    for name, columns in zip(names, guesses, strict=True):
        part = operator @ columns
        if part.any():
            cov += part @ part.T
            causes[f"unseen {name}"] = np.einsum("mk,mk->m", part, part)
    return Carried(row.value, cov, causes)


def _share(mesh: Mesh, triangles: Mask, known: Mask) -> float:
    """Part of the area of some triangles that belongs to nodes without a value; a third of each to each corner."""
    area = np.linalg.norm(mesh.triangle_normals()[triangles], axis=1)
    total = float(area.sum())
    return float((area * (~known[mesh.triangles[triangles]]).mean(axis=1)).sum()) / total if total > 0 else 0.0


def _opening(mesh: Mesh, triangles: Mask) -> Array:
    """(3,) sum of the area vectors over the area."""
    normals = mesh.triangle_normals()[triangles]
    return np.asarray(normals.sum(axis=0) / max(float(np.linalg.norm(normals, axis=1).sum()), 1e-300))


def _closed(surface: Surface, triangles: Mask) -> bool:
    """Whether every edge of some triangles has two of them."""
    edges, count = replace(surface, triangles=surface.triangles[triangles]).edges()
    return bool(len(edges)) and bool((count == 2).all())
