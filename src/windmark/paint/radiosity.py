"""Self-illumination: the model lights itself, I = E + rho F I, with F the form factors of what nodes see.

Source: W. Ruyten, "Assessment of Lambertian and self-illumination", and Y. Le Sant, "Overview of the self-illumination
effect applied to pressure sensitive paint applications" (ICIASF 2001); paint taken as Lambertian.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError, g3
from windmark.paint.form_factors import FormFactors
from windmark.paint.modes import NodeField
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]

MOST_BOUNCES = 200


@dataclass(frozen=True, eq=False)
class SelfIllumination:
    """Light with what other parts of the model threw on it taken off.

    Parameters
    ----------
    field : (V) the paint's own light; mode ``self-illumination`` for the reflectivity's error
    change : (V,) part by which the light became less, 0 to 1; NaN where there was none
    largest : the largest change
    node : where it is, -1 where nothing changed
    guessed : part of the facets' area whose light was not seen and was taken as the mean of all
    """

    field: NodeField
    change: Array
    largest: float
    node: int
    guessed: float

    def __str__(self) -> str:
        at = f", at node {self.node}" if self.node >= 0 else ""
        part = 100 * self.guessed
        unseen = f"; {g3(part)} % of the surface was not seen and taken as the mean" if self.guessed else ""
        return f"self-illumination: at most {g3(100 * self.largest)} % of the light{at}{unseen}"


def remove_self_illumination(
    light: NodeField, factors: FormFactors, reflectivity: float, *, reflectivity_sigma: float = 0.0
) -> SelfIllumination:
    """The paint's own light from what was measured: E = I - rho F I.

    Parameters
    ----------
    light : (V) measured, in one unit for the whole surface (cameras merged, gains taken off); NaN where not seen
    factors : of the mesh where it was
    reflectivity : of the paint for its own light, 0 to below 1
    reflectivity_sigma : its error

    Returns
    -------
    SelfIllumination. The noise of the light that is reflected is averaged over facets and is left out.

    Raises
    ------
    DataError
        Where no light was seen, or more is reflected than was measured: the reflectivity or the factors are wrong.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]]
    >>> corner = wm.Mesh.make(corners, [[0, 1, 2], [0, 2, 3], [0, 3, 5], [0, 5, 4]])  # floor and wall
    >>> measured = wm.NodeField.make(np.full(6, 100.0))
    >>> own = wm.remove_self_illumination(measured, wm.form_factors(corner), 0.5)
    >>> bool((own.field.value < 100.0).all()), own.node  # most is reflected in the corner
    (True, 3)
    """
    check_kinds("remove_self_illumination", light=(light, NodeField), factors=(factors, FormFactors))
    _check(len(light), factors, reflectivity)
    if not reflectivity_sigma >= 0:
        raise UsageError(f"self-illumination: reflectivity_sigma must be at least 0, got {reflectivity_sigma}")
    on = light.known
    if not on.any():
        raise DataError("remove_self_illumination: no node has a light")
    sums = factors.share @ np.where(on, light.value, 0.0)
    part = factors.share @ on.astype(float)
    mean = float(light.value[on].mean())
    facet = np.where(part > 1e-9, sums / np.maximum(part, 1e-300), mean)
    thrown = factors.matrix @ facet
    own = light.value - reflectivity * thrown
    with np.errstate(invalid="ignore", divide="ignore"):
        change = np.where(light.value > 0, reflectivity * thrown / light.value, np.nan)
    if np.median(own[on] > 0) == 0:
        raise DataError("remove_self_illumination: more light would be reflected than was measured")
    out = replace(light, value=own)
    if reflectivity_sigma:
        out = out.with_mode("self-illumination", np.where(on, -thrown * reflectivity_sigma, 0.0))
    largest = float(np.nanmax(change)) if np.isfinite(change).any() else 0.0
    return SelfIllumination(out, change, largest, int(np.nanargmax(change)) if largest > 0 else -1,
                            float(np.mean(part <= 1e-9)))  # fmt: skip


def add_self_illumination(
    own: ArrayLike, factors: FormFactors, reflectivity: float, *, tolerance: float = 1e-9
) -> tuple[Array, int]:
    """Light (V,) of a surface whose paint gives ``own`` (V,), all reflections included, and how many were needed.

    Raises
    ------
    DataError
        Where the reflections do not fade (form factors that add up to more than 1 / reflectivity).
    """
    e = np.asarray(own, dtype=float)
    _check(len(e), factors, reflectivity)
    if not np.isfinite(e[np.diff(factors.share.tocsc().indptr) > 0]).all():
        raise DataError("add_self_illumination: the light of every node is needed")
    e = np.where(np.isfinite(e), e, 0.0)
    light = e
    for bounce in range(1, MOST_BOUNCES + 1):
        new = e + reflectivity * (factors.matrix @ (factors.share @ light))
        if np.abs(new - light).max() <= tolerance * np.abs(e).max():
            return new, bounce
        light = new
    raise DataError(f"add_self_illumination: reflections have not faded after {MOST_BOUNCES}")


def _check(count: int, factors: FormFactors, reflectivity: float) -> None:
    if count != factors.matrix.shape[0]:
        raise ValueError(f"self-illumination: expected the factors' {factors.matrix.shape[0]} nodes, got {count}")
    if not 0 <= reflectivity < 1:
        raise UsageError(f"self-illumination: reflectivity must be 0 to below 1, got {reflectivity}")
