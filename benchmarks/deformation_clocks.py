"""Cameras that are not in step: a swinging wing, measured in step, with the nearest pictures, and interpolated.

Error of tip rise and twist against the truth, for the second camera at several rates; cam1 takes 50 pictures per second
and the wing swings with 4 Hz. "sigma" is the root mean square of the stated ones. One table, and JSON with --json FILE.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from windmark import io
from windmark.pipeline.deform import FrameImages, follow_deformation, load, read_deform_project
from windmark.pipeline.deform.frames import instants_of
from windmark.pipeline.simulate_deforming import _swinging, simulate_deforming
from windmark.synth import deforming_sequence, stereo_wing

SIZE, FRAMES, REACH = (640, 400), 30, 528.0
RATES = (50.0, 30.0, 25.0, 16.0)


def errors(frames, test, times):
    """RMS error of rise and twist of the tip, stated sigma, frames with both cameras."""
    out = []
    for frame, t in zip(follow_deformation(frames, test), times, strict=True):
        if frame.state is None or t < 0.1 or len(frame.views) < 2:
            continue
        q, state = frame.state.parameters, _swinging(t)
        rise = q["wing.bend_2"] + q["wing.bend_3"] - REACH * state.tip_fraction
        twist = q["wing.twist_1"] + q["wing.twist_2"] - state.twist_deg
        names = list(test.volumes.names)
        pick = np.array([[n.startswith(f"wing.{k}") for n in names] for k in ("bend", "twist")], float)
        cov = frame.state.cov[frame.state.slices["law"], frame.state.slices["law"]]
        out.append([rise, twist, *np.diag(pick @ cov @ pick.T) * max(1.0, frame.state.sigma0) ** 2])
    every = np.array(out)
    return {
        "frames": len(every), "rise_mm": float(np.sqrt((every[:, 0] ** 2).mean())),
        "twist_deg": float(np.sqrt((every[:, 1] ** 2).mean())),
        "sigma_rise_mm": float(np.sqrt(every[:, 2].mean())), "sigma_twist_deg": float(np.sqrt(every[:, 3].mean())),
    }  # fmt: skip


def main(quick: bool = False) -> list[dict[str, object]]:
    """Measure, print the table, return its rows."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate_deforming(folder, 1, FRAMES, SIZE, clocks=True)
        (folder / "deform.toml").write_text((folder / "deform.toml").read_text().replace("zero = [", "# zero = ["))
        project = read_deform_project(folder / "deform.toml")
        test = load(project).test
        world = stereo_wing(1, size_px=SIZE, nodes=20_000)
        times = np.arange(FRAMES) / 50
        slow_images, start = folder / "images", -0.0263
        both = list(deforming_sequence(world, [_swinging(t) for t in times], seed=9))
        frames = [FrameImages(str(k), float(t), i) for k, (t, i) in enumerate(zip(times, both, strict=True))]
        rows.append({"cam2_hz": 50.0, "how": "in step", **errors(frames, test, times)})
        for rate in RATES[:1] if quick else RATES:
            stamps = start + np.arange(int(np.ceil((times[-1] - start) * rate)) + 1) / rate
            for old in slow_images.glob("cam2-*.tif"):
                old.unlink()
            made = deforming_sequence(world, [_swinging(t) for t in stamps], seed=7, cameras=["cam2"])
            for k, images in enumerate(made):
                io.write_image(slow_images / f"cam2-{k:04d}.tif", images["cam2"])
            files = [f"cam2-{k:04d}.tif" for k in range(len(stamps))]
            io.write_table(folder / "cam2-times.csv", {"image": np.array(files), "time_s": stamps})
            timed = instants_of(project).frames
            nearest = [FrameImages(f.key, f.instant, f.images) for f in timed]
            rows.append({"cam2_hz": rate, "how": "nearest", **errors(nearest, test, times)})
            rows.append({"cam2_hz": rate, "how": "interpolated", **errors(timed, test, times)})
    print(f"{'cam2 Hz':>8} {'pictures':14}{'frames':>7}{'rise mm':>9}{'sigma':>8}{'twist deg':>11}{'sigma':>8}")
    for r in rows:
        print(f"{r['cam2_hz']:8.0f} {r['how']:14}{r['frames']:7d}{r['rise_mm']:9.3f}{r['sigma_rise_mm']:8.3f}"
              f"{r['twist_deg']:11.4f}{r['sigma_twist_deg']:8.4f}")  # fmt: skip
    return rows


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
