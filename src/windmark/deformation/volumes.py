"""The model's volumes: each with its own law, attached to each other (AIAA 2005-5007, section V).

A point is first moved by its own volume's law, then by its parent's, and so on: the parent's law takes the moved
point as one of its own. So a flap turns about its hinge and is then bent with the wing. A volume that is stiffer
than its parent (an engine on a wing) is *attached* at a point instead: it follows the parent's motion of that point
and the parent's rotation there, and keeps its shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.law import BoundLaw, Law, Linear
from windmark.deformation.parameter import Parameter
from windmark.geometry.rotations import project_to_so3

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

REACH = 1e-4
"""Change of place for the derivative of a law by its points, as part of their extent."""


@dataclass(frozen=True)
class Volume:
    """A part of the model.

    Parameters
    ----------
    name : as in the volume column of the markers and the volumes of the grid
    law : how it deforms; None where it only follows its parent
    parent : name of the volume it is fixed to; None for the model's frame
    attach : (3,) point at which it is fixed to its parent as a rigid body; None to be deformed with it
    """

    name: str
    law: Law | None = None
    parent: str | None = None
    attach: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.attach is not None and self.parent is None:
            raise ValueError(f"Volume {self.name}: attach has no meaning without a parent")


@dataclass(frozen=True)
class Volumes:
    """All volumes of a model and the parameters of their laws.

    Parameters
    ----------
    parts : the volumes; one that is not named here is rigid and belongs to the model's frame
    """

    parts: tuple[Volume, ...]

    @staticmethod
    def of(parts: Sequence[Volume] | Volumes) -> Volumes:
        """Volumes from a list.

        Raises
        ------
        ValueError
            For a name that comes twice, a parent that does not exist, volumes that are their own parents.
        """
        if isinstance(parts, Volumes):
            return parts
        names = [p.name for p in parts]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"volumes: {twice[0]} is there more than once")
        known = {p.name: p for p in parts}
        for part in parts:
            if part.parent is not None and part.parent not in known:
                raise ValueError(f"volumes: parent {part.parent!r} of {part.name} is not one of {', '.join(names)}")
            above, chain = part.parent, [part.name]
            while above is not None:
                if above in chain:
                    raise ValueError(f"volumes: {' -> '.join([*chain, above])}: a volume cannot be its own parent")
                chain.append(above)
                above = known[above].parent
        return Volumes(tuple(parts))

    @cached_property
    def _slices(self) -> dict[str, slice]:
        """Where each volume's parameters stand among all."""
        out, first = {}, 0
        for part in self.parts:
            count = len(part.law.parameters) if part.law is not None else 0
            out[part.name] = slice(first, first + count)
            first += count
        return out

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of all laws, in the order of q."""
        return tuple(p for part in self.parts if part.law is not None for p in part.law.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Text volume.parameter for each of them."""
        return tuple(
            f"{part.name}.{p.name}" for part in self.parts if part.law is not None for p in part.law.parameters
        )

    @property
    def start(self) -> Array:
        """(K,) the parameters of the undeformed model."""
        return np.array([p.start for p in self.parameters])

    def bind(self, xyz: ArrayLike, volume: Texts | Sequence[str] | str) -> Placed:
        """The laws for points (N, 3) of volumes (N,)."""
        points = np.asarray(xyz, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"Volumes.bind: xyz must be (N, 3), got {points.shape}")
        names = np.full(len(points), volume) if isinstance(volume, str) else np.asarray(volume, dtype=np.str_)
        if names.shape != (len(points),):
            raise ValueError(f"Volumes.bind: volume must be ({len(points)},), got {names.shape}")
        groups = []
        for part in self.parts:
            index = np.flatnonzero(names == part.name)
            if len(index):
                groups.append((index, self._chain(part, points[index])))
        return Placed(points, tuple(groups), len(self.names))

    def _chain(self, part: Volume, xyz: Array) -> _Chain:
        known = {p.name: p for p in self.parts}
        own = part.law.bind(xyz) if part.law is not None else None
        above: list[tuple[Volume, slice]] = []
        attach, walk = part.attach, part
        carried: list[Array | None] = []
        while walk.parent is not None:
            carried.append(None if attach is None else np.asarray(attach, dtype=float))
            walk = known[walk.parent]
            above.append((walk, self._slices[walk.name]))
            attach = walk.attach
        return _Chain(xyz, own, self._slices[part.name], tuple(zip(above, carried, strict=True)))


@dataclass(frozen=True)
class Placed:
    """Points of volumes, bound to their laws.

    Parameters
    ----------
    xyz : (N, 3) undeformed
    groups : index and chain of laws of every volume that has any of the points
    count : number of all parameters K
    """

    xyz: Array
    groups: tuple[tuple[NDArray[np.int64], _Chain], ...]
    count: int

    def place(self, q: Array) -> Array:
        """Displaced points (N, 3) in the model's frame, for all parameters (K,)."""
        out = self.xyz.copy()
        for index, chain in self.groups:
            out[index] = chain.place(q)
        return out

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """Displaced points (N, 3) and their derivative (N, 3, K)."""
        out, by_q = self.xyz.copy(), np.zeros((*self.xyz.shape, self.count))
        for index, chain in self.groups:
            out[index], by_q[index] = chain.linearise(q, self.count)
        return out, by_q


@dataclass(frozen=True)
class _Chain:
    """Points of one volume: its own law, then the laws above, each as a field or, where attached, as a rigid body."""

    xyz: Array
    own: BoundLaw | None
    where: slice
    above: tuple[tuple[tuple[Volume, slice], Array | None], ...]

    def place(self, q: Array) -> Array:
        points = self.xyz if self.own is None else self.own.place(q[self.where])
        for (part, where), attach in self.above:
            if part.law is not None:
                points = _carried(part.law, points, q[where], attach)
        return points

    def linearise(self, q: Array, count: int) -> tuple[Array, Array]:
        by_q = np.zeros((*self.xyz.shape, count))
        points = self.xyz
        if self.own is not None:
            points, by_q[..., self.where] = self.own.linearise(q[self.where])
        for (part, where), attach in self.above:
            if part.law is None:
                continue
            moved = by_q.any(axis=(0, 1))
            before, points, own = points, *_carried_jacobian(part.law, points, q[where], attach)
            for j in np.flatnonzero(moved):  # what moved the points below is carried on
                by_q[..., j] = _along(part.law, before, by_q[..., j], q[where], attach)
            by_q[..., where] += own
        return points, by_q


def _carried(law: Law, points: Array, q: Array, attach: Array | None) -> Array:
    """Points moved by a law above."""
    if attach is None:
        return law.bind(points).place(q)
    rotation, centre = _frame(law, attach, points, q)
    return np.asarray((points - attach) @ rotation.T + centre)


def _carried_jacobian(law: Law, points: Array, q: Array, attach: Array | None) -> tuple[Array, Array]:
    """Points moved by a law above, and their derivative by its parameters."""
    if attach is None:
        return law.bind(points).linearise(q)
    from windmark.deformation.law import Numeric

    steps = np.array([p.step for p in law.parameters])
    return Numeric(lambda v: _carried(law, points, v, attach), steps).linearise(q)


def _along(law: Law, points: Array, direction: Array, q: Array, attach: Array | None) -> Array:
    """Derivative of the moved points where they are moved in a direction (N, 3)."""
    if attach is not None:
        return np.asarray(direction @ _frame(law, attach, points, q)[0].T)
    longest = float(np.linalg.norm(direction, axis=1).max(initial=0.0))
    h = REACH * _extent(points) / longest
    return np.asarray((law.bind(points + h * direction).place(q) - law.bind(points - h * direction).place(q)) / (2 * h))


def _frame(law: Law, attach: Array, points: Array, q: Array) -> tuple[Array, Array]:
    """Rotation and place of the frame that a law carries along at a point."""
    h = REACH * _extent(points)
    around = attach + np.concatenate([np.zeros((1, 3)), h * np.eye(3), -h * np.eye(3)])
    moved = law.bind(around).place(q)
    return project_to_so3((moved[1:4] - moved[4:]).T / (2 * h)), moved[0]


def _extent(points: Array) -> float:
    return float(max(np.ptp(points, axis=0).max(initial=0.0), 1e-3 * np.abs(points).max(initial=0.0), 1e-9))


def rigid_placed(xyz: Array) -> Linear:
    """Points that do not deform, as a bound law without parameters."""
    return Linear(xyz, np.zeros((*xyz.shape, 0)))
