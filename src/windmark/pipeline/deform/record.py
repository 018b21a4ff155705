"""What is kept of every frame: a few numbers, relative to the wind-off zero, with their sigma."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation, Stations, span_values
from windmark.geometry import Pose
from windmark.scene import MarkerSet
from windmark.tasks.deform.task import DeformedFrame, Sight
from windmark.tasks.deform.zero import Zero, motion_since

Array = NDArray[np.float64]
Pair = tuple[Array, Array]

MISFIT = "misfit"
"""Status of a frame whose laws do not explain it: its numbers are there, with sigmas that contain the misfit."""
DOUBTFUL = 5.0
"""A spot whose sigma is so many times the median of its frame has something on it or beside it."""


@dataclass(frozen=True)
class FrameRecord:
    """One instant.

    Parameters
    ----------
    index, key, instant, time_s, seconds : see `DeformedFrame`
    status : that of the frame; "misfit" where more of the residuals is misfit than noise
    reason : that of the frame, and the warnings that name something or belong to a misfit
    spots, outliers : observations, and those left out
    rms_px, sigma0 : of the residuals
    doubtful : camera and marker of the spots that are much less certain than the others, see `doubtful`
    q, q_sigma : (K,) laws' parameters less the zero
    motion, motion_sigma : (6,) see `MOTION`
    bending, bending_sigma, twist, twist_sigma : (S,) by the laws alone, less the zero
    pitch, pitch_sigma : (S,) twist with the rigid motion, less the zero
    latency_s : from the newest image's time stamp to the result; NaN unless live
    cameras : camera -> what it saw, and why that is little
    warnings, suspect : see `Deformation`
    causes : of each warning, see `Doubt`
    unchecked : what the images cannot tell and no sigma contains
    series : cause and sentence of what all frames so far say together

    Every sigma is that of the state's covariance, which contains what the residuals show: they may say that laws,
    tables and lens are worse than what was stated, never that they are better.
    """

    index: int
    key: str
    instant: float
    time_s: float
    status: str
    reason: str
    seconds: float
    spots: int
    outliers: int
    rms_px: float
    sigma0: float
    q: Array
    q_sigma: Array
    motion: Array
    motion_sigma: Array
    bending: Array = field(default_factory=lambda: np.zeros(0))
    bending_sigma: Array = field(default_factory=lambda: np.zeros(0))
    twist: Array = field(default_factory=lambda: np.zeros(0))
    twist_sigma: Array = field(default_factory=lambda: np.zeros(0))
    pitch: Array = field(default_factory=lambda: np.zeros(0))
    pitch_sigma: Array = field(default_factory=lambda: np.zeros(0))
    latency_s: float = float("nan")
    doubtful: tuple[str, ...] = ()
    cameras: Mapping[str, Sight] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    suspect: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()
    series: tuple[tuple[str, str], ...] = ()


def doubtful(frame: DeformedFrame, names: NDArray[np.str_]) -> tuple[str, ...]:
    """Text camera/marker of the spots that took part with `DOUBTFUL` times the usual sigma, in the order of the spots.

    Something lies on them or beside them (an edge, another part of the model, a highlight): the detector says so in
    their covariance, and they hardly count.
    """
    seen, state = frame.observations, frame.state
    if seen is None or state is None:
        return ()
    size = np.sqrt(np.trace(seen.cov, axis1=1, axis2=2))
    which = np.flatnonzero(state.used & (size > DOUBTFUL * np.median(size)))
    return tuple(f"{frame.views[seen.view[k]]}/{names[seen.point[k]]}" for k in which)


def record(
    frame: DeformedFrame, zero: Zero | None, stations: Stations | None, markers: MarkerSet, centre: Array,
    time_s: float, latency_s: float, count: int,
) -> FrameRecord:  # fmt: skip
    """The numbers of a frame.

    Parameters
    ----------
    markers : of model and walls
    centre : (3,) the point whose shift is reported, in the model's frame
    count : number of the laws' parameters
    """
    common = (frame.index, frame.key, frame.instant, time_s, frame.status, frame.reason, frame.seconds)
    span, series = 0 if stations is None else len(stations), tuple((d.cause, str(d)) for d in frame.series)
    if frame.state is None:
        nan, six, along = np.full(count, np.nan), np.full(6, np.nan), np.full(span, np.nan)
        return FrameRecord(
            *common, 0, 0, np.nan, np.nan, nan, nan, six, six, along, along, along, along, along, along, latency_s,
            cameras=frame.cameras, series=series,
        )  # fmt: skip
    state = frame.state
    q_sigma = np.array([state.sigma[n] for n in state.volumes.names])
    if zero is not None and zero.more is not None:
        q_sigma = np.sqrt(q_sigma**2 + np.diag(zero.more)[: len(q_sigma)])
    motion, motion_sigma = _motion(state, zero, centre)
    none = np.zeros(0)
    bending, twist, pitch = ((none, none),) * 3 if stations is None else _span(state, zero, stations)
    named = [str(d) for d in state.doubts if d.names or not state.fits]
    status, reason = frame.status if state.fits else MISFIT, "; ".join([frame.reason] * bool(frame.reason) + named)
    return FrameRecord(
        *common[:4], status, reason, frame.seconds, len(state.used), int((~state.used).sum()), state.rms_px,
        state.sigma0,
        state.q - (zero.q if zero is not None else 0.0), q_sigma, motion, motion_sigma, *bending, *twist,
        *pitch, latency_s, doubtful(frame, markers.name), frame.cameras, state.warnings,
        state.suspect, tuple(d.cause for d in state.doubts), tuple(map(str, state.unchecked)), series,
    )  # fmt: skip


def _motion(state: Deformation, zero: Zero | None, centre: Array) -> tuple[Array, Array]:
    """Shift of the centre and rotation vector in degrees, less the zero, and their sigma."""
    first = zero.tunnel_from_model if zero is not None else Pose.identity()
    out, j = motion_since(state.tunnel_from_model, first, centre)
    cov = np.zeros((6, 6))
    if "motion" in state.slices:
        cov = j @ state.cov[state.slices["motion"], state.slices["motion"]] @ j.T
    if zero is not None:
        cov = cov + zero.more_of(np.zeros((6, len(state.q))), j)
    return out, np.sqrt(np.diag(cov))


def _span(state: Deformation, zero: Zero | None, stations: Stations) -> tuple[Pair, Pair, Pair]:
    """Bending, twist and pitch with their sigma, less the zero."""
    model, tunnel = (span_values(state, stations, frame=f) for f in ("model", "tunnel"))
    off = zero.span if zero is not None else None
    cov = [v.cov for v in (model, tunnel)]
    bending, twist, pitch = model.bending, model.twist_deg, tunnel.twist_deg
    if off is not None:
        bending, twist, pitch = bending - off[0].bending, twist - off[0].twist_deg, pitch - off[1].twist_deg
        cov = [c + o.cov for c, o in zip(cov, off, strict=True)]
    s = len(stations)
    sigma = [np.sqrt(np.diag(c)) for c in cov]
    return (bending, sigma[0][:s]), (twist, sigma[0][s:]), (pitch, sigma[1][s:])
