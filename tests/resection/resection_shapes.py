"""Meshes, cameras and slow, plain twins of the ray caster for the tests of resection."""

from __future__ import annotations

import numpy as np

from windmark.geometry import Camera, Pose
from windmark.scene import Mesh, structured_triangles


def plate(nx=9, ny=7, size=(4.0, 3.0)):
    """A flat plate in z = 0, normal +z, centred on the origin."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, nx) * size[0], np.linspace(-0.5, 0.5, ny) * size[1])
    xyz = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    return Mesh.make(xyz, structured_triangles(nx, ny))


def box(n=5, half=(1.0, 1.0, 1.0), center=(0.0, 0.0, 0.0)):
    """A closed box of six blocks, n x n nodes each, normals outward; the blocks share no node."""
    s = np.linspace(-1.0, 1.0, n)
    a, b = (g.ravel() for g in np.meshgrid(s, s))
    vertices, triangles = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            xyz = np.empty((n * n, 3))
            xyz[:, axis], xyz[:, (axis + 1) % 3], xyz[:, (axis + 2) % 3] = side, a, b
            triangles.append(structured_triangles(n, n, first=len(vertices) * n * n, reverse=side < 0))
            vertices.append(xyz)
    return Mesh.make(np.concatenate(vertices) * half + np.array(center), np.concatenate(triangles))


def sphere(n=24, radius=1.0, center=(0.0, 0.0, 0.0)):
    """A globe of n meridians, normals outward; its poles are collapsed edges, so some triangles have no area."""
    lon, lat = np.meshgrid(np.linspace(0, 2 * np.pi, n + 1), np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1))
    xyz = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1).reshape(-1, 3)
    xyz[: n + 1] = [0, 0, -1]
    xyz[-n - 1 :] = [0, 0, 1]
    return Mesh.make(xyz * radius + np.array(center), structured_triangles(n + 1, n // 2 + 1))


def joined(*meshes):
    """Several meshes as one."""
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    triangles = [m.triangles + f for m, f in zip(meshes, first, strict=False)]
    return Mesh.make(np.concatenate([m.vertices for m in meshes]), np.concatenate(triangles))


def moved(mesh, *by):
    """The mesh shifted."""
    return Mesh.make(mesh.vertices + np.array(by), mesh.triangles)


def soup(rng, count, spread=1.0, size=0.5):
    """Triangles at random, through each other."""
    middle = rng.uniform(-spread, spread, (count, 1, 3))
    corners = middle + size * rng.normal(size=(count, 3, 3))
    return Mesh.make(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def lens_camera(size_px=(60, 44), focal_px=55.0):
    """A camera with every parameter at work; its distortion moves the corners by several pixels."""
    return Camera(
        size_px, focal_px, 1.02, size_px[0] * 0.47, size_px[1] * 0.52,
        k1=-0.12, k2=0.03, p1=2e-3, p2=-1e-3, k3=-0.004, tilt_x=0.02, tilt_y=-0.03,
    )  # fmt: skip


def pixel_grid(camera):
    """Pixel centres (H, W, 2)."""
    w, h = camera.size_px
    return np.stack(np.meshgrid(np.arange(w, dtype=float), np.arange(h, dtype=float)), axis=-1)


def intersections(vertices, triangles, origin, direction):
    """Moeller-Trumbore for rays (N, 3) and triangles: distances (N, T) in units of the direction, NaN for a miss."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    e, f = b - a, c - a
    p = np.cross(direction[:, None], f)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("tk,ntk->nt", e, p)
        s = origin - a
        u = np.einsum("ntk,ntk->nt", np.broadcast_to(s, p.shape), p) * inverse
        q = np.broadcast_to(np.cross(s, e), p.shape)
        v = np.einsum("ntk,ntk->nt", np.broadcast_to(direction[:, None], p.shape), q) * inverse
        t = np.einsum("tk,ntk->nt", f, q) * inverse
        return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & np.isfinite(t), t, np.nan)


def brute_first_hits(vertices_cam, triangles, rays):
    """Twin of `cast`: triangle (N,) (-1 for none) and depth (N,) (inf for none)."""
    direction = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    t = np.nan_to_num(intersections(vertices_cam, triangles, np.zeros(3), direction), nan=np.inf)
    first = np.argmin(t, axis=1)
    depth = t[np.arange(len(rays)), first]
    return np.where(np.isfinite(depth), first, -1), depth


def brute_hidden(mesh, center, nodes, margin):
    """Whether the straight line from nodes (indices) to the camera meets a triangle nearer than the node.

    ``margin`` is the part of the line next to the node that does not count; the node's own triangles do not either.
    """
    out = np.zeros(len(nodes), bool)
    for k in range(0, len(nodes), 50):
        some = nodes[k : k + 50]
        t = intersections(mesh.vertices, mesh.triangles, center, mesh.vertices[some] - center)
        own = (mesh.triangles[None] == some[:, None, None]).any(axis=2)
        with np.errstate(invalid="ignore"):
            out[k : k + 50] = ((t < 1 - margin) & ~own).any(axis=1)
    return out


def looking_at(eye, target=(0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0)):
    return Pose.look_at(eye, target, up)
