"""Centres against the Cramer-Rao bound of the right noise model, in everything that disturbs them.

    python benchmarks/detection_limits.py [--quick] [--cells WORD] [--seed N]

Each row is one kind of scene (drawn by `_raster`, which shares nothing with windmark, spoilt by `_sensor`) at one
radius. "detect" is the public verb with the radius given, "fit" the template at starts that are off by 0.1 px with
radii wrong by up to 15 %. RMS over the bound is per marker and axis: sqrt(mean(error^T bound^-1 error / 2)); z is the
standard deviation of error over stated sigma along x and along y, and sqrt(chi^2 / 2) of both with the stated
correlation. A marker is lost that has nothing within max(1.5 px, radius / 2), or no stated covariance. The bound is
computed from numerical derivatives of the noise-free picture by all of the scene's numbers (also those of a shadow's
edge, a line, dirt, a neighbour, the second field's shift) and the covariance of the noise, within max(2 a, a + 4.5
blurs + 1) of the centre. Of discs with a neighbour, a shadow or dirt every other one in the frame is a clean one, which
is not judged.

Left out: the error of the frame's own learning where it holds few markers (each frame has 80), lenses, several radii in
a frame, bright markers but for one row, colour. The statistical error of a ratio or z of n markers is 1 / sqrt(4 n).
For JPEG the bound takes the file's errors for noise of the second moments they have (`_sensor`).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from _raster import EXTRAS, Drawing, Optics
from _scoring import pair
from _sensor import Sensor
from windmark.detection import detect
from windmark.detection.template.refine import refine_template

Array = NDArray[np.float64]

RADII_PX = (2.0, 3.0, 5.0, 8.0)
LEVEL, CONTRAST = 180.0, 0.7  # grey levels of 255, share of the light that a disc takes away
ACROSS, DOWN, SHAPES = 8, 10, 16  # markers in a frame, different ones among them
MIXED = ("touching", "shadow", "line", "scratch", "dirt")  # every other marker of such a frame is a clean one
FIRST_SEED = 190_000  # of the scenes that judge; do not tune on these
PLAIN, SHARP = Sensor(white=LEVEL * CONTRAST / 20), Optics()
COLUMNS = ("lost", "RMS/bd", "z x", "z y", "chi2/2")


@dataclass(frozen=True)
class Cell:
    """One kind of scene: what differs from discs tilted by up to 60 deg on even light in white noise (depth / 20)."""

    name: str
    sensor: Sensor = PLAIN
    optics: Optics = SHARP
    tilt: tuple[float, float] = (0.0, 60.0)
    slope: float = 0.0
    disturbed: str = ""
    gap: float = 0.0
    contrast: float = CONTRAST
    blur: str = "gauss"


def cells() -> list[Cell]:
    """All rows of the table, in its order."""
    quiet = replace(PLAIN, white=LEVEL * CONTRAST / 60)
    file = Sensor(white=LEVEL * CONTRAST / 40, bits=8)
    out = [Cell("flat"), Cell("flat, depth/noise 10", replace(PLAIN, white=LEVEL * CONTRAST / 10))]
    out += [Cell(f"slope {100 * s:g} %/px", slope=s) for s in (0.015, 0.03)]
    out += [Cell(f"tilt {t:g}", tilt=(t, t)) for t in (0.0, 45.0, 60.0, 70.0)]
    out += [Cell(f"texture {100 * t:g} %, {c:g} px", replace(quiet, texture=t, length=c))
            for t in (0.02, 0.04) for c in (1.2, 2.0)]  # fmt: skip
    out += [Cell(f"{n:g} electrons", Sensor(white=1.5 * LEVEL / n, electrons=n)) for n in (25, 100, 1000, 10_000)]
    out += [Cell(f"JPEG {q}", replace(file, quality=q)) for q in (90, 75, 50)]
    out += [Cell("gamma 0.45", replace(file, gamma=0.45)), Cell("8 bits", file)]
    out += [Cell(f"defocus {r:g} px", optics=Optics(0.4, defocus=r), blur="defocus") for r in (1.0, 2.0)]
    out += [Cell(f"motion {m:g} px", optics=Optics(0.5, motion=m, motion_angle=0.4), blur="motion") for m in (2.0, 4.0)]
    out += [Cell(f"active side {a:g}", optics=Optics(0.45, active=a)) for a in (0.5, 0.8)]
    out += [Cell("interlaced", disturbed="fields")]
    out += [Cell(f"touching, gap {g:g}", disturbed="touching", gap=g) for g in (0.5, 1.0, 2.0)]
    out += [Cell("half-shadow", disturbed="shadow"), Cell("line", disturbed="line")]
    out += [Cell("scratch", disturbed="scratch"), Cell("dirt on the rim", disturbed="dirt")]
    return [*out, Cell("bright", contrast=-1.2, sensor=replace(PLAIN, level=80.0))]


@dataclass(frozen=True)
class Sheet:
    """Noise-free tiles (K, S, S) of a cell; centres (K, 2) of discs and neighbours from their middles; bounds."""

    tiles: Array
    place: Array
    bound: Array
    second: Array
    judged: NDArray[np.bool_]


def reach_of(axis: float, optics: Optics) -> float:
    """Radius of the window of the bound."""
    return float(max(2 * axis, axis + 4.5 * np.hypot(optics.spread, 0.29) + 1))


def drawing(cell: Cell, radius: float, rng: np.random.Generator) -> Drawing:
    """One marker of a cell, at a random place in its pixel."""
    reach = reach_of(radius, cell.optics)
    size = 2 * int(np.ceil(reach)) + 7
    if cell.disturbed == "touching":
        size += 2 * int(np.ceil(radius + cell.gap))
    size += (1 - size) % 4  # odd, 1 more than a multiple of 4: with one line more the tiles' distance is 2 mod 4
    xx, xy, yy = _half_axes(radius, cell.tilt, rng)
    x, y = rng.uniform(-0.5, 0.5, 2)
    light = 80.0 if cell.contrast < 0 else LEVEL
    values = {"x": x, "y": y, "sxx": xx, "sxy": xy, "syy": yy, "contrast": cell.contrast, "level": light}
    values |= {"slope x": cell.slope, "slope y": 0.0} | _disturbance(cell, radius, values, rng)
    return Drawing(size, cell.optics, values, cell.disturbed, cell.blur)


def _half_axes(radius: float, tilt: tuple[float, float], rng: np.random.Generator) -> tuple[float, float, float]:
    """Half-axes matrix of a disc seen under a random tilt (uniform in the cosine) and azimuth."""
    minor = radius * rng.uniform(*sorted(np.cos(np.radians(tilt))))
    turn = rng.uniform(0, np.pi)
    c, s = np.cos(turn), np.sin(turn)
    return radius * c * c + minor * s * s, (radius - minor) * c * s, radius * s * s + minor * c * c


def _disturbance(cell: Cell, radius: float, disc: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Values of what is beside the disc or over it."""
    x, y, turn = disc["x"], disc["y"], rng.uniform(0, np.pi)
    shape = np.array([[disc["sxx"], disc["sxy"]], [disc["sxy"], disc["syy"]]])
    if cell.disturbed == "touching":  # both of one shape: along a direction the rims are |S^-1 e|^-1 from the centres
        e = np.array([np.cos(2 * turn), np.sin(2 * turn)])
        away = 2 / np.linalg.norm(np.linalg.solve(shape, e)) + cell.gap
        same = {f"{k}2": disc[k] for k in ("sxx", "sxy", "syy", "contrast")}
        return {"x2": x + away * e[0], "y2": y + away * e[1], **same}
    if cell.disturbed == "shadow":
        return {"edge": x + radius * rng.uniform(-0.6, 0.6), "edge angle": rng.uniform(-0.2, 0.2),
                "dimmed": rng.uniform(0.3, 0.6), "penumbra": rng.uniform(0.5, 2.0)}  # fmt: skip
    if cell.disturbed in ("line", "scratch"):
        offset = x * np.cos(turn) + y * np.sin(turn) + radius * rng.uniform(-0.7, 0.7)
        out = {"line": offset, "line angle": turn, "half width": rng.uniform(0.4, 0.8),
               "opacity": rng.uniform(0.3, 0.6)}  # fmt: skip
        if cell.disturbed == "scratch":
            out |= {"opacity": -rng.uniform(0.5, 1.0), "end": y * np.cos(turn) - x * np.sin(turn)}
        return out
    if cell.disturbed == "dirt":
        rim = shape @ np.array([np.cos(2 * turn), np.sin(2 * turn)])
        return {"dirt x": x + rim[0], "dirt y": y + rim[1], "dirt radius": max(0.3 * radius, 0.8), "opacity": 0.6}
    return {"shift x": 1.0, "shift y": 0.3} if cell.disturbed == "fields" else {}


def bound_of(one: Drawing, cell: Cell, radius: float, rng: np.random.Generator) -> Array:
    """(2, 2) of the centre: the block of the inverse of J C^-1 J^T, every unknown free."""
    place = np.arange(one.size) - one.size // 2
    x, y = place[None] - one.values["x"], place[:, None] - one.values["y"]
    reach = reach_of(radius, cell.optics)
    window = np.hypot(x, y) <= reach
    if cell.disturbed == "touching":
        window |= np.hypot(x + one.values["x"] - one.values["x2"], y + one.values["y"] - one.values["y2"]) <= reach
    rows = one.derivatives()[:, window]
    weighted = np.linalg.solve(np.linalg.cholesky(cell.sensor.covariance(one.draw(), window, rng)), rows.T)
    scale = np.linalg.norm(weighted, axis=0)
    # Two unknowns that no pixel tells apart (a blur under a penumbra) must not spoil the centre: pseudo-inverse.
    inverse = np.linalg.pinv((weighted / scale).T @ (weighted / scale), rcond=1e-10, hermitian=True)
    return np.asarray((inverse / scale / scale[:, None])[:2, :2])


def sheet(cell: Cell, radius: float, seed: int, shapes: int) -> Sheet:
    """Different markers of a cell with their bounds."""
    rng = np.random.default_rng([seed, round(1000 * radius), *cell.name.encode()])
    drawn = [drawing(cell, radius, rng) for _ in range(shapes)]
    bound = np.array([bound_of(one, cell, radius, rng) for one in drawn])
    judged = np.ones(shapes, dtype=bool)
    if cell.disturbed in MIXED:
        judged, bound = np.repeat([True, False], shapes), np.concatenate([bound, np.full_like(bound, np.nan)])
        drawn += [_undisturbed(one) for one in drawn]
    second = np.array([[one.values.get("x2", np.nan), one.values.get("y2", np.nan)] for one in drawn])
    place = np.array([[one.values["x"], one.values["y"]] for one in drawn])
    return Sheet(np.array([one.draw() for one in drawn]), place, bound, second, judged)


def _undisturbed(one: Drawing) -> Drawing:
    """The same disc with nothing beside it or over it."""
    values = {k: v for k, v in one.values.items() if k not in EXTRAS[one.disturbed]}
    return replace(one, values=values, disturbed="")


@dataclass(frozen=True)
class Frame:
    """A noise-free frame (H, W): centres (N, 2), their bounds (N, 2, 2), which are judged, neighbours (M, 2)."""

    clean: Array
    xy: Array
    bound: Array
    judged: NDArray[np.bool_]
    second: Array


def frame(one: Sheet, rng: np.random.Generator, sloped: bool) -> Frame:
    """Tiles side by side, every other one mirrored so that the light goes on; sloped ones may be turned."""
    size, count = one.tiles.shape[1], ACROSS * DOWN
    pick = rng.permutation(np.resize(np.arange(len(one.tiles)), count))
    flip = (np.arange(count) % ACROSS) % 2 == 1
    tiles, sign = one.tiles[pick].copy(), np.where(flip, -1.0, 1.0)[:, None] * [1, 0] + [0, 1]
    tiles[flip] = tiles[flip, :, ::-1]
    tiles = np.pad(tiles, ((0, 0), (0, 1), (0, 0)), mode="edge")  # even rows: fields go on
    grid = tiles.reshape(DOWN, ACROSS, size + 1, size).swapaxes(1, 2).reshape(DOWN * (size + 1), ACROSS * size)
    index = np.arange(count)
    middle = np.stack([index % ACROSS * size, index // ACROSS * (size + 1)], axis=1) + size // 2
    margin = 2 * int(rng.integers(6, 14))
    grid = np.pad(grid, margin, mode="edge")
    xy, second = (middle + margin + p[pick] * sign for p in (one.place, one.second))
    bound = one.bound[pick] * (sign[:, :, None] * sign[:, None, :])
    if sloped and rng.random() < 0.5:
        grid, xy, second, bound = grid.T.copy(), xy[:, ::-1], second[:, ::-1], bound[:, ::-1, ::-1]
    return Frame(grid, xy, bound, one.judged[pick], second[np.isfinite(second).all(axis=1)])


def measured(cell: Cell, radius: float, seed: int, frames: int, shapes: int) -> dict[str, dict[str, float]]:
    """Columns of both ways of measuring; `RMS/bd` and z are of the markers that were not lost."""
    one = sheet(cell, radius, seed, shapes)
    tally: dict[str, list[Any]] = {"detect": [], "fit": []}
    total, polarity = 0, "bright" if cell.contrast < 0 else "dark"
    for k in range(frames * (2 if cell.disturbed in MIXED else 1)):
        rng = np.random.default_rng([seed, k, round(1000 * radius), *cell.name.encode()])
        drawn = frame(one, rng, cell.slope > 0)
        image = cell.sensor.picture(drawn.clean, rng)
        total += int(drawn.judged.sum())
        found = detect(image, radius_px=radius, polarity=polarity)
        tally["detect"].append(errors(found.xy, found.cov, drawn, radius))
        every = np.concatenate([drawn.xy, drawn.second])
        start = every + rng.normal(0, 0.1, every.shape)
        fits = refine_template(image, start, radius * rng.uniform(0.85, 1.15, len(every)), polarity=polarity,
                               photometry="multiplicative")  # fmt: skip
        tally["fit"].append(errors(fits.xy[fits.converged], fits.cov[fits.converged], drawn, radius))
    return {way: columns(parts, total) for way, parts in tally.items()}


def errors(found: Array, cov: Array, drawn: Frame, radius: float) -> tuple[Array, Array, Array]:
    """Errors (K, 2), stated covariances and bounds of the judged markers that were found."""
    stated = np.isfinite(cov).all(axis=(1, 2))
    found, cov = found[stated], cov[stated]
    every = np.concatenate([drawn.xy, drawn.second])
    pairs = pair(found, every, max(1.5, 0.5 * radius))
    mine = np.append(drawn.judged, np.zeros(len(drawn.second), dtype=bool))[pairs.true]
    f, t = pairs.found[mine], pairs.true[mine]
    return found[f] - every[t], cov[f], drawn.bound[t]


def columns(parts: list[tuple[Array, Array, Array]], total: int) -> dict[str, float]:
    """The figures of a cell, NaN where fewer than ten markers were found."""
    error, cov, bound = (np.concatenate([p[k] for p in parts]) for k in range(3))
    if len(error) < 10:
        return dict(zip(COLUMNS, (total - len(error), *[np.nan] * 4), strict=True))

    def ratio(matrix: Array) -> float:
        return float(np.sqrt(np.einsum("ki,kij,kj->k", error, np.linalg.inv(matrix), error).mean() / 2))

    z = (error / np.sqrt(cov[:, [0, 1], [0, 1]])).std(axis=0)
    return dict(zip(COLUMNS, (total - len(error), ratio(bound), *z, ratio(cov)), strict=True))


def main(quick: bool = False, word: str = "", seed: int = FIRST_SEED) -> dict[str, object]:
    """Measure, print one table, return its numbers: row -> way -> column."""
    frames, shapes, radii = (2, 8, (3.0, 5.0)) if quick else (12, SHAPES, RADII_PX)
    print(f"{frames * ACROSS * DOWN} markers in each row; error of a ratio {(4 * frames * ACROSS * DOWN) ** -0.5:.3f}")
    print(f"{'':24s}{'r':>4s}" + "".join(f"  |{way:>7s}" + "".join(f"{c:>8s}" for c in COLUMNS)
                                         for way in ("detect", "fit")))  # fmt: skip
    results: dict[str, Any] = {}
    for cell in cells():
        if word not in cell.name:
            continue
        for radius in radii:
            row = measured(cell, radius, seed, frames, shapes)
            results[f"{cell.name}, r {radius:g}"] = row
            print(f"{cell.name:24s}{radius:4g}" + "".join("  |" + " " * 7 + _numbers(row[w]) for w in row), flush=True)
    for way in ("detect", "fit"):
        for column in COLUMNS[1:]:
            values = np.array([row[way][column] for row in results.values()])
            values = values[np.isfinite(values)]
            if len(values):
                print(f"{way:8s}{column:8s} median {np.median(values):.3f}, least {values.min():.3f}, "
                      f"largest {values.max():.3f}")  # fmt: skip
    return results


def _numbers(row: dict[str, float]) -> str:
    return f"{row['lost']:8.0f}" + "".join(f"{row[c]:8.3f}" for c in COLUMNS[1:])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="two radii, fewer markers")
    parser.add_argument("--cells", default="", metavar="WORD", help="only rows whose name holds this")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    options = parser.parse_args()
    main(options.quick, options.cells, options.seed)
