"""Another lens, or markers off their table? Leads of both over scatter, for planted faults of each kind.

    python benchmarks/verdict_lens.py [--tunnels N] [--seed S]

Of every tunnel (1000 x 800 px, some 29 markers in view) the wind-off picture is registered with a focal length 1 % off,
a principal point 20 px off, and with tables that are off: scattered by 0.4 mm, bent (quadratic, and with a cubic and
scatter), twisted. "told" counts the cases in which the verdict would speak of a lens.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from windmark import detect, register, synth
from windmark.geometry import Camera
from windmark.pipeline.verdict.lens import other_interior
from windmark.scene import MarkerSet
from windmark.scene.detections import middle_sigma

EACH = 4


def planted(markers: MarkerSet, camera: Camera, rng: np.random.Generator) -> Iterator[tuple[str, MarkerSet, Camera]]:
    """Kind of fault, table, camera."""
    sign = rng.choice([-1, 1])
    yield "focal length 1 %", markers, replace(camera, focal_px=camera.focal_px * (1 + 0.01 * sign))
    yield "principal point 20 px", markers, replace(camera, cx=camera.cx + 20 * sign)
    middle, size = markers.xyz.mean(axis=0), np.ptp(markers.xyz, axis=0).max()
    u = (markers.xyz - middle) / size
    for _ in range(EACH):
        a, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        b, way = rng.standard_normal((2, 3))
        off = {
            "scattered": rng.normal(0, 0.4, u.shape),
            "bent": 3 * np.outer((u @ a) ** 2, way),
            "twisted": 0.01 * np.cross(axis, markers.xyz - middle) * (u @ b)[:, None],
            "cubic, scattered": np.outer(3 * (u @ a) ** 2 + 6 * (u @ b) ** 3, way) + rng.normal(0, 0.1, u.shape),
        }
        for kind, shift in off.items():
            yield kind, replace(markers, xyz=markers.xyz + shift), camera


def main() -> None:
    """Plant, register, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tunnels", type=int, default=8)
    parser.add_argument("--seed", type=int, default=300)
    wanted = parser.parse_args()
    rng = np.random.default_rng(wanted.seed)
    rows: dict[str, list[tuple[float, float, bool]]] = {}
    for seed in range(wanted.seed, wanted.seed + wanted.tunnels):
        test = synth.wind_tunnel(seed, size_px=(1000, 800), nodes=3000, clutter=None)
        shot = test.shot("wind-off")
        spots = detect(shot.image, radius_px=3.0)
        markers = test.markers.take(test.markers.role != "wall")
        for kind, table, camera in planted(markers, test.cameras[shot.view.camera], rng):
            answer = register(spots, table, camera)
            if answer:
                other = other_interior(answer, middle_sigma(spots.cov[answer.matching.detection]))
                rows.setdefault(kind, []).append((other.lead, other.likelier, other.told))
    print(f"{'fault':24s}{'n':>4s}{'told':>6s}   lead over scatter (min, median, max)   over a smooth table")
    for kind, every in rows.items():
        lead, likelier, told = np.array(every).T
        words = ["  ".join(f"{v:7.1f}" for v in (x.min(), np.median(x), x.max())) for x in (lead, likelier)]
        print(f"{kind:24s}{len(every):4d}{int(told.sum()):6d}   {words[0]}              {words[1]}")


if __name__ == "__main__":
    main()
