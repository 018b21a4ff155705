"""The numbers of a point: what tables, report and journal have of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.paint import COEFFICIENTS, CamerasApart, InSitu, dominant
from windmark.pipeline.alike import alike
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.psp.point import PointOutcome
from windmark.pipeline.psp.table import PointRow
from windmark.tasks.psp import Scatter, SurfaceSection, TapTable, shown_areas

Array = NDArray[np.float64]

REDUCED, FAILED = "reduced", "failed"


@dataclass(frozen=True, eq=False)
class SectionRecord:
    """Cp along a cut, see `SurfaceSection`; (K,) taps in it that count: x / c, Cp and sigma; why it has no loads."""

    name: str
    xyz: Array
    x_c: Array
    upper: NDArray[np.bool_]
    cp: Array
    sigma: Array
    line: NDArray[np.int32]
    tap_x_c: Array
    tap_cp: Array
    tap_sigma: Array
    why: str = ""


@dataclass(frozen=True, eq=False)
class PointRecord:
    """What became of a point.

    Parameters
    ----------
    name, alpha_deg : of the table
    pictures : camera and kind -> names, sizes and checksums of its pictures
    status, reason : `REDUCED`; or `FAILED`, and why
    remarks : what is to be said of it
    alpha_seen_deg, beta_seen_deg : incidence and sideslip that the pictures show
    rms_px : median residual of the registrations
    pictures_used : wind-on and wind-off pictures that count
    seen : part of the grid's nodes with a Cp
    median_sigma_cp : over these
    contradiction_cp : part of it that is there because Mach, p_inf and q_inf contradict each other
    flicker, systematic : of the lamps (NaN: nothing says it), and by which cameras differ, see `MergedRatio`
    apart : of each two cameras, see `CamerasApart`
    scatter : of the pictures of each camera and kind
    several : what tells that pictures of several states are named, in words
    taken : content of each of its pictures, see `same_picture.content_of` -> kind, name, camera
    fit : figures of the fit to the taps, empty without one
    loads : volume -> coefficient -> value and sigma
    shown : volume -> part of its area that is on a side that cameras show: loads are those of this part
    causes : what dominates: of "Cp" over all nodes, of "CL" of all volumes -> (cause, share), the largest first
    taps, sections : paint against taps, Cp along cuts
    followed : what was said of every instant of its pictures
    seconds : for each stage
    """

    name: str
    alpha_deg: float
    pictures: Mapping[str, str]
    status: str
    reason: str = ""
    remarks: tuple[str, ...] = ()
    alpha_seen_deg: float = float("nan")
    rms_px: float = float("nan")
    pictures_used: tuple[int, int] = (0, 0)
    seen: float = 0.0
    median_sigma_cp: float = float("nan")
    contradiction_cp: float = 0.0
    flicker: float = float("nan")
    systematic: float = float("nan")
    fit: Mapping[str, float] = field(default_factory=dict)
    loads: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    shown: Mapping[str, float] = field(default_factory=dict)
    causes: Mapping[str, list[tuple[str, float]]] = field(default_factory=dict)
    taps: TapTable | None = None
    sections: tuple[SectionRecord, ...] = ()
    followed: tuple[Followed, ...] = ()
    apart: tuple[CamerasApart, ...] = ()
    scatter: tuple[Scatter, ...] = ()
    several: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    taken: Mapping[bytes, tuple[str, str, str]] = field(default_factory=dict)
    beta_seen_deg: float = float("nan")

    @property
    def key(self) -> str:
        """The point's name."""
        return self.name


def failed(row: PointRow, pictures: Mapping[str, str], why: str) -> PointRecord:
    """A point that could not be reduced."""
    return PointRecord(row.name, row.alpha_deg, pictures, FAILED, why)


def record_of(row: PointRow, pictures: Mapping[str, str], done: PointOutcome) -> PointRecord:
    """The numbers of a reduced point."""
    reduced = done.reduced
    troubles = [f"{what}: {why}" for found in (done.on, done.off) for what, why in found.troubles.items()]
    known = reduced.cp.known
    used = np.isin(np.arange(len(reduced.cp)), reduced.mesh.used)
    loads, causes = {}, {"Cp": dominant(reduced.cp)}
    if reduced.loads is not None:
        loads = {name: reduced.loads.row(name) for name in reduced.loads.names}
        causes["CL"] = reduced.loads.dominant("all", "CL")
        troubles += reduced.loads.warnings
    without = {s.name: s.why for s in reduced.section_loads}
    counts = tuple(sum(name not in reduced.merged.left_out for name in found.names) for found in (done.on, done.off))
    return PointRecord(
        row.name, row.alpha_deg, pictures, REDUCED, "", (*reduced.remarks, *troubles), done.alpha_seen_deg,
        float(np.median([*done.on.rms_px, *done.off.rms_px])), (counts[0], counts[1]),
        float((known & used).sum() / max(int(used.sum()), 1)),
        float(np.median(reduced.cp.sigma[known])),
        abs(row.contradiction) * row.p_inf / row.q_inf / np.sqrt(3), reduced.merged.flicker, reduced.merged.systematic,
        _fit(reduced.in_situ), loads, shown_areas(reduced.mesh, reduced.shown), causes,
        reduced.taps,
        tuple(_section(s, reduced.taps, without) for s in reduced.sections),
        (*done.on.followed, *done.off.followed), reduced.merged.apart,
        reduced.merged.scatter, (*done.on.several, *done.off.several),
        dict(done.seconds), dict(done.pictures), done.beta_seen_deg,
    )  # fmt: skip


def _section(s: SurfaceSection, taps: TapTable | None, without: Mapping[str, str]) -> SectionRecord:
    at = np.array([k for k in s.taps if taps is not None and not taps.words[k]], dtype=int)
    cp, sigma = (np.zeros(0), np.zeros(0)) if taps is None else (taps.cp[at], taps.cp_sigma[at])
    p, x_c = s.profile, s.tap_x_c[np.isin(s.taps, at)]
    return SectionRecord(s.name, p.xyz, p.x_c, p.upper, p.cp.value, p.cp.sigma, p.line, x_c, cp, sigma,
                         without.get(s.name, ""))  # fmt: skip


def _fit(fit: InSitu | None) -> dict[str, float]:
    """Slope and offset (at the middle of the taps), and how well taps and paint agree, in pascals."""
    if fit is None:
        return {}
    slope = float(fit.coefficients[1] / fit.scale) if len(fit.coefficients) > 1 else float("nan")
    return {
        "taps": int(fit.used.sum()), "slope": slope, "slope_free": float(fit.free == "both"),
        "offset_Pa": float(fit.coefficients[0] - fit.center),
        "rms_Pa": fit.rms, "leave_one_out_rms_Pa": fit.loo_rms, "scatter_Pa": fit.scatter,
        "noise_Pa": fit.noise, **_moved(fit),
    }  # fmt: skip


def _moved(fit: InSitu) -> dict[str, float]:
    """By how much the fit moves the paint's own pressure, and by how much it may where both are right."""
    (_, offset_sigma), (_, slope_sigma) = fit.moved
    sigmas = {"offset_sigma_Pa": offset_sigma, "slope_sigma": slope_sigma}
    return {key: value for key, value in sigmas.items() if np.isfinite(value)}


def load_columns(records: list[PointRecord]) -> dict[str, NDArray]:
    """The table of loads: a row for each point and volume."""
    rows = [(r, volume, of) for r in records for volume, of in r.loads.items()]
    out: dict[str, NDArray] = {
        "point": np.array([r.name for r, _, _ in rows], dtype=np.str_),
        "alpha_deg": np.array([r.alpha_deg for r, _, _ in rows]),
        "volume": np.array([v for _, v, _ in rows], dtype=np.str_),
        "area_shown": np.array([r.shown.get(v, np.nan) for r, v, _ in rows]),
    }
    for name in COEFFICIENTS:
        out[name] = np.array([of[name][0] for _, _, of in rows])
        out[f"sigma_{name}"] = np.array([of[name][1] for _, _, of in rows])
    return out


def grouped(records: Sequence[PointRecord]) -> dict[str, list[str]]:
    """What is to be said of points -> their names; numbers that differ from point to point are those of the first."""
    return alike((r.name, remark) for r in records for remark in r.remarks)
