"""Normals of markers whose table has none: of the surface through the neighbours, or of the side they are seen from.

The eccentricity of a disc of radius r at a distance d looks like a shift of the marker by about r^2 / d along its
normal, which no picture tells from a real one. So a normal that is wrong by 10 degrees leaves a sixth of that shift,
and a marker without a normal among corrected ones all of it: every marker gets one, be it a rough one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from windmark.geometry.discs import tangent

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NEIGHBOURS = 12
"""Neighbours that a surface is fitted to."""
LEAST = 6
"""Markers with fewer neighbours have no surface."""
PAIRED = 8
"""Nearest neighbours whose pairs start the search."""
ROUNDS = 8
"""Rounds of the robust fit."""
FLAT = 0.08
"""Scatter about the surface, as part of the neighbours' rms distance, from which it is none."""
MEMBERS = 0.6
"""Share of the neighbours (by their robust weight) that a surface needs."""
BENT = 0.5
"""The paraboloid must know the slope so much better than the plane: it has more to explain residuals with."""
OFF = 4.0
"""A marker so many times the neighbours' scatter off their surface is not on it."""
UNSURE = 0.3
"""1 sigma (radians) from which a slope is not known."""
LEAST_FACING = 0.35
"""Least cosine between a normal and the mean direction to the cameras: nobody marks a surface seen at 70 degrees."""
LENT = 4
"""Nearest normals that a marker without a surface borrows."""
SAME_SIDE = 0.5
"""Cosine to the direction that the markers are seen from on the whole, below which a marker has a side of its own."""


def all_normals(xyz: Array, known: Array, towards: Array) -> Array:
    """(N, 3) normals: the known ones, else of the local surface, else of the nearest with one; NaN without a place.

    Parameters
    ----------
    xyz : (N, 3) markers
    known : (N, 3) normals, NaN where unknown
    towards : (N, 3) mean direction from each marker to the cameras that saw it
    """
    out = known.copy()
    usable = np.isfinite(xyz).all(axis=1) & np.isfinite(towards).all(axis=1)
    missing = np.flatnonzero(~np.isfinite(known).all(axis=1) & usable)
    if not len(missing):
        return out
    own = _unit(towards[missing])
    surface, sigma = local_surface(xyz[usable], xyz[missing])
    along = np.einsum("ni,ni->n", surface, own)
    surface *= np.where(along < 0, -1.0, 1.0)[:, None]
    there = (sigma < UNSURE) & (np.abs(along) > LEAST_FACING)
    out[missing[there]] = surface[there]
    sure: Mask = np.asarray(np.isfinite(out).all(axis=1) & usable)
    out[missing[~there]] = _borrowed(xyz, out, sure, missing[~there], towards)
    return out


def _borrowed(xyz: Array, normal: Array, sure: Mask, poor: Ints, towards: Array) -> Array:
    """(P, 3) mean of the nearest normals for the markers ``poor`` (P,); their side where there are no such normals."""
    # One direction for all, where it will do: the sides of single markers fan out with their place in the picture.
    own, common = _unit(towards[poor]), _unit(np.nanmean(towards, axis=0))
    side = np.where((own @ common > SAME_SIDE)[:, None], common, own)
    if sure.sum() < LENT:
        return side
    near = cKDTree(xyz[sure]).query(xyz[poor], k=LENT)[1]
    mean = normal[sure][near].mean(axis=1)
    length = np.linalg.norm(mean, axis=1)
    mean /= np.maximum(length, 1e-9)[:, None]
    fits = (length > SAME_SIDE) & (np.einsum("ni,ni->n", mean, own) > LEAST_FACING)
    return np.where(fits[:, None], mean, side)


def local_surface(xyz: Array, at: Array) -> tuple[Array, Array]:
    """Unit normals (M, 3), of either sign, of the surface of points (N, 3) at some of them (M, 3), and 1 sigma (M,).

    A plane or a paraboloid through the nearest points, whichever knows the slope better by its own residuals; robust,
    for the neighbours may belong to another part. Sigma is inf where there is no surface, or the point is not on it.
    """
    count = min(NEIGHBOURS + 1, len(xyz))
    if count <= LEAST:
        return np.tile([0.0, 0.0, 1.0], (len(at), 1)), np.full(len(at), np.inf)
    near = xyz[cKDTree(xyz).query(at, k=count)[1]] - at[:, None]
    size = np.sqrt((near**2).sum(axis=2).mean(axis=1))[:, None, None]
    around = near / np.where(size > 0, size, 1.0)
    normal = _median_plane(around)
    best = normal, np.full(len(at), np.inf)
    for terms in (3, 6):
        if count <= terms + 1:
            continue
        found = normal
        for _ in range(2):  # the second time in the frame of the first
            found, sigma = _fitted(around, found, terms)
        better = sigma < BENT * best[1] if terms > 3 else sigma < best[1]
        best = np.where(better[:, None], found, best[0]), np.where(better, sigma, best[1])
    return best


def _median_plane(around: Array) -> Array:
    """(M, 3) normals of the planes through the origin, and two of the nearest (M, K, 3), nearest to half of all."""
    first, second = np.triu_indices(min(PAIRED, around.shape[1] - 1), 1)
    across = np.cross(around[:, 1 + first], around[:, 1 + second])
    length = np.linalg.norm(across, axis=2, keepdims=True)
    across = np.where(length > 1e-9, across / np.where(length > 1e-9, length, 1.0), [0.0, 0.0, 1.0])
    median = np.median(np.abs(np.einsum("mpi,mki->mpk", across, around)), axis=2)
    best = np.where(length[..., 0] > 1e-9, median, np.inf).argmin(axis=1)
    return np.asarray(np.take_along_axis(across, best[:, None, None], axis=1)[:, 0])


def _fitted(around: Array, normal: Array, terms: int) -> tuple[Array, Array]:
    """Normals (M, 3) at the origin of surfaces over the plane across ``normal``, and their sigma (M,)."""
    u = tangent(normal)
    v = np.cross(normal, u)
    x, y, z = (np.einsum("mki,mi->mk", around, axis) for axis in (u, v, normal))
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y][:terms], axis=2)
    weight = np.ones_like(z)
    for _ in range(ROUNDS):
        weighted = design * weight[..., None]
        inverse = np.linalg.pinv(weighted.transpose(0, 2, 1) @ design, rcond=1e-9, hermitian=True)
        value = (inverse @ (weighted * z[..., None]).sum(axis=1)[..., None])[..., 0]
        residual = z - (design @ value[..., None])[..., 0]
        scale = np.maximum(1.4826 * np.median(np.abs(residual), axis=1, keepdims=True), 1e-9)
        weight = 1 / (1 + (residual / (2.0 * scale)) ** 2)
    free = np.maximum(weight.sum(axis=1) - terms, 0.5)
    variance = (weight * residual**2).sum(axis=1) / free
    slope = value[:, 1:3]
    sigma = np.sqrt(np.maximum(variance * (inverse[:, 1, 1] + inverse[:, 2, 2]) / 2, 0.0))
    none = np.linalg.eigvalsh(weighted.transpose(0, 2, 1) @ design)[:, 0] < 1e-6
    none |= (variance > FLAT**2) | (weight.mean(axis=1) < MEMBERS)
    away = np.abs(residual[:, 0]) > OFF * np.sqrt(variance)
    found = _unit(normal - slope[:, :1] * u - slope[:, 1:] * v)
    return found, np.where(none | away, np.inf, sigma)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))
