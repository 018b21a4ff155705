"""What the observations determine: weak directions, named, and the covariance of the rest.

Criterion. The information matrix H is looked at in natural units (`Block.natural`: 1 rad about the points, the
distance itself, the focal length itself, ...). A direction is *not determined* where

- its uncertainty (2 sigma) is larger than one natural unit, the parameter itself: this holds near a degenerate
  case (a focal length on a plane seen almost frontally), where a test of the condition number alone would pass
  and give a number without meaning; or
- it belongs to a null eigenvalue, to rounding, of H scaled to unit diagonal: exactly degenerate cases, whatever
  the observations' sigma. Scaling to unit diagonal is within a factor P of the best there is (van der Sluis
  1969), and keeps one tight prior from making everything else look weak.

Both are free of length units and of the order of the parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.problem import NormalEquations
from windmark.geometry import DegenerateGeometry

Array = NDArray[np.float64]

MAX_UNCERTAINTY = 1.0
"""Largest uncertainty (2 sigma) of a determined direction, in natural units."""

NULL_EIGENVALUE = 1e-13
"""Eigenvalue of the information matrix scaled to unit diagonal that is zero but for rounding."""

_FLOOR = 1e-6
"""Information (per natural unit squared) that stands for none at all."""

_SHARE = 0.1
"""A parameter is named when it holds at least this part of the squared length of a weak direction."""


def weak_parameters(system: NormalEquations, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the parameters that make up the directions which are not determined; empty if all are.

    Parameters
    ----------
    system : normal equations, in natural units
    names : (P,) names of the parameters
    """
    return _weak(*_scaled_eigen(system.information), names)


def _weak(value: Array, vector: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """`weak_parameters` from what `_scaled_eigen` returns."""
    null = value < NULL_EIGENVALUE
    limit = (MAX_UNCERTAINTY / 2) ** 2
    if not null.any() and float((vector * vector / value).sum()) <= limit:
        return ()  # the sum of all variances, and so the largest
    weak = [vector[:, null] / np.linalg.norm(vector[:, null], axis=0)]
    if not null.all():
        # Of a covariance the largest eigenvalues, the weak ones, are the accurate ones.
        variance, direction = np.linalg.eigh((vector[:, ~null] / value[~null]) @ vector[:, ~null].T)
        weak.append(direction[:, variance > limit])
    share = (np.concatenate(weak, axis=1) ** 2).max(axis=1, initial=0.0)
    return tuple(name for name, part in zip(names, share, strict=True) if part >= _SHARE)


def _scaled_eigen(information: Array) -> tuple[Array, Array]:
    """Eigenvalues (P,) of the matrix scaled to unit diagonal, and its eigenvectors scaled back, as columns.

    The inverse of the matrix is ``(vector / value) @ vector.T``.
    """
    # Without the floor the rounding of a zero would pass for information once it is scaled to 1.
    h = information + _FLOOR * np.eye(len(information))
    scale = np.sqrt(np.diagonal(h))
    value, vector = np.linalg.eigh(h / scale[:, None] / scale)
    return value, vector / scale[:, None]


def covariance(system: NormalEquations, names: tuple[str, ...], noise: Array | None = None) -> Array:
    """(P, P) covariance of a tangent step: H^-1 B H^-1, with B the covariance of the gradient.

    Parameters
    ----------
    system : normal equations, in natural units
    names : (P,) names of the parameters
    noise : B in natural units; None where it is H itself, as in least squares with known sigma

    Raises
    ------
    DegenerateGeometry
        Naming the parameters that are not determined.
    """
    value, vector = _scaled_eigen(system.information)
    weak = _weak(value, vector, names)
    if weak:
        raise DegenerateGeometry("the observations do not determine all free parameters", weak)
    inverse = (vector / value) @ vector.T
    cov = system.natural @ (inverse if noise is None else inverse @ noise @ inverse) @ system.natural.T
    return (cov + cov.T) / 2
