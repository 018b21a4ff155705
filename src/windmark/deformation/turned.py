"""How laws turn the surface where its markers are: a disc on a flap is seen as obliquely as the flap stands.

A law says where points of the surface go. What it does to points beside the surface is often nothing that means much (a
hinge may be written for a plane), so a normal goes along by two lines in the surface and not as a line of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.law import LawError
from windmark.deformation.volumes import REACH, Placed

Array = NDArray[np.float64]


def turns(placed: Placed, q: Array, normal: Array) -> Array:
    """Rotations (N, 3, 3) of the surface at bound points, in the model's frame; none where no normal is known.

    None, too, where a law has no place for points right beside a marker.

    Parameters
    ----------
    placed : the points
    q : (K,) parameters of all laws
    normal : (N, 3) of the undeformed surface; NaN where unknown
    """
    out = np.tile(np.eye(3), (len(placed.xyz), 1, 1))
    index, before, tips = _beside(placed, normal)
    if not len(index):
        return out
    try:
        moved = tips.place(q)
    except LawError:
        return out
    here = placed.place(q)[index]
    after = _carried(moved[: len(index)] - here, moved[len(index) :] - here)
    good = np.isfinite(after).all(axis=(1, 2))
    out[index[good]] = (after @ np.swapaxes(before, 1, 2))[good]
    return out


def _beside(placed: Placed, normal: Array) -> tuple[NDArray[np.int64], Array, Placed]:
    """Points that laws turn, their axes as of `surface_axes`, and two places beside each; the same for every state."""
    for known, found in placed.beside:
        if known == normal.tobytes():
            return found
    with_law = [index for index, chain in placed.groups if chain.own is not None or chain.above]
    index = np.concatenate([np.zeros(0, np.int64), *with_law])
    index = index[np.isfinite(normal[index]).all(axis=1)]
    before, xyz = surface_axes(normal[index]), placed.xyz[index]
    reach = REACH * float(np.abs(xyz).max(initial=1e-9))
    beside = np.concatenate([xyz + reach * before[..., k] for k in (0, 1)])
    found = index, before, placed.volumes.bind(beside, np.tile(placed.names[index], 2))
    placed.beside[:] = [(normal.tobytes(), found)]
    return found


def rotated(turned: Array, value: Array) -> Array:
    """Normals (N, 3) or curvatures (N, 3, 3) that rotations (N, 3, 3) take along."""
    if value.ndim == 2:
        return np.asarray((turned @ value[..., None])[..., 0])
    return np.asarray(turned @ value @ np.swapaxes(turned, 1, 2))


def surface_axes(normal: Array) -> Array:
    """(N, 3, 3) axes of a surface with normals (N, 3) as columns: two in the surface, then its unit normal."""
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    beside = np.where(np.abs(normal[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(normal, beside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first), normal], axis=-1)


def _carried(first: Array, second: Array) -> Array:
    """(N, 3, 3) `surface_axes` where both lines in the surface became ``first`` and ``second`` (N, 3); NaN for none.

    Both lines count alike: a shear turns one of them as far as the other one, the other way.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        first, second, normal = map(_unit, (first, second, _cross(first, second)))
        first = _unit(first + _cross(second, normal))
    return np.stack([first, _cross(normal, first), normal], axis=-1)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.sqrt((v * v).sum(axis=1, keepdims=True)))


def _cross(a: Array, b: Array) -> Array:
    """`numpy.cross` of (N, 3), which takes five times as long for sixty of them."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
