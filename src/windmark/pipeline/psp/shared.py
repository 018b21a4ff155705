"""Pictures that several points name: they were taken once, so what two rows say of that instant must be the same."""

from __future__ import annotations

from collections.abc import Sequence

from windmark.pipeline.psp.record import PointRecord
from windmark.pipeline.psp.stream import differs, in_words
from windmark.pipeline.psp.table import WIND_OFF, WIND_ON, PointRow

STREAM = ("mach", "p_inf", "q_inf", "t_0", "alpha_deg", "beta_deg")
"""What a row says of the instant of its wind-on pictures."""
AT_REST = ("p_off", "t_off")
"""And of its wind-off ones."""
DRIFTS = 0.01
"""Part by which pressure and temperature of one series of wind-off pictures may differ from row to row: tables have the
barometer of the row's own time."""


def shared_pictures(records: Sequence[PointRecord], rows: Sequence[PointRow]) -> list[tuple[str, str]]:
    """Points with pictures that an earlier point has, too, and of which it says otherwise, and what, in words.

    `Once` looks within a point; here it is the prints of all points' pictures that are compared, whatever their files
    are called. That several rows name the same wind-off pictures is no fault where they say the same of them. Parts of
    references that are not the row's own (`PointRow.parts`) are those of a table, or other points of the run.
    """
    of = {row.name: row for row in rows}
    first: dict[bytes, tuple[str, tuple[str, str, str]]] = {}
    both: dict[tuple[str, str, str, str], list[str]] = {}
    for r in records:
        for content, taken in r.taken.items():
            kind, name, _ = taken
            if "(" in kind or r.name not in of:
                continue
            before, its = first.setdefault(content, (r.name, taken))
            if before != r.name and (why := _contradiction(of[before], its, of[r.name], taken)):
                both.setdefault((before, r.name, _kind(kind), why), []).append(name)
    out = []
    for (before, other, kind, why), names in both.items():
        pictures = f"picture {names[0]}" if len(names) == 1 else f"pictures, {len(names)} of them (first {names[0]})"
        out.append((other, f"points {before} and {other} have the same {kind} {pictures}, but {why}"))
    return out


def _kind(kind: str) -> str:
    return WIND_ON if kind.startswith(WIND_ON) else WIND_OFF


def _contradiction(a: PointRow, its: tuple[str, str, str], b: PointRow, taken: tuple[str, str, str]) -> str:
    """What two rows say of one picture that cannot both be right; "" for nothing."""
    if its[2] != taken[2]:
        return f"it is of {its[2]} and of {taken[2]}"
    kinds = _kind(its[0]), _kind(taken[0])
    if kinds[0] != kinds[1]:
        # A point at low speed may be what others are compared with: then that is the state of their reference.
        on, off = (a, b) if kinds[0] == WIND_ON else (b, a)
        if not differs("p_inf", on.p_inf, off.p_off, DRIFTS):
            return ""
        return (f"{on.name} has it as wind-on at p_inf {in_words('p_inf', on.p_inf)}, {off.name} as wind-off at p_off "
                f"{in_words('p_off', off.p_off)}")  # fmt: skip
    keys, part = (STREAM, {}) if kinds[0] == WIND_ON else (AT_REST, {"part": DRIFTS})
    odd = [key for key in keys if differs(key, getattr(a, key), getattr(b, key), **part)]
    both = [f"{in_words(k)} {in_words(k, getattr(a, k))} and {in_words(k, getattr(b, k))}" for k in odd]
    return f"their rows say {', '.join(both)}" if both else ""
