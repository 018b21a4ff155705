"""Several cameras round the virtual wing merged on its surface, against the truth: ``python benchmarks/merging.py``.

Two and four cameras, each with its own gain (1 to 2.1), poses found from the markers. Per set: nodes that any camera
sees and that got a value; error of the values against the noise-free truth (relative, away from markers) of each single
camera and of all merged; gains against the truth in sigmas; steps along the seams in sigmas. Then the same with lenses
that lose 15 % of light in the corners: what gains cannot explain is to be found as systematic difference.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from numpy.typing import NDArray

from windmark.detection import detect
from windmark.pipeline.simulate import RADIUS_PX
from windmark.pipeline.simulate_cameras import EXPOSURES, camera_shots
from windmark.registration import Registration, register
from windmark.resection import MergedViews, Picture, merge_views
from windmark.scene import Mesh
from windmark.synth import Sensor, TunnelTest

Array = NDArray[np.float64]

CLEAR = 2.5
"""Radii of a marker within which its dark disc is no paint."""

SEED = 3


def pictures(test: TunnelTest) -> list[Picture]:
    """The cameras' pictures with the poses that their markers give."""
    model = test.markers.with_role("model")
    out = []
    for shot in test.shots:
        camera = test.cameras[shot.view.camera]
        answer = register(detect(shot.image, radius_px=RADIUS_PX), model, camera)
        assert isinstance(answer, Registration), answer.reason
        out.append(Picture(shot.view.camera, shot.image, camera, answer.cam_from_model, None, answer.cov))
    return out


def model_of(test: TunnelTest) -> Mesh:
    """The grid without walls."""
    keep = test.mesh.volume != "wall"
    return Mesh(test.mesh.vertices, test.mesh.triangles[keep], test.mesh.volume[keep], test.mesh.blocks)


def truth(test: TunnelTest, reference: int) -> Array:
    """(V,) noise-free grey level less black in the reference camera's gain, without shading; NaN at markers."""
    sensor = Sensor()
    level = (2.0**sensor.bits - 1 - sensor.black) * EXPOSURES[reference] * test.shots[0].world.node_intensity()
    apart = np.full(len(level), np.inf)
    for xyz, radius in zip(test.markers.xyz, test.markers.radius, strict=True):
        apart = np.minimum(apart, np.linalg.norm(test.mesh.vertices - xyz, axis=1) / radius)
    return np.where(apart > CLEAR, level, np.nan)


def row(test: TunnelTest, merged: MergedViews, seconds: float) -> dict[str, float]:
    """One set in figures; errors in percent, median and RMS without the worst 2 % (outlines)."""
    true = truth(test, merged.gains.reference)
    seen = np.any([v.visible for v in merged.views], axis=0)

    def error(values: Array, where: NDArray[np.bool_]) -> tuple[float, float]:
        off = 100 * np.abs(values[where] / true[where] - 1)
        return float(np.median(off)), float(np.sqrt(np.mean(np.sort(off)[: int(0.98 * len(off))] ** 2)))

    single, same = [], []
    for values in merged.values:
        where = np.isfinite(values) & np.isfinite(true) & (true > 0)
        single.append(error(values, where))
        same.append(error(merged.nodes.value, where))
    gains = np.array(EXPOSURES[: len(merged.names)]) / EXPOSURES[merged.gains.reference]
    off = (merged.gains.gain - gains)[merged.gains.sigma > 0] / merged.gains.sigma[merged.gains.sigma > 0]
    known = np.isfinite(merged.nodes.value) & np.isfinite(true) & (true > 0)
    z = np.abs((merged.nodes.value - true) / merged.nodes.sigma)[known]
    best = int(np.argmin([m for m, _ in single]))
    best_rms = int(np.argmin([r for _, r in single]))
    return {
        "visible": int(seen.sum()), "without_value": int((seen & ~np.isfinite(merged.nodes.value)).sum()),
        "seen_by_best_single": int(max(np.isfinite(v).sum() for v in merged.values)),
        "best_single_median_%": single[best][0], "merged_there_median_%": same[best][0],
        "best_single_rms_%": single[best_rms][1], "merged_there_rms_%": same[best_rms][1],
        "error_over_sigma": float(np.median(z) / 0.67449),
        "gain_worst_%": float(100 * np.abs(merged.gains.gain / gains - 1).max()),
        "gain_worst_in_sigmas": float(np.abs(off).max()),
        "systematic_%": 100 * merged.gains.systematic,
        **{f"seam_{k}": v for k, v in merged.seams.summary().items()},
        "seam_nodes": len(merged.seams), "seconds": seconds,
    }  # fmt: skip


def main(quick: bool = False) -> dict[str, object]:
    """Merge, print the table, return its columns."""
    rows: dict[str, dict[str, float]] = {}
    for shading in (0.0,) if quick else (0.0, 0.15):
        test = camera_shots(SEED, 4, sensor=Sensor(vignetting=shading), clutter=False)
        shown, mesh = pictures(test), model_of(test)
        for count in (2, 4):
            start = time.perf_counter()
            merged = merge_views(mesh, shown[:count], black=Sensor().black, reference="cam1")
            assert isinstance(merged, MergedViews)
            name = f"{count} cameras" + (f", shading {100 * shading:.0f} %" if shading else "")
            rows[name] = row(test, merged, time.perf_counter() - start)
    names = list(rows)
    print(f"{'':28}" + "".join(f"{n:>26}" for n in names))
    for key in rows[names[0]]:
        print(f"{key:28}" + "".join(f"{rows[n][key]:26.4g}" for n in names))
    return dict(rows)


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
