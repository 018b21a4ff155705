"""Light that the model throws on itself, taken off the ratio; and what that changed.

Source: Le Sant, ICIASF 2001 (see `paint.radiosity`). Each kind of picture has its own: E_off / E_on is the ratio times
(1 - c_off) / (1 - c_on), c being the part of a node's light that comes from other parts of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError, g2, g3
from windmark.paint import (
    FormFactors,
    NodeField,
    NotFitted,
    combined,
    form_factors,
    merge_cameras,
    remove_self_illumination,
)
from windmark.scene import Mesh

Array = NDArray[np.float64]

CAUSE = "self-illumination"
MOST = 0.9
"""A node of whose light a larger part is that of others says nothing of its own."""
MUCH = 0.05
"""Of the hemisphere of a node that surface fills: paint of reflectivity 0.5 throws 2.5 % of its light on it then, most
of which cancels in the ratio."""
LOOKED_AT, COARSE = 1000, 50
"""Nodes, evenly over all of a mesh, and facets that tell whether a model throws light on itself at all."""


@dataclass(frozen=True, eq=False)
class Reflecting:
    """A paint that throws back a part of its own light.

    Parameters
    ----------
    reflectivity, sigma : for that light, 0 to below 1, and its error
    factors : form factors of the grid
    """

    reflectivity: float
    sigma: float
    factors: FormFactors


@dataclass(frozen=True, eq=False)
class Change:
    """What taking it off changed.

    Parameters
    ----------
    off, on : largest part of a node's light that was thrown on it, wind-off and wind-on
    ratio : (V,) factor on the ratio, 1 where nothing is known
    guessed : part of the surface whose light no camera shows, taken as the mean of all
    """

    off: float
    on: float
    ratio: Array
    guessed: float

    def __str__(self) -> str:
        by = 100 * (self.ratio - 1)
        words = (
            f"self-illumination taken off: up to {g2(100 * self.off)} % of the light wind-off, {g2(100 * self.on)} % "
            f"wind-on; the ratio changed by {np.nanmin(by):+.2g} to {np.nanmax(by):+.2g} %, "
            f"{g2(np.sqrt(np.nanmean(by**2)))} % RMS"
        )
        if not self.guessed:
            return words
        return f"{words}; no camera sees {g2(100 * self.guessed)} % of the surface: its light was taken as the mean"


def left_words(mesh: Mesh) -> list[str]:
    """What is said of light that the model throws on itself and nobody asked to take off; nothing where it is little.

    How much it is takes the paint's reflectivity, which is not known: said is how much of the model is beside other.
    """
    nodes = np.unique(np.linspace(0, len(mesh.vertices) - 1, LOOKED_AT).round().astype(np.int64))
    filled = np.nan_to_num(form_factors(mesh, facets=COARSE, nodes=nodes).seen[nodes])
    much = filled > MUCH
    if not much.any():
        return []
    most = int(np.argmax(filled))
    at = ", ".join(g3(x) for x in mesh.vertices[nodes[most]])
    return [
        "no [self_illumination] is given: light that the model throws on itself is neither corrected nor in any sigma; "
        f"at {g2(100 * float(much.mean()))} % of the grid's nodes other parts of it fill {g2(100 * MUCH)} % of the "
        f"hemisphere and more, at most {g2(100 * filled[most])} %, near ({at})"
    ]


def own_light(
    ratio: NodeField,
    lights: Mapping[str, Mapping[str, NodeField]],
    tapers: Array,
    how: Reflecting,
    kinds: tuple[str, str],
) -> tuple[NodeField, Change]:
    """The ratio of the paint's own light.

    Parameters
    ----------
    ratio : (V) wind-off / wind-on, as the cameras show it
    lights : kind -> camera -> (V) its light as it left the surface, in the camera's own unit
    tapers : (C, V) the cameras' weights
    kinds : what wind-off and wind-on are called

    Raises
    ------
    DataError
        Where cameras share too little to tell their units, or more light would be reflected than there is.
    """
    off, on = (_thrown(lights[kind], tapers, how) for kind in kinds)
    factor = (1 - off[0]) / (1 - on[0])
    value = ratio.value * factor
    out = combined(value, [(ratio, factor)], unit=ratio.unit)
    if how.sigma > 0 and how.reflectivity > 0:
        slope = (on[0] / (1 - on[0]) - off[0] / (1 - off[0])) / how.reflectivity
        out = out.with_mode(CAUSE, np.where(out.known, value * slope * how.sigma, 0.0))
    used = ratio.known
    largest = [float(np.nanmax(of[0][used], initial=0.0)) for of in (off, on)]
    return out, Change(largest[0], largest[1], np.where(used, factor, 1.0), max(off[1], on[1]))


def _thrown(cameras: Mapping[str, NodeField], tapers: Array, how: Reflecting) -> tuple[Array, float]:
    """(V,) part of a node's light that was thrown on it, NaN where that is nearly all; and how much was guessed."""
    merged = merge_cameras(list(cameras.values()), list(cameras), tapers=tapers)
    if isinstance(merged, NotFitted):
        raise DataError(f"self-illumination: the cameras' lights cannot be put together: {merged.reason}")
    done = remove_self_illumination(merged.field, how.factors, how.reflectivity)
    return np.where(done.change < MOST, done.change, np.nan), done.guessed
