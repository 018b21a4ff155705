"""The surface's temperature, wind on and off: given, by recovery, from thermocouples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError
from windmark.paint.cp import AIR, TunnelConditions
from windmark.paint.modes import NodeField, principal_axes
from windmark.paint.well_tests import alike, tested_wells

Array = NDArray[np.float64]

TURBULENT, LAMINAR = 0.896, 0.845
"""Recovery factors of air, about the cube and the square root of its Prandtl number."""
COLUMNS = 8
"""Principal axes of an interpolation's error that are kept as modes; the rest counts as independent."""
ANCHORS = 60
"""Places at which the interpolation's error is known jointly; between them it is interpolated by its own covariance."""


def given_temperature(value: ArrayLike, sigma: ArrayLike = 0.0, *, common_sigma: float = 0.0, count: int | None = None,
                      unit: str = "K", cause: str = "temperature") -> NodeField:  # fmt: skip
    """A known temperature: one for ``count`` nodes, or a map (N,).

    Parameters
    ----------
    sigma : (N,) or one number, independent errors
    common_sigma : error that all nodes share, the mode ``cause``

    Examples
    --------
    >>> import windmark as wm
    >>> wall = wm.given_temperature(295.0, 0.3, common_sigma=0.4, count=3)
    >>> wall.value.tolist(), wall.sigma.round(6).tolist(), wall.names
    ([295.0, 295.0, 295.0], [0.5, 0.5, 0.5], ('temperature',))
    """
    v = np.asarray(value, dtype=float)
    if v.ndim == 0:
        if count is None:
            raise UsageError("given_temperature: one number needs count, the number of nodes")
        v = np.full(count, float(v))
    out = NodeField.make(v, sigma, unit=unit)
    return out.with_mode(cause, common_sigma) if common_sigma else out


def recovery_temperature(
    conditions: TunnelConditions,
    count: int,
    *,
    recovery: ArrayLike = TURBULENT,
    recovery_sigma: float = 0.01,
    t_0_sigma: float = 0.5,
    gamma: float = AIR,
    cause: str = "recovery temperature",
) -> NodeField:
    """Adiabatic wall temperature of N nodes: T = T_inf + r (T_0 - T_inf).

    Parameters
    ----------
    conditions : with Mach number and total temperature (absolute, K)
    count : number of nodes
    recovery : r of all nodes or (N,): 0.896 turbulent, 0.845 laminar
    recovery_sigma, t_0_sigma : errors that all nodes share (modes ``cause:1``, ``cause:2``)

    Raises
    ------
    DataError
        Where the conditions hold no Mach number or no total temperature, or one that is not absolute.

    Examples
    --------
    >>> import windmark as wm
    >>> conditions = wm.TunnelConditions.from_mach(1e5, 0.8, 300.0)
    >>> wall = wm.recovery_temperature(conditions, 2, recovery=[0.845, 0.896])  # laminar, turbulent
    >>> wall.value.round(2).tolist()
    [294.72, 296.46]
    """
    if not (np.isfinite(conditions.mach) and np.isfinite(conditions.t_0)):
        raise DataError("recovery_temperature: the conditions have no Mach number or no total temperature")
    if conditions.temperature_unit != "K" or not conditions.t_0 > 0:
        raise DataError(f"recovery_temperature: the total temperature must be in K, got {conditions.t_0:g} "
                        f"{conditions.temperature_unit}")  # fmt: skip
    r = np.broadcast_to(np.asarray(recovery, dtype=float), (count,))
    share = 1 / (1 + 0.5 * (gamma - 1) * conditions.mach**2)
    slopes = np.stack([np.full(count, conditions.t_0 * (1 - share)), share + r * (1 - share)], axis=1)
    out = NodeField.make(conditions.t_0 * (share + r * (1 - share)), unit="K")
    return out.with_modes(cause, slopes, np.diag([recovery_sigma**2, t_0_sigma**2]))


def thermocouple_temperature(
    xyz: ArrayLike,
    points: ArrayLike,
    values: ArrayLike,
    *,
    sigma: ArrayLike,
    length: float,
    spread: float | None = None,
    common_sigma: float = 0.0,
    unit: str = "K",
    cause: str = "thermocouples",
    names: Sequence[str] | None = None,
    remarks: list[str] | None = None,
) -> NodeField:
    """Temperature of nodes from a few thermocouples in the surface.

    Parameters
    ----------
    xyz : (N, 3) nodes
    points, values : (M, 3) and (M,) of the thermocouples; NaN values do not count
    sigma : (M,) or one number, their own errors
    length : distance over which the temperature keeps about its value
    spread : standard deviation of the temperature about its mean over the surface; None: as the thermocouples show it
        (three or more)
    common_sigma : error that all share (mode ``cause common``)
    names : (M,) of the thermocouples, for what is said of them; None: by their number, from 1
    remarks : gets what is to be said: a reading that contradicts all others and does not count, readings that differ
        beyond their sigmas

    Returns
    -------
    NodeField: between thermocouples interpolated, far from them (several ``length``) their mean, with a sigma that
    grows to ``spread``; modes ``cause:k``. A reading that contradicts all others is left out, and where nothing tells
    which is wrong all sigmas are larger, by as much as readings differ (`well_tests`).

    Raises
    ------
    DataError
        Without any thermocouple, or with fewer than three and no spread.

    Notes
    -----
    Kriging with an unknown mean and the covariance spread^2 exp(-d^2 / (2 length^2)) (Cressie, Statistics for Spatial
    Data, 1993, section 3.2); distances are straight ones, through the model.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> nodes = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [50.0, 0.0, 0.0]])
    >>> places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    >>> wall = wm.thermocouple_temperature(nodes, places, [300.0, 302.0, 304.0], sigma=0.1, length=1.0)
    >>> wall.value.round(1).tolist(), wall.sigma.round(2).tolist()
    ([300.0, 300.7, 302.0], [0.1, 0.28, 2.5])
    """
    node, at = np.asarray(xyz, dtype=float), np.asarray(points, dtype=float)
    t, s = np.asarray(values, dtype=float), np.asarray(sigma, dtype=float)
    if node.ndim != 2 or node.shape[1] != 3 or at.shape != (len(t), 3):
        raise ValueError(
            f"thermocouple_temperature: expected xyz (N, 3), points (M, 3), values (M,), got {node.shape}, {at.shape}, "
            f"{t.shape}"
        )
    scales = np.concatenate([s.ravel(), [length, 1.0 if spread is None else spread]])
    if not ((scales > 0) & np.isfinite(scales)).all():
        raise UsageError("thermocouple_temperature: length, sigma and spread must be finite and above zero")
    good = np.isfinite(t) & np.isfinite(at).all(axis=1)
    noise = np.broadcast_to(s**2, t.shape)[good]
    at, t = at[good], t[good]
    if not len(t) or (len(t) < 3 and spread is None):
        raise DataError(f"thermocouple_temperature: {len(t)} thermocouples have a value; expected at least "
                        f"{1 if spread else 3}")  # fmt: skip
    called = np.array([f"thermocouple {k + 1}" for k in range(len(good))] if names is None else [*names])[good]
    tested = tested_wells(at, t, noise, length, spread, called.tolist(), unit)
    if remarks is not None:
        remarks += tested.words
    at, t, noise, power = at[tested.used], t[tested.used], tested.variance[tested.used], tested.power
    anchor = _spread_out(node[np.isfinite(node).all(axis=1)], ANCHORS)
    inverse: Array = np.asarray(np.linalg.inv(power * alike(at, at, length) + np.diag(noise)), dtype=float)
    ones = np.ones(len(t))
    mean = float(ones @ inverse @ t / (ones @ inverse @ ones))
    value = _blocks(node, lambda x: mean + power * alike(x, at, length) @ (inverse @ (t - mean)))
    own, error = _errors(node, at, anchor, inverse, power, length)
    out = _with_error(
        NodeField.make(value, unit=unit), node, own, error, power,
        lambda x: _cross(x, at, anchor, inverse, power, length), cause,
    )  # fmt: skip
    return out.with_mode(f"{cause} common", common_sigma) if common_sigma else out


def varying(field: NodeField, xyz: ArrayLike, *, spread: float, length: float, cause: str = "wall") -> NodeField:
    """A temperature from which the wall's differs by place: the covariance spread^2 exp(-d^2 / (2 length^2)).

    Parameters
    ----------
    field : (N) the temperature
    xyz : (N, 3) nodes; where they are NaN the variation counts as independent
    spread, length : standard deviation, and the distance over which it keeps about its value

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> from windmark.paint import varying
    >>> nodes = np.column_stack([np.linspace(0, 1, 5), np.zeros((5, 2))])
    >>> wall = varying(wm.given_temperature(295.0, count=5), nodes, spread=0.8, length=0.3)
    >>> wall.sigma.round(2).tolist(), len(wall.names) > 1
    ([0.8, 0.8, 0.8, 0.8, 0.8], True)
    """
    node = np.asarray(xyz, dtype=float)
    here = np.isfinite(node).all(axis=1)
    if not here.any():
        return field
    anchor, power = _spread_out(node[here], ANCHORS), spread**2
    return _with_error(
        field, node, np.full(len(node), power), power * alike(anchor, anchor, length), power,
        lambda x: power * alike(x, anchor, length), cause,
    )  # fmt: skip


def _with_error(
    field: NodeField, node: Array, own: Array, error: Array, power: float, cross: Callable[[Array], Array], cause: str
) -> NodeField:
    """A field with an error whose variances (N,) at the nodes and covariance (A, A) at the anchors are known.

    ``cross`` gives the covariance of that at some places with that at the anchors; ``power`` is its size. The error at
    a node, given that at the anchors, is linear in it, and independent of it for the rest.
    """
    kept = principal_axes(error)[:, :COLUMNS]
    gain = np.linalg.solve(error + 1e-9 * power * np.eye(len(error)), kept)
    modes = np.nan_to_num(np.concatenate([cross(x) @ gain for x in _cut(node)]))
    rest, known = np.maximum(own - (modes**2).sum(axis=1), 0.0), field.known
    return replace(
        field, white=field.white + np.where(known, rest, 0.0),
        modes=np.column_stack([field.modes, np.where(known[:, None], modes, 0.0)]),
        names=(*field.names, *(f"{cause}:{k + 1}" for k in range(kept.shape[1]))),
    )  # fmt: skip


def _cut(node: Array) -> list[Array]:
    return np.array_split(node, max(len(node) // 20_000, 1))


def _blocks(node: Array, of: object) -> Array:
    return np.concatenate([of(x) for x in _cut(node)])  # type: ignore[operator]


def _cross(a: Array, at: Array, b: Array, inverse: Array, power: float, length: float) -> Array:
    """(A, B) covariance of the kriging error at places a and b."""
    ones = np.ones(len(at))
    ka, kb = power * alike(a, at, length), power * alike(b, at, length)
    ua, ub = 1 - ka @ inverse @ ones, 1 - kb @ inverse @ ones
    return np.asarray(power * alike(a, b, length) - ka @ inverse @ kb.T + np.outer(ua, ub) / (ones @ inverse @ ones))


def _errors(node: Array, at: Array, anchor: Array, inverse: Array, power: float, length: float) -> tuple[Array, Array]:
    """Variance (N,) of the kriging error at the nodes, and its covariance (A, A) at the anchors."""
    ones = np.ones(len(at))

    def own(x: Array) -> Array:
        k = power * alike(x, at, length)
        u = 1 - k @ inverse @ ones
        return np.asarray(power - np.einsum("nk,kl,nl->n", k, inverse, k) + u**2 / (ones @ inverse @ ones))

    error = _cross(anchor, at, anchor, inverse, power, length)
    return np.maximum(_blocks(node, own), 0.0), 0.5 * (error + error.T)


def _spread_out(xyz: Array, count: int) -> Array:
    """At most ``count`` places, each as far as can be from those before (Gonzalez, 1985)."""
    far = np.linalg.norm(xyz - xyz[0], axis=1)
    chosen = [0]
    while len(chosen) < min(count, len(xyz)) and far.max() > 0:
        chosen.append(int(np.argmax(far)))
        far = np.minimum(far, np.linalg.norm(xyz - xyz[chosen[-1]], axis=1))
    return xyz[chosen]
