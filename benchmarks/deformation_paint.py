"""PSP pictures of a deformed wing, mapped with and without its deformation (AIAA 2005-5007, Fig. 10).

A rendered swept wing with synthetic pressure-sensitive paint, wind-off and wind-on, before cameras 30 degrees off its
normal, 0.5 mm per pixel. Under wind the tip rises by 2 % of the span and twists by 1 degree, and the model moves by
2 mm and half a degree. Ratio wind-off / wind-on at the grid's nodes on wing and body against the ratio that the paint
truly gives there, all as `windmark deform` makes it with ``[values]``:

as a whole      the grid where it fits all markers best: software that knows no deformation
one camera      the grid bent by the beam law that is found from the same one image
two cameras     ... from both cameras
truth           the grid as it truly is: what noise, blur and the paint's grain leave

The error of the pressure coefficient is that of the ratio by the paint's and the stream's constants (Stern-Volmer
A = 0.2, Mach 0.8). ``--picture FILE`` draws the error maps side by side.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from windmark import synth
from windmark.app.deform_pictures import Maps, maps_picture
from windmark.app.pictures import png
from windmark.geometry import Pose
from windmark.pipeline.deform import DeformedFrame, FrameImages, follow_deformation
from windmark.pipeline.deform.entries import ValuesEntry
from windmark.pipeline.deform.values import Mapper, away_from, surface_values
from windmark.scene import Mesh

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "deformation"))
import wing_scenes as scenes

SEED, CAMERA = 52_017, "cam1"
MACH, STERN_VOLMER = 0.8, 0.2
SENSOR = synth.Sensor()


@dataclass(frozen=True)
class Mapped:
    """Errors of the ratio in percent at the nodes, NaN where not all ways of mapping have a value.

    Parameters
    ----------
    mesh : wing and body at rest
    truth : (V,) the ratio as it is
    errors : way of mapping -> (V,)
    off_px : (V,) how far the grid as a whole is off in the image
    direction, up : the camera's
    """

    mesh: Mesh
    truth: np.ndarray
    errors: dict[str, np.ndarray]
    off_px: np.ndarray
    direction: np.ndarray
    up: np.ndarray


def mapped(seed: int = SEED, size_px: tuple[int, int] = (1280, 800), nodes: int = 60_000) -> Mapped:
    """Render, identify, map."""
    test = synth.stereo_wing(seed, size_px=size_px, nodes=nodes)
    model = test.mesh.volume != "wall"
    mesh = replace(test.mesh, triangles=test.mesh.triangles[model], volume=test.mesh.volume[model], blocks=())
    pivot = np.array([130.0, 0.0, 0.0])
    turn = Pose.from_rotvec(np.radians([0.06, 0.5, -0.04]), np.zeros(3)).rotation
    motion = Pose(turn, pivot - turn @ pivot + [0.7, 0.25, 1.9])
    states = synth.WingState(), synth.WingState(scenes.TIP, scenes.TWIST_DEG, motion, mach=MACH)
    images = list(synth.deforming_sequence(test, states, sensor=SENSOR, seed=seed))
    still, blown = (synth.deformed_world(test, s) for s in states)
    light = [w.node_intensity() for w in (still, blown)]  # none where no lamp shines
    truth = np.divide(*light, out=np.full(len(mesh.vertices), np.nan), where=light[1] > 0)
    how = ValuesEntry(cameras=(CAMERA,), black=SENSOR.black)
    ratios: dict[str, np.ndarray] = {}
    for name, cameras in (("one camera", [CAMERA]), ("two cameras", None)):
        mapper = Mapper(scenes.deformation_test(test, cameras), mesh, how)
        off, on = (_found(test, images[k], cameras) for k in (0, 1))
        mapper.reference([off])
        ratios[name] = mapper.frame(*on)[f"ratio_{CAMERA}"]
        if name == "one camera":
            assert mapper.compared is not None
            ratios["as a whole"], off_px = mapper.compared.rigid, mapper.compared.off_px
    camera, pose = test.cameras[CAMERA], test.cam_from_tunnel[CAMERA]
    grey = [surface_values(images[k][CAMERA], replace(mesh, vertices=w.mesh.vertices), camera, pose, how)
            for k, w in enumerate((still, blown))]  # fmt: skip
    ratios["truth"] = np.where(away_from(test.markers, mesh, how.clear), grey[0] / grey[1], np.nan)
    errors = {n: 100 * (ratios[n] / truth - 1) for n in ("as a whole", "one camera", "two cameras", "truth")}
    all_seen = np.all([np.isfinite(e) for e in errors.values()], axis=0)
    errors = {n: np.where(all_seen, e, np.nan) for n, e in errors.items()}
    return Mapped(mesh, truth, errors, np.where(all_seen, off_px, np.nan), pose.rotation[2], -pose.rotation[1])


def _found(
    test: synth.TunnelTest, images: dict[str, np.ndarray], cameras: list[str] | None
) -> tuple[DeformedFrame, FrameImages]:
    names = list(test.cameras) if cameras is None else cameras
    taken = FrameImages("0", 0.0, {n: images[n] for n in names})
    frame = next(follow_deformation([taken], scenes.deformation_test(test, cameras)))
    if frame.state is None:
        raise SystemExit(f"deformation_paint: {frame.reason}")
    return frame, taken


def figures_of(error: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Root mean square and the size that 95 % of the nodes keep, of the ratio (%) and of Cp."""
    good = np.isfinite(error)
    cp = error[good] / 100 * truth[good] / (1 - STERN_VOLMER) / (0.7 * MACH**2)
    out = {"nodes": float(good.sum())}
    for name, values in (("ratio", error[good]), ("cp", cp)):
        out[f"{name}_rms"] = float(np.sqrt((values**2).mean()))
        out[f"{name}_p95"] = float(np.percentile(np.abs(values), 95))
    return out


def picture(done: Mapped) -> Figure:
    """True ratio, and the error maps with and without deformation side by side."""
    shown = np.where(np.isfinite(done.errors["truth"]), done.truth, np.nan)
    maps = [Maps({"truth": shown}, "ratio wind-off / wind-on"),
            Maps({"grid as a whole": done.errors["as a whole"], "grid deformed": done.errors["one camera"]},
                 "error of the ratio, %", diverging=True)]  # fmt: skip
    return maps_picture(done.mesh, maps, direction=done.direction, up=done.up)


def main(quick: bool = False, file: str | None = None) -> dict[str, object]:
    """Measure, print the table, return its rows."""
    done = mapped(SEED, *(((640, 400), 20_000) if quick else ((1280, 800), 60_000)))
    off = done.off_px[np.isfinite(done.off_px)]
    out: dict[str, object] = {"off_px_rms": float(np.sqrt((off**2).mean())), "off_px_max": float(off.max())}
    print(f"grid as a whole off by {out['off_px_rms']:.2f} px RMS, {out['off_px_max']:.2f} px at most")
    print("grid            ratio, %: RMS   95 %   Cp: RMS    95 %   nodes")
    for name, error in done.errors.items():
        r = figures_of(error, done.truth)
        out[name] = r
        print(f"{name:15s} {r['ratio_rms']:13.3f} {r['ratio_p95']:6.3f} {r['cp_rms']:9.4f} {r['cp_p95']:7.4f}"
              f" {r['nodes']:7.0f}")  # fmt: skip
    if file is not None:
        Path(file).write_bytes(png(picture(done)))
    return out


if __name__ == "__main__":
    main("--quick" in sys.argv, sys.argv[sys.argv.index("--picture") + 1] if "--picture" in sys.argv else None)
