"""What laws lack, as smooth displacements of their volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.parameter import ANGLE_UNITS
from windmark.deformation.volumes import Volumes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Texts = NDArray[np.str_]

MOST_DEGREE = 4
"""Along a volume; every five of its markers allow one degree more."""
MARKERS_PER_DEGREE = 5
KINDS = ("bending", "twist", "camber", "sway in its plane", "stretch", "shear")


@dataclass(frozen=True)
class Shapes:
    """Smooth displacements of a volume and of what is carried by it.

    Parameters
    ----------
    volume, carried : its name, and the names of all volumes that it moves
    centre : (3,) of its markers
    axes : (3, 3) its longest axis, the next one, and the normal of both
    half : (2,) its half extents along the first two
    degree : of the polynomials along the first
    """

    volume: str
    carried: tuple[str, ...]
    centre: Array
    axes: Array
    half: Array
    degree: int

    @staticmethod
    def of(volume: str, carried: Sequence[str], xyz: Array) -> Shapes | None:
        """Of markers (k, 3); None where they are too few for any."""
        degree = min(len(xyz) // MARKERS_PER_DEGREE - 1, MOST_DEGREE)
        if degree < 1:
            return None
        axes = np.linalg.svd(xyz - xyz.mean(axis=0), full_matrices=True)[2]
        along = (xyz - xyz.mean(axis=0)) @ axes[:2].T
        half = np.maximum(np.ptp(along, axis=0) / 2, 1e-30)
        half[1] = max(half[1], 1e-3 * half[0])
        return Shapes(volume, tuple(carried), xyz.mean(axis=0), axes, half, degree)

    @property
    def kind(self) -> Texts:
        """(m,) which of `KINDS` each column is."""
        n = self.degree + 1
        return np.repeat(KINDS, [n, n, 2, n, n, n])

    def columns(self, xyz: Array, names: Texts) -> Array:
        """(N, 3, m) displacement of undeformed points by one unit of each, at the edge of the volume."""
        u, v = ((xyz - self.centre) @ self.axes[:2].T / self.half).T
        power = np.polynomial.legendre.legvander(u, self.degree)
        turning = v[:, None] * power
        scalar = (power, turning, (v * v)[:, None] * power[:, :2], power, power, turning)
        direction = (self.axes[2], self.axes[2], self.axes[2], self.axes[1], self.axes[0], self.axes[0])
        parts = [s[:, None, :] * d[:, None] for s, d in zip(scalar, direction, strict=True)]
        return np.where(np.isin(names, self.carried)[:, None, None], np.concatenate(parts, axis=-1), 0.0)


@dataclass(frozen=True, eq=False)
class Misfit:
    """What the laws lack.

    Parameters
    ----------
    shapes : of the volumes with a pattern
    chosen : (m,) columns of these, one behind the other
    value : (m,) how much of each is left
    second : (m, m) its second moment: of the value itself, which the laws do not have, and of its error
    follow : (F, m) how all that was free would follow
    """

    shapes: tuple[Shapes, ...]
    chosen: Ints
    value: Array
    second: Array
    follow: Array

    def columns(self, xyz: Array, names: Texts) -> Array:
        """(N, 3, m) displacement of undeformed points of volumes (N,) in the model's frame."""
        return np.concatenate([s.columns(xyz, names) for s in self.shapes], axis=-1)[..., self.chosen]


def length_unit(volumes: Volumes) -> str:
    """The length unit, where it was given or a law's parameter has it; else ""."""
    known = [p.unit for p in volumes.parameters if p.unit and "/" not in p.unit and p.unit not in ANGLE_UNITS]
    return volumes.unit or (known[0] if known else "")


def carried(volumes: Volumes, name: str) -> list[str]:
    """The volume itself; where it has a law, all that is moved with it."""
    parts = {p.name: p for p in volumes.parts}
    if name not in parts or parts[name].law is None:
        return [name]
    out = []
    for part in volumes.parts:
        walk = part
        while walk.name != name and walk.parent is not None:
            walk = parts[walk.parent]
        out += [part.name] if walk.name == name else []
    return out
