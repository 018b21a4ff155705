"""Loads of the sides of the model that cameras show; what none shows is named, not guessed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import WindmarkError, g2, g3
from windmark.paint import COEFFICIENTS, LoadReference, Loads, NodeField, fewer_modes, integrate_loads, load_operator
from windmark.scene import Mesh

Mask = NDArray[np.bool_]

MODES = 25
"""Columns of Cp that the loads get: `integrate_loads` adds one for what it fills in of each volume."""
ALL = "all"
"""The row of all volumes together, as `integrate_loads` calls it."""
EACH = 0.1
"""Cp by which the side that no camera shows is said to count."""
TURNED = 2.0
"""Sigmas of a coefficient by which another incidence must turn it before that counts."""
UNSEEN_SIDE = " (not seen)"
"""Ends the name of the part of a volume that no camera shows."""


def seen_sides(mesh: Mesh, known: Mask) -> Mesh:
    """The grid with every volume divided: triangles of which no corner has a value are a volume of their own."""
    blind = ~known[mesh.triangles].any(axis=1)
    width = max((len(str(n)) for n in set(mesh.volume.tolist())), default=0) + len(UNSEEN_SIDE)
    names = mesh.volume.astype(f"<U{width}")
    names[blind] = np.char.add(mesh.volume[blind].astype(f"<U{width}"), UNSEEN_SIDE)
    out = replace(mesh, volume=names)
    # The same surface: what was found of it once is not looked for at every point.
    out.__dict__["_still"] = mesh.__dict__.get("_still", mesh)
    return out


def shown_areas(mesh: Mesh, known: Mask) -> dict[str, float]:
    """Part of the area of every volume, and of `ALL` of them, that is on a side with values (V,)."""
    area = np.linalg.norm(mesh.triangle_normals(), axis=1)
    shown = known[mesh.triangles].any(axis=1)
    groups = {str(name): mesh.volume == name for name in dict.fromkeys(mesh.volume.tolist())}
    groups[ALL] = np.ones(len(area), dtype=np.bool_)
    return {name: float(area[own & shown].sum() / max(area[own].sum(), 1e-300)) for name, own in groups.items()}


def side_loads(mesh: Mesh, reference: LoadReference, triangles: Mask) -> str:
    """Loads of a Cp of `EACH` all over some triangles (T,), in words: what a share of each load rests on."""
    whole = load_operator(mesh, reference, triangles).sum(axis=1) * EACH
    return ", ".join(f"{name} {whole[COEFFICIENTS.index(name)]:+.2g}" for name in ("CL", "CD", "Cm"))


def between_incidences(loads: Loads, reference: LoadReference, apart_deg: float, remarks: list[str]) -> Loads:
    """Loads with the error of wind axes whose incidence is either the reference's or ``apart_deg`` more.

    Nothing says which of the two it is, so that the variance is half of what they differ by, squared; those along body
    axes have none of it. As they are where that turns no coefficient by more than `TURNED` of its sigmas: a sting that
    bends under load has the model at another incidence than its support. ``remarks`` say where it counts.
    """
    turn = replace(reference, alpha_deg=reference.alpha_deg + apart_deg).wind_axes() - reference.wind_axes()
    body, wind = ([COEFFICIENTS.index(name) for name in names] for names in (("CA", "CY", "CN"), ("CD", "CC", "CL")))
    change = np.zeros(loads.value.shape)
    change[:, wind] = loads.value[:, body] @ turn.T
    if not (np.abs(change) > TURNED * loads.sigma).any():
        return loads
    remarks.append(
        f"the pictures show an incidence of {reference.alpha_deg + apart_deg:.2f} degrees, the table of points says "
        f"{reference.alpha_deg:g}: loads along the wind are those of the table's, and their sigmas have what the two "
        f"differ by (CD {change[-1, wind[0]]:+.2g})"
    )
    cov = loads.cov + change[:, :, None] * change[:, None, :] / 2
    causes = tuple({**of, "incidence": row**2 / 2} for of, row in zip(loads.causes, change, strict=True))
    return replace(loads, cov=cov, sigma=np.sqrt(np.diagonal(cov, axis1=1, axis2=2)), causes=causes)


def hole_words(mesh: Mesh, seen: Mask, known: Mask) -> list[str]:
    """What is said of holes in the sides that are ``seen`` (V,): triangles of which no corner is ``known`` (V,)."""
    area = np.linalg.norm(mesh.triangle_normals(), axis=1)
    hole = seen[mesh.triangles].any(axis=1) & ~known[mesh.triangles].any(axis=1)
    out = []
    for name in dict.fromkeys(mesh.volume[hole].tolist()):
        own = mesh.volume == name
        part = float(area[own & hole].sum() / max(float(area[own].sum()), 1e-300))
        out.append(f"{name}: {g2(100 * part)} % of its area is shown by cameras, but has no value: pixels that are "
                   "saturated or do not count, in pictures of the point or in flat ones; its loads are filled in there "
                   "from around, and what that may be wrong by is in their sigmas")  # fmt: skip
    return out


def seen_loads(
    mesh: Mesh,
    cp: NodeField,
    reference: LoadReference,
    least_seen: float,
    remarks: list[str],
    *,
    seen: Mask | None = None,
) -> Loads | None:
    """Loads of what was seen, None where ``remarks`` say why not; they name what no camera shows.

    ``seen`` (V,) nodes that decide which sides those are; by default those with a value. What has none there
    is filled in by `integrate_loads`.
    """
    seen = cp.known if seen is None else seen
    sides = seen_sides(mesh, seen)
    volumes = [str(n) for n in dict.fromkeys(sides.volume.tolist()) if not str(n).endswith(UNSEEN_SIDE)]
    blind = ~seen[mesh.triangles].any(axis=1)
    for name, part in shown_areas(mesh, seen).items():
        if part < 1 and name != ALL:
            remarks.append(f"{name}: {g3(100 * (1 - part))} % of its area is on a side that no camera shows; its loads "
                           "are those of the rest. Nothing says those of that side, they are not estimated: a Cp of "
                           f"{EACH:g} all over it makes {side_loads(mesh, reference, blind & (mesh.volume == name))}")
    try:
        done = integrate_loads(sides, fewer_modes(cp, MODES), reference, volumes=volumes, least_seen=least_seen)
    except WindmarkError as error:
        remarks.append(f"no loads: {error}")
        return None
    return done
