"""Surface that bears no paint, or on which no lamp shines: what light it has others throw on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import vertex_volumes
from windmark.geometry.order import quantile
from windmark.paint.surface import joined_surface
from windmark.scene import Mesh
from windmark.tasks.psp.levels import Level
from windmark.tasks.psp.sampling import Sampling

Mask = NDArray[np.bool_]

UNLIT, DIM = 0.05, 0.25
"""Of the light that the bright tenth of a camera's nodes has at least, wind-off. Paint throws some per cent of its
light on what is beside it, up to a quarter in a corner (half of the hemisphere, reflectivity 0.5): what has no more
tells the pressure there. Dim surface that goes over into unlit one is its brighter part."""


def without_unlit(levels: Mapping[str, Level], how: Sampling, mesh: Mesh) -> tuple[dict[str, Level], Mask]:
    """Each camera's light wind-off without the nodes of a mesh with next to none; (V,) where no camera is left then.

    What is known not to be paint (``how.patches``) is dark by itself and not meant.
    """
    out: dict[str, Level] = {}
    seen, lit = np.zeros((2, 1), dtype=np.bool_)
    for name, of in levels.items():
        known = np.isfinite(of.value)
        typical = quantile(of.value[known], 0.9) if known.any() else 0.0
        share = of.value / typical if typical > 0 else np.where(known, 1.0, np.nan)
        bright = known & ~_beside(mesh, share < DIM, share < UNLIT)
        seen, lit = seen | known, lit | bright
        out[name] = of if bright.sum() == known.sum() else replace(of, value=np.where(bright, of.value, np.nan))
    dark = np.asarray(seen & ~lit)
    return out, dark if how.patches is None else dark & ~how.patches.nodes


def _beside(mesh: Mesh, dim: Mask, unlit: Mask) -> Mask:
    """Nodes (V,) that are unlit, and dim ones that hang together with them."""
    if not unlit.any():
        return unlit
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    surface = joined_surface(mesh)
    at, on = surface.place, np.zeros(len(surface.first), dtype=np.bool_)
    on[at[dim & (at >= 0)]] = True
    edge = surface.edges()[0]
    edge = edge[on[edge].all(axis=1)]
    part = connected_components(coo_array((np.ones(len(edge)), edge.T), shape=(len(on),) * 2), directed=False)[1]
    return np.asarray(dim & (at >= 0) & np.isin(part[at], np.unique(part[at[unlit & (at >= 0)]])))


def unlit_words(rest: Mesh, unlit: Mask, known: Mask) -> list[str]:
    """What is said of nodes (V,) that are ``unlit``, beside those that have a value."""
    if not unlit.any():
        return []
    volume, parts = vertex_volumes(rest), []
    for name in dict.fromkeys(volume[unlit].tolist()):
        own = volume == name
        share = 100 * float((own & unlit).sum() / max((own & (unlit | known)).sum(), 1))
        parts.append(f"{share:.0f} % of {name}" if name else f"{share:.0f} %")
    return [
        f"{' and '.join(parts)} that cameras show has next to none of the bright parts' light wind-off: no "
        "lamp shines there, or there is no paint; what light it has others throw on it, and it gets no value"
    ]
