"""The light that the lamps throw on a surface: what moves in it shines otherwise at the same pressure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.scene import Mesh

Array = NDArray[np.float64]

LEAST = 0.02
"""Nodes with less than this part of the largest light are not lit."""


@dataclass(frozen=True)
class Lamp:
    """A point that shines on all sides: light = power cos(angle) / distance^2, in the tunnel's frame."""

    position: tuple[float, float, float]
    power: float = 1.0


def lit(mesh: Mesh, lamps: Sequence[Lamp]) -> Array:
    """(V,) light on the nodes of a grid in the tunnel: power / length^2; 1 without lamps, NaN where none shines.

    Shadows are not in it.
    """
    if not lamps:
        return np.ones(len(mesh.vertices))
    normals = np.nan_to_num(mesh.vertex_normals())
    out = np.zeros(len(mesh.vertices))
    for lamp in lamps:
        away = np.array(lamp.position) - mesh.vertices
        square = np.einsum("vk,vk->v", away, away)
        out += lamp.power * np.maximum(np.einsum("vk,vk->v", away, normals), 0) / (square * np.sqrt(square))
    top = float(np.nanmax(out[mesh.used], initial=0.0))
    return np.where(out > LEAST * top, out, np.nan)
