"""Speed of a live deformation measurement: frames per second, latency, memory over ten thousand frames.

Two cameras of 1 Mpx, 60 markers on the model, no markers on walls; the wing swings, images are in memory, each another
than the one before. "frame" is the time from both images to the deformation with the covariance of its parameters and
the displacement of every marker with its covariance, in steady tracking; the searches of the two cameras run in two
threads. The throughput counts everything but the checks: against the truth (errors over their sigma, of the laws'
parameters and of the markers' displacements, over the different images), and the same adjustment by
scipy.optimize.least_squares with numerical derivatives from the same start and observations, without covariance.

    python benchmarks/deformation_speed.py [--quick] [FRAMES]
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from windmark import synth
from windmark.deformation import Deformation
from windmark.deformation.sighting import LAW
from windmark.geometry import Pose
from windmark.pipeline.deform import DeformationTest, FrameImages, follow_deformation

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "deformation"))
import wing_scenes as scenes

SEED = 4_210_000
RENDERED = 24
WARM = 50


def swing(k: int) -> synth.WingState:
    """The model in the k-th rendered frame: a quarter of a swing of 8 Hz at 800 frames per second."""
    phase = 0.5 * np.pi * k / (RENDERED - 1)
    turn = Pose.from_rotvec(np.radians([0.0, 0.3 * np.sin(phase), 0.0]), np.array([0.0, 0.0, 1.5 * np.sin(phase)]))
    return synth.WingState(0.02 * np.sin(phase), np.sin(phase), turn)


def place_of(k: int) -> int:
    """Which rendered image the k-th frame is: forth and back through them."""
    way = [*range(RENDERED), *range(RENDERED - 2, 0, -1)]
    return way[k % len(way)]


def errors_over_sigma(
    state: Deformation, displacement: tuple[np.ndarray, np.ndarray], test: synth.TunnelTest, setup: DeformationTest,
    truth: synth.WingState,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Errors over their sigma: of the twist and the bending at the tip, and of all markers' displacements."""
    q = scenes.true_law(test.shape, truth)
    own = state.slices[LAW]
    error, cov = state.q - q, state.cov[own, own]
    tip = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])  # powers of bending and of twist at e = 1
    laws = tip @ error / np.sqrt(np.diag(tip @ cov @ tip.T))
    true = truth.motion.apply(state.placed.place(q)) - setup.markers.xyz
    markers = (displacement[0] - true) / np.sqrt(np.diagonal(displacement[1], axis1=1, axis2=2))
    return laws, markers.ravel()


def frames(images: list[dict[str, np.ndarray]], count: int) -> Iterator[FrameImages]:
    """Forth and back through the rendered images."""
    for k in range(count):
        yield FrameImages(str(k), float(k), images[place_of(k)])


def memory_mb() -> float:
    """Memory in use now."""
    with open("/proc/self/statm") as stream:
        return int(stream.read().split()[1]) * resource.getpagesize() / 2**20


def by_scipy(state: Deformation, setup: DeformationTest, observations: object) -> float:
    """Seconds that least_squares takes for the same adjustment."""
    o = observations
    markers, volumes = setup.markers, setup.volumes
    bound = volumes.bind(markers.xyz[o.point], markers.volume[o.point])  # type: ignore[attr-defined]
    root = np.linalg.inv(np.linalg.cholesky(o.cov))  # type: ignore[attr-defined]

    def residual(x: np.ndarray) -> np.ndarray:
        place = (Pose.exp(x[4:]) @ state.tunnel_from_model).apply(bound.place(x[:4]))
        out = np.empty((len(o.xy), 2))  # type: ignore[attr-defined]
        for v, station in enumerate(setup.stations):
            own = o.view == v  # type: ignore[attr-defined]
            out[own] = station.camera.project(station.cam_from_tunnel.apply(place[own]))[0] - o.xy[own]  # type: ignore[attr-defined]
        return np.asarray((root @ out[..., None]).ravel())

    start = np.concatenate([0.95 * state.q, np.zeros(6)])
    began = time.perf_counter()
    least_squares(residual, start, x_scale="jac")
    return time.perf_counter() - began


def main(quick: bool = False, count: int = 10_000) -> dict[str, float]:
    """Measure, print, return the figures."""
    count = 200 if quick else count
    test = synth.stereo_wing(SEED, nodes=20_000)
    setup = scenes.deformation_test(test, walls=False)
    images = list(synth.deforming_sequence(test, [swing(k) for k in range(RENDERED)], seed=SEED))
    seconds, spots, lost, cold, peers, scaled = [], [], 0, 0, [], []
    memory, began, checks = 0.0, 0.0, 0.0
    for k, frame in enumerate(follow_deformation(frames(images, count), setup)):
        if k == WARM:
            memory, began = memory_mb(), time.perf_counter()
        if k < WARM:
            continue
        lost += frame.state is None
        cold += frame.status == "cold"
        if frame.state is None or frame.observations is None:
            seconds.append(frame.seconds)
            continue
        start = time.perf_counter()
        displacement = frame.state.markers_displaced()
        stop = time.perf_counter()
        seconds.append(frame.seconds + stop - start)
        spots.append(len(frame.observations))
        if k - WARM < 2 * RENDERED - 2:
            scaled.append(errors_over_sigma(frame.state, displacement, test, setup, swing(place_of(k))))
        if k % (count // 10) == 0:
            peers.append(by_scipy(frame.state, setup, frame.observations))
            print(f"frame {k}: {memory_mb():.0f} MB", flush=True)
        checks += time.perf_counter() - stop
    wall = time.perf_counter() - began - checks
    ms = 1e3 * np.array(seconds)
    of_laws, of_markers = (np.concatenate(z) for z in zip(*scaled, strict=True))
    figures = {
        "frames": len(ms), "lost": lost, "cold": cold, "spots": float(np.median(spots)),
        "frames_per_s": len(ms) / wall, "median_ms": float(np.median(ms)), "p99_ms": float(np.percentile(ms, 99)),
        "memory_growth_mb": memory_mb() - memory, "scipy_ms": 1e3 * float(np.median(peers)),
        "z_laws": float(np.sqrt(np.mean(of_laws**2))), "z_markers": float(np.sqrt(np.mean(of_markers**2))),
    }  # fmt: skip
    print("  ".join(f"{n} {v:.4g}" for n, v in figures.items()))
    print(f"the whole frame takes {figures['median_ms'] / figures['scipy_ms']:.2f} of scipy's adjustment alone")
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
