"""Calibration of pressure paint: ``python benchmarks/paint_calibration.py``.

Fresh paints (second order in pressure, one to two in temperature, at random), each calibrated from a table of its own:
orders chosen, error of p and coverage of its 95 % interval at pressures and temperatures inside of the range, sigma of
the table stated or not. Then in-situ: 20 taps of which none to six are blocked, a temperature error that all share, an
a-priori calibration with an error of its own: coverage, blocked taps missed, good taps left out, error with and without
in-situ. Seeds begin at 5000.
"""

from __future__ import annotations

import sys
import time
from collections import Counter

import numpy as np

from windmark.errors import UsageError
from windmark.paint import NodeField, PaintFit, SternVolmer, fit_paint, given_temperature, in_situ, pressure_map

P_REF, T_REF = 101325.0, 293.15


def random_paint(rng: np.random.Generator) -> SternVolmer:
    """A paint of 0.6 to 0.9 sensitivity, slightly curved, 0.3 to 1.5 % per K."""
    while True:
        curve, share = rng.uniform(-0.08, 0.08), rng.uniform(0.6, 0.9)
        by_t = rng.uniform(0.003, 0.015)
        a = np.array([[1 - share - curve, 0.2 * by_t, 0.0], [share, by_t, rng.uniform(-5e-5, 5e-5)], [curve, 0.0, 0.0]])
        try:
            return SternVolmer(a, P_REF, T_REF, (10e3, 160e3), (270.0, 325.0))
        except UsageError:
            continue


def cell_table(law: SternVolmer, rng: np.random.Generator, sigma: float) -> PaintFit:
    """Eight pressures by five temperatures of a cell."""
    p, t = (g.ravel() for g in np.meshgrid(np.linspace(2e4, 1.5e5, 8), np.linspace(280, 315, 5)))
    r = law.ratio(p, t) * (1 + sigma * rng.normal(size=p.size))
    stated = sigma * law.ratio(p, t) if rng.uniform() < 0.5 else None
    fit = fit_paint(p, t, r, p_ref=P_REF, t_ref=T_REF, ratio_sigma=stated)
    assert isinstance(fit, PaintFit), fit.reason
    return fit


def a_priori(runs: int) -> dict[str, float | str]:
    """Coverage of pressures by the calibration alone, and by calibration, ratio and temperature together."""
    alone, whole, orders, off = [], [], Counter(), []
    start = time.thread_time()
    for seed in range(runs):
        rng = np.random.default_rng(5000 + seed)
        law = random_paint(rng)
        fit = cell_table(law, rng, 0.003)
        orders[fit.order] += 1
        p, t = rng.uniform(2.2e4, 1.45e5, 100), rng.uniform(282, 313, 100)
        r = law.ratio(p, t) / law.ratio(9e4, 291.0)
        exact = pressure_map(fit.law, NodeField.make(r), given_temperature(t), p_off=9e4, t_off=291.0).field
        alone.append(np.abs(exact.value - p) < 1.96 * exact.sigma)
        e, cold = rng.normal(), 291.0 + 0.2 * rng.normal()
        got = pressure_map(
            fit.law, NodeField.make(r + 0.004 * rng.normal(size=100), 0.004),
            given_temperature(t + 0.3 * e + 0.1 * rng.normal(size=100), 0.1, common_sigma=0.3), p_off=9e4, t_off=cold,
            t_off_sigma=0.2,
        ).field  # fmt: skip
        whole.append(np.abs(got.value - p) < 1.96 * got.sigma)
        off.append((got.value - p) / p)
    return {
        "orders chosen": ", ".join(f"{o}: {n}" for o, n in orders.most_common()),
        "95 % interval holds %, calibration alone": float(100 * np.mean(alone)),
        "95 % interval holds %, with ratio and temperatures": float(100 * np.mean(whole)),
        "relative error of p, RMS %": float(100 * np.sqrt(np.mean(np.square(off)))),
        "cpu-s per calibration": (time.thread_time() - start) / runs,
    }


def taps(runs: int, blocked: int) -> dict[str, float]:
    """One number of blocked taps."""
    hold, before, error, plain, missed, lost, refused = [], [], [], [], 0, 0, 0
    for seed in range(runs):
        rng = np.random.default_rng(9000 + 1000 * blocked + seed)
        law = random_paint(rng)
        fit = cell_table(law, rng, 0.003).law
        true, nodes = rng.uniform(4.5e4, 9e4, 20), rng.uniform(4.7e4, 8.8e4, 50)
        e = rng.normal()
        warm = 1.5 * e  # the tunnel's temperature is known to 1.5 K

        def seen(p: np.ndarray, noise: float, *, rng=rng, law=law, fit=fit, warm=warm) -> NodeField:
            r = law.ratio(p, 296.0) / law.ratio(9e4, 291.0)
            return pressure_map(
                fit, NodeField.make(r * (1 + noise * rng.normal(size=len(p))), noise * r),
                given_temperature(296.0 + warm, common_sigma=1.5, count=len(p)), p_off=9e4, t_off=291.0).field

        readings = true + 60 * rng.normal(size=20)
        bad = rng.choice(20, blocked, replace=False)
        readings[bad] += rng.choice([-1, 1], blocked) * rng.uniform(2.5e3, 3e4, blocked)
        names = [f"t{k}" for k in range(20)]
        found = in_situ(names, readings, seen(true, 0.003), pressure_sigma=60.0)
        if not found:
            refused += 1
            continue
        x = seen(nodes, 0.003)
        got = found.applied(x)
        hold.append(np.abs(got.value - nodes) < 1.96 * got.sigma)
        before.append(np.abs(x.value - nodes) < 1.96 * x.sigma)
        error.append(got.value - nodes)
        plain.append(x.value - nodes)
        named = {int(name[1:]) for name in found.blocked}
        missed += len(set(bad.tolist()) - named)
        lost += len(named - set(bad.tolist()))
    return {
        "95 % interval holds %": float(100 * np.mean(hold)), "before in-situ %": float(100 * np.mean(before)),
        "RMS error Pa": float(np.sqrt(np.mean(np.square(error)))),
        "before in-situ Pa": float(np.sqrt(np.mean(np.square(plain)))),
        "blocked taps missed": missed, "of": blocked * runs, "good taps left out": lost, "refused": refused,
    }  # fmt: skip


def main(quick: bool = False) -> dict[str, dict[str, float | str]]:
    """Measure, print the tables, return them."""
    runs = 40 if quick else 300
    rows: dict[str, dict[str, float | str]] = {"a-priori": a_priori(runs)}
    for blocked in (0, 3) if quick else (0, 2, 4, 6):
        rows[f"in-situ, {blocked} of 20 taps blocked"] = {**taps(runs, blocked)}
    for name, row in rows.items():
        print(name)
        for key, value in row.items():
            print(f"    {key:55}{value if isinstance(value, str) else format(value, '.4g')}")
    return rows


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
