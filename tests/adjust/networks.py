"""Small networks with known truth for the tests of `adjust.network`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from windmark.adjust.network import Network, NetworkState
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

NAMES = ("focal_px", "aspect", "cx", "cy", "k1", "k2", "p1", "p2")
CAMERA = Camera((1500, 1000), 1530.0, 1.0005, 752.0, 495.0, k1=-0.06, k2=0.05, p1=3e-4, p2=-2e-4)


ROUGH = Camera((1500, 1000), 1530.0 * 1.15)


@dataclass
class Case:
    """A network, its true values, and values to start from."""

    network: Network
    truth: NetworkState
    start: NetworkState


def make(
    seed, *, views=8, points=25, noise=0.1, rig=False, seen=0.8, free=NAMES, kept=None, camera=CAMERA, **options
) -> Case:
    """Convergent pictures of a bumpy plate of 600 mm; with ``rig`` two cameras at every instant."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-300, 300, (points, 3)) * [1, 0.8, 0.3]
    members = 2 if rig else 1
    frames = [view(rng) for _ in range(views)]
    rotation, translation = (np.stack([getattr(p, name) for p in frames]) for name in ("rotation", "translation"))
    offsets = Pose.exp(np.array([[0, 0, 0, 0, 0, 0], [0.02, -0.25, 0.05, 260.0, 10.0, 40.0]])) if rig else None
    cameras = (camera, replace(camera, focal_px=1480.0, k1=-0.03))[:members]
    view_frame, member = np.repeat(np.arange(views), members), np.tile(np.arange(members), views)
    truth = NetworkState(cameras, Pose(rotation, translation), xyz, offsets)
    v, p = np.nonzero(rng.random((views * members, points)) < seen)
    xy, inside = project(truth, view_frame, member if rig else np.full(len(member), -1), member, v, p)
    v, p, xy = v[inside], p[inside], xy[inside]
    cov = np.broadcast_to(noise**2 * np.eye(2), (len(v), 2, 2)).copy()
    network = Network(
        v, p, xy + rng.normal(0, noise, xy.shape), cov, member if rig else np.zeros(views, int), view_frame,
        member if rig else np.full(views, -1), (tuple(free),) * members, np.ones(views, bool),
        np.zeros((points, 3), bool), **({"free_offset": np.array([False, True])} if rig else {}), **options,
    )  # fmt: skip
    begin = NetworkState(
        tuple(replace(c, focal_px=1.02 * c.focal_px, k1=0.0, k2=0.0, p1=0.0, p2=0.0) for c in cameras),
        Pose.exp(rng.normal(0, 1, (views, 6)) * [0.005, 0.005, 0.005, 5, 5, 5]) @ truth.frames,
        xyz + rng.normal(0, 2.0, xyz.shape), offsets,
    )  # fmt: skip
    return Case(network, truth, begin)


def view(rng) -> Pose:
    """A camera some 1.3 m away, looking at the plate from a random side, rolled."""
    around, up = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.8)
    eye = rng.uniform(1150, 1400) * np.array([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)])
    return Pose.look_at(eye, rng.normal(0, 10, 3), np.array([np.cos(3 * around), np.sin(3 * around), 0.1]))


def project(state, view_frame, view_offset, view_camera, v, p):
    """True pixels and whether they are in the picture, one by one."""
    xy, inside = np.zeros((len(v), 2)), np.zeros(len(v), bool)
    for o, (i, n) in enumerate(zip(v, p, strict=True)):
        f, a = view_frame[i], view_offset[i]
        x = state.frames.rotation[f] @ state.points[n] + state.frames.translation[f]
        if a >= 0:
            x = state.offsets.rotation[a] @ x + state.offsets.translation[a]
        camera = state.cameras[view_camera[i]]
        if state.change is not None:
            focal, x0, y0 = state.change[i]
            camera = replace(camera, focal_px=camera.focal_px * (1 + focal), cx=camera.cx + x0, cy=camera.cy + y0)
        xy[o], _ = camera.project(x)
        inside[o] = camera.in_image(xy[o])
    return xy, inside


def whole(system):
    """The information matrix and the free motions of all parameters, dense ones first."""
    d = len(system.g_d)
    out = np.zeros((d + len(system.g_e),) * 2)
    out[:d, :d] = np.triu(system.h_dd) + np.triu(system.h_dd, 1).T
    out[d:, :d], out[:d, d:] = system.h_ed, system.h_ed.T
    size = system.h_ee.shape[1]
    for e, block in enumerate(system.h_ee):
        s = slice(d + e * size, d + (e + 1) * size)
        out[s, s] = block
    return out, np.concatenate([system.gauge.dense, system.gauge.blocks])


def nouns(case, *, start=None, camera=ROUGH):
    """The case as a user has it: marks, rough markers, views without poses."""
    net = case.network
    xyz = case.start.points if start is None else start
    markers = MarkerSet.make([f"m{i:02d}" for i in range(len(xyz))], xyz)
    rig = len(case.truth.cameras) > 1
    names = [f"cam{c}" for c in range(len(case.truth.cameras))]
    views = [View(f"v{v:02d}", names[net.view_camera[v]], f"f{net.view_frame[v]}") for v in range(len(net.view_camera))]
    observations = Observations(net.view, net.point, net.xy, net.cov)
    return observations, markers, dict.fromkeys(names, camera), views, {"rig": rig}
