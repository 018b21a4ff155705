"""2D alignment against 3D alignment: held-out residual, true error and error of the ratio, and speed beside OpenCV.

Models before one camera, wind-off and wind-on:

plate      flat, turned out of its plane and in it, moved by about 100 px
wing       a rendered swept wing that moves as a rigid body (curved: it has relief and perspective)
bent wing  ... whose tip rises by 2 % of the span and twists by 1 degree as well
far        ... the same, moved by about 100 px

Markers are those that `detect` finds in the rendered pictures (of the plate: true places with 0.03 px of noise). Every
way of aligning says where in the wind-on picture each pixel of the wind-off one is; the truth is known for every pixel
of the wing. "Ratio" is the error of the ratio of two pictures whose paint has a gradient of 1 %/px (root mean square),
the wind-on one made from the true places and recomputed as `align` does. All figures are inside the markers' hull.

3D rigid is the pose that fits this picture's markers best; 3D law the beam law and the motion found from it.

The speed is that of recomputing a picture of 1 Mpx by one thread, beside cv2.remap with its cubic kernel on a map that
is already there; the error is against a picture that is known everywhere (waves of 12 px and longer).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import windmark as wm
from windmark import synth
from windmark.deformation import identify
from windmark.geometry.planar import KINDS, PlanarTransform, hull_of, inside_hull
from windmark.resection import map_pixels, warp_image
from windmark.scene import Detections, Observations, View

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "deformation"))
import wing_scenes as scenes

Array = NDArray[np.float64]
Place = Callable[[Array], Array]

CAMERA, SEED = "cam1", 7
WAYS = ("none", *KINDS, "auto", "3D rigid", "3D law")
GRADIENT = 0.01
"""Of the paint, per pixel, root mean square."""


@dataclass(frozen=True)
class Case:
    """Two pictures' markers and the truth.

    Parameters
    ----------
    reference, image : the markers
    pixels, true : (P, 2) pixels of the model in the reference and where they truly are in the image
    back : where a pixel (N, 2) of the image truly comes from in the reference; NaN off the model
    ways : other ways of aligning, by name: the places (P, 2) of ``pixels``
    size_px : of the pictures
    """

    reference: Detections
    image: Detections
    pixels: Array
    true: Array
    back: Place
    ways: dict[str, Array]
    size_px: tuple[int, int]


def plate(seed: int) -> Case:
    """A flat plate with 48 markers."""
    rng = np.random.default_rng(seed)
    camera = wm.Camera((960, 720), 1400.0)
    at_rest = wm.Pose.look_at([30.0, -40.0, 500.0], [0, 0, 0], [0, 1, 0])
    moved = at_rest @ wm.Pose.from_rotvec(np.radians([4.0, -3.0, 2.0]), [30.0, -18.0, 4.0])
    xyz = np.column_stack([rng.uniform(-120, 120, 48), rng.uniform(-90, 90, 48), np.zeros(48)])
    spots = [Detections.make(camera.project(p.apply(xyz))[0] + rng.normal(0, 0.03, (48, 2)), sigma_px=0.03)
             for p in (at_rest, moved)]  # fmt: skip

    def through(a: wm.Pose, b: wm.Pose) -> Place:
        plane = [np.column_stack([p.rotation[:, :2], p.translation]) for p in (a, b)]
        h = camera.matrix @ plane[1] @ np.linalg.inv(camera.matrix @ plane[0])

        def place(xy: Array) -> Array:
            w = np.column_stack([xy, np.ones(len(xy))]) @ h.T
            return w[:, :2] / w[:, 2:]

        return place

    pixels = _grid(camera.size_px)
    there = through(at_rest, moved)
    exact = there(pixels)
    return Case(*spots, pixels, exact, through(moved, at_rest), {"3D rigid": exact, "3D law": exact}, camera.size_px)


def wing(seed: int, state: synth.WingState, size_px: tuple[int, int]) -> Case:
    """The rendered wing, wind-off and in a state; detection, labels from the truth for 3D."""
    test = synth.stereo_wing(seed, size_px=size_px, nodes=20_000)
    camera, station = test.cameras[CAMERA], test.cam_from_tunnel[CAMERA]
    still, blown = (synth.deformed_world(test, s) for s in (synth.WingState(), state))
    found, perfect = [], []
    for s in (synth.WingState(), state):
        images, renderings = scenes.rendered(test, s, synth.Sensor(), [seed, 1])
        found.append(wm.detect(images[CAMERA], radius_px=size_px[0] / 256))
        perfect.append(renderings[CAMERA])
    maps = [map_pixels(w.mesh, camera, station, cull_backfaces=True) for w in (still, blown)]
    on_wing = maps[0].valid & (still.mesh.volume[np.maximum(maps[0].triangle, 0)] == "wing")
    pixels = _grid(size_px)[on_wing.ravel()]
    triangle, weights = maps[0].triangle[on_wing], maps[0].barycentric[on_wing]

    def seen(vertices: Array, triangle: Array, weights: Array) -> Array:
        corners = vertices[still.mesh.triangles[triangle]]
        xyz = np.einsum("nk,nkc->nc", np.column_stack([1 - weights.sum(axis=1), weights]), corners)
        return camera.project(station.apply(xyz))[0]

    back_map = np.full((*maps[1].valid.shape, 2), np.nan)
    good = maps[1].valid
    back_map[good] = seen(still.mesh.vertices, maps[1].triangle[good], maps[1].barycentric[good])
    ways = {}
    observed = _observations(found[1], perfect[1].markers.ellipse_xy, perfect[1].markers.visible)
    for name, laws in (("3D rigid", []), ("3D law", scenes.volumes(test.shape))):
        view = View(CAMERA, CAMERA, "", station)
        got = identify(observed, test.markers, laws, {CAMERA: camera}, [view], reject=bool(laws))
        if got:
            ways[name] = seen(got.mesh(still.mesh).vertices, triangle, weights)
    true = seen(blown.mesh.vertices, triangle, weights)
    return Case(*found, pixels, true, lambda xy: _look_up(back_map, xy), ways, size_px)


def measure(case: Case, kinds: tuple[str, ...] = WAYS) -> dict[str, dict[str, float]]:
    """Held-out residual, true error and error of the ratio of every way of aligning."""
    blank = np.zeros(case.size_px[::-1], np.float32)
    inside = None
    out: dict[str, dict[str, float]] = {}
    painted = _painted(case)
    for name in ("auto", *[k for k in kinds if k != "auto"]):
        held, chosen = float("nan"), ""
        if name in case.ways:
            places = case.ways[name]
        elif name == "none":
            places = case.pixels
        elif name.startswith("3D"):
            continue
        else:
            answer = wm.align_images(
                blank, blank, detections=case.image, reference_detections=case.reference, kind=name
            )
            if not answer:
                print(f"{name}: {answer.reason}")
                continue
            held, chosen, places = answer.held_out_px, answer.kind, answer.transform.apply(case.pixels)
            if inside is None:
                inside = inside_hull(hull_of(answer.reference_xy), case.pixels)
                shift = np.hypot(*answer.shift_px.T)
                out["motion"] = {"median_px": float(np.median(shift)), "largest_px": float(shift.max())}
        assert inside is not None, "auto must be aligned, it says where the markers' hull is"
        off = np.hypot(*(places - case.true)[inside].T)
        out[name] = {"held_out_px": held, "error_px": float(np.sqrt(np.mean(off**2))),
                     "error_p95_px": float(np.percentile(off, 95)),
                     "ratio_percent": _ratio_error(case, painted, places, inside)}  # fmt: skip
        if name == "auto":
            out[name]["kind"] = chosen  # type: ignore[assignment]
    return out


def paint(xy: Array) -> Array:
    """Light with a gradient of 1 %/px (root mean square), waves of 63 px."""
    return 1000 * np.exp(10 * GRADIENT * (np.sin(xy[..., 0] / 10) + np.sin(xy[..., 1] / 10)))


def _painted(case: Case) -> NDArray[np.float32]:
    """The wind-on picture of that paint."""
    width, height = case.size_px
    return paint(case.back(_grid(case.size_px))).reshape(height, width).astype(np.float32)


def _ratio_error(case: Case, painted: NDArray[np.float32], places: Array, inside: Array) -> float:
    """Root mean square of ratio less one, percent."""
    got = wm.resection.interpolate_image(painted, places[inside])
    ratio = paint(case.pixels[inside]) / got
    return float(100 * np.sqrt(np.nanmean((ratio - 1) ** 2)))


def _grid(size_px: tuple[int, int]) -> Array:
    return np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in size_px)), axis=-1).reshape(-1, 2)


def _look_up(places: Array, xy: Array) -> Array:
    x, y = xy.astype(int).T
    return places[y, x]


def _observations(spots: Detections, truth: Array, visible: Array) -> Observations:
    """Spots labelled with the markers that truly are there."""
    spot, marker = [], []
    for m in np.flatnonzero(visible & np.isfinite(truth).all(axis=1)):
        off = np.hypot(*(spots.xy - truth[m]).T)
        if off.min() < 1.0:
            spot.append(int(off.argmin()))
            marker.append(int(m))
    return Observations(np.zeros(len(spot), np.int64), np.array(marker), spots.xy[spot], spots.cov[spot])


def speed(repeat: int = 7) -> dict[str, float]:
    """Milliseconds per megapixel by one thread and error in pixels, ours and OpenCV's cubic."""
    import cv2

    cv2.setNumThreads(1)
    size = (1024, 1024)
    at = _grid(size).reshape(1024, 1024, 2)

    def waves(xy: Array) -> Array:
        return 1000 + 200 * np.sin(xy[..., 0] * 2 * np.pi / 12) * np.sin(xy[..., 1] * 2 * np.pi / 17)

    image = waves(at).astype(np.float32)
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 1024, (60, 2))
    y = 1.01 * (x - 500) + 512 + 5 * ((x[:, :1] - 500) / 500) ** 2 * [0.2, 1.0] + rng.normal(0, 0.03, x.shape)
    out: dict[str, float] = {}
    for kind in ("affine", "poly3", "spline"):
        transform: PlanarTransform = wm.geometry.planar.fit_planar(kind, x, y).transform
        dense = np.concatenate([transform.apply(row) for row in at]).reshape(at.shape)
        truth, flat = waves(dense), dense.astype(np.float32)
        runs = {
            "ours": lambda t=transform: warp_image(image, t.apply, size),
            "cv2": lambda f=flat: cv2.remap(image, f, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT,
                                            borderValue=float("nan")),
        }  # fmt: skip
        seen = {n: call() for n, call in runs.items()}
        known = np.isfinite(seen["ours"]) & np.isfinite(seen["cv2"])
        slope = float(np.sqrt(np.mean((200 * 2 * np.pi / 12) ** 2 / 4)))
        exact = wm.resection.interpolate_image(image, dense)
        for name, call in runs.items():
            times = []
            for _ in range(repeat):
                start = time.thread_time()
                call()
                times.append(time.thread_time() - start)
            out[f"{kind} {name} ms"] = 1e3 * float(np.median(times)) / 1.048576
            out[f"{kind} {name} error px"] = float(np.sqrt(np.mean((seen[name] - truth)[known] ** 2))) / slope
        out[f"{kind} ours against every place exact px"] = float(
            np.sqrt(np.mean((seen["ours"] - exact)[known] ** 2)) / slope)  # fmt: skip
    return out


def states() -> dict[str, synth.WingState]:
    """Of the wing."""
    pivot = np.array([130.0, 0.0, 0.0])

    def motion(turn_deg: list[float], shift: list[float]) -> wm.Pose:
        rotation = wm.Pose.from_rotvec(np.radians(turn_deg), np.zeros(3)).rotation
        return wm.Pose(rotation, pivot - rotation @ pivot + shift)

    near, far = motion([0.1, 2.0, -0.05], [1.0, 0.5, 6.0]), motion([0.1, 2.0, -0.5], [30.0, 50.0, 6.0])
    return {
        "wing": synth.WingState(motion=near),
        "bent wing": synth.WingState(scenes.TIP, -scenes.TWIST_DEG, near),
        "far": synth.WingState(scenes.TIP, -scenes.TWIST_DEG, far),
    }


def main(quick: bool = False) -> dict[str, object]:
    """Measure, print the tables, return the figures."""
    size = (640, 400) if quick else (1280, 800)
    done = {"plate": measure(plate(SEED))}
    for name, state in states().items():
        done[name] = measure(wing(SEED, state, size))
    for figure, words in (("held_out_px", "held-out residual, px"), ("error_px", "true error, px RMS"),
                          ("ratio_percent", "error of the ratio at 1 %/px, % RMS")):  # fmt: skip
        print(f"\n{words:<38}" + "".join(f"{n:>12}" for n in done))
        for way in WAYS:
            cells = [rows.get(way, {}).get(figure, float("nan")) for rows in done.values()]
            print(f"{way:<38}" + "".join(f"{c:12.3f}" for c in cells))
    print("\nmotion, px: " + ", ".join(f"{n} {r['motion']['median_px']:.0f} to {r['motion']['largest_px']:.0f}"
                                       for n, r in done.items()))  # fmt: skip
    print("auto: " + ", ".join(f"{n} {r['auto']['kind']}" for n, r in done.items()))
    fast = speed(3 if quick else 7)
    print("\nrecomputing 1 Mpx, one thread")
    for name, value in fast.items():
        print(f"{name:<45}{value:10.4g}")
    return {"ways": done, "speed": fast}


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
