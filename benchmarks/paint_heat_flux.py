"""Heat flux from infrared histories: ``python benchmarks/paint_heat_flux.py``.

Error against the analytic step and ramp of the flux; stated sigma against draws, white and correlated noise; a wall of
two layers against a fine finite-difference solution, and what the semi-infinite formula makes of it; histories per
second of thread time, semi-infinite and layered.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from windmark.paint import Layer, Wall, heat_flux

Array = NDArray[np.float64]

DT = 0.01
MACOR = Wall.semi_infinite(1.46, 2.0e6)
LAYERS = (Layer(2e-4, 0.2, 1.5e6), Layer(3e-3, 15.0, 3.6e6))


def analytic() -> dict[str, float]:
    """Relative errors (%) for exact temperatures of a step and a ramp of the flux."""
    e, t = MACOR.layers[0].effusivity, DT * np.arange(401)
    step = heat_flux([2e4 / e * np.sqrt(t / np.pi)], DT, MACOR, initial=0.0).flux[0] / 1e4
    ramp = heat_flux([4e4 / (3 * e) * t**1.5 / np.sqrt(np.pi)], DT, MACOR).flux[0] / 1e4
    return {
        f"{name} after {n} samples, error %": float(100 * (got[n] / true[n] - 1))
        for name, got, true in (("step", step, np.ones(401)), ("ramp", ramp, t)) for n in (20, 100, 400)
    }  # fmt: skip


def sigmas(draws: int, seed: int) -> dict[str, float]:
    """Stated sigma over that of draws, at the last of 400 samples; noise of 0.1 K."""
    rng = np.random.default_rng(seed)
    out = {}
    for name, c in (("white", (1.0,)), ("correlated 0.6, 0.3", (1.0, 0.6, 0.3))):
        full = sum(r * (np.eye(400, k=k) + (np.eye(400, k=-k) if k else 0)) for k, r in enumerate(c))
        noise = 0.1 * rng.normal(size=(draws, 400)) @ np.linalg.cholesky(full).T
        got = heat_flux(300 + noise, DT, MACOR, sigma=0.1, correlation=c)
        out[f"sigma, {name} noise: stated W/m2"] = float(got.noise_sigma[0, -1])
        out[f"sigma, {name} noise: of draws"] = float(got.flux[:, -1].std())
    return out


def finite_differences(back: str, q: object, steps: int, cells: int = 800, fine: int = 8) -> Array:
    """Surface temperature of the layers under a flux q(t): Crank-Nicolson."""
    depth = np.concatenate([np.full(cells, la.thickness / cells) for la in LAYERS])
    k = np.concatenate([np.full(cells, la.conductivity) for la in LAYERS])
    c = np.concatenate([np.full(cells, la.capacity) for la in LAYERS])
    between = 1 / (0.5 * depth[:-1] / k[:-1] + 0.5 * depth[1:] / k[1:])
    end = 2 * k[-1] / depth[-1] if back == "isothermal" else 0.0
    diagonal = np.concatenate([[0.0], between]) + np.append(between, end)
    h, t, out = DT / fine, np.zeros(len(k)), []
    bands = np.zeros((3, len(k)))
    bands[0, 1:], bands[1], bands[2, :-1] = -0.5 * between, c * depth / h + 0.5 * diagonal, -0.5 * between
    for n in range(steps * fine + 1):
        if n % fine == 0:
            out.append(t[0] + q(n * h) * 0.5 * depth[0] / k[0])
        flow = np.diff(t) * between
        change = np.append(flow, 0.0) - np.concatenate([[0.0], flow])
        change[-1] -= end * t[-1]
        right = c * depth / h * t + 0.5 * change
        right[0] += 0.5 * (q(n * h) + q((n + 1) * h))
        t = solve_banded((1, 1), bands, right)
    return np.array(out)


def layered(steps: int) -> dict[str, float]:
    """Largest error (% of the mean flux) from the 30th sample on, of both walls, for a flux that swings and grows."""
    out = {}

    def q(t: float | Array) -> float | Array:
        return 1e4 * np.sin(t) ** 2 + 5e3 * t

    true = np.asarray(q(DT * np.arange(steps + 1)))
    for back in ("adiabatic", "isothermal"):
        t = finite_differences(back, q, steps)
        for name, wall in (("layers", Wall.of(LAYERS, back)), ("semi-infinite", Wall.semi_infinite(0.2, 1.5e6))):
            off = heat_flux([t], DT, wall, initial=0.0).flux[0] - true
            out[f"two layers, {back} back, taken as {name}: worst error %"] = float(
                100 * np.abs(off[30:]).max() / true.mean())  # fmt: skip
    return out


def speed(histories: int) -> dict[str, float]:
    """Histories of 400 samples per second of thread time, median of five."""
    t = 300 + np.random.default_rng(0).normal(size=(histories, 400))
    out = {}
    for name, wall in (("semi-infinite", MACOR), ("two layers", Wall.of(LAYERS))):
        seconds = []
        for _ in range(5):
            start = time.thread_time()
            heat_flux(t, DT, wall, sigma=0.1)
            seconds.append(time.thread_time() - start)
        out[f"{name}: histories of 400 samples per cpu-s"] = histories / float(np.median(seconds))
    return out


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print the table, return it."""
    rows = {**analytic(), **sigmas(2_000 if quick else 20_000, 11), **layered(200 if quick else 400),
            **speed(8_000 if quick else 33_000)}  # fmt: skip
    for name, value in rows.items():
        print(f"{name:70}{value:14.5g}")
    return rows


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
