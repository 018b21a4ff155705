"""What is known of several markers' coordinates together: errors that they share, as those of one survey do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError, g3
from windmark.geometry.described import described
from windmark.scene.markers import MarkerSet

Array = NDArray[np.float64]

ROUNDING = 1e-6
"""Eigenvalues of the correlations so far below zero come from digits that were cut off. Smaller ones count as so large:
such a combination is known a thousand times better than the coordinates, as the whole's shift and turn are in the
survey's own free network."""


@described(lambda m: {"markers": len(m), "length unit": m.length_unit or "not said"})  # fmt: skip
@dataclass(frozen=True, eq=False)
class MarkerCovariance:
    """Joint covariance of markers' coordinates; singular ones are allowed (a survey in its own inner datum).

    Parameters
    ----------
    name : (K,) str, unique
    cov : (3K, 3K) in the squared length unit, rows and columns x, y, z of the first marker, then of the second, ...
    length_unit : in, ft, mm, cm or m; "" where nothing says it

    Raises
    ------
    ValueError
        Where ``cov`` is no covariance, saying why: its shape, not finite, not symmetric, a variance that is not > 0
        (markers that do not move are held with `calibration.Fixed`), or a negative eigenvalue.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b", "c"], np.eye(3), sigma=1.0)
    >>> survey = wm.MarkerCovariance(np.array(["b", "a"]), 0.01 * np.eye(6) + 0.03)  # errors that a and b share
    >>> survey.take(["a"]).cov.shape
    (3, 3)
    >>> survey.on(markers).sigma[:, 0].round(6).tolist()  # of c nothing is said
    [0.2, 0.2, 1.0]
    """

    name: NDArray[np.str_]
    cov: Array
    length_unit: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", np.asarray(self.name, dtype=np.str_))
        cov, n = np.array(self.cov, dtype=float), 3 * len(self.name)
        if cov.shape != (n, n):
            raise UsageError(f"MarkerCovariance: cov must be {(n, n)} for {n // 3} names, got {cov.shape}")
        names = self.name.tolist()
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise UsageError(f"MarkerCovariance: name must be unique, more than once: {', '.join(twice[:5])}")
        variance = np.diagonal(cov)
        for bad, words in ((~(np.isfinite(cov).all(axis=1)), "finite"), (~(variance > 0), "of variances > 0")):
            if bad.any():
                name = names[int(bad.argmax()) // 3]
                raise UsageError(f"MarkerCovariance: cov must be {words}; it is not for {name}")
        correlation = cov / np.sqrt(np.outer(variance, variance))
        skew = np.abs(correlation - correlation.T)
        if skew.max(initial=0.0) > ROUNDING:
            i, j = np.unravel_index(int(skew.argmax()), skew.shape)
            raise UsageError(f"MarkerCovariance: cov must be symmetric, not for {names[i // 3]} and {names[j // 3]}")
        least = float(np.linalg.eigvalsh(correlation)[0]) if n else 0.0
        if least < -ROUNDING * n:
            raise UsageError(
                "MarkerCovariance: cov must be positive semidefinite: no errors can be correlated so; the smallest "
                f"eigenvalue of the correlations is {g3(least)}, expected 0 or more"
            )
        object.__setattr__(self, "cov", (cov + cov.T) / 2)

    def __len__(self) -> int:
        return len(self.name)

    @property
    def sigma(self) -> Array:
        """(K, 3) 1 sigma of each coordinate."""
        return np.sqrt(np.diagonal(self.cov)).reshape(-1, 3)

    def take(self, names: Sequence[str]) -> MarkerCovariance:
        """Of these markers alone, in their order: whatever else was surveyed is left open."""
        place = {str(n): k for k, n in enumerate(self.name)}
        index = (3 * np.array([place[n] for n in names], dtype=np.int64)[:, None] + np.arange(3)).ravel()
        return replace(self, name=np.array(names, dtype=np.str_), cov=self.cov[np.ix_(index, index)])

    def scaled(self, factor: float) -> MarkerCovariance:
        """With all sigmas so many times larger."""
        return replace(self, cov=self.cov * factor**2)

    def whitener(self) -> Array:
        """(3K, 3K) ``W`` with ``W^T W = cov^-1``; see `ROUNDING` for what is known exactly."""
        sigma = np.sqrt(np.diagonal(self.cov))
        value, vector = np.linalg.eigh(self.cov / np.outer(sigma, sigma))
        return np.asarray((vector / np.sqrt(np.maximum(value, ROUNDING))).T / sigma)

    def on(self, markers: MarkerSet) -> MarkerSet:
        """A table with these sigmas.

        Raises
        ------
        ValueError
            Names a marker that the table does not have.
        """
        place = {str(n): k for k, n in enumerate(markers.name)}
        missing = [str(n) for n in self.name if str(n) not in place]
        if missing:
            raise UsageError(f"the covariance names the marker {missing[0]!r}, which the table does not have")
        sigma = markers.sigma.copy()
        sigma[[place[str(n)] for n in self.name]] = self.sigma
        return replace(markers, sigma=sigma)
