"""`PlanarTransform`: a fitted transformation from the reference's plane to an image's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.geometry.planar import bases

Array = NDArray[np.float64]

KINDS = ("similarity", "affine", "projective", "poly2", "poly3", "spline")
"""From the simplest to the most flexible one."""
NEEDED = {"similarity": 3, "affine": 4, "projective": 5, "poly2": 8, "poly3": 13, "spline": 8}
"""Fewest pairs of each kind: one or two more than fix it, for what nothing checks is no measurement."""
_ROUNDS, _SETTLED_PX = 30, 1e-9


@dataclass(frozen=True)
class PlanarTransform:
    """``xy_image = f(xy_reference)``, both in pixels.

    Parameters
    ----------
    kind : one of `KINDS`
    centre, length_px : u = (xy_reference - centre) / length_px are the normalised coordinates
    origin : (2,) added to what the parameters give, image pixels
    parameters : (P,) pixels; of a projective one the last two are of the denominator (1 + p6 u + p7 v); polynomials:
        monomials 1, u, v, u^2, u v, v^2, ... of x, then of y; spline: 1, u, v and the nodes' weights of x, then of y
    cov : (P, P) covariance of the parameters; of a spline (M + 3, M + 3), the same for x and y
    misfit_px : 1 sigma per coordinate of what the kind cannot follow (parallax, local deformation)
    nodes : (M, 2) normalised places of the spline's nodes; (0, 2) for the others
    left_out_px : 1 sigma of a term of the next order, see `bases.next_terms`: as large as the markers do not tell
    hidden : (P, Q) what these terms look like to the parameters at the markers: the rest is not compensated
    within : the largest sum of squares of the rest at a marker; the misfit is that of such places
    """

    kind: str
    centre: Array
    length_px: float
    origin: Array
    parameters: Array
    cov: Array
    misfit_px: float
    nodes: Array
    left_out_px: float = 0.0
    hidden: Array = field(default_factory=lambda: np.zeros((0, 0)))
    within: float = 0.0

    def apply(self, xy: ArrayLike) -> Array:
        """Places in the image of places (..., 2) in the reference."""
        p, shape = self._normalised(xy, "apply")
        if self.kind == "spline":
            place = self._spline_places(p)
        else:
            place = bases.evaluate(self.kind, p, self.parameters)
        return (self.origin + place).reshape(shape)

    def jacobian(self, xy: ArrayLike) -> Array:
        """(..., 2, 2) derivative of the image place (rows) with respect to the reference place."""
        p, shape = self._normalised(xy, "jacobian")
        if self.kind == "spline":
            linear, weights = self.parameters.reshape(2, -1)[:, 1:3], self.parameters.reshape(2, -1)[:, 3:]
            out = linear[None] + np.einsum("nmk,cm->nck", bases.plate_slope(p, self.nodes), weights)
        else:
            out = bases.slope(self.kind, p, self.parameters)
        return (out / self.length_px).reshape(*shape[:-1], 2, 2)

    def cov_at(self, xy: ArrayLike) -> Array:
        """(..., 2, 2) covariance of the mapped place in px^2: of the parameters, and what the kind cannot follow.

        Beyond the markers it grows with the distance: by the parameters' errors, and by the terms of the next order,
        which may be as large as the markers do not tell.
        """
        p, shape = self._normalised(xy, "cov_at")
        if self.kind == "spline":
            basis = self._spline_basis(p)[:, [*range(3, 3 + len(self.nodes)), 0, 1, 2]]
            # Kriging: the variance of what is not known is the generalised covariance at 0, which is 0, less this.
            variance = np.maximum(-np.einsum("ni,ij,nj->n", basis, self.cov, basis), 0.0)
            out = variance[:, None, None] * np.eye(2)
        else:
            a = bases.design(self.kind, p, self.parameters)
            out = a @ self.cov @ np.swapaxes(a, 1, 2)
        misfit = self.misfit_px**2 + self._left_out(p)
        return (out + misfit[:, None, None] * np.eye(2)).reshape(*shape[:-1], 2, 2)

    def sigma_px(self, xy: ArrayLike) -> Array:
        """(...,) 1 sigma per coordinate of the mapped place: root of the mean of both variances."""
        return np.sqrt(np.trace(self.cov_at(xy), axis1=-2, axis2=-1) / 2)

    def inverse(self, xy_image: ArrayLike, near: ArrayLike | None = None) -> Array:
        """Places (..., 2) in the reference of places in the image, by Newton's method; NaN where it does not settle.

        Parameters
        ----------
        xy_image : (..., 2) image pixels
        near : where to start, as the centre of the markers by default
        """
        target = np.asarray(xy_image, dtype=float)
        goal = target.reshape(-1, 2)
        x = np.array(np.broadcast_to(self.centre if near is None else np.asarray(near, dtype=float), goal.shape))
        for _ in range(_ROUNDS):
            off = self.apply(x) - goal
            j = self.jacobian(x)
            det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.stack([j[:, 1, 1] * off[:, 0] - j[:, 0, 1] * off[:, 1],
                                 j[:, 0, 0] * off[:, 1] - j[:, 1, 0] * off[:, 0]], axis=1) / det[:, None]  # fmt: skip
            x = x - step
            if not (np.abs(step) > _SETTLED_PX).any():
                break
        with np.errstate(invalid="ignore"):
            wrong = ~(np.abs(self.apply(x) - goal).max(axis=1, initial=0.0) < 1e-6)
        x[wrong] = np.nan
        return x.reshape(target.shape)

    def record(self) -> dict[str, Any]:
        """Everything as numbers and lists with their meaning, to be written into a file; see `planar_from_record`."""
        return {
            "meaning": "xy_image = origin + f((xy_reference - centre) / length_px), pixels, (0, 0) is the centre of "
            "the top-left pixel",
            "kind": self.kind, "centre": self.centre.tolist(), "length_px": self.length_px,
            "origin": self.origin.tolist(), "terms": self._terms(), "parameters": self.parameters.tolist(),
            "nodes": self.nodes.tolist(), "misfit_px": self.misfit_px, "cov": self.cov.tolist(),
            "left_out_px": self.left_out_px, "hidden": self.hidden.tolist(), "within": self.within,
        }  # fmt: skip

    def _terms(self) -> list[str]:
        """What each parameter is the factor of."""
        if self.kind == "similarity":
            return ["a: x a u - b v, y b u + a v", "b", "x", "y"]
        if self.kind == "projective":
            return [*(f"{c}: {t}" for c in "xy" for t in ("1", "u", "v")), "denominator: u", "denominator: v"]
        if self.kind == "spline":
            nodes = [f"r^2 ln r of node {k}" for k in range(len(self.nodes))]
            return [f"{c}: {t}" for c in "xy" for t in ("1", "u", "v", *nodes)]
        return [f"{c}: u^{i} v^{j}" for c in "xy" for i, j in bases.exponents(bases.ORDER[self.kind])]

    def _left_out(self, u: Array) -> Array:
        """(N,) variance per coordinate of what terms of the next order do beyond the markers, px^2."""
        if not self.hidden.size:
            return np.zeros(len(u))
        rest = bases.next_terms(self.kind, u) - bases.design(self.kind, u, self.parameters) @ self.hidden
        return np.asarray(0.5 * self.left_out_px**2 * np.maximum((rest**2).sum(axis=(1, 2)) - self.within, 0.0))

    def _spline_places(self, u: Array) -> Array:
        from windmark.geometry.planar._kernels import plate_places

        out = np.empty(u.shape)
        plate_places(np.ascontiguousarray(u), self.nodes, self.parameters.reshape(2, -1), out)
        return out

    def _spline_basis(self, u: Array) -> Array:
        return np.column_stack([np.ones(len(u)), u, bases.plate(u, self.nodes)])

    def _normalised(self, xy: ArrayLike, verb: str) -> tuple[Array, tuple[int, ...]]:
        p = np.asarray(xy, dtype=float)
        if p.shape[-1:] != (2,):
            raise ValueError(f"PlanarTransform.{verb}: expected places (..., 2), got {p.shape}")
        return (p.reshape(-1, 2) - self.centre) / self.length_px, p.shape


def planar_from_record(record: Mapping[str, Any]) -> PlanarTransform:
    """The transformation of a `PlanarTransform.record`.

    Raises
    ------
    ValueError
        Where a key is missing, or the kind and the number of parameters do not fit.
    """
    keys = ("kind", "centre", "length_px", "origin", "parameters", "cov", "misfit_px", "nodes")
    for key in keys:
        if key not in record:
            raise UsageError(f"planar_from_record: {key!r} is missing; expected the keys {', '.join(keys)}")
    arrays = {k: np.array(record[k], dtype=float) for k in ("centre", "origin", "parameters", "cov")}
    nodes = np.array(record["nodes"], dtype=float).reshape(-1, 2)
    kind = str(record["kind"])
    count = 2 * (len(nodes) + 3) if kind == "spline" else bases.PARAMETERS.get(kind, -1)
    if arrays["parameters"].shape != (count,):
        raise UsageError(
            f"planar_from_record: expected one of {', '.join(KINDS)} with its number of parameters, got {kind!r} with "
            f"{arrays['parameters'].size}"
        )
    return PlanarTransform(kind, arrays["centre"], float(record["length_px"]), arrays["origin"], arrays["parameters"],
                           arrays["cov"], float(record["misfit_px"]), nodes, float(record.get("left_out_px", 0.0)),
                           np.array(record.get("hidden", np.zeros((0, 0))), dtype=float),
                           float(record.get("within", 0.0)))  # fmt: skip
