"""The template against the Cramer-Rao bound, beside SPOT's bowl, a thresholded centroid and SimpleBlobDetector.

    python benchmarks/template.py [--quick]

Each cell of the grid (radius, blur, depth over noise, tilt, slope of the light) is one frame of markers of its kind, at
random places within a pixel and random azimuths, drawn by `windmark.synth.disc_image` (sub-pixels and their covered
share; not the template's formula) on light that falls off linearly, with white noise. They are fitted through
`refine_template`: blur and noise are learnt from the frame, the starts are off by 0.1 px per axis and by SPOT's bias on
slopes, the radii by 15 %. The bound of every marker is computed for its own ellipse, place and slope, with all ten
unknowns free, on the pixels within `window_radius(r, blur, 4.5)`; to know the blur would lower it by the share that the
table states, as centre and blur decouple. RMS / bound of a cell of n markers is known to 1 / sqrt(4 n).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from _scoring import pair, refinements, simple_blob, windmark_detector
from windmark.detection.template.crlb import centre_bound, window_radius
from windmark.detection.template.refine import TemplateFits, refine_template
from windmark.synth import disc_image, marker_scene

Array = NDArray[np.float64]

RADII_PX, BLURS_PX, TILTS_DEG = (2.0, 3.0, 5.0, 8.0), (0.5, 0.7, 1.0, 1.2), (0.0, 45.0, 60.0)
DEPTH_OVER_NOISE, SLOPES = (10.0, 20.0, 50.0), (0.0, 0.015, 0.05)
BIAS_SLOPES, PEER_SLOPES = (0.01, 0.02, 0.04, 0.06, 0.08), (0.0, 0.015, 0.05)
DEPTH, BACKGROUND = 1500.0, 2000.0  # grey levels
RADIUS_ERROR, START_ERROR_PX = 0.15, 0.1
BLURS_SEEN = 4.5  # of the bound's window
KNOWN_BLUR = (5,)  # index into the ten unknowns
FIRST_SCENE = 1000  # seeds of the scenes that judge; do not tune on these


@dataclass(frozen=True)
class Sheet:
    """Noise-free tiles (N, S, S), each with one marker; `xy` (N, 2) in the sheet, `bound` (N, 2, 2) for noise 1."""

    tiles: Array
    xy: Array
    axes_px: Array
    slope: Array
    bound: Array
    known: Array

    def image(self, repeat: int) -> Array:
        """All tiles side by side, so many times below each other."""
        n, size, _ = self.tiles.shape
        rows = self.tiles.reshape(n // COLUMNS, COLUMNS, size, size).transpose(0, 2, 1, 3)
        return np.tile(rows.reshape(n // COLUMNS * size, COLUMNS * size), (repeat, 1))

    def places(self, repeat: int) -> Array:
        """Centres in that image."""
        down = len(self.tiles) // COLUMNS * self.tiles.shape[1]
        return np.concatenate([self.xy + np.array([0.0, k * down]) for k in range(repeat)])


COLUMNS = 10  # markers side by side


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print one table, return its figures."""
    results: dict[str, object] = {}
    _grid(results, geometries=50 if quick else 100, repeat=2 if quick else 10, quick=quick)
    _bias(results, geometries=50 if quick else 100)
    _scenes(results, 2 if quick else 12)
    _peers(results, geometries=50 if quick else 100, repeat=2 if quick else 5)
    print(f"\n{'template':<74}value")
    for name, value in results.items():
        print(f"{name:<72} {value:8.4g}" if isinstance(value, float | int) else f"{name:<72} {value}")
    return results


def sheet(seed: int, geometries: int, radius: float, tilt: float, blur: float, slope: float) -> Sheet:
    """One marker per tile: random place, azimuth and direction of the slope."""
    rng = np.random.default_rng([seed, round(1000 * radius), round(tilt), round(1000 * blur), round(1000 * slope)])
    reach = float(window_radius(radius, blur, BLURS_SEEN))
    size = 2 * int(np.ceil((1 + RADIUS_ERROR) * reach)) + 5
    axes = radius * np.array([1.0, np.cos(np.radians(tilt))])
    place, azimuth = rng.uniform(-0.5, 0.5, (geometries, 2)), rng.uniform(0, np.pi, geometries)
    turn = rng.uniform(0, 2 * np.pi, geometries)
    slopes = slope * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    tiles, bounds = np.empty((geometries, size, size)), np.empty((2, geometries, 2, 2))
    for k in range(geometries):
        center, fall = place[k] + size // 2, (float(slopes[k, 0]), float(slopes[k, 1]))
        tiles[k] = disc_image(
            (size, size), center, axes, azimuth[k], level=BACKGROUND, depth=DEPTH, slope=fall, blur_px=blur
        )
        for known, out in zip(((), KNOWN_BLUR), bounds, strict=True):
            out[k] = centre_bound(
                axes, azimuth[k], blur_px=blur, depth=DEPTH, background=BACKGROUND, slope=fall, xy=place[k],
                photometry="multiplicative", window_px=reach, known=known,
            )  # fmt: skip
    index = np.arange(geometries)
    corner = size * np.stack([index % COLUMNS, index // COLUMNS], axis=1)
    return Sheet(tiles, corner + size // 2 + place, np.tile(axes, (geometries, 1)), slopes, *bounds)


def fit(drawn: Sheet, repeat: int, noise: float, seed: int) -> tuple[Array, TemplateFits]:
    """Errors (K, 2) and fits of a noisy frame; the sheet is repeated until it has K markers."""
    rng = np.random.default_rng([seed, repeat, round(1e3 * noise)])
    image = drawn.image(repeat)
    image = image + rng.normal(0.0, noise, image.shape)
    truth, radius = drawn.places(repeat), np.sqrt(drawn.axes_px.prod(axis=1))
    spot = 0.25 * drawn.slope * radius[:, None] ** 2  # additive models see a marker that much towards the light
    start = truth + np.tile(spot, (repeat, 1)) + rng.normal(0.0, START_ERROR_PX, truth.shape)
    given = np.tile(radius, repeat) * rng.uniform(1 - RADIUS_ERROR, 1 + RADIUS_ERROR, len(truth))
    fits = refine_template(image, start, given)
    return fits.xy - truth, fits


def cells(quick: bool) -> Iterator[tuple[float, float, float, float]]:
    """(radius, tilt, blur, slope)."""
    if quick:
        return iter(product((2.0, 5.0), (0.0, 60.0), (0.5, 1.2), (0.0, 0.05)))
    return iter(product(RADII_PX, TILTS_DEG, BLURS_PX, SLOPES))


def _grid(results: dict[str, object], geometries: int, repeat: int, quick: bool) -> None:
    count = geometries * repeat
    ratio, spread, lost, names = [], [], [], []
    cheaper, white, flagged = [], [], []
    for radius, tilt, blur, slope in cells(quick):
        drawn = sheet(1, geometries, radius, tilt, blur, slope)
        cheaper.append(1.0 - np.sqrt(np.trace(drawn.known, axis1=1, axis2=2).mean()
                                     / np.trace(drawn.bound, axis1=1, axis2=2).mean()))  # fmt: skip
        for depth in DEPTH_OVER_NOISE:
            noise = DEPTH / depth
            error, fits = fit(drawn, repeat, noise, 2)
            good = fits.converged & np.isfinite(error).all(axis=1)
            bound = noise * np.sqrt(np.tile(drawn.bound[:, [0, 1], [0, 1]], (repeat, 1)))
            ratio.append(float(np.sqrt(np.mean((error / bound)[good] ** 2))))
            spread.append(float(np.std((error / np.sqrt(fits.cov[:, [0, 1], [0, 1]]))[good])))
            lost.append(int((~good).sum()))
            white.append(fits.frame.noise is not None and fits.frame.noise.is_white)
            flagged.append(float(np.mean(fits.flags & 4 > 0)))
            names.append(f"r {radius:g} tilt {tilt:g} blur {blur:g} slope {100 * slope:g} %/px, depth/noise {depth:g}")
    order = np.argsort(ratio)[::-1]
    results["grid: cells"] = len(ratio)
    results["grid: markers per cell"] = count
    results["grid: statistical error of a cell's RMS / bound"] = 1.0 / np.sqrt(4.0 * count)
    results["grid: RMS / bound, median cell"] = float(np.median(ratio))
    results["grid: RMS / bound, worst cell"] = float(np.max(ratio))
    for k in order[:5]:
        results[f"  {names[k]}"] = ratio[k]
    results["grid: cells above 1.10"] = int((np.array(ratio) > 1.10).sum())
    results["grid: markers not converged"] = int(np.sum(lost))
    for k in np.argsort(lost)[::-1][:3]:
        if lost[k]:
            results[f"  not converged in {names[k]}"] = lost[k]
    results["grid: bound with known blur lower by, worst cell"] = float(np.max(cheaper))
    results["white noise: z-std of centres, median cell"] = float(np.median(spread))
    results["white noise: z-std, least cell"] = float(np.min(spread))
    results["white noise: z-std, largest cell"] = float(np.max(spread))
    results["white noise: cells with z-std in 0.95-1.05 [%]"] = 100.0 * float(
        np.mean(np.abs(np.array(spread) - 1) <= 0.05)
    )
    for k in np.argsort(spread)[::-1][:3]:
        results[f"  z-std in {names[k]}"] = spread[k]
    results["white noise: cells whose noise was taken for white [%]"] = 100.0 * float(np.mean(white))
    results["white noise: markers flagged contaminated [%]"] = 100.0 * float(np.mean(flagged))


def _bias(results: dict[str, object], geometries: int) -> None:
    """Mean error along the slope, and RMS of all errors per axis, with practically no noise (depth / 10,000)."""
    for slope in BIAS_SLOPES:
        along, rms = [0.0], [0.0]
        for radius, tilt, blur in product(RADII_PX, (0.0, 45.0), (BLURS_PX[0], BLURS_PX[-1])):
            if slope * window_radius(radius, blur, BLURS_SEEN) > 0.95:  # the light would end in the window
                continue
            drawn = sheet(3, geometries, radius, tilt, blur, slope)
            error, _ = fit(drawn, 1, 1e-4 * DEPTH, 4)
            along.append(abs(float(np.mean(np.sum(error * drawn.slope, axis=1)) / slope)))
            rms.append(float(np.sqrt(np.mean(error**2))))
        results[f"slope {100 * slope:g} %/px: bias along it, worst of radius, tilt, blur [px]"] = max(along)
        results[f"slope {100 * slope:g} %/px: RMS error per axis without noise, worst [px]"] = max(rms)


def _scenes(results: dict[str, object], seeds: int) -> None:
    """Covariances on textured paint and in infrared scenes, and crossed markers in clutter, at known places."""
    for kind, photometry, many in (
        ("clean", "multiplicative", 1),
        ("infrared", "additive", 2),
        ("cluttered", "multiplicative", 1),
    ):
        z, flagged, lost, dirty, noticed = [], [], 0, [], []
        for seed in range(FIRST_SCENE, FIRST_SCENE + many * seeds):
            scene = marker_scene(seed, kind)
            rng = np.random.default_rng([seed, 5])
            radius = np.sqrt(scene.axes_px.prod(axis=1)) * rng.uniform(1 - RADIUS_ERROR, 1 + RADIUS_ERROR, len(scene))
            fits = refine_template(
                scene.image, scene.xy + rng.normal(0.0, START_ERROR_PX, scene.xy.shape), radius,
                polarity=scene.polarity, photometry=photometry,
            )  # fmt: skip
            contaminated, error = fits.flags & 4 > 0, fits.xy - scene.xy
            whole, touched = ~scene.border & ~scene.contaminated, ~scene.border & scene.contaminated
            lost += int((~scene.border & ~fits.converged).sum())
            flagged += contaminated[whole].tolist()
            dirty += np.hypot(*error[touched].T).tolist()
            noticed += contaminated[touched].tolist()
            z.append((error / np.sqrt(fits.cov[:, [0, 1], [0, 1]]))[whole & ~contaminated & fits.converged])
        values = np.concatenate(z)
        results[f"{kind} scenes: markers"] = len(flagged) + len(dirty)
        results[f"{kind} scenes: z-std of centres"] = float(values.std())
        worst = max((float(v.std()) for v in z), key=lambda s: abs(np.log(s)))
        results[f"{kind} scenes: z-std of the worst scene"] = worst
        results[f"{kind} scenes: largest |z|"] = float(np.abs(values).max())
        results[f"{kind} scenes: not converged"] = lost
        results[f"{kind} scenes: clean markers flagged contaminated [%]"] = 100.0 * float(np.mean(flagged))
        if kind == "cluttered":
            results["cluttered scenes: contaminated markers"] = len(dirty)
            results["cluttered scenes: their median error (2-D) [px]"] = float(np.median(dirty))
            results["cluttered scenes: their 90 % error [px]"] = float(np.quantile(dirty, 0.9))
            results["cluttered scenes: of them flagged [%]"] = 100.0 * float(np.mean(noticed))


def _peers(results: dict[str, object], geometries: int, repeat: int) -> None:
    """RMS / bound of others on the same frames: depth / noise 20, blur 0.7."""
    for radius, tilt, slope in product(RADII_PX, (0.0, 45.0), PEER_SLOPES):
        drawn, noise = sheet(6, geometries, radius, tilt, 0.7, slope), DEPTH / 20.0
        truth = drawn.places(repeat)
        image = drawn.image(repeat)
        image = image + np.random.default_rng(7).normal(0.0, noise, image.shape)
        byte = np.clip(image * (255.0 / (2.0 * BACKGROUND)) + 0.5, 0.0, 255.0).astype(np.uint8)
        bound = noise * np.sqrt(np.tile(drawn.bound[:, [0, 1], [0, 1]], (repeat, 1)))
        found = {
            "template": fit(drawn, repeat, noise, 8)[1].xy,
            "thresholded centroid": _centroids(image, drawn, repeat),
            "SimpleBlobDetector": simple_blob((radius, radius))(byte, "dark")[0],
        }
        for name in set(refinements()) - {"template"}:
            found[name] = windmark_detector(radius, refine=name)(image, "dark")[0]
        text = ", ".join(f"{name} {_ratio(xy, truth, bound)}" for name, xy in found.items())
        results[f"RMS/bound, r {radius:g} tilt {tilt:g} slope {100 * slope:g} %/px"] = text


def _ratio(xy: Array, truth: Array, bound: Array) -> str:
    pairs = pair(xy, truth, 1.5)
    ratio = np.sqrt(np.mean(((xy[pairs.found] - truth[pairs.true]) / bound[pairs.true]) ** 2))
    return f"{ratio:.2f}" + (f" ({len(pairs.missed)} missed)" if len(pairs.missed) else "")


def _centroids(image: Array, drawn: Sheet, repeat: int) -> Array:
    """Centroid of what is darker than half way between each tile's darkest pixels and its rim, weighted by that."""
    size, n = drawn.tiles.shape[1], len(drawn.tiles) * repeat
    tiles = image.reshape(n // COLUMNS, size, COLUMNS, size).transpose(0, 2, 1, 3).reshape(n, size, size)
    place = np.arange(size) - size // 2
    near = np.hypot(place, place[:, None]) <= 1.5 * drawn.axes_px.max() + 2.0
    rim = np.median(tiles[:, ~near], axis=1)
    dark = np.quantile(tiles[:, near], 0.05, axis=1)
    weight = np.maximum(0.5 * (rim + dark)[:, None, None] - tiles, 0.0) * near
    total = weight.sum((1, 2))
    shift = np.stack([(weight * place).sum((1, 2)), (weight * place[:, None]).sum((1, 2))], axis=1) / total[:, None]
    return np.rint(drawn.places(repeat)) + shift


if __name__ == "__main__":
    main("--quick" in sys.argv)
