"""Deformation of a rendered swept wing: error, stated sigma and the Cramer-Rao bound, for several set-ups.

55 markers on the wing, 5 on the body, 72 on the floor; two cameras of 1 Mpx, 60 degrees apart, 0.5 mm per pixel. The
tip bends by 2 % of the span and twists by 1 degree, the model moves by 20 mm and 2 degrees; the images are rendered
and spoiled by blur, shot noise, 12 bits and dead pixels. Every case is found cold: detection, labels, law. Set-ups:

two cameras     both stand still
one camera      the same images, the first camera alone, with the beam's law
shaken          the cameras moved by 2 mm and 0.2 degrees: held by the wall markers, or taken as fixed
textured        the first two with 1 % of grain in the paint, which displaces markers by as much as the noise does

bound: the same adjustment's covariance where every visible marker is located as well as the sensor's noise allows
(Cramer-Rao bound of the rendered ellipse); the textured paint is not in it, so those rows must lie above. z: standard
deviation of error / stated sigma, of all cases.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from windmark import synth
from windmark.deformation import Deformation, identify, span_values
from windmark.detection.template.crlb import centre_bound
from windmark.pipeline.deform import DeformationTest, FrameImages, follow_deformation
from windmark.scene import Observations, View

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "deformation"))
import wing_scenes as scenes

FIRST_SEED = 4_330_000
SENSOR = synth.Sensor()
STATIONS = 11
PER_MODEL = 2
"""Cases of one model: the paint's texture shifts each marker by the same in all of them, so models must change, too."""
GRAIN = 0.01


@dataclass
class Row:
    """Errors, sigmas and bounds of one set-up, over cases."""

    twist: list[np.ndarray] = field(default_factory=list)
    twist_sigma: list[np.ndarray] = field(default_factory=list)
    twist_bound: list[np.ndarray] = field(default_factory=list)
    bending: list[np.ndarray] = field(default_factory=list)
    bending_sigma: list[np.ndarray] = field(default_factory=list)
    bending_bound: list[np.ndarray] = field(default_factory=list)
    refused: int = 0
    markers: list[int] = field(default_factory=list)

    def figures(self) -> dict[str, float]:
        """The row of the table; the station at the root does not move."""
        out: dict[str, float] = {"cases": len(self.twist), "refused": self.refused}
        out["markers"] = float(np.median(self.markers)) if self.markers else np.nan
        for name in ("twist", "bending"):
            error, sigma, bound = (np.array(getattr(self, name + part))[:, 1:] for part in ("", "_sigma", "_bound"))
            out[f"{name}_rms"] = float(np.sqrt((error**2).mean()))
            out[f"{name}_sigma"] = float(np.sqrt((sigma**2).mean()))
            out[f"{name}_sigma_worst"] = float(np.sqrt((sigma**2).mean(axis=0)).max())
            out[f"{name}_z"] = float(np.sqrt(((error / sigma) ** 2).mean()))
            out[f"{name}_over_bound"] = float(np.sqrt((error**2).mean() / (bound**2).mean()))
        return out


def spot_bound(test: synth.TunnelTest, shot: synth.Rendering, truth: synth.MarkerTruth, k: int) -> np.ndarray:
    """(2, 2) bound of one marker's centre in px^2, from its ellipse and the light round it."""
    x, y = np.rint(truth.ellipse_xy[k]).astype(int)
    reach = int(np.ceil(2 * truth.axes_px[k, 0])) + 1
    patch = shot.image[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
    height, width = shot.image.shape
    off2 = (truth.ellipse_xy[k, 0] - (width - 1) / 2) ** 2 + (truth.ellipse_xy[k, 1] - (height - 1) / 2) ** 2
    shade = 1 - SENSOR.vignetting * off2 / (0.25 * (width**2 + height**2))
    light = float(np.quantile(patch, 0.8)) * SENSOR.exposure * shade
    noise = np.sqrt(light * SENSOR.full_well_e + SENSOR.read_noise_e**2) / SENSOR.full_well_e
    contrast = 0.85
    return centre_bound(
        truth.axes_px[k], truth.angle[k], blur_px=SENSOR.blur_px, depth=contrast * light,
        noise=float(noise), background=light, photometry="multiplicative",
    )  # fmt: skip


def bound(
    test: synth.TunnelTest, setup: DeformationTest, state: synth.WingState, seen: dict[str, synth.Rendering]
) -> Deformation:
    """The state that perfect spots give, whose covariance is the bound."""
    view, point, xy, cov = [], [], [], []
    names = [s.name for s in setup.stations]
    index = {str(n): k for k, n in enumerate(test.markers.name)}
    rows = np.array([index[str(n)] for n in setup.markers.name])
    for v, name in enumerate(names):
        truth = seen[name].markers
        for k in np.flatnonzero(truth.visible[rows]):
            view.append(v)
            point.append(k)
            xy.append(truth.ellipse_xy[rows[k]])
            cov.append(spot_bound(test, seen[name], truth, rows[k]))
    observations = Observations(np.array(view), np.array(point), np.array(xy), np.array(cov))
    views = [
        View(s.name, s.name, "", state.shaken[s.name] @ s.cam_from_tunnel if s.moves else s.cam_from_tunnel)
        for s in setup.stations
    ]
    answer = identify(
        observations, setup.markers, setup.volumes, {s.name: s.camera for s in setup.stations}, views,
        free_poses=[s.name for s in setup.stations if s.moves], reject=False,
    )  # fmt: skip
    assert isinstance(answer, Deformation), answer
    return answer


def score(row: Row, test: synth.TunnelTest, setup: DeformationTest, state: synth.WingState, images: dict, best) -> None:
    """One case of one set-up."""
    names = [s.name for s in setup.stations]
    frame = next(follow_deformation([FrameImages("0", 0.0, {n: images[n] for n in names})], setup))
    if frame.state is None:
        row.refused += 1
        print("refused:", frame.reason)
        return
    at = scenes.span_stations(test.shape, STATIONS)
    got, least = span_values(frame.state, at), span_values(best, at)
    true = span_values(_true(best, test, state), at)
    row.markers.append(len(frame.observations) if frame.observations is not None else 0)
    row.twist.append(got.twist_deg - true.twist_deg)
    row.bending.append(got.bending - true.bending)
    row.twist_sigma.append(got.twist_sigma_deg)
    row.bending_sigma.append(got.bending_sigma)
    row.twist_bound.append(least.twist_sigma_deg)
    row.bending_bound.append(least.bending_sigma)


def _true(best: Deformation, test: synth.TunnelTest, state: synth.WingState) -> Deformation:
    from dataclasses import replace

    return replace(best, q=scenes.true_law(test.shape, state))


def main(quick: bool = False, count: int = 100) -> dict[str, dict[str, float]]:
    """Measure, print the table, return its rows."""
    count = 2 if quick else count
    names = "two cameras", "one camera", "shaken, walls", "shaken, taken as fixed", "two, textured", "one, textured"
    rows = {n: Row() for n in names}
    for k in range(count):
        if k % PER_MODEL == 0:
            clean, grained = (synth.stereo_wing(FIRST_SEED + k // PER_MODEL, nodes=20_000, grain=g) for g in (0, GRAIN))
        rng = np.random.default_rng([FIRST_SEED, k])
        still, shaken = scenes.random_state(rng), scenes.random_state(rng, shake=True)
        for test, state, setups in (
            (clean, still, {"two cameras": scenes.deformation_test(clean),
                            "one camera": scenes.deformation_test(clean, ["cam1"])}),
            (clean, shaken, {"shaken, walls": scenes.deformation_test(clean, moves=True),
                             "shaken, taken as fixed": scenes.deformation_test(clean, walls=False)}),
            (grained, still, {"two, textured": scenes.deformation_test(grained),
                              "one, textured": scenes.deformation_test(grained, ["cam1"])}),
        ):  # fmt: skip
            images, perfect = scenes.rendered(test, state, SENSOR, [FIRST_SEED, k])
            for name, setup in setups.items():
                best = bound(test, setup, state, perfect)
                score(rows[name], test, setup, state, images, best)
        if k + 1 in (1, 5) or (k + 1) % 10 == 0:
            table(rows)
    return {n: r.figures() for n, r in rows.items() if r.twist}


def table(rows: dict[str, Row]) -> None:
    """Print what is there so far."""
    print(f"{'':24s} {'cases':>5s} {'refused':>7s} {'spots':>5s} | {'twist rms':>9s} {'sigma':>7s} {'worst':>7s}"
          f" {'z':>5s} {'/bound':>6s} | {'bending rms':>11s} {'sigma':>7s} {'z':>5s} {'/bound':>6s}  (deg, mm)")  # fmt: skip  # noqa: E501
    for name, row in rows.items():
        if row.twist:
            r = row.figures()
            print(f"{name:24s} {r['cases']:5.0f} {r['refused']:7.0f} {r['markers']:5.0f} | {r['twist_rms']:9.4f}"
                  f" {r['twist_sigma']:7.4f} {r['twist_sigma_worst']:7.4f} {r['twist_z']:5.2f}"
                  f" {r['twist_over_bound']:6.2f} | {r['bending_rms']:11.4f} {r['bending_sigma']:7.4f}"
                  f" {r['bending_z']:5.2f} {r['bending_over_bound']:6.2f}", flush=True)  # fmt: skip
    still, moved = rows["two cameras"], rows["shaken, walls"]
    if still.twist and moved.twist:
        shares = [(_rms(getattr(moved, n)) / _rms(getattr(still, n))) for n in ("twist", "twist_sigma", "twist_bound")]
        print("shaken over fixed cameras, twist: error {:.2f}, sigma {:.2f}, bound {:.2f}".format(*shares), flush=True)


def _rms(values: list[np.ndarray]) -> float:
    return float(np.sqrt((np.array(values)[:, 1:] ** 2).mean()))


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
