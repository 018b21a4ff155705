"""What the observations determine: weak directions, named, and the covariance of the rest.

Criterion. The information matrix is taken in natural units (`Block.natural`: 1 rad about the points, the
distance itself, the focal length itself, ...). An eigenvalue is 1 / sigma^2 of its direction. A direction
is *not determined* where its uncertainty (2 sigma) is larger than the parameter itself, or where the
eigenvalue is rounding error of the largest one. The first holds for data near a degenerate case (a focal
length on a plane seen almost frontally), where a test of the condition number alone would pass and give a
number without meaning; the second for exactly degenerate cases, whatever the observations' sigma. Both are
free of units and of the order of parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.adjust.problem import NormalEquations
from windmark.geometry import DegenerateGeometry

Array = NDArray[np.float64]

MAX_UNCERTAINTY = 1.0
"""Largest uncertainty (2 sigma) of a determined direction, in natural units."""

MAX_CONDITION = 1e13
"""Largest condition number of the information matrix in natural units that still means something."""

_SHARE = 0.1
"""A parameter is named when it holds at least this part of the squared length of a weak direction."""


def weak_parameters(system: NormalEquations, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the parameters that make up the directions which are not determined; empty if all are.

    Parameters
    ----------
    system : normal equations, in natural units
    names : (P,) names of the parameters
    """
    # Rows of a parameter that nothing depends on are zero: such a parameter is an eigenvector by itself.
    value, vector = np.linalg.eigh(system.information)
    limit = max((2 / MAX_UNCERTAINTY) ** 2, value.max(initial=0.0) / MAX_CONDITION)
    weak = vector[:, value < limit]
    share = (weak**2).max(axis=1, initial=0.0)
    return tuple(name for name, part in zip(names, share, strict=True) if part >= _SHARE)


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
    weak = weak_parameters(system, names)
    if weak:
        raise DegenerateGeometry("the observations do not determine all free parameters", weak)
    inverse = np.linalg.inv(system.information)
    cov = system.natural @ (inverse if noise is None else inverse @ noise @ inverse) @ system.natural.T
    return (cov + cov.T) / 2
