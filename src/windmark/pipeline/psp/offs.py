"""The reference of points that name no wind-off pictures of their own: by incidence, or the mean of their run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from windmark import io
from windmark.errors import DataError
from windmark.paint import reference_shares
from windmark.pipeline.psp.columns import in_unit, temperatures
from windmark.pipeline.psp.stream import FROZEN_K, PRESSURE, joined
from windmark.pipeline.psp.table import CHANNELS, PointRow, ReferencePart


def read_references(path: Path) -> tuple[ReferencePart, ...]:
    """A CSV table ``alpha_deg,p_off_UNIT,T_off_UNIT,off[,off_reference][,off_temperature]``, a row per incidence.

    Raises
    ------
    FileError
        For a missing column or cell, an incidence that is there twice, values that no tunnel has, or no row.
    """
    table = io.read_table(path, required=("alpha_deg", "off"), known=None)
    if not len(table):
        raise io.FileError(path, "has no rows; expected wind-off pictures of an incidence in each")
    alpha, p, t = table.numbers("alpha_deg"), in_unit(table, "p_off", PRESSURE), temperatures(table, "T_off")
    off = table.text("off")
    table.check([bool(pattern) for pattern in off], "off must name pictures")
    table.check(p > 0, "p_off must be a number above zero")
    table.check(t > FROZEN_K, f"T_off must be above {FROZEN_K:g} K: is it in the column's unit?")
    table.check([a not in alpha[:k] for k, a in enumerate(alpha)], "alpha_deg is there more than once")
    colours = {name: table.text(f"off_{name}") for name in CHANNELS if f"off_{name}" in table}
    return tuple(
        ReferencePart(f"at {alpha[k]:g} degrees", float(alpha[k]), 1.0, off[k], {n: of[k] for n, of in colours.items()},
                      float(p[k]), float(t[k])) for k in range(len(off))
    )  # fmt: skip


def by_incidence(rows: Sequence[PointRow], references: Sequence[ReferencePart]) -> tuple[PointRow, ...]:
    """Points that name no wind-off pictures get the references that they lie between, see `paint.reference_at`."""
    return tuple(row if row.off or row.trouble else _between(row, references) for row in rows)


def _between(row: PointRow, references: Sequence[ReferencePart]) -> PointRow:
    if not np.isfinite(row.alpha_deg):
        return row  # said where conditions are missing
    at = [of.alpha_deg for of in references]
    try:
        shares = reference_shares(at, row.alpha_deg)
    except DataError as error:
        why = str(error).removeprefix("reference_at: ")
        return replace(row, trouble=f"{why}: light is not taken on so far (line {row.line} of the table of points)")
    parts = tuple(replace(references[k], share=share) for k, share in shares.items())
    p, t = (sum(share * getattr(references[k], name) for k, share in shares.items()) for name in ("p_off", "t_off"))
    values, words = joined([
        ("the table of references", {"p_off": p, "t_off": t}), ("its row", {"p_off": row.p_off, "t_off": row.t_off})
    ])  # fmt: skip
    if min(shares.values()) < 0:
        words = (*words, f"its incidence {row.alpha_deg:g} lies beyond the references' {min(at):g} to {max(at):g}: "
                 "their light is taken to go on straight")  # fmt: skip
    return replace(row, p_off=values["p_off"], t_off=values["t_off"], parts=parts, remarks=(*row.remarks, *words))


def by_run(rows: Sequence[PointRow]) -> tuple[PointRow, ...]:
    """Every point gets the other points of its run: its reference is the mean of all of them, its own pictures too."""
    out = []
    for row in rows:
        others = [of for of in rows if of.run == row.run and of is not row]
        place = f"(line {row.line} of the table of points)"
        trouble = row.trouble
        if row.off or any(off for _, off in row.channels.values()):
            trouble = trouble or f"its row names wind-off pictures, but its reference is the mean of its run {place}"
        if "temperature" in row.channels:
            trouble = trouble or ("a temperature paint needs a reference of one temperature, which the mean of a run "
                                  f"is not {place}")  # fmt: skip
        if not others:
            trouble = trouble or f"its run {row.run!r} has no other point: the mean of a run needs two or more {place}"
        parts = tuple(
            ReferencePart(f"point {of.name}", of.alpha_deg, 1 / len(others), of.on, {n: on for n, (on, _) in
                                                                                     of.channels.items()})
            for of in others
        )  # fmt: skip
        out.append(replace(row, trouble=trouble, parts=parts, own=True))
    return tuple(out)


def run_remarks(rows: Sequence[PointRow], most_deg: float) -> list[str]:
    """Runs whose points are no small changes about one state: their incidences differ by more than ``most_deg``."""
    out = []
    for run in dict.fromkeys(row.run for row in rows):
        alpha = np.array([row.alpha_deg for row in rows if row.run == run])
        span = float(np.ptp(alpha[np.isfinite(alpha)])) if np.isfinite(alpha).any() else 0.0
        if span > most_deg:
            out.append(f"run {run!r}: its incidences span {span:g} degrees; the mean of a run stands for one steady "
                       "state, and the gain holds for small changes about it")  # fmt: skip
    return out

