"""Self-calibration: is it at the bound, do its covariances hold, how fast is it beside COLMAP's bundle adjustment?

Scenarios: S1 25 pictures of 100 markers on a nearly flat plate of 690 mm with a rake, S2 50 of 150 markers on a model
before walls, S3 500 of 2000 markers. 3004 x 2000 px, focal length 3070 px, 0.1 px of noise. Datum D1: free network
(inner constraints over all markers); D2: four markers held. The bound is the Cramer-Rao bound at the truth.

"rms/CRLB": root mean square error of the markers over all runs beside the bound's. "95 %": share of true values
within the ellipsoids that should hold 95 %, for the eight interior parameters together, and for each marker. The
interior parameters count once in a run: "+-" is what chance does to their share (1 sigma, 1.5 % with 200 runs).

Speed: one thread, from the same rough start to the minimum, then the complete marginal covariance; pycolmap (where it
is installed) gets the same marks, start and free parameters, and is asked for the same minimum and for its covariances
(`estimate_ba_covariance`: those of points with everything else known). "verb": the public `self_calibrate` of the same
marks and start: gross errors sought, every mark tested, other focal lengths sought, all covariances, names.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

import _networks as nets
from windmark.adjust.levenberg_marquardt import SolveOptions, minimise
from windmark.adjust.network import NetworkProblem
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.calibration import Free, self_calibrate
from windmark.geometry.similarity import align

OPTIONS = SolveOptions(gradient_tol=1e-3, initial_damping=1e-5)
SEEDS = 1_920_000


def efficiency(name: str, held: bool, runs: int) -> dict[str, float]:
    """Errors of many runs on one scenario beside the bound, and what the ellipsoids hold."""
    scene = nets.scenario(name, SEEDS)
    bound, _ = scene.bound(held)
    free = np.ones(len(scene.truth.points), bool)
    if held:
        free[scene.primaries] = False
    squares, inside_marker, inside_lens, sigma2 = [], [], [], []
    for run in range(runs):
        # Noise of its own in each datum: the interior parameters do not depend on the datum.
        rng = np.random.default_rng(SEEDS + 1 + run + 100_000 * held)
        network = scene.network(held, scene.noisy(rng))
        problem = NetworkProblem(network, scene.truth)
        values, system, report = minimise(problem, scene.truth, OPTIONS)
        assert report.converged, report
        covariance = in_datum(network_covariance(system, problem.layout))
        moved = values.points
        if not held:
            moved = align(moved, scene.truth.points).apply(moved)
        error = (moved - scene.truth.points)[free]
        squares.append((error**2).sum())
        chi = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance.points()[free]), error)
        inside_marker.append((chi < chi2.ppf(0.95, 3)).mean())
        units = problem.units(values).camera[0][:8]
        lens = (values.cameras[0].parameters() - scene.truth.cameras[0].parameters())[:8] / units
        inside_lens.append(lens @ np.linalg.solve(covariance.dense()[:8, :8], lens) < chi2.ppf(0.95, 8))
        redundancy = 2 * len(scene.view) - len(system.g_d) - len(system.g_e) + system.gauge.dense.shape[1]
        sigma2.append(2 * report.final_cost / redundancy)
    limit = float(np.trace(bound[free], axis1=1, axis2=2).sum())
    return {
        "bound_mm": float(np.sqrt(limit / free.sum())),
        "rms_over_crlb": float(np.sqrt(np.mean(squares) / limit)),
        "lens_95": 100 * float(np.mean(inside_lens)),
        "lens_95_sigma": 100 * float(np.sqrt(0.05 * 0.95 / runs)),
        "marker_95": 100 * float(np.mean(inside_marker)),
        "sigma0_squared": float(np.mean(sigma2)),
    }


def speed(name: str, repeats: int) -> dict[str, float]:
    """Median times of solve, covariance and the public verb in ms, and pycolmap's, interleaved."""
    scene = nets.scenario(name, SEEDS)
    rng = np.random.default_rng(SEEDS)
    network, start = scene.network(False, scene.noisy(rng)), scene.start(rng)
    nouns = scene.nouns(network.xy, start.points, posed=True)
    frames = zip(nouns[3], start.frames.rotation, start.frames.translation, strict=True)
    views = [replace(v, cam_from_model=nets.Pose(r, t)) for v, r, t in frames]
    ours, theirs, extra, verb, cost = [], [], [], [], 0.0
    for repeat in range(repeats + 1):
        begin = time.thread_time()
        problem = NetworkProblem(network, start)
        _, system, report = minimise(problem, start, OPTIONS)
        middle = time.thread_time()
        in_datum(network_covariance(system, problem.layout)).points()
        end = time.thread_time()
        cost = report.final_cost
        del system, problem
        seconds = peer(scene, network.xy, start)
        before = time.thread_time()
        answer = self_calibrate(*nouns[:2], {"cam": start.cameras[0]}, views, datum=Free())
        assert answer, answer
        if repeat:
            ours.append(middle - begin)
            extra.append(end - middle)
            theirs.append(seconds[:2])
            verb.append(time.thread_time() - before)
    whole = np.array(theirs).sum(axis=1)
    return {
        "solve_ms": 1e3 * float(np.median(ours)), "iterations": report.iterations,
        "covariance_ms": 1e3 * float(np.median(extra)), "pycolmap_ms": 1e3 * float(np.median(np.array(theirs)[:, 0])),
        "ratio": float(np.median(np.array(theirs)[:, 0] / np.array(ours))), "cost": cost, "pycolmap_cost": seconds[2],
        "verb_ms": 1e3 * float(np.median(verb)), "pycolmap_whole_ms": 1e3 * float(np.median(whole)),
        "verb_ratio": float(np.median(whole / np.array(verb))),
    }  # fmt: skip


def peer(scene: nets.Scenario, xy: np.ndarray, start: nets.NetworkState) -> tuple[float, float, float]:
    """CPU seconds of COLMAP's bundle adjustment and its covariances, its cost in our units; NaN without pycolmap."""
    try:
        import pycolmap
    except ImportError:
        return float("nan"), float("nan"), float("nan")
    world = pycolmap.Reconstruction()
    c = start.cameras[0]
    # COLMAP's pixel centres are at 0.5.
    interior = [c.focal_px, c.focal_px * c.aspect, c.cx + 0.5, c.cy + 0.5, c.k1, c.k2, c.p1, c.p2]
    camera = pycolmap.Camera(model="OPENCV", width=c.size_px[0], height=c.size_px[1], params=interior, camera_id=1)
    world.add_camera_with_trivial_rig(camera)
    seen: dict[int, list[tuple[int, int]]] = {}
    for v in range(len(start.frames.translation)):
        mine = np.flatnonzero(scene.view == v)
        image = pycolmap.Image(name=str(v), camera_id=1, image_id=v + 1)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(p + 0.5) for p in xy[mine]])
        rotation = pycolmap.Rotation3d(start.frames.rotation[v])
        world.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, start.frames.translation[v]))
        for k, o in enumerate(mine):
            seen.setdefault(int(scene.point[o]), []).append((v + 1, k))
    for p, places in sorted(seen.items()):
        track = pycolmap.Track()
        for image_id, k in places:
            track.add_element(image_id, k)
        world.add_point3D(start.points[p], track, np.zeros(3, np.uint8))
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in world.images:
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = True
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.max_num_iterations = 200
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, world)
    begin = time.process_time()
    adjuster.solve()
    middle = time.process_time()
    covariance = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), world, adjuster)
    extra = time.process_time() - middle if covariance is not None else float("nan")
    found = _state(world, scene, start)
    network = scene.network(False, xy)
    return middle - begin, extra, NetworkProblem(network, found).cost(found)


def _state(world: object, scene: nets.Scenario, start: nets.NetworkState) -> nets.NetworkState:
    """COLMAP's result in our convention."""
    f, fy, cx, cy, k1, k2, p1, p2 = world.cameras[1].params  # type: ignore[attr-defined]
    camera = replace(start.cameras[0], focal_px=f, aspect=fy / f, cx=cx - 0.5, cy=cy - 0.5, k1=k1, k2=k2, p1=p1, p2=p2)
    poses = [world.images[v + 1].cam_from_world() for v in range(len(start.frames.translation))]  # type: ignore[attr-defined]
    frames = nets.Pose(np.stack([p.rotation.matrix() for p in poses]), np.stack([p.translation for p in poses]))
    points = start.points.copy()
    for key, p in zip(sorted(set(scene.point.tolist())), sorted(world.points3D), strict=True):  # type: ignore[attr-defined]
        points[key] = world.points3D[p].xyz  # type: ignore[attr-defined]
    return replace(start, cameras=(camera,), frames=frames, points=points)


def main(quick: bool = False, runs: int = 200) -> dict[str, dict[str, float]]:
    """Measure, print the tables, return their rows."""
    figures: dict[str, dict[str, float]] = {}
    print("           runs  bound mm  rms/CRLB  95 % lens    +-  95 % marker  sigma0^2")
    for name, count in (("S1", runs), ("S2", runs), ("S3", max(runs // 10, 1))):
        if quick and name == "S3":
            continue
        for held in (False, True):
            number = 5 if quick else count
            r = figures[f"{name} {'D2' if held else 'D1'}"] = efficiency(name, held, number)
            print(f"{name} {'D2' if held else 'D1':7s} {number:5d} {r['bound_mm']:9.4f} {r['rms_over_crlb']:9.4f}"
                  f" {r['lens_95']:9.1f}% {r['lens_95_sigma']:5.1f} {r['marker_95']:11.1f}%"
                  f" {r['sigma0_squared']:9.4f}", flush=True)  # fmt: skip
    print("\nms            solve  steps  all cov.  pycolmap  ratio     verb  pycolmap + cov.  ratio  cost, pycolmap's")
    for name, repeats in (("S1", 15), ("S2", 7), ("S3", 3)):
        if quick and name != "S1":
            continue
        r = figures[f"{name} speed"] = speed(name, 3 if quick else repeats)
        print(f"{name:10s} {r['solve_ms']:8.1f} {r['iterations']:6.0f} {r['covariance_ms']:9.1f}"
              f" {r['pycolmap_ms']:9.1f} {r['ratio']:6.1f} {r['verb_ms']:8.1f} {r['pycolmap_whole_ms']:16.1f}"
              f" {r['verb_ratio']:6.1f}  {r['cost']:.3f} {r['pycolmap_cost']:.3f}",
              flush=True)  # fmt: skip
    return figures


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    main("--quick" in sys.argv, *numbers)
