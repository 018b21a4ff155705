"""Markers of a model or a test section: what is known about them in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry.described import described
from windmark.scene.shown import pandas_table

Array = NDArray[np.float64]

ROLES = ("model", "wall", "primary", "secondary", "tap", "virtual", "fiducial")


def _figures(m: MarkerSet) -> dict[str, object]:
    role, count = np.unique(m.role, return_counts=True)
    unit = m.length_unit or "no unit"
    return {"markers": len(m), "roles": ", ".join(f"{n} {r}" for r, n in zip(role, count, strict=True)), "unit": unit}


@described(_figures)
@dataclass(frozen=True)
class MarkerSet:
    """N markers as columns.

    Parameters
    ----------
    name : (N,) str, unique
    xyz : (N, 3) centre of the physical disc
    sigma : (N, 3) standard deviation of xyz, NaN where unknown
    radius : (N,) radius of the disc, NaN where unknown
    normal : (N, 3) unit outward normal, NaN where unknown
    volume : (N,) str, the volume (body part with its own deformation law) the marker belongs to
    role : (N,) str, one of `ROLES`
    length_unit : of place, sigma and radius: in, ft, mm, cm or m; "" where nothing says it
    curvature : (N, 3, 3) of the surface at each, one over the length unit: what is d away from the centre along the
        surface lies d C d / 2 below its tangent plane. Zero where it is flat or not known, as in tables, which do not
        hold it; `geometry.surface_curvature` takes it from a grid

    Only name and xyz are needed; `MarkerSet.make` fills the rest.

    Examples
    --------
    >>> import windmark as wm
    >>> markers = wm.MarkerSet.make(["a", "b", "w"], [[0, 0, 0], [1, 0, 0], [5, 0, 0]], role=["model", "model", "wall"])
    >>> markers.with_role("model").name.tolist()
    ['a', 'b']
    >>> markers.take([2]).xyz.tolist()
    [[5.0, 0.0, 0.0]]
    """

    name: NDArray[np.str_]
    xyz: Array
    sigma: Array
    radius: Array
    normal: Array
    volume: NDArray[np.str_]
    role: NDArray[np.str_]
    length_unit: str = ""
    curvature: Array = field(default_factory=lambda: np.zeros(0), repr=False)

    def __post_init__(self) -> None:
        n = len(self.name)
        if not self.curvature.size:
            object.__setattr__(self, "curvature", np.zeros((n, 3, 3)))
        shapes = {"xyz": (n, 3), "sigma": (n, 3), "radius": (n,), "normal": (n, 3), "curvature": (n, 3, 3)}
        for column, shape in shapes.items():
            got = np.shape(getattr(self, column))
            if got != shape:
                raise ValueError(f"MarkerSet: {column} must be {shape} for {n} names, got {got}")
        for column in ("volume", "role"):
            if len(getattr(self, column)) != n:
                raise ValueError(f"MarkerSet: {column} must have {n} entries, got {len(getattr(self, column))}")
        if len(set(self.name.tolist())) < n:
            unique, counts = np.unique(self.name, return_counts=True)
            raise ValueError(f"MarkerSet: name must be unique, more than once: {', '.join(unique[counts > 1][:5])}")
        if not np.isfinite(self.xyz).all():
            bad = self.name[~np.isfinite(self.xyz).all(axis=1)]
            raise ValueError(f"MarkerSet: xyz must be finite, it is not for {', '.join(bad[:5])}")
        wrong = sorted(set(self.role.tolist()) - set(ROLES))
        if wrong:
            raise ValueError(f"MarkerSet: role must be among {', '.join(ROLES)}, got {', '.join(wrong)}")

    @staticmethod
    def make(
        name: Sequence[str] | NDArray[np.str_],
        xyz: ArrayLike,
        *,
        sigma: ArrayLike | None = None,
        radius: ArrayLike | None = None,
        normal: ArrayLike | None = None,
        volume: Sequence[str] | NDArray[np.str_] | str = "model",
        role: Sequence[str] | NDArray[np.str_] | str = "model",
        length_unit: str = "",
    ) -> MarkerSet:
        """Markers from what is known; scalars and missing columns are filled, normals made unit length.

        ``sigma``: one for all, (3,) per axis, (N,) per marker, or (N, 3).
        """
        n = len(name)
        normals = np.full((n, 3), np.nan) if normal is None else _places("normal", normal, n)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, length, out=np.full_like(normals, np.nan), where=length > 0)
        return MarkerSet(
            name=np.asarray(name, dtype=np.str_),
            xyz=_places("xyz", xyz, n),
            sigma=_filled("sigma", _per_marker(sigma, n), (n, 3)),
            radius=_filled("radius", radius, (n,)),
            normal=normals,
            volume=_text(volume, n),
            role=_text(role, n),
            length_unit=length_unit,
        )

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame``: name, x, y, z, normal, radius, volume, role and sigma of each marker."""
        axes = "xyz"
        return pandas_table({
            "name": self.name, **{a: self.xyz[:, k] for k, a in enumerate(axes)},
            **{f"n{a}": self.normal[:, k] for k, a in enumerate(axes)}, "radius": self.radius, "volume": self.volume,
            "role": self.role, **{f"sigma_{a}": self.sigma[:, k] for k, a in enumerate(axes)},
        })  # fmt: skip

    def __len__(self) -> int:
        return len(self.name)

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Every column, (N, ...), by its name."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "length_unit"}

    @property
    def is_disc(self) -> NDArray[np.bool_]:
        """(N,) whose radius and normal are known: the centre of its image is told from the image of its centre."""
        return np.isfinite(self.radius) & np.isfinite(self.normal).all(axis=1)

    def take(self, index: ArrayLike) -> MarkerSet:
        """The markers of a boolean mask or an index array, in that order."""
        i = np.asarray(index)
        if not i.size and i.dtype != bool:
            i = i.astype(np.int64)  # an empty list is made of floats
        return replace(self, **{name: column[i] for name, column in self.columns.items()})

    def with_role(self, *roles: str) -> MarkerSet:
        """The markers of the given roles."""
        return self.take(np.isin(self.role, roles))


def _places(column: str, values: ArrayLike, n: int) -> Array:
    """(N, 3); of a single marker three numbers will do."""
    given = np.array(values, dtype=float)
    if not (given.shape == (n, 3) or (given.size == 3 * n and n <= 1)):
        raise ValueError(f"MarkerSet: {column} must be {(n, 3)} for {n} names, got {given.shape}")
    return given.reshape(n, 3)


def _per_marker(sigma: ArrayLike | None, n: int) -> ArrayLike | None:
    """One sigma for each marker as a column; of three markers nobody knows whether three numbers are theirs."""
    given = np.shape(sigma) if sigma is not None else ()
    if given != (n,) or n == 1:
        return sigma
    values = np.asarray(sigma, dtype=float)
    if n == 3 and np.ptp(values) > 0:
        raise ValueError("MarkerSet: sigma of three markers must be (3, 1), one each, or (1, 3), per axis; got (3,)")
    return values[:, None]


def _filled(column: str, values: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    if values is None:
        return np.full(shape, np.nan)
    given = np.asarray(values, dtype=float)
    try:
        return np.array(np.broadcast_to(given, shape))
    except ValueError:
        raise ValueError(f"MarkerSet: {column} must be {shape} for {shape[0]} names, got {given.shape}") from None


def _text(values: Sequence[str] | NDArray[np.str_] | str, n: int) -> NDArray[np.str_]:
    return np.full(n, values) if isinstance(values, str) else np.asarray(values, dtype=np.str_)
