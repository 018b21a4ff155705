"""Resection: speed and accuracy beside peers, in one run, on one thread.

The scene is synthetic: a wing through a body, 304,200 nodes (NASA's open test grid has 309,062, for
which upsp-processing takes 17 s to set up visibility and 12 s to map the nodes; on that grid itself
tests/resection/test_nasa.py holds `see_nodes` to the exact answer).
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.resection import (
    interpolate_image,
    map_pixels,
    node_values,
    section,
    see_nodes,
    see_pixels,
    silhouette,
    virtual_image,
)
from windmark.resection.reasons import HIDDEN, VISIBLE
from windmark.scene import Mesh, structured_triangles


def main(quick: bool = False) -> dict[str, float]:
    """Measure, print one table, return its numbers (seconds, ratios, px, per cent as named)."""
    results: dict[str, float] = {}
    nodes = 120 if quick else 390
    mesh = wing_and_body(nodes)
    camera = Camera((1280, 800), 1400.0, k1=-0.08, k2=0.01, p1=5e-4)
    pose = Pose.look_at([2.1, -6.0, 5.0], [0.0, 0.5, 0.2], [0, 0, 1])
    results["triangles"] = len(mesh.triangles)
    results["nodes"] = len(mesh.vertices)
    _geometry(results, mesh, camera, pose, repeat=2 if quick else 5)
    _images(results, mesh, camera, pose, repeat=2 if quick else 5)
    _vtk(results, mesh, camera, pose, count=300 if quick else 2000)
    _interpolation_error(results)
    print("\nresection                                            value")
    for name, value in results.items():
        print(f"{name:<50} {value:10.4g}")
    return results


def wing_and_body(n: int) -> Mesh:
    """A swept wing through a body of revolution: closed, curved, one part before the other."""
    chord, span = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(-3, 3, n))
    wing = np.stack([0.5 * np.cos(chord) + 0.3 * abs(span), span, 0.06 * np.sin(chord)], axis=-1).reshape(-1, 3)
    turn, along = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(-2, 2, n))
    radius = 0.4 * np.sqrt(1 - (along / 2.001) ** 2)
    body = np.stack([along, radius * np.cos(turn), radius * np.sin(turn)], axis=-1).reshape(-1, 3)
    triangles = np.concatenate([structured_triangles(n, n, reverse=True), structured_triangles(n, n, first=n * n)])
    return Mesh.make(np.concatenate([wing, body]), triangles)


def best(call: Callable[[], object], repeat: int) -> float:
    """Least CPU time of some calls, after one that compiles."""
    call()
    times = []
    for _ in range(repeat):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return min(times)


def _geometry(results: dict[str, float], mesh: Mesh, camera: Camera, pose: Pose, repeat: int) -> None:
    results["map_pixels, 1 Mpx [s]"] = best(lambda: map_pixels(mesh, camera, pose), repeat)
    results["see_nodes, trusting orientation [s]"] = best(lambda: see_nodes(mesh, camera, pose), repeat)
    results["see_nodes, two-sided [s]"] = best(lambda: see_nodes(mesh, camera, pose, two_sided=True), repeat)
    pixel_map = map_pixels(mesh, camera, pose)
    results["silhouette, 1 Mpx [s]"] = best(lambda: silhouette(pixel_map), repeat)
    results["section [s]"] = best(lambda: section(mesh, [0, 0.5, 0], [0, 1, 0]), repeat)
    xy, _ = camera.project(pose.apply(pixel_map.xyz()[pixel_map.valid]))
    rows, columns = np.nonzero(pixel_map.valid)
    results["pixel's point back to its pixel, worst [px]"] = np.abs(xy - np.stack([columns, rows], axis=1)).max()


def _images(results: dict[str, float], mesh: Mesh, camera: Camera, pose: Pose, repeat: int) -> None:
    image = np.random.default_rng(0).integers(0, 4096, (800, 1280)).astype(np.uint16)
    other = Pose.look_at([0.5, -4.0, 6.0], [0.0, 0.5, 0.2], [0, 0, 1])
    pixel_map = map_pixels(mesh, camera, other)
    seen = see_pixels(pixel_map, camera, pose)
    for name in ("linear", "cubic"):
        results[f"virtual_image, 1 Mpx, {name} [s]"] = best(
            lambda name=name: virtual_image(image, pixel_map, camera, pose, interpolation=name), repeat
        )
        results[f"  the image alone (sequences), {name} [s]"] = best(
            lambda name=name: pixel_map.to_image(node_values(image, seen, interpolation=name)), repeat
        )
    view = see_nodes(mesh, camera, pose)
    results["node_values, linear [ns per visible node]"] = (
        1e9 * best(lambda: node_values(image, view, interpolation="linear"), repeat) / view.visible.sum()
    )
    xy = np.random.default_rng(1).uniform(2, 790, (800, 1280, 2))
    ours = best(lambda: interpolate_image(image, xy, interpolation="linear"), repeat)
    results["interpolate_image, linear [ns per point]"] = 1e9 * ours / 1024000
    cubic = best(lambda: interpolate_image(image, xy, interpolation="cubic"), repeat)
    results["interpolate_image, cubic [ns per point]"] = 1e9 * cubic / 1024000
    try:
        import cv2
    except ImportError:
        return
    cv2.setNumThreads(1)
    x, y = (np.ascontiguousarray(xy[..., k], dtype=np.float32) for k in (0, 1))
    theirs = best(lambda: cv2.remap(image, x, y, cv2.INTER_LINEAR), repeat)
    results["  cv2.remap, linear (1/32 px) [ns per point]"] = 1e9 * theirs / 1024000
    theirs = best(lambda: cv2.remap(image, x, y, cv2.INTER_CUBIC), repeat)
    results["  cv2.remap, cubic (1/32 px) [ns per point]"] = 1e9 * theirs / 1024000


def _vtk(results: dict[str, float], mesh: Mesh, camera: Camera, pose: Pose, count: int) -> None:
    """Visibility of some nodes by VTK's ray casting, one node at a time: time and agreement."""
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
    view = see_nodes(mesh, camera, pose, two_sided=True)
    some = np.random.default_rng(2).choice(
        np.flatnonzero(np.isin(view.reason, (VISIBLE, HIDDEN))), count, replace=False
    )
    surface.ray_trace(pose.center, mesh.vertices[0])  # builds the tree
    start = time.thread_time()
    hidden = np.zeros(count, bool)
    for k, node in enumerate(mesh.vertices[some]):
        # Stop short of the node, whose own triangles do not hide it.
        points, _ = surface.ray_trace(pose.center, pose.center + (1 - 1e-5) * (node - pose.center), first_point=True)
        hidden[k] = points.size > 0
    per_node = (time.thread_time() - start) / count
    results["VTK ray casting [us per node]"] = 1e6 * per_node
    results["see_nodes, two-sided [us per node]"] = 1e6 * results["see_nodes, two-sided [s]"] / len(mesh.vertices)
    results["nodes on which VTK agrees [%]"] = 100 * np.mean(hidden == (view.reason[some] == HIDDEN))


def _interpolation_error(results: dict[str, float]) -> None:
    """RMS error on a sine of 8 px period, in per cent of its amplitude."""
    x, y = np.meshgrid(np.arange(400.0), np.arange(300.0))
    image = np.sin(2 * np.pi * x / 8 + 0.3 * y).astype(np.float32)
    xy = np.random.default_rng(3).uniform(5, 290, (100_000, 2))
    truth = np.sin(2 * np.pi * xy[:, 0] / 8 + 0.3 * xy[:, 1])
    for name in ("linear", "cubic"):
        got = interpolate_image(image, xy, interpolation=name)
        results[f"error at 8 px period, {name} [% rms]"] = 100 * np.sqrt(np.mean((got - truth) ** 2))
    try:
        import cv2
    except ImportError:
        return
    fx, fy = (v.astype(np.float32)[:, None] for v in xy.T)
    for name, flag in (("linear", cv2.INTER_LINEAR), ("cubic", cv2.INTER_CUBIC)):
        parts = [cv2.remap(image, fx[k : k + 30000], fy[k : k + 30000], flag) for k in range(0, len(fx), 30000)]
        error = np.concatenate(parts)[:, 0] - truth
        results[f"  cv2.remap, {name} [% rms]"] = 100 * np.sqrt(np.mean(error**2))


if __name__ == "__main__":
    import sys

    main("--quick" in sys.argv)
