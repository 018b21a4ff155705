"""The file of a paint's calibration: what `windmark paint-calibrate` writes and a project's ``[paint]`` names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from windmark import io
from windmark.errors import UsageError, WindmarkError, g3
from windmark.paint import PaintFit, SternVolmer, TemperaturePaint, TunnelGain
from windmark.paint.modes import principal_axes
from windmark.pipeline.project_entries import Finite, Positive
from windmark.pipeline.settings import Strict, explained

FORMAT = "windmark paint calibration 1"

Span = tuple[Finite, Finite]
Row = tuple[Finite, ...]


@dataclass(frozen=True, eq=False)
class PaintCalibration:
    """A calibrated paint as a job uses it.

    Parameters
    ----------
    law : with its covariance; of pressure itself, or of small changes about a steady one
    rms, cv_rms : of the calibration's residuals, and of each row against the others; NaN where not known
    warnings : what is to be said of it, in words
    source : the file that it comes from
    """

    law: SternVolmer | TunnelGain
    rms: float
    cv_rms: float
    warnings: tuple[str, ...]
    source: Path

    def __str__(self) -> str:
        law = self.law
        p, t = (f"{low:g} to {high:g}" for low, high in (law.p_range, law.t_range))
        if isinstance(law, TunnelGain):
            return (f"the tunnel's gain form; steady pressures of {p} {law.pressure_unit}, {t} {law.temperature_unit}"
                    f"{', taken as exact' if law.cov is None else ''}")  # fmt: skip
        return (f"order {law.order[0]} in pressure, {law.order[1]} in temperature, RMS {g3(self.rms)}, cross-validated "
                f"{g3(self.cv_rms)}; {p} Pa, {t} K")  # fmt: skip

    def record(self) -> dict[str, Any]:
        """Its figures."""
        if isinstance(self.law, TunnelGain):
            return {"gain": self.law.coefficients.tolist()}
        return {"orders": list(self.law.order), "rms": self.rms, "cross_validated_rms": self.cv_rms}

    @staticmethod
    def of_fit(fit: PaintFit, source: Path) -> PaintCalibration:
        """The calibration of a table of cell measurements."""
        return PaintCalibration(fit.law, fit.rms, fit.cv_rms, fit.warnings, source)


class _File(Strict):
    """What both kinds have. ``cov``: of the coefficients row by row, null where they are taken as exact."""

    format: Literal["windmark paint calibration 1"]
    coefficients: Any
    t_ref_K: Finite
    t_range_K: Span
    cov: tuple[Row, ...] | None = None
    rms: Finite | None = None
    cv_rms: Finite | None = None
    warnings: tuple[str, ...] = ()
    made_of: str = ""
    rows: int = 0


class PressureFile(_File):
    """I_ref / I = sum over k, j of coefficients[k][j] (p / p_ref)^k (T - T_ref)^j, see `paint.SternVolmer`."""

    kind: Literal["pressure"]
    coefficients: tuple[Row, ...]
    p_ref_Pa: Positive
    p_range_Pa: Span
    chosen_order: tuple[int, int] | None = None
    orders: Mapping[str, float | str] = Field(default_factory=dict)


class TemperatureFile(_File):
    """ln(I_ref / I) = sum over k of coefficients[k] (T - T_ref)^k, see `paint.TemperaturePaint`."""

    kind: Literal["temperature"]
    coefficients: Row


class GainFile(Strict):
    """dp / d(I_ss / I) = a + b T + c T^2 + (d + e T + f T^2) p_ss, ``coefficients`` a to f, see `paint.TunnelGain`.

    ``p_range``, ``t_range``: calibrated range of steady pressure and temperature; all in ``pressure_unit`` and
    ``temperature_unit``. ``cov``: as in the others.
    """

    format: Literal["windmark paint calibration 1"]
    kind: Literal["gain"]
    coefficients: tuple[Finite, Finite, Finite, Finite, Finite, Finite]
    p_range: Span
    t_range: Span
    pressure_unit: Literal["Pa", "psf"] = "Pa"
    temperature_unit: Literal["K", "degC", "degF"] = "K"
    cov: tuple[Row, ...] | None = None
    warnings: tuple[str, ...] = ()
    made_of: str = ""


AnyFile = PressureFile | TemperatureFile | GainFile
KINDS: dict[str, type[AnyFile]] = {"pressure": PressureFile, "temperature": TemperatureFile, "gain": GainFile}


def pressure_record(fit: PaintFit, source: Path) -> dict[str, Any]:
    """The content of a calibration file of pressure; ``source``: the table of M rows that it was made of."""
    law = fit.law
    return {
        "format": FORMAT, "kind": "pressure", "coefficients": law.coefficients, "p_ref_Pa": law.p_ref,
        "t_ref_K": law.t_ref, "p_range_Pa": law.p_range, "t_range_K": law.t_range, "cov": law.cov,
        "chosen_order": fit.order, "orders": {f"{k},{j}": of for (k, j), of in fit.orders.items()},
        **_quality(fit.rms, fit.cv_rms, fit.warnings, source, len(fit.residuals)),
    }  # fmt: skip


def temperature_record(law: TemperaturePaint, source: Path, rows: int) -> dict[str, Any]:
    """The content of a calibration file of temperature."""
    return {
        "format": FORMAT, "kind": "temperature", "coefficients": law.coefficients, "t_ref_K": law.t_ref,
        "t_range_K": law.t_range, "cov": law.cov, **_quality(law.rms, law.cv_rms, (), source, rows),
    }  # fmt: skip


def _quality(rms: float, cv_rms: float, warnings: tuple[str, ...], source: Path, rows: int) -> dict[str, Any]:
    return {"rms": rms, "cv_rms": cv_rms, "warnings": warnings, "made_of": source.name, "rows": rows}


def read_calibration(path: Path) -> PaintCalibration:
    """A calibration of pressure, or of the gain of small changes about a steady one.

    Raises
    ------
    FileError
        For what is no such file, is one of temperature, or has a law without an inverse or no covariance.
    """
    content = _read(path)
    nan = float("nan")
    if isinstance(content, GainFile):
        spans = {"p_range": content.p_range, "t_range": content.t_range}
        if (empty := next((key for key, (low, high) in spans.items() if not low < high), "")):
            raise io.FileError(path, "expected two numbers, the smaller one first", empty)
        gain: TunnelGain = _made(path, content, lambda cov: TunnelGain(
            np.array(content.coefficients), content.p_range, content.t_range, cov, content.pressure_unit,
            content.temperature_unit,
        ))  # fmt: skip
        return PaintCalibration(gain, nan, nan, content.warnings, path)
    if not isinstance(content, PressureFile):
        raise io.FileError(path, "is the calibration of a temperature paint; expected one of pressure", "kind")
    law = _made(path, content, lambda cov: SternVolmer(
        np.array(content.coefficients), content.p_ref_Pa, content.t_ref_K, content.p_range_Pa, content.t_range_K, cov,
    ))  # fmt: skip
    rms, cv_rms = (nan if v is None else v for v in (content.rms, content.cv_rms))
    return PaintCalibration(law, rms, cv_rms, content.warnings, path)


def read_temperature_calibration(path: Path) -> TemperaturePaint:
    """A calibration of temperature; see `read_calibration`."""
    content = _read(path)
    if not isinstance(content, TemperatureFile):
        raise io.FileError(path, "is the calibration of a pressure paint; expected one of temperature", "kind")
    nan = float("nan")
    rms, cv_rms = (nan if v is None else v for v in (content.rms, content.cv_rms))
    law: TemperaturePaint = _made(path, content, lambda cov: TemperaturePaint(
        np.array(content.coefficients), content.t_ref_K, content.t_range_K, cov, rms, cv_rms,
    ))  # fmt: skip
    return law


def _read(path: Path) -> AnyFile:
    content = io.read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise io.FileError(path, f"expected {FORMAT!r}, as windmark paint-calibrate writes it", "format")
    kind = KINDS.get(str(content.get("kind")))
    if kind is None:
        raise io.FileError(path, f"expected one of {', '.join(KINDS)}, got {content.get('kind')!r}", "kind")
    try:
        return kind(**content)
    except ValidationError as error:
        raise explained(path, error, kind) from None


def _made(path: Path, content: AnyFile, make: Any) -> Any:
    """The law; what is wrong with it is the file's fault."""
    sizes = [np.size(row) for row in content.coefficients]
    try:
        if len(sizes) < 2 or len(set(sizes)) > 1 or not np.isfinite(content.coefficients).all():
            raise UsageError("coefficients must be two or more, finite, in rows of one length")
        if content.cov is None:
            return make(None)
        if {len(content.cov), *map(len, content.cov)} != {sum(sizes)} or not np.isfinite(content.cov).all():
            raise UsageError(f"cov must be {sum(sizes)} x {sum(sizes)} finite numbers, as there are coefficients")
        cov = np.array(content.cov, dtype=float)
        principal_axes(cov)
        return make(cov)
    except WindmarkError as error:
        raise io.FileError(path, str(error), "coefficients, ranges and cov") from None
