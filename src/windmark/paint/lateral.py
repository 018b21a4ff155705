"""Shape and conduction along the surface: the Laplacian at the nodes, curvature, and heat that goes sideways."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.surface import joined_surface
from windmark.paint.walls import Wall
from windmark.scene import Mesh

Array = NDArray[np.float64]


def node_laplacian(mesh: Mesh) -> Any:
    """(V, V) sparse Laplacian on the surface, per length unit squared; rows of NaN at borders and in no triangle.

    Nodes of blocks that meet are one place: only the first of them has a weight, and all have its row.
    """
    from scipy.sparse import csr_array

    surface = joined_surface(mesh)
    lap, areas = surface.laplacian
    count, places = len(mesh.vertices), len(surface.first)
    scale = np.where((areas > 0) & ~surface.border, 1 / np.where(areas > 0, areas, 1.0), np.nan)
    on = np.flatnonzero(surface.place >= 0)
    spread = csr_array((np.ones(len(on)), (on, surface.place[on])), shape=(count, places))
    gather = csr_array((np.ones(places), (np.arange(places), surface.first)), shape=(places, count))
    lap = lap.tocsr()
    lap.data = lap.data * np.repeat(scale, np.diff(lap.indptr))
    return (spread @ lap @ gather).tocsr()


def curvature_sum(mesh: Mesh) -> Array:
    """(V,) sum of the surface's two curvatures, 1 / length unit; positive where it is convex to the outside.

    By the Laplacian of the place, which is minus that times the normal (Meyer et al., Visualization and Mathematics
    III, 2003); NaN at borders, and a mean over the cells round a node: a sharp edge has the curvature of a round one as
    wide as its cells.
    """
    bend = node_laplacian(mesh) @ mesh.vertices
    return np.asarray(-np.einsum("vk,vk->v", bend, mesh.vertex_normals()))


def lateral_conduction(mesh: Mesh, rise: ArrayLike, wall: Wall, time: float) -> Array:
    """Heat (V,), W / m^2, that flows along the surface and is missing in the flux of `heat_flux`.

    Parameters
    ----------
    rise : (V,) temperature less initial temperature, NaN where not known (NaN there and beside)
    time : seconds since the heating began

    Returns
    -------
    (V,) the Laplacian on the surface times the conductance of all layers, each to the depth to which a step of the
    surface temperature has gone (`Wall.conductance_along`): -k laplacian(T) 2 sqrt(diffusivity t / pi) of a
    semi-infinite wall. Where it is no small part of the flux, one-dimensional conduction does not hold.
    """
    t = np.asarray(rise, dtype=float)
    if t.shape != (len(mesh.vertices),):
        raise ValueError(f"lateral_conduction: rise must be ({len(mesh.vertices)},), got {t.shape}")
    if mesh.length_unit not in ("", "m"):
        raise UsageError(f"lateral_conduction: the mesh must be in m, as the wall is; it is in {mesh.length_unit}")
    return np.asarray(-lateral_conductance(wall, time) * (node_laplacian(mesh) @ t))


def lateral_conductance(wall: Wall, time: float) -> float:
    """Conductance along the surface (W / K) of all that heat has gone to after a time, see `Wall.conductance_along`."""
    return float(wall.conductance_along([time])[0])
