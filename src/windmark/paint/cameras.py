"""Several cameras' values on the same nodes: merged by inverse variance, gains from what both see, seams tested."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import UsageError
from windmark.paint.modes import NodeField, combined
from windmark.paint.refusal import NotFitted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GAINS = ("overlap", "none")
LEAST = 20
"""Nodes that two cameras must both see before their gains are compared."""
WELL = 0.3
"""Taper above which a camera sees a node well enough for that."""
REGIONS = 12
"""Parts of an overlap, in the order of the nodes, that are taken as independent of each other."""
CUT = 2.4
"""Nodes whose misfit is so many times the usual one count half (Cauchy's weight)."""
FAR = 6.0
"""Sigmas from which two values of a node contradict each other."""
_MEDIAN = 0.4549364
"""Of chi-square with one degree of freedom."""


@dataclass(frozen=True)
class CamerasApart:
    """How far two cameras are apart on the nodes that both see well.

    Parameters
    ----------
    first, second : their names
    typical : difference in stated sigmas (median over that of chance: 1 where sigmas are right); an error that one
        camera has everywhere shows here, since no merging can take it out
    beyond : part of the nodes that are over `FAR` sigmas apart, what cameras differ by everywhere being in the sigma
    """

    first: str
    second: str
    typical: float
    beyond: float


@dataclass(frozen=True, eq=False)
class MergedCameras:
    """Values of C cameras as one field.

    Parameters
    ----------
    field : (N) merged; modes ``camera gain:k`` of the gains, ``camera NAME`` of what no gain explains
    names : (C,)
    calibrated : (C) the cameras' own fields, gains taken off
    source : (N,) int8, the camera that counts most, -1 for none
    weights : (C, N) what each counts, adding up to 1
    gain, gain_sigma : (C,) value = shown / gain; the gains' product is 1
    systematic : part of the value by which cameras differ beyond noise, one sigma of one camera; NaN with no overlap
    overlap : (C, C) nodes that two cameras both see well
    apart : of each two cameras that see common nodes well
    """

    field: NodeField
    names: tuple[str, ...]
    calibrated: tuple[NodeField, ...]
    source: NDArray[np.int8]
    weights: Array
    gain: Array
    gain_sigma: Array
    systematic: float
    overlap: NDArray[np.int64]
    apart: tuple[CamerasApart, ...] = ()

    def __bool__(self) -> bool:
        return True

    def seams(self, triangles: NDArray[np.int32]) -> CameraSeams:
        """Steps where one camera takes over from another, see `CameraSeams`."""
        t = np.asarray(triangles, dtype=np.int64)
        edge = np.unique(np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1), axis=0)
        a, b = self.source[edge[:, 0]].astype(int), self.source[edge[:, 1]].astype(int)
        on = (a >= 0) & (b >= 0) & (a != b)
        node, first, second = edge[on, 0], np.minimum(a, b)[on], np.maximum(a, b)[on]
        value = np.stack([f.value for f in self.calibrated])
        var = np.stack([f.variance for f in self.calibrated])
        step = value[first, node] - value[second, node]
        at_gain = np.hypot(self.gain_sigma[first], self.gain_sigma[second]) * np.abs(self.field.value[node])
        own = self.systematic * np.sqrt(2) * np.abs(self.field.value[node]) if np.isfinite(self.systematic) else 0.0
        sigma = np.sqrt(var[first, node] + var[second, node] + at_gain**2 + own**2)
        known = np.isfinite(step)
        return CameraSeams(node[known], first[known], second[known], step[known], sigma[known], int((~known).sum()))


@dataclass(frozen=True, eq=False)
class CameraSeams:
    """Edges of the grid along which the camera that counts most changes.

    Parameters
    ----------
    node : (S,) one of the edge's nodes
    first, second : (S,) the two cameras
    step, sigma : (S,) value of the first less that of the second there, and its standard deviation
    unchecked : edges of whose node one camera alone has a value: nothing tells a step there
    """

    node: NDArray[np.int64]
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    step: Array
    sigma: Array
    unchecked: int

    @property
    def typical(self) -> float:
        """Typical size of a step in sigmas (median over that of chance: 1 where sigmas are right); NaN with none."""
        if not len(self.step):
            return float("nan")
        return float(np.median(np.abs(self.step) / np.maximum(self.sigma, 1e-300)) / np.sqrt(_MEDIAN))


def merge_cameras(
    fields: Sequence[NodeField],
    names: Sequence[str],
    *,
    tapers: ArrayLike | None = None,
    gain: str = "overlap",
) -> MergedCameras | NotFitted:
    """Merge cameras.

    Parameters
    ----------
    fields : C fields on the same N nodes, NaN where a camera does not see one. Errors of one camera are modes with
        names of their own, errors that they share have one name
    names : (C,) of the cameras
    tapers : (C, N) from 0 to 1, falling to 0 where a camera's view ends, so that no seam jumps; None: 1
    gain : "overlap": each camera's values may have a factor of its own (lamps, shutters), found from what both see;
        "none": taken as they are

    Returns
    -------
    MergedCameras; or NotFitted where a camera shares too few nodes with the others for its gain. Nodes that only one
    camera sees keep its value. A single camera is merged with itself.

    Raises
    ------
    ValueError
        For fields of different lengths, or names that are there twice.

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> light = np.linspace(100.0, 200.0, 60)
    >>> nodes = np.arange(60)
    >>> left = wm.NodeField.make(np.where(nodes < 45, light, np.nan), 1.0)
    >>> right = wm.NodeField.make(np.where(nodes > 15, 1.1 * light, np.nan), 1.0)  # another shutter
    >>> merged = wm.merge_cameras([left, right], ["left", "right"])
    >>> (merged.gain / merged.gain[0]).round(3).tolist(), int(np.isfinite(merged.field.value).sum())
    ([1.0, 1.1], 60)
    """
    taper = _checked(fields, names, tapers, gain)
    value = np.stack([np.where(t > 0, f.value, np.nan) for f, t in zip(fields, taper, strict=True)])
    variance = np.stack([f.variance for f in fields])
    well = np.isfinite(value) & (taper > WELL) & (value > 0)
    overlap = well.astype(np.int64) @ well.T.astype(np.int64)
    log_gain, cov = np.zeros(len(fields)), np.zeros((len(fields), len(fields)))
    if gain == "overlap" and len(fields) > 1:
        found = _gains(value, variance, well, overlap)
        if isinstance(found, int):
            return NotFitted(
                f"merge_cameras: {names[found]} shares fewer than {LEAST} well-seen nodes with the others, so its gain "
                'is unknown; gain = "none" takes it as it is', {"camera": names[found]}
            )  # fmt: skip
        log_gain, cov = found
    factor = np.exp(log_gain)
    calibrated = tuple(f.applied(f.value / g, 1 / g) for f, g in zip(fields, factor, strict=True))
    value, variance = value / factor[:, None], variance / factor[:, None] ** 2
    systematic = _systematic(value, variance, well)
    apart = cameras_apart(names, value, variance, well, systematic)
    return _merged(calibrated, tuple(names), value, variance, taper, factor, cov, systematic, overlap, apart)


def _checked(fields: Sequence[NodeField], names: Sequence[str], tapers: ArrayLike | None, gain: str) -> Array:
    if not fields or len(fields) != len(names) or len(set(names)) < len(names) or len(fields) > 127:
        raise UsageError(f"merge_cameras: expected 1 to 127 fields and as many different names, got {list(names)}")
    if len({len(f) for f in fields}) > 1:
        raise ValueError(f"merge_cameras: all fields must have one length, got {[len(f) for f in fields]}")
    if gain not in GAINS:
        raise UsageError(f"merge_cameras: gain must be one of {', '.join(GAINS)}, got {gain!r}")
    shape = (len(fields), len(fields[0]))
    taper = np.ones(shape) if tapers is None else np.asarray(tapers, dtype=float)
    if taper.shape != shape or not ((taper >= 0) & (taper <= 1)).all():
        raise UsageError(f"merge_cameras: tapers must be {shape}, from 0 to 1, got {taper.shape}")
    return taper


def _gains(value: Array, variance: Array, well: Mask, overlap: NDArray[np.int64]) -> tuple[Array, Array] | int:
    """Logarithms of the gains and their covariance; or a camera that is not joined to the others."""
    count = len(value)
    rows, right, weight = [], [], []
    for a, b in combinations(range(count), 2):
        if overlap[a, b] < LEAST:
            continue
        both = well[a] & well[b]
        mean, var = _difference(np.log(value[a, both] / value[b, both]),
                                variance[a, both] / value[a, both] ** 2 + variance[b, both] / value[b, both] ** 2)
        row = np.zeros(count)
        row[a], row[b] = 1.0, -1.0
        rows.append(row)
        right.append(mean)
        weight.append(1 / max(var, 1e-18))
    joined = {0}
    for _ in range(count):
        joined |= {int(k) for row in rows for k in np.flatnonzero(row) if joined & set(np.flatnonzero(row).tolist())}
    if len(joined) < count:
        return next(k for k in range(count) if k not in joined)
    design, w = np.array(rows), np.array(weight)
    inverse = np.linalg.pinv((design * w[:, None]).T @ design, hermitian=True)
    gains = inverse @ (design.T @ (w * np.array(right)))
    # Three cameras close a circle: what does not close is an error of its own.
    dof = len(rows) - count + 1
    factor = max(float((w * (np.array(right) - design @ gains) ** 2).sum()) / dof, 1.0) if dof > 0 else 1.0
    return gains, inverse * factor


def _difference(d: Array, variance: Array) -> tuple[float, float]:
    """Mean of differences that may hold dirt, and its variance by the scatter of whole parts of the overlap."""
    usual = np.maximum(variance, 1e-4 * float(np.median(variance)) + 1e-30)
    mean = float(np.median(d))
    for _ in range(30):
        chi = (d - mean) ** 2 / usual
        scale = max(float(np.median(chi)) / _MEDIAN, 1.0)
        w = 1 / usual / (1 + chi / (CUT**2 * scale))
        new = float((w * d).sum() / w.sum())
        if abs(new - mean) < 1e-12:
            break
        mean = new
    parts = np.array_split(np.arange(len(d)), min(REGIONS, len(d)))
    sums = np.array([(w[p] * (d[p] - mean)).sum() for p in parts])
    spread = float((sums**2).sum()) / float(w.sum()) ** 2 * len(parts) / (len(parts) - 1)
    return mean, max(spread, 1 / float((1 / usual).sum()))


def _systematic(value: Array, variance: Array, well: Mask) -> float:
    """The part s of the value for which the median of d^2 / (var + 2 s^2 V^2) is that of noise; NaN with no overlap."""
    parts = [np.stack(pair) for _, _, *pair in _pairs(value, variance, well)]
    if not parts or not sum(p.shape[1] for p in parts):
        return float("nan")
    square, var, size = np.concatenate(parts, axis=1)
    low, high = 0.0, 1.0

    def excess(s: float) -> float:
        return float(np.median(square / np.maximum(var + s**2 * size, 1e-30 * size))) - _MEDIAN

    if excess(0.0) <= 0:
        return 0.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def _pairs(value: Array, variance: Array, well: Mask) -> Iterator[tuple[int, int, Array, Array, Array]]:
    """Of each two cameras, on the nodes that both see well: d^2, its variance, and twice the square of their mean."""
    for a, b in combinations(range(len(value)), 2):
        both = well[a] & well[b]
        d, mean = value[a, both] - value[b, both], 0.5 * (value[a, both] + value[b, both])
        yield a, b, d**2, variance[a, both] + variance[b, both], 2 * mean**2


def cameras_apart(
    names: Sequence[str], value: Array, variance: Array, well: Mask, systematic: float, steps: Array | None = None
) -> tuple[CamerasApart, ...]:
    """How far each two cameras with common nodes are apart.

    Parameters
    ----------
    names : (C,)
    value, variance : (C, N) as calibrated, gains taken off
    well : (C, N) nodes that a camera sees well
    systematic : part of the value by which cameras differ everywhere beyond their variances, one sigma of one camera
    steps : (C, N) variance beside steps of the picture. What both cameras show there counts, as the rim of a marker:
        a dead pixel of one of them is none
    """
    out = []
    for a, b, square, var, size in _pairs(value, variance, well):
        if len(square) < LEAST:
            continue
        least = 5e-13 * size
        typical = float(np.sqrt(np.median(square / np.maximum(var, least)) / _MEDIAN))
        both = well[a] & well[b]
        rims = 0.0 if steps is None else 2 * np.minimum(steps[a, both], steps[b, both])
        far = square > FAR**2 * np.maximum(var + systematic**2 * size + rims, least)
        out.append(CamerasApart(names[a], names[b], typical, float(far.mean())))
    return tuple(out)


def _merged(fields: tuple[NodeField, ...], names: tuple[str, ...], value: Array, variance: Array, taper: Array,
            factor: Array, cov: Array, systematic: float, overlap: NDArray[np.int64],
            apart: tuple[CamerasApart, ...]) -> MergedCameras:  # fmt: skip
    """The weighted mean with all its modes."""
    own = np.nan_to_num(systematic) * np.where(np.isfinite(value), value, 0.0)
    total = variance + own**2
    # A perfect picture still needs a finite weight.
    least = 1e-12 * float(np.nanmedian(value**2)) if np.isfinite(value).any() else 1.0
    w = np.where(np.isfinite(value), taper / np.maximum(total, max(least, 1e-300)), 0.0)
    seen = w.sum(axis=0) > 0
    share = w / np.where(seen, w.sum(axis=0), 1.0)
    mean = np.where(seen, (share * np.where(share > 0, value, 0.0)).sum(axis=0), np.nan)
    out = combined(mean, list(zip(fields, share, strict=True)), unit=fields[0].unit)
    if np.any(cov):
        out = out.with_modes("camera gain", np.where(seen, share * np.where(share > 0, value, 0.0), 0.0).T, cov)
    if systematic > 0:
        for k, name in enumerate(names):
            out = out.with_mode(f"camera {name}", share[k] * own[k])
    source = np.where(seen, share.argmax(axis=0), -1).astype(np.int8)
    sigma = np.sqrt(np.maximum(np.diagonal(cov), 0.0))
    return MergedCameras(out, names, fields, source, share, factor, sigma, systematic, overlap, apart)
