"""The verb `windmark paint-calibrate`: a table of cell measurements to a calibration file, and a picture of the fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from windmark import io
from windmark.app import console
from windmark.app.alone import not_drawn, png_alone
from windmark.app.verdict_words import judged
from windmark.errors import UsageError, g3
from windmark.paint import PaintFit, TemperaturePaint
from windmark.paint.cell_fit import MOST_P, MOST_T
from windmark.paint.temperature_paint import MOST_ORDER
from windmark.pipeline.psp.calibration import pressure_record, temperature_record
from windmark.pipeline.psp.cell import CellTable, calibrate_paint, calibrate_temperature_paint, read_cell
from windmark.pipeline.verdict import Verdict
from windmark.pipeline.verdict.cell import pressure_verdict, temperature_verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Record = dict[str, Any]


def paint_calibrate(
    table: Path, output: Path, p_ref_Pa: float, t_ref_K: float, order: str | None, temperature: bool, as_json: bool
) -> None:
    """Fit, write the file and beside it the picture, both or none; say how good it is."""
    orders = _orders(order, temperature)
    picture = output.with_suffix(".png")
    if picture == output:
        raise UsageError(f"--output {output}: expected the name of a JSON file; the picture beside it ends in .png")
    io.try_paths([output, picture], console.complain)
    cell = read_cell(table, pressure=not temperature)
    record, lines, verdict, draw = (_temperature if temperature else _pressure)(cell, p_ref_Pa, t_ref_K, orders)
    failed: list[str] = []
    drawn = png_alone(picture.name, draw, failed)
    with io.atomic_paths([output, *([] if drawn is None else [picture])]) as places:
        io.write_json(places[output], record)
        if drawn is not None:
            places[picture].write_bytes(drawn)
    written = [output] if drawn is None else [output, picture]
    key = "[temperature] paint" if temperature else "[paint] calibration"
    said = {**record, "output": output, "not_drawn": failed}
    lines += [*judged(said, verdict), *not_drawn(failed), f"written: {', '.join(map(str, written))}",
              f"in a project: {key} = \"{output.name}\""]
    console.answer(said, as_json, lines)


def _orders(text: str | None, temperature: bool) -> tuple[int, ...] | None:
    """Of the option ``--order``: ``2,1``, or ``2`` for a temperature paint."""
    if text is None:
        return None
    count, example = (1, "2") if temperature else (2, "2,1 (powers of pressure and of temperature)")
    try:
        found = tuple(int(part) for part in text.split(","))
    except ValueError:
        found = ()
    least, most = ((1,), (MOST_ORDER,)) if temperature else ((1, 0), (MOST_P, MOST_T))
    if len(found) != count or not all(a <= k <= b for a, k, b in zip(least, found, most, strict=True)):
        limits = " and ".join(f"{a} to {b}" for a, b in zip(least, most, strict=True))
        raise UsageError(f"--order must be whole numbers such as {example}, within {limits}, got {text!r}")
    return found


def _pressure(
    cell: CellTable, p_ref_Pa: float, t_ref_K: float, orders: tuple[int, ...] | None
) -> tuple[Record, list[str], Verdict, Callable[[], Figure]]:
    fit = calibrate_paint(
        cell, p_ref_Pa=p_ref_Pa, t_ref_K=t_ref_K, orders=None if orders is None else (orders[0], orders[1])
    )

    def draw() -> Figure:
        from windmark.app.paint_pictures import pressure_picture

        return pressure_picture(cell, fit)

    return pressure_record(fit, cell.path), _pressure_lines(fit), pressure_verdict(fit, cell), draw


def _pressure_lines(fit: PaintFit) -> list[str]:
    """The calibration in words, with what the paint does in the middle of its range."""
    law = fit.law
    p, t = np.mean(law.p_range), np.mean(law.t_range)
    by_p, by_t, by_a = (a[0] for a in law.slopes([p], [t]))
    ratio, p_sigma = law.ratio(p, t), np.sqrt(max(by_a @ law.cov @ by_a, 0.0)) / by_p if law.cov is not None else 0.0
    said = "as asked for" if len(fit.orders) == 1 else "chosen by cross-validation"
    return [
        f"{len(fit.residuals)} measurements, {law.p_range[0]:g} to {law.p_range[1]:g} Pa, {law.t_range[0]:g} to "
        f"{law.t_range[1]:g} K",
        f"order {fit.order[0]} in pressure and {fit.order[1]} in temperature ({said}), RMS {g3(fit.rms)}, "
        f"cross-validated {g3(fit.cv_rms)}" + _beyond(fit),
        f"at {p:.6g} Pa and {t:.5g} K: {g3(by_p * p / ratio)} % per % of pressure, "
        f"{g3(100 * by_t / ratio)} % per K; the calibration leaves {g3(p_sigma)} Pa open (1 sigma)",
        *(f"note: {words}" for words in fit.warnings),
    ]  # fmt: skip


def _beyond(fit: PaintFit) -> str:
    if fit.law.order == fit.order:
        return ""
    return f"; the law is the mean of the possible orders, up to {fit.law.order[0]} and {fit.law.order[1]}"


def _temperature(
    cell: CellTable, p_ref_Pa: float, t_ref_K: float, orders: tuple[int, ...] | None
) -> tuple[Record, list[str], Verdict, Callable[[], Figure]]:
    law = calibrate_temperature_paint(cell, t_ref_K=t_ref_K, order=None if orders is None else orders[0])

    def draw() -> Figure:
        from windmark.app.paint_pictures import temperature_picture

        return temperature_picture(cell, law)

    rows = len(cell.ratio)
    said = temperature_verdict(law, cell)
    lines = [*_temperature_lines(law, rows), *(f"note: {words}" for words in cell.remarks)]
    return temperature_record(law, cell.path, rows), lines, said, draw


def _temperature_lines(law: TemperaturePaint, rows: int) -> list[str]:
    t = np.mean(law.t_range)
    slope = float(np.diff(law.log_ratio([t - 0.5, t + 0.5]))[0])
    return [
        f"{rows} measurements, {law.t_range[0]:g} to {law.t_range[1]:g} K",
        f"order {len(law.coefficients) - 1}, RMS {g3(law.rms)} of ln(I_ref / I), cross-validated {g3(law.cv_rms)}",
        f"at {t:.5g} K: {g3(100 * slope)} % per K",
    ]
