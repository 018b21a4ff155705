"""From the errors of nodes to those of loads, means and sections; what they are made of, and the end of a chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError, UsageError
from windmark.paint.modes import MERGED, MOST_MODES, NodeField

Array = NDArray[np.float64]

WHITE = "noise"
"""What the independent part of a variance is called beside the modes' names."""


@dataclass(frozen=True, eq=False)
class Carried:
    """M linear functions of a field (loads, means, sections) with their covariance.

    Parameters
    ----------
    value : (M,)
    cov : (M, M)
    causes : variance (M,) that each cause brings, all columns of it together; `WHITE` for the independent part. The
        largest first, by its largest share of any of the M
    """

    value: Array
    cov: Array
    causes: Mapping[str, Array] = field(default_factory=dict)

    @property
    def sigma(self) -> Array:
        """(M,) standard deviations."""
        return np.sqrt(np.maximum(np.diagonal(self.cov), 0.0))

    def dominant(self, k: int = 0) -> list[tuple[str, float]]:
        """What the k-th variance is made of: causes with their share, the largest first."""
        total = max(float(self.cov[k, k]), 1e-300)
        shares = [(name, float(part[k]) / total) for name, part in self.causes.items()]
        return sorted(shares, key=lambda item: -item[1])


def carried(field_: NodeField, operator: Any) -> Carried:
    """Linear functions of the field.

    Parameters
    ----------
    operator : (M, N) weights, dense or a SciPy sparse array

    Raises
    ------
    DataError
        Where a node without a value would count.
    """
    on = field_.known
    dense = not hasattr(operator, "multiply")
    w: Any = np.asarray(operator, dtype=float) if dense else operator.tocsr()
    if w.shape[1:] != (len(field_),):
        raise ValueError(f"carried: operator must be (M, {len(field_)}), got {w.shape}")
    used = np.asarray((abs(w) > 0).sum(axis=0)).ravel() > 0
    if (used & ~on).any():
        raise DataError(f"carried: {int((used & ~on).sum())} nodes that count have no value")
    zeroed = replace(field_, value=np.where(on, field_.value, 0.0), white=np.where(on, field_.white, 0.0),
                     modes=np.where(on[:, None], field_.modes, 0.0))  # fmt: skip
    white = w @ (w * zeroed.white).T if dense else (w.multiply(zeroed.white[None]) @ w.T).toarray()
    by_mode = np.asarray(w @ zeroed.modes)
    causes = {WHITE: np.diagonal(white).copy()}
    for name, column in zip(field_.names, by_mode.T, strict=True):
        cause = name.split(":")[0]
        causes[cause] = causes.get(cause, 0.0) + column**2
    cov = white + by_mode @ by_mode.T
    total = np.maximum(np.diagonal(cov), 1e-300)
    order = sorted(causes, key=lambda name: -float((causes[name] / total).max(initial=0.0)))
    return Carried(np.asarray(w @ zeroed.value), cov, {name: causes[name] for name in order})


def dominant(field_: NodeField) -> list[tuple[str, float]]:
    """What the nodes' variances are made of: each cause's share, all nodes together, the largest first."""
    on = field_.known & np.isfinite(field_.variance)
    total = max(float(field_.variance[on].sum()), 1e-300)
    shares = {WHITE: float(field_.white[on].sum()) / total}
    for name, column in zip(field_.names, field_.modes.T, strict=True):
        cause = name.split(":")[0]
        shares[cause] = shares.get(cause, 0.0) + float((column[on] ** 2).sum()) / total
    return sorted(shares.items(), key=lambda item: -item[1])


def fewer_modes(field_: NodeField, most: int = MOST_MODES) -> NodeField:
    """The field with at most ``most`` columns: the causes of least weight lose their own axes first.

    Every cause keeps at least one column, its columns are turned to their principal axes over the nodes; what is left
    out goes to the independent part, so every node keeps its variance. For the end of a chain only: such columns are
    marked (``cause*:1``), for another field's are other axes.
    """
    if len(field_.names) <= most:
        return field_
    on = field_.known
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(field_.names):
        groups.setdefault(name.split(":")[0], []).append(k)
    if len(groups) > most:
        raise UsageError(f"fewer_modes: {len(groups)} causes cannot be in {most} columns")
    found: list[tuple[float, str, Array]] = []
    first: list[tuple[str, Array]] = []
    for name, of in groups.items():
        columns = np.where(on[:, None], field_.modes[:, of], 0.0)
        value, axes = np.linalg.eigh(columns.T @ columns)
        turned = columns @ axes[:, ::-1]
        first.append((name, turned[:, 0]))
        found += [(float(v), name, turned[:, k]) for k, v in enumerate(value[::-1]) if k]
    found.sort(key=lambda item: -item[0])
    room = most - len(first)
    rest = sum((c**2 for _, _, c in found[room:]), np.zeros(len(field_)))
    kept = first + [(name, c) for _, name, c in found[:room]]
    count: dict[str, int] = {}
    names = []
    for name, _ in kept:
        count[name] = count.get(name, 0) + 1
        names.append(f"{name.rstrip(MERGED)}{MERGED}:{count[name]}")
    return NodeField(field_.value, field_.white + rest, np.stack([c for _, c in kept], axis=1), tuple(names),
                     field_.unit)  # fmt: skip
