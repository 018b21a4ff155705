"""Values on nodes with the errors that they share: Cov(nodes) = diag(white) + M Mᵀ.

A standard deviation per node says nothing of a sum: 300,000 nodes of sigma(Cp) = 0.01 give sigma(CL) = 2e-5 if their
errors are independent, and one temperature error of 0.2 K common to all gives hundred times that. So every error that
many nodes share is a *mode*: a named column with the change of every node for one standard deviation of its cause.
Columns of one name in two fields are the same cause, whatever function of the fields is formed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry.described import described
from windmark.scene.shown import xarray_dataset

Array = NDArray[np.float64]

MOST_MODES = 30
"""Columns that a field may have."""
NEGLIGIBLE = 1e-3
"""A column that is nowhere a larger part of the cause's sigma adds less than a millionth to the variance: it counts as
independent noise."""
MERGED = "*"
"""Ends the name of columns that `fewer_modes` made: they are no longer the cause of that name itself."""


@described(lambda f: {
    "nodes": len(f), "known": int(np.isfinite(f.value).sum()), "unit": f.unit or "none",
    "modes": ", ".join(dict.fromkeys(n.partition(":")[0] for n in f.names)) or "none",
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class NodeField:
    """A quantity on N nodes (or taps, points) with its uncertainty.

    Parameters
    ----------
    value : (N,) float64, NaN where it is not known
    white : (N,) variance of what is independent from node to node, in the unit squared
    modes : (N, K) change of every node for one sigma of each cause, in the unit; K at most `MOST_MODES`
    names : (K,) of the columns, all different: "cause", or "cause:1", "cause:2" where it has several columns. Two
        fields that have a name in common share that cause
    unit : of the value, "" for a plain number

    Raises
    ------
    ValueError
        For arrays that do not fit together, a negative variance, names that are there twice, more than 30 columns.

    Examples
    --------
    >>> import windmark as wm
    >>> pressure = wm.NodeField.make([100.0, 120.0], 3.0, unit="Pa").with_mode("offset", [4.0, 4.0])
    >>> pressure.sigma.tolist()  # of independent noise and of what all nodes share
    [5.0, 5.0]
    >>> pressure.take([1]).value.tolist(), pressure.names
    ([120.0], ('offset',))
    """

    value: Array
    white: Array
    modes: Array
    names: tuple[str, ...] = ()
    unit: str = ""

    def __post_init__(self) -> None:
        n = len(self.value)
        if np.shape(self.value) != (n,) or np.shape(self.white) != (n,) or np.shape(self.modes) != (n, len(self.names)):
            raise ValueError(
                f"NodeField: value and white must be (N,), modes (N, {len(self.names)}), got {np.shape(self.value)}, "
                f"{np.shape(self.white)} and {np.shape(self.modes)}"
            )
        if len(set(self.names)) < len(self.names):
            raise UsageError(f"NodeField: the names of modes must differ, got {', '.join(self.names)}")
        if len(self.names) > MOST_MODES:
            raise UsageError(
                f"NodeField: at most {MOST_MODES} modes, got {len(self.names)}; fewer_modes puts the smallest together"
            )
        if (self.white < 0).any():
            raise ValueError("NodeField: white must be a variance, at least 0")

    @staticmethod
    def make(value: ArrayLike, sigma: ArrayLike = 0.0, *, unit: str = "") -> NodeField:
        """A field (N,) whose errors are independent, of standard deviation ``sigma`` (N,) or one for all."""
        v = np.atleast_1d(np.asarray(value, dtype=float))
        s = np.asarray(sigma, dtype=float)
        if not (s[np.isfinite(s)] >= 0).all():
            raise UsageError("NodeField: sigma must be at least 0")
        return NodeField(v, np.broadcast_to(s**2, v.shape).copy(), np.zeros((len(v), 0)), (), unit)

    def __len__(self) -> int:
        return len(self.value)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) where there is a value, and a variance of it."""
        return np.isfinite(self.value) & np.isfinite(self.white)

    @property
    def variance(self) -> Array:
        """(N,) of each node by itself; NaN where there is no value."""
        return np.where(self.known, self.white + np.einsum("nk,nk->n", self.modes, self.modes), np.nan)

    @property
    def sigma(self) -> Array:
        """(N,) standard deviation of each node by itself."""
        return np.sqrt(self.variance)

    def to_xarray(self) -> Any:
        """An ``xarray.Dataset``: value and sigma by node, and the change by each shared error (node, mode)."""
        return xarray_dataset(
            {"value": (("node",), self.value, self.unit), "sigma": (("node",), self.sigma, self.unit),
             "modes": (("node", "mode"), self.modes, self.unit)}, {"mode": list(self.names)},
        )  # fmt: skip

    def with_mode(self, name: str, column: ArrayLike) -> NodeField:
        """The field with one more shared error: ``column`` (N,) or a number, the change for one sigma of its cause."""
        new = np.broadcast_to(np.asarray(column, dtype=float), self.value.shape)
        return replace(self, modes=np.column_stack([self.modes, new]), names=(*self.names, name))

    def with_modes(self, name: str, slopes: ArrayLike, cov: ArrayLike) -> NodeField:
        """The field with the errors of P parameters that all nodes share.

        Parameters
        ----------
        name : of the cause; its columns are ``name:1`` to ``name:P``
        slopes : (N, P) derivative of the value by each parameter
        cov : (P, P) of the parameters. The columns are the slopes along its principal axes, so that the same cov gives
            the same causes in another field. A column of no weight counts as independent noise
        """
        j, axes = np.asarray(slopes, dtype=float), principal_axes(cov)
        if j.shape != (len(self), len(axes)):
            raise ValueError(f"with_modes: slopes must be ({len(self)}, {len(axes)}), got {j.shape}")
        columns = j @ axes
        total = np.einsum("nk,nk->n", columns, columns)
        keep = (columns**2 > NEGLIGIBLE**2 * total[:, None]).any(axis=0)
        rest = np.where(np.isfinite(total), (columns[:, ~keep] ** 2).sum(axis=1), 0.0)
        names = [f"{name}:{k + 1}" for k in np.flatnonzero(keep)]
        return replace(self, white=self.white + rest, modes=np.column_stack([self.modes, columns[:, keep]]),
                       names=(*self.names, *names))  # fmt: skip

    def take(self, index: ArrayLike) -> NodeField:
        """The field on some nodes: indices or a mask."""
        at = np.asarray(index)
        return replace(self, value=self.value[at], white=self.white[at], modes=self.modes[at])

    def applied(self, value: ArrayLike, slope: ArrayLike, *, unit: str | None = None) -> NodeField:
        """A function of every node's own value: what it gives (N,), and its derivative (N,) there."""
        return combined(value, [(self, slope)], unit=self.unit if unit is None else unit)


def combined(value: ArrayLike, parts: Sequence[tuple[NodeField, ArrayLike]], *, unit: str = "") -> NodeField:
    """A function of several fields, node by node.

    Parameters
    ----------
    value : (N,) of the function
    parts : the fields that it is formed of, each with the derivative (N,) or one number by it. Their independent parts
        must be independent of each other, too; modes of the same name are one cause, and their changes are added
    unit : of the result

    Raises
    ------
    ValueError
        For fields of different length, or when two of them have merged columns (`fewer_modes`) of one name.
    """
    v = np.asarray(value, dtype=float)
    names = tuple(dict.fromkeys(name for part, _ in parts for name in part.names))
    for name in names:
        if name.split(":")[0].endswith(MERGED) and sum(name in part.names for part, _ in parts) > 1:
            raise UsageError(f"combined: {name} of two fields are no longer the same cause; use fewer_modes at the end")
    white, modes = np.zeros(v.shape), np.zeros((*v.shape, len(names)))
    for part, slope in parts:
        if len(part) != len(v):
            raise ValueError(f"combined: all fields must have {len(v)} nodes, got {len(part)}")
        s = np.broadcast_to(np.asarray(slope, dtype=float), v.shape)
        with np.errstate(invalid="ignore", over="ignore"):
            counts = np.isfinite(v) & (s != 0)
            white += np.where(counts, s**2 * part.white, 0.0)
            for k, name in enumerate(part.names):
                modes[:, names.index(name)] += np.where(counts, s * part.modes[:, k], 0.0)
    return NodeField(v, white, modes, names, unit)


def interpolated(field_: NodeField, nodes: ArrayLike, weights: ArrayLike) -> NodeField:
    """The field at M points, each a weighted mean of some nodes (a tap in its triangle).

    Parameters
    ----------
    nodes, weights : (M, k) of the nodes that each point is made of. A node of weight 0 does not count

    Returns
    -------
    NodeField of M points. That two points may share a node's independent noise is left out.
    """
    at, w = np.asarray(nodes, dtype=int), np.asarray(weights, dtype=float)
    if at.shape != w.shape or at.ndim != 2:
        raise ValueError(f"interpolated: nodes and weights must be (M, k), got {at.shape} and {w.shape}")

    def mean(of: Array, by: Array) -> Array:
        return np.asarray(np.where(by != 0, by * of[at], 0.0).sum(axis=1))

    modes = np.zeros((len(at), len(field_.names)))
    for k, column in enumerate(field_.modes.T):
        modes[:, k] = mean(column, w)
    return NodeField(mean(field_.value, w), mean(field_.white, w**2), modes, field_.names, field_.unit)


def principal_axes(cov: ArrayLike) -> Array:
    """(P, P) A with A Aᵀ = cov: columns along the principal axes, the largest first, of a fixed sign."""
    c = np.asarray(cov, dtype=float)
    if c.ndim != 2 or c.shape[0] != c.shape[1] or not np.isfinite(c).all():
        raise ValueError(f"cov must be a finite (P, P) matrix, got {c.shape}")
    scale = np.sqrt(np.maximum(np.diagonal(c), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    value, vector = np.linalg.eigh((c / unit[:, None] / unit + (c / unit[:, None] / unit).T) / 2)
    if value[0] < -1e-8 * value[-1]:
        raise UsageError("cov is no covariance: it has a negative eigenvalue")
    vector = vector * np.where(vector[np.abs(vector).argmax(axis=0), np.arange(len(c))] < 0, -1.0, 1.0)
    return np.asarray((unit[:, None] * vector * np.sqrt(np.maximum(value, 0.0)))[:, ::-1])
