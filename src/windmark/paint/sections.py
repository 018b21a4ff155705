"""Section cuts: Cp against x/c, and the section's normal force, axial force and moment; the loading along the span."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.errors import DataError, UsageError, g3
from windmark.paint.axes import LoadReference
from windmark.paint.carry import carried
from windmark.paint.modes import NodeField, interpolated
from windmark.scene import Mesh
from windmark.scene.doubled import TWICE, doubled, doubled_zones
from windmark.scene.shown import check_kinds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SECTION_LOADS = ("cn", "ca", "cm")
"""Per section: normal and axial force over q and chord, moment (nose up) about the quarter chord over q chord^2."""


class Cut(Protocol):
    """Lines in which a plane cuts the mesh, as `resection.section` gives them."""

    @property
    def xyz(self) -> Array:
        """(N, 3) points in order, line by line."""
        ...

    @property
    def line(self) -> NDArray[np.int32]:
        """(N,) number of each point's line."""
        ...

    @property
    def triangle(self) -> NDArray[np.int32]:
        """(N,) a triangle that holds each point, that in which the line goes on."""
        ...

    @property
    def barycentric(self) -> Array:
        """(N, 2) weights of that triangle's second and third vertex."""
        ...


@dataclass(frozen=True, eq=False)
class SectionProfile:
    """Cp along a cut.

    Parameters
    ----------
    x_c : (N,) place along the chord, 0 at the most forward point of the cut and 1 at the most aft one
    cp : (N) with sigma and modes, NaN where the surface was not seen
    upper : (N,) bool, surface that looks up (body axes)
    line : (N,) number of each point's line
    xyz : (N, 3)
    chord : length between the most forward and the most aft point, along the body's axis
    """

    x_c: Array
    cp: NodeField
    upper: Mask
    line: NDArray[np.int32]
    xyz: Array
    chord: float


@dataclass(frozen=True, eq=False)
class SpanLoading:
    """Loads of S sections.

    Parameters
    ----------
    station, chord : (S,) place along the span (starboard axis, length unit) and chord
    value, sigma : (S, 3) the `SECTION_LOADS`; NaN where more than ``unseen`` allows is missing
    cov : (3 S, 3 S) section by section
    causes : variance (3 S,) that each cause brings
    unseen : (S,) part of the cut's length without a value
    warnings : sections without loads, with the reason
    """

    station: Array
    chord: Array
    value: Array
    sigma: Array
    cov: Array
    causes: Mapping[str, Array]
    unseen: Array
    warnings: tuple[str, ...] = ()


def section_profile(mesh: Mesh, cp: NodeField, cut: Cut, reference: LoadReference) -> SectionProfile:
    """Cp against x/c along a cut.

    Parameters
    ----------
    mesh, cp : the surface and its (V) pressure coefficients
    cut : of this mesh
    reference : its body axes say where aft and up are

    Raises
    ------
    DataError
        For a cut without points or without extent along the chord, and for one of which more than `TWICE` of the length
        is in the mesh twice (`scene.doubled`): it would count twice in the section's loads.

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> cp = wm.NodeField.make([-1.0, 0.0, 0.0, -1.0])
    >>> cut = wm.section(plate, [0.0, 0.5, 0.0], [0.0, 1.0, 0.0])
    >>> profile = wm.section_profile(plate, cp, cut, wm.LoadReference(area=2.0, chord=2.0, span=1.0))
    >>> profile.x_c.tolist(), profile.cp.value.tolist(), profile.upper.tolist()
    ([0.0, 0.5, 1.0], [-1.0, -0.5, 0.0], [True, True, True])
    """
    check_kinds("section_profile", mesh=(mesh, Mesh), cp=(cp, NodeField), reference=(reference, LoadReference))
    if len(cp) != len(mesh.vertices):
        raise ValueError(f"section_profile: cp must have {len(mesh.vertices)} nodes, got {len(cp)}")
    aft, _, up = reference.body_axes
    if not len(cut.xyz):
        raise DataError("section_profile: the plane does not meet the grid")
    x = cut.xyz @ aft
    chord = float(np.ptp(x))
    if not chord > 0:
        raise DataError("section_profile: the cut has no length along the body's axis; is it a cross-section?")
    _refuse_doubled(mesh, cut)
    nodes, weights = _weights(mesh, cut)
    upper = mesh.triangle_normals()[cut.triangle] @ up > 0
    return SectionProfile((x - x.min()) / chord, interpolated(cp, nodes, weights), upper, cut.line, cut.xyz, chord)


def _refuse_doubled(mesh: Mesh, cut: Cut) -> None:
    found = doubled(mesh)
    if not found:
        return
    length = np.where(np.diff(cut.line) == 0, np.linalg.norm(np.diff(cut.xyz, axis=0), axis=1), 0.0)
    layers = np.where(found.upon[cut.triangle[:-1]] >= 0, length, 0.0)
    share = 0.5 * float(layers.sum()) / max(float(length.sum()), 1e-300)
    if share > TWICE:
        raise DataError(f"section_profile: {doubled_zones(mesh, found)}: {g3(100 * share)} % of the cut's length is in "
                        "the grid twice and would count twice in its loads; leave a zone that is there twice out of "
                        "its volume, and blank what overlaps of overset zones (IBLANK = 0)")  # fmt: skip


def _weights(mesh: Mesh, cut: Cut) -> tuple[NDArray[np.int64], Array]:
    """Nodes (N, 3) and weights of the points of a cut; tiny weights, of rounding, are none."""
    b = np.clip(cut.barycentric, 0.0, 1.0)
    w = np.column_stack([1 - b.sum(axis=1), b])
    w = np.where(w > 1e-9, w, 0.0)
    return mesh.triangles[cut.triangle].astype(np.int64), w / w.sum(axis=1, keepdims=True)


def span_loading(
    mesh: Mesh, cp: NodeField, cuts: Sequence[Cut], normal: ArrayLike, reference: LoadReference, *,
    most_unseen: float = 0.05,
) -> SpanLoading:  # fmt: skip
    """Normal force, axial force and moment of sections.

    Parameters
    ----------
    mesh, cp : as in `section_profile`
    cuts : S cuts with planes of one normal
    normal : (3,) of the planes, about along the span
    reference : body axes
    most_unseen : part of a cut's length that may be without a value; Cp goes on straight along the line there

    Returns
    -------
    SpanLoading. Forces per unit of span are integrals along the cut: f = -integral of Cp n ds, n in the plane. Lines
    that are not closed leave out what closes them (a blunt base).

    Examples
    --------
    >>> import windmark as wm
    >>> plate = wm.Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> cp, reference = wm.NodeField.make([-1.0, 0.0, 0.0, -1.0]), wm.LoadReference(area=2.0, chord=2.0, span=1.0)
    >>> cuts = [wm.section(plate, [0.0, y, 0.0], [0.0, 1.0, 0.0]) for y in (0.25, 0.75)]
    >>> loading = wm.span_loading(plate, cp, cuts, [0.0, 1.0, 0.0], reference)
    >>> loading.station.tolist(), loading.value[:, 0].round(6).tolist()  # normal force of each section
    ([0.25, 0.75], [0.5, 0.5])
    """
    check_kinds("span_loading", mesh=(mesh, Mesh), cp=(cp, NodeField), reference=(reference, LoadReference))
    n = np.asarray(normal, dtype=float)
    if n.shape != (3,) or not np.linalg.norm(n) > 0:
        raise UsageError(f"span_loading: normal must be three numbers, not all zero, got {normal!r}")
    if not 0 <= most_unseen < 1:
        raise UsageError(f"span_loading: most_unseen must be from 0 to below 1, got {most_unseen}")
    from scipy.sparse import csr_array, vstack

    n = n / np.linalg.norm(n)
    rows: list[Any] = []
    station, chord, unseen, words = [], [], [], []
    for k, cut in enumerate(cuts):
        profile = section_profile(mesh, cp, cut, reference)
        operator, missing = _operator(profile, n, reference, mesh.triangle_normals()[cut.triangle])
        nodes, weights = _weights(mesh, cut)
        at = csr_array((weights.ravel(), (np.repeat(np.arange(len(nodes)), 3), nodes.ravel())),
                       shape=(len(nodes), len(cp)))  # fmt: skip
        rows.append(csr_array(operator) @ at)
        station.append(float((cut.xyz @ reference.body_axes[1]).mean()))
        chord.append(profile.chord)
        unseen.append(missing)
        if missing > most_unseen:
            words.append(f"section {k + 1}: {g3(100 * missing)} % of the cut was not seen; no loads")
    if not rows:
        raise UsageError("span_loading: expected at least one cut")
    good = np.array(unseen) <= most_unseen
    every = np.repeat(good, 3)
    both = vstack([row if ok else 0 * row for row, ok in zip(rows, good, strict=True)]).tocsr()
    both.eliminate_zeros()
    got = carried(cp, both)
    value, sigma = (np.where(every, a, np.nan).reshape(-1, 3) for a in (got.value, got.sigma))
    cov = np.where(every[:, None] & every, got.cov, np.nan)
    place = np.array(station), np.array(chord)
    return SpanLoading(*place, value, sigma, cov, got.causes, np.array(unseen), tuple(words))


def _operator(profile: SectionProfile, n: Array, reference: LoadReference, outward: Array) -> tuple[Array, float]:
    """(3, N) weights of the points' Cp in the section's loads, and the part of the length without a value."""
    aft, starboard, up = reference.body_axes
    count = len(profile.x_c)
    x = profile.xyz @ aft
    first, last = profile.xyz[np.argmin(x)], profile.xyz[np.argmax(x)]
    about = first + 0.25 * (last - first)
    out, missing, total = np.zeros((3, count)), 0.0, 0.0
    for which in np.unique(profile.line):
        at = np.flatnonzero(profile.line == which)
        step = np.diff(profile.xyz[at], axis=0)
        flat = np.cross(step, n)
        # Outward as the triangle in which the segment lies.
        flat *= np.where(np.einsum("nk,nk->n", flat, outward[at[:-1]]) < 0, -1.0, 1.0)[:, None]
        length = np.linalg.norm(step, axis=1)
        known = profile.cp.known[at]
        both = known[:-1] & known[1:]
        total, missing = total + float(length.sum()), missing + float(length[~both].sum())
        if not known.any():
            continue
        middle = 0.5 * (profile.xyz[at[:-1]] + profile.xyz[at[1:]]) - about
        moment = np.cross(middle, -flat) @ starboard
        loads = np.stack([-flat @ up / profile.chord, -flat @ aft / profile.chord, moment / profile.chord**2])
        arc = np.concatenate([[0.0], np.cumsum(length)])
        out[:, at] += 0.5 * loads @ (_shares(known, arc, 0) + _shares(known, arc, 1))
    return out, missing / total if total > 0 else 1.0


def _shares(known: Mask, arc: Array, end: int) -> Array:
    """(N - 1, N) what each segment's first (0) or second (1) end takes of each point's Cp: its own where it is known,
    else of the two known ones next to it along the line.
    """
    n = len(known)
    place = np.arange(n - 1) + end
    on = np.flatnonzero(known)
    right = np.clip(np.searchsorted(on, place), 0, len(on) - 1)
    left = np.clip(np.searchsorted(on, place, side="right") - 1, 0, len(on) - 1)
    a, b = on[left], on[right]
    span = arc[b] - arc[a]
    t = np.divide(arc[place] - arc[a], span, out=np.zeros(n - 1), where=span > 0)
    out = np.zeros((n - 1, n))
    np.add.at(out, (np.arange(n - 1), a), 1 - t)
    np.add.at(out, (np.arange(n - 1), b), t)
    return out
