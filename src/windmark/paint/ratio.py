"""The ratio wind off over wind on, at nodes in object space, and the reference that it is formed with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError
from windmark.paint.modes import NodeField, combined
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]


def form_ratio(
    reference: NodeField, on: NodeField, *, channel: tuple[NodeField, NodeField] | None = None
) -> NodeField:  # fmt: skip
    """I_ref / I of every node.

    Parameters
    ----------
    reference, on : (N) light wind off and wind on, on the same nodes of the model
    channel : the two in the reference channel of a two-colour paint, insensitive to pressure: the ratio of its own
        lights takes out what lamp and motion did

    Returns
    -------
    NodeField, NaN where a light is missing, infinite or not above zero. Independent noise by var(r) / r^2 = sum of
    var(I) / I^2, the limit that photons set; modes that wind off and on share cancel as far as they are the same part
    of the light.

    Raises
    ------
    ValueError
        For fields of different lengths.

    Examples
    --------
    >>> import windmark as wm
    >>> off, on = wm.NodeField.make([200.0, 200.0], 2.0), wm.NodeField.make([100.0, 0.0], 1.0)
    >>> ratio = wm.form_ratio(off, on)
    >>> ratio.value.tolist(), ratio.sigma.round(4).tolist()  # no light, no ratio
    ([2.0, nan], [0.0283, nan])
    """
    check_kinds("form_ratio", reference=(reference, NodeField), on=(on, NodeField))
    parts = [reference, on, *(channel if channel is not None else ())]
    if len({len(p) for p in parts}) > 1:
        raise ValueError(f"form_ratio: all fields must have one length, got {[len(p) for p in parts]}")
    good = np.all([(p.value > 0) & np.isfinite(p.value) for p in parts], axis=0)
    lights = [np.where(good, p.value, np.nan) for p in parts]
    r = lights[0] / lights[1]
    if channel is not None:
        r = r * lights[3] / lights[2]
    signs = (1.0, -1.0, -1.0, 1.0)
    slopes = [np.where(good, sign * r / light, 0.0) for sign, light in zip(signs, lights, strict=False)]
    return combined(r, list(zip(parts, slopes, strict=True)))


def reference_at(incidences: ArrayLike, fields: Sequence[NodeField], incidence: float) -> NodeField:
    """The reference picture for an incidence, straight between those that were taken.

    Parameters
    ----------
    incidences : (R,) at which references were taken, all different, in any order
    fields : (R) their lights
    incidence : that of the picture wind on, of the same unit; the one reference there is serves for all

    Raises
    ------
    DataError
        For an incidence outside of what was taken by more than a tenth of its span: lights are not extrapolated.
    """
    if np.shape(incidences) != (len(fields),):
        raise UsageError(f"reference_at: expected as many incidences as fields, got {np.shape(incidences)}")
    shares = reference_shares(incidences, incidence)
    if len(shares) == 1:
        return fields[next(iter(shares))]
    pair = [fields[k] for k in shares]
    # A node that one of them does not show is not known in between.
    both = pair[0].known & pair[1].known
    return weighted_mean([replace(f, value=np.where(both, f.value, np.nan)) for f in pair], list(shares.values()))


def reference_shares(incidences: ArrayLike, incidence: float) -> dict[int, float]:
    """Which of the references (R,) make up that for an incidence, and their shares, of sum 1: one, or the two that it
    lies between (beyond the last one by up to a tenth of their span one of the shares is below zero).

    Raises
    ------
    DataError
        See `reference_at`.
    UsageError
        For incidences that are not all different, or no numbers.
    """
    at = np.asarray(incidences, dtype=float)
    if at.ndim != 1 or not len(at) or len(np.unique(at)) < len(at) or not np.isfinite(at).all():
        raise UsageError(f"reference_at: expected different incidences, got {at.tolist()}")
    if len(at) == 1:
        return {0: 1.0}
    order = np.argsort(at)
    low, high = at[order[0]], at[order[-1]]
    reach = 0.1 * (high - low)
    if not low - reach <= incidence <= high + reach:
        raise DataError(f"reference_at: incidence {incidence:g} lies outside the references' {low:g} to {high:g}")
    k = int(np.clip(np.searchsorted(at[order], incidence, side="right") - 1, 0, len(at) - 2))
    first, second = int(order[k]), int(order[k + 1])
    share = float((incidence - at[first]) / (at[second] - at[first]))
    if share in (0.0, 1.0):
        return {second if share else first: 1.0}
    return {first: 1 - share, second: share}


def mean_reference(fields: Sequence[NodeField]) -> NodeField:
    """The mean of a run as its own reference: of each node over the pictures that show it."""
    if not fields:
        raise UsageError("mean_reference: expected at least one picture")
    return weighted_mean(fields, [1.0] * len(fields))


def weighted_mean(fields: Sequence[NodeField], weights: Sequence[float]) -> NodeField:
    """The mean of fields on the same nodes with fixed weights, of each node over the fields that know it."""
    if len({len(f) for f in fields}) > 1:
        raise ValueError(f"weighted_mean: all fields must have one length, got {[len(f) for f in fields]}")
    share = node_shares([f.known for f in fields], weights)
    total = share.sum(axis=0)
    value = sum((np.where(f.known, s * f.value, 0.0) for f, s in zip(fields, share, strict=True)), np.zeros(len(total)))
    value = np.where(np.abs(total) > 0, value, np.nan)
    clean = [replace(f, white=np.where(f.known, f.white, 0.0), modes=np.where(f.known[:, None], f.modes, 0.0))
             for f in fields]  # fmt: skip
    return combined(value, list(zip(clean, share, strict=True)), unit=fields[0].unit)


def node_shares(known: Sequence[NDArray[np.bool_]], weights: Sequence[float]) -> Array:
    """(F, N) what each of F fields counts at each node, of sum 1 over those that know it; 0 where none does."""
    w = np.array([np.where(on, weight, 0.0) for on, weight in zip(known, weights, strict=True)])
    total = w.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(np.abs(total) > 0, w / total, 0.0)
