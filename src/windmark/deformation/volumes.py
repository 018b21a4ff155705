"""The model's volumes: each with its own law, attached to each other (AIAA 2005-5007, section V).

A point is first moved by its own volume's law, then by its parent's, and so on: the parent's law takes the moved
point as one of its own. So a flap turns about its hinge and is then bent with the wing. A volume that is stiffer
than its parent (an engine on a wing) is *attached* at a point instead: it follows the parent's motion of that point
and the parent's rotation there, and keeps its shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.deformation.law import BoundLaw, Law, Numeric
from windmark.deformation.parameter import Parameter
from windmark.errors import UsageError
from windmark.geometry.rotations import project_to_so3

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

REACH = 1e-4
"""Change of place for the derivative of a law by its points, as part of their extent."""
SMALL = 1e-3
"""Size of a rigid body's joint, as part of the body: its rotation is the mean one there."""


@dataclass(frozen=True)
class Volume:
    """A part of the model.

    Parameters
    ----------
    name : as in the volume column of the markers and the volumes of the grid
    law : how it deforms; None where it only follows its parent
    parent : name of the volume it is fixed to; None for the model's frame
    attach : (3,) point at which it is fixed to its parent as a rigid body; None to be deformed with it

    Examples
    --------
    >>> import windmark as wm
    >>> flap = wm.Volume("flap", parent="wing", attach=(80.0, 200.0, 0.0))  # rigid, goes where the wing goes
    >>> flap.law is None
    True
    >>> try:
    ...     wm.Volume("flap", attach=(80.0, 200.0, 0.0))
    ... except ValueError as error:
    ...     print(error)
    Volume flap: attach has no meaning without a parent
    """

    name: str
    law: Law | None = None
    parent: str | None = None
    attach: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.attach is not None and self.parent is None:
            raise UsageError(f"Volume {self.name}: attach has no meaning without a parent")


@dataclass(frozen=True)
class Volumes:
    """All volumes of a model and the parameters of their laws.

    Parameters
    ----------
    parts : the volumes; one that is not named here is rigid and belongs to the model's frame
    unit : of lengths in what is said of them; "" for that of the laws' parameters, if one has it
    """

    parts: tuple[Volume, ...]
    unit: str = ""

    @staticmethod
    def of(parts: Sequence[Volume] | Volumes, unit: str = "") -> Volumes:
        """Volumes from a list; those that are some already stay as they are.

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
            raise UsageError(f"volumes: {twice[0]} is there more than once")
        known = {p.name: p for p in parts}
        for part in parts:
            if part.parent is not None and part.parent not in known:
                raise UsageError(f"volumes: parent {part.parent!r} of {part.name} is not one of {', '.join(names)}")
            above, chain = part.parent, [part.name]
            while above is not None:
                if above in chain:
                    raise UsageError(f"volumes: {' -> '.join([*chain, above])}: a volume cannot be its own parent")
                chain.append(above)
                above = known[above].parent
        return Volumes(tuple(parts), unit)

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
        return Placed(self, points, names, tuple(groups))

    def _chain(self, part: Volume, xyz: Array) -> _Chain:
        known = {p.name: p for p in self.parts}
        own = part.law.bind(xyz) if part.law is not None else None
        links, walk = [], part
        while walk.parent is not None:
            attach = None if walk.attach is None else np.asarray(walk.attach, dtype=float)
            walk = known[walk.parent]
            links.append(_Link(walk.law, self._slices[walk.name], attach))
        return _Chain(xyz, own, self._slices[part.name], tuple(links), np.array([p.step for p in self.parameters]))


@dataclass(frozen=True, eq=False)
class Placed:
    """Points of volumes, bound to their laws.

    Parameters
    ----------
    volumes : the volumes
    xyz : (N, 3) undeformed
    names : (N,) their volumes
    groups : index and chain of laws of every volume that has any of the points
    beyond : parameters that the laws had no place for lately, at most one, see `ends`
    beside : places beside the points that are asked for how laws turn them, at most once, see `turned`
    """

    volumes: Volumes
    xyz: Array
    names: Texts
    groups: tuple[tuple[NDArray[np.int64], _Chain], ...]
    beyond: list[Array] = field(default_factory=list, repr=False)
    beside: list[Any] = field(default_factory=list, repr=False)
    _last: list[tuple[bytes, Array, Array]] = field(default_factory=list, repr=False)  # at most one, swapped as a whole

    def __reduce__(self) -> tuple[Any, ...]:
        """Laws may be anything that can be called: a copy binds them again, and knows the same last place."""
        return placed_again, (self.volumes, self.xyz, self.names, list(self._last), self.__dict__.get("rates"))

    @cached_property
    def rates(self) -> Array:
        """(K,) how far one unit of each parameter moves the farthest point, near the undeformed model."""
        by_q = self.linearise(self.volumes.start)[1]
        return np.asarray(np.linalg.norm(by_q, axis=1).max(axis=0, initial=0.0))

    def place(self, q: Array) -> Array:
        """Displaced points (N, 3) in the model's frame, for all parameters (K,)."""
        for known, place, _ in self._last:
            if known == q.tobytes():
                return place.copy()
        out = self.xyz.copy()
        for index, chain in self.groups:
            out[index] = chain.place(q)
        return out

    def linearise(self, q: Array) -> tuple[Array, Array]:
        """Displaced points (N, 3) and their derivative (N, 3, K).

        The last ones are kept: where one search ends the next one starts, and what is asked of a state lies between.
        """
        for known, place, slope in self._last:
            if known == q.tobytes():
                return place.copy(), slope.copy()
        out, by_q = self.xyz.copy(), np.zeros((*self.xyz.shape, len(self.volumes.names)))
        for index, chain in self.groups:
            out[index], by_q[index] = chain.linearise(q, by_q.shape[2])
        self._last[:] = [(q.tobytes(), out.copy(), by_q.copy())]
        return out, by_q


def placed_again(
    volumes: Volumes, xyz: Array, names: Texts, last: list[tuple[bytes, Array, Array]], rates: Array | None
) -> Placed:
    """Points bound to their laws as they were when they were copied, see `Placed`."""
    placed = volumes.bind(xyz, names)
    placed._last.extend(last)
    if rates is not None:
        placed.__dict__["rates"] = rates
    return placed


class _Link(NamedTuple):
    """A volume above: its law, where its parameters stand, and the point at which the volume below is attached."""

    law: Law | None
    where: slice
    attach: Array | None


@dataclass(frozen=True)
class _Chain:
    """Points of one volume: its own law, then the laws above, each as a field or, once attached, as a rigid body."""

    xyz: Array
    own: BoundLaw | None
    where: slice
    above: tuple[_Link, ...]
    steps: Array

    @property
    def columns(self) -> tuple[slice, ...]:
        """Where the parameters stand that move the points."""
        return self.where, *(link.where for link in self.above)

    def place(self, q: Array) -> Array:
        points = self.xyz if self.own is None else self.own.place(q[self.where])
        held: Array | None = None  # what is attached to a rigid body is one with it further up, too
        for link in self.above:
            held = held if link.attach is None else link.attach
            if link.law is None:
                continue
            if held is None:
                points = link.law.bind(points).place(q[link.where])
            else:
                rotation, centre = _frame(link.law, held, points, q[link.where])
                points, held = (points - held) @ rotation.T + centre, centre
        return points

    def linearise(self, q: Array, count: int) -> tuple[Array, Array]:
        if any(link.attach is not None for link in self.above):
            return self._by_differences(q, count)
        by_q = np.zeros((*self.xyz.shape, count))
        points = self.xyz
        if self.own is not None:
            points, by_q[..., self.where] = self.own.linearise(q[self.where])
        for link in self.above:
            if link.law is None:
                continue
            before, (points, own) = points, link.law.bind(points).linearise(q[link.where])
            for j in np.flatnonzero(by_q.any(axis=(0, 1))):  # what moved the points below is carried on
                by_q[..., j] = _along(link.law, before, by_q[..., j], q[link.where])
            by_q[..., link.where] += own
        return points, by_q

    def _by_differences(self, q: Array, count: int) -> tuple[Array, Array]:
        mine = np.concatenate([np.arange(count)[s] for s in self.columns])

        def place(part: Array) -> Array:
            whole = q.copy()
            whole[mine] = part
            return self.place(whole)

        by_q = np.zeros((*self.xyz.shape, count))
        points, by_q[..., mine] = Numeric(place, self.steps[mine]).linearise(q[mine])
        return points, by_q


def _along(law: Law, points: Array, direction: Array, q: Array) -> Array:
    """Derivative of the moved points where they are moved in a direction (N, 3)."""
    h = REACH * _extent(points) / float(np.linalg.norm(direction, axis=1).max())
    return np.asarray((law.bind(points + h * direction).place(q) - law.bind(points - h * direction).place(q)) / (2 * h))


def _frame(law: Law, attach: Array, points: Array, q: Array) -> tuple[Array, Array]:
    """Rotation and place of the frame that a law carries along at a point."""
    h = SMALL * _extent(points)
    around = attach + np.concatenate([np.zeros((1, 3)), h * np.eye(3), -h * np.eye(3)])
    moved = law.bind(around).place(q)
    return project_to_so3((moved[1:4] - moved[4:]).T / (2 * h)), moved[0]


def _extent(points: Array) -> float:
    return float(max(np.ptp(points, axis=0).max(initial=0.0), 1e-3 * np.abs(points).max(initial=0.0), 1e-9))
