"""Tunnel conditions in NASA's ``.wtd`` files: a line of names that starts with ``#``, one of values, taps after it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from windmark import io
from windmark.io.text import read_text

PSF_Pa, MISSING = 47.880259, 9999.0
"""Pressures are in pounds per square foot, TTF in degrees Fahrenheit: the file itself does not say so. Values from
``MISSING`` on stand for none."""
NAMES = {"alpha_deg": "ALPHA", "beta_deg": "BETA", "mach": "MACH", "p_inf": "PS", "q_inf": "Q", "t_0": "TTF"}
"""Columns of the table of points (`PointRow`) -> names in the file."""


def read_wtd(path: Path) -> Mapping[str, float]:
    """The stream of one point: `NAMES` -> value in degrees, pascals and kelvin; NaN for what the file does not say.

    A static or dynamic pressure, or a Mach number, of 0 is none; where the total pressure is 0 nothing was measured of
    pressures and temperature.

    Raises
    ------
    FileError
        For a file without a line of names and one of as many numbers.
    """
    lines = read_text(path).splitlines()
    at = next((k for k, line in enumerate(lines) if line.startswith("#") and "MACH" in line.upper().split()), None)
    if at is None:
        raise io.FileError(path, "has no line of names that starts with # and has MACH in it")
    names, cells = lines[at].lstrip("#").upper().split(), lines[at + 1].split() if at + 1 < len(lines) else []
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        values = []
    if len(values) != len(names) or len(set(names)) < len(names):
        raise io.FileError(path, f"has {len(names)} names; expected as many different ones, and as many numbers below "
                           "them", at + 2)  # fmt: skip
    said = {n: v if abs(v) < MISSING else np.nan for n, v in zip(names, values, strict=True)}
    out = {key: said.get(name, np.nan) for key, name in NAMES.items()}
    if said.get("PTOT") == 0:
        out |= {"p_inf": np.nan, "q_inf": np.nan, "t_0": np.nan}
    for key in ("mach", "p_inf", "q_inf"):
        out[key] = out[key] if out[key] > 0 else np.nan
    return {**out, "p_inf": out["p_inf"] * PSF_Pa, "q_inf": out["q_inf"] * PSF_Pa,
            "t_0": (out["t_0"] - 32) * 5 / 9 + 273.15}  # fmt: skip
