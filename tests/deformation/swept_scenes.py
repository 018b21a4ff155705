"""A swept wing on a body before a wall and two cameras, as projected points."""

from dataclasses import dataclass

import numpy as np

from windmark.deformation import Volume, Volumes, identify
from windmark.deformation.laws import Beam
from windmark.geometry import Camera, Pose
from windmark.scene import MarkerSet, Observations, View

NOISE = 0.05
BEAM = Beam(root=(103, 72, 0), tip=(384, 600, 0), section=(0, 1, 0), unit="mm")
PARTS = (Volume("wing", BEAM, parent="body"), Volume("body"))
VOLUMES = Volumes.of(PARTS)
Q = np.array([13.2, -4.0, 0.4, 0.6])
MOTION = Pose.from_rotvec(np.radians([0.5, 2.0, -0.3]), [3.0, 1.0, 20.0])
CAMERA = Camera((1280, 1024), 2090.0)
TARGET = np.array([205.0, 290.0, 0.0])


def markers():
    """50 on a swept wing of 600 mm, 10 on the body, 12 on a wall behind."""
    rng = np.random.default_rng(0)
    y, part = np.repeat(np.linspace(80, 580, 10), 5), np.tile(np.linspace(0.1, 0.9, 5), 10)
    wing = np.stack([np.tan(np.radians(28)) * y + part * (260 - 140 * y / 600), y, 10 * np.sin(np.pi * part)], axis=1)
    body = rng.uniform([-200, 0, 40], [500, 60, 70], (10, 3))
    wall = rng.uniform([-100, 0, -151], [500, 600, -149], (12, 3))
    names = [f"m{k}" for k in range(72)]
    volume, role = ["wing"] * 50 + ["body"] * 10 + ["wall"] * 12, ["model"] * 60 + ["wall"] * 12
    return MarkerSet.make(names, np.vstack([wing, body, wall]), volume=volume, role=role)


MARKERS = markers()
WALL = MARKERS.role == "wall"


def views():
    """Two cameras 60 degrees apart, 0.5 mm per pixel."""
    out = []
    for k, degrees in enumerate((-30, 30)):
        a = np.radians(degrees)
        eye = TARGET + 1045 * np.array([0, np.sin(a), np.cos(a)])
        out.append(View(f"v{k}", f"c{k}", "0", Pose.look_at(eye, TARGET, [1, 0, 0])))
    return out


VIEWS = views()
CAMERAS = {"c0": CAMERA, "c1": CAMERA}


@dataclass(frozen=True)
class Truth:
    """What the cameras see, without noise."""

    view: np.ndarray
    point: np.ndarray
    xy: np.ndarray


def seen(q=Q, motion=MOTION, poses=None, xyz=MARKERS.xyz, volumes=VOLUMES, wall=False, set_of=MARKERS):
    place = motion.apply(volumes.bind(xyz, np.where(WALL, "", set_of.volume)).place(q))
    place = np.where(WALL[:, None], xyz, place)
    view, point, xy = [], [], []
    for k, v in enumerate(VIEWS):
        pose = v.cam_from_model if poses is None else poses[k]
        pixel, valid = CAMERA.project(pose.apply(place))
        index = np.flatnonzero(valid & CAMERA.in_image(pixel) & (wall | ~WALL))
        view.append(np.full(len(index), k))
        point.append(index)
        xy.append(pixel[index])
    return Truth(np.concatenate(view), np.concatenate(point), np.concatenate(xy))


def observed(truth, rng=None, noise=NOISE, only=None):
    keep = np.ones(len(truth.view), bool) if only is None else only(truth)
    xy = truth.xy[keep]
    if rng is not None:
        xy = xy + noise * rng.standard_normal(xy.shape)
    return Observations(truth.view[keep], truth.point[keep], xy, np.tile(noise**2 * np.eye(2), (len(xy), 1, 1)))


def draws(count, truth, seed, set_of=MARKERS, parts=PARTS, views_of=VIEWS, **options):
    rng, out = np.random.default_rng(seed), []
    for _ in range(count):  # all but the first begin at the first one's answer, which is several times faster
        start = out[0] if out else None
        out.append(identify(observed(truth, rng), set_of, parts, CAMERAS, views_of, start=start, **options))
    assert all(out)
    return out


def z_of(result, q=Q):
    return (result.q - q) / [result.sigma[n] for n in result.volumes.names]
