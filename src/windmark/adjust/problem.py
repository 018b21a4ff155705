"""The adjustment problem: named free blocks, terms of the cost, and its normal equations by blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.blocks import Block, VectorBlock
from windmark.adjust.terms import Term, Values

Array = NDArray[np.float64]


_PINNED = 1e12
"""Information, per natural unit squared, on a number that is held at its bound."""


class Step(NamedTuple):
    """A candidate step of all free parameters."""

    delta: Array  # (P,) tangent step, in the blocks' own units
    size: float  # largest component in natural units
    decrease: float  # of the cost, as the quadratic model predicts it


class NormalEquations:
    """Quadratic model of the cost about one point, held in natural units.

    Parameters
    ----------
    cost : half the sum of the losses
    gradient : (P,) derivative of the cost by a step in natural units
    information : (P, P) J^T W J in natural units
    natural : (P, P) block-diagonal, columns are the natural units as tangent steps
    """

    def __init__(self, cost: float, gradient: Array, information: Array, natural: Array) -> None:
        self.cost = cost
        self.gradient = gradient
        self.information = information
        self.natural = natural
        # Marquardt's scaling. A parameter whose sigma exceeds its natural unit is not determined (`determinacy`):
        # there the damping must not fall to rounding level with the information.
        self._damping = np.maximum(np.diagonal(information), 1.0)

    def solve(self, damping: float) -> Step | None:
        """Step that minimises the model plus Marquardt's term; None where the matrix is not positive definite."""
        a = self.information + np.diag(damping * self._damping)
        try:
            np.linalg.cholesky(a)
            step = -np.linalg.solve(a, self.gradient)
        except np.linalg.LinAlgError:
            return None
        decrease = -float(step @ (self.gradient + 0.5 * self.information @ step))
        return Step(self.natural @ step, float(np.abs(step).max(initial=0.0)), decrease)

    def decrement(self, other: NormalEquations) -> float:
        """See `levenberg_marquardt.System`."""
        try:
            step = np.linalg.solve(self.information, other.gradient)
        except np.linalg.LinAlgError:
            return float("inf")
        return float(np.sqrt(max(float(other.gradient @ step), 0.0)))


class Problem:
    """Sum of terms over free blocks. It knows neither cameras nor poses; new jobs are new blocks and terms.

    Parameters
    ----------
    blocks : name -> block, for everything that is free; the order is that of the covariance
    terms : observation blocks and priors

    The values of all blocks, and fixed things that terms look up (a known camera), travel beside it as
    one mapping, so a problem is never changed by a solve. ``slices`` is where each block stands among the
    unknowns.
    """

    def __init__(self, blocks: Mapping[str, Block], terms: Sequence[Term]) -> None:
        self.blocks = dict(blocks)
        self.terms = tuple(terms)
        sizes = [len(block.names) for block in self.blocks.values()]
        ends = [0, *accumulate(sizes)]
        self.size = ends[-1]
        self.slices = {name: slice(*pair) for name, pair in zip(self.blocks, pairwise(ends), strict=True)}
        unknown = sorted({name for term in self.terms for name in term.blocks} - set(self.blocks))
        if unknown:
            raise ValueError(f"Problem: terms depend on unknown blocks {', '.join(unknown)}")
        # The columns of each term's own small normal matrix within the whole one.
        everything = np.arange(self.size)
        self._columns = [
            np.concatenate([everything[:0], *(everything[self.slices[name]] for name in term.blocks)])
            for term in self.terms
        ]
        self._own = [np.ix_(columns, columns) for columns in self._columns]

    @property
    def names(self) -> tuple[str, ...]:
        """(P,) names of the free parameters, led by the block's name where the bare ones are not unique."""
        bare = tuple(name for block in self.blocks.values() for name in block.names)
        if len(set(bare)) == len(bare):
            return bare
        return tuple(f"{key}.{name}" for key, block in self.blocks.items() for name in block.names)

    def cost(self, values: Values) -> float:
        """Half the sum of the losses; inf where a term has no prediction."""
        total = 0.0
        for term in self.terms:
            residual = term.residual(values)
            if residual is None:
                return float("inf")
            total += float(term.loss.evaluate(np.sum(residual * residual, axis=-1))[0].sum())
        return total / 2

    def linearise(self, values: Values) -> NormalEquations | None:
        """Cost, gradient and information at ``values``; None where a term has no prediction."""
        cost = 0.0
        natural = self.natural(values)
        gradient = np.zeros(self.size)
        information = np.zeros((self.size, self.size))
        for term, columns, own in zip(self.terms, self._columns, self._own, strict=True):
            linearised = term.linearise(values)
            if linearised is None:
                return None
            residual = linearised.residual
            rho, weight = term.loss.evaluate(np.sum(residual * residual, axis=-1))
            cost += 0.5 * float(rho.sum())
            if not columns.size:
                continue
            j = np.concatenate([linearised.jacobian[name] for name in term.blocks], axis=-1)
            root = np.sqrt(weight)[:, None]
            # Natural units go in before squaring: a turn about the points cancels most of a turn about the camera.
            j = (j * root[..., None]).reshape(-1, columns.size) @ natural[own]
            gradient[columns] += j.T @ (residual * root).ravel()
            information[own] += j.T @ j
        if not np.isfinite(cost):
            return None
        self._pin(values, gradient, information)
        return NormalEquations(cost, gradient, information, natural)

    def _pin(self, values: Values, gradient: Array, information: Array) -> None:
        """Numbers that stand at a bound and would leave it are known there: they take no part in the step."""
        for name, block in self.blocks.items():
            if isinstance(block, VectorBlock):
                s = self.slices[name]
                pinned = block.pinned(values[name], gradient[s])
                if not pinned.any():
                    continue
                at = s.start + np.flatnonzero(pinned)
                gradient[at] = 0.0
                information[at] = information[:, at] = 0.0
                information[at, at] = _PINNED

    def natural(self, values: Values) -> Array:
        """(P, P) natural units of all blocks as tangent steps, block-diagonal."""
        basis = np.zeros((self.size, self.size))
        for name, block in self.blocks.items():
            s = self.slices[name]
            basis[s, s] = block.natural(values[name])
        return basis

    def retract(self, values: Values, delta: Array) -> dict[str, Any] | None:
        """The values after a tangent step (P,); None where a block refuses it."""
        out = dict(values)
        for name, block in self.blocks.items():
            moved = block.retract(values[name], delta[self.slices[name]])
            if moved is None:
                return None
            out[name] = moved
        return out
