"""Two pictures with known truth and a few matches by hand, one of them wrong: what `clicked_pair` says of it.

Observations only, no pixels. Shared by the tests and the benchmark of `windmark epipolar`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import reconstruct_scenes as scenes
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.geometry.two_view import epipolar_distance, sampson_distance
from windmark.scene import Detections
from windmark.tasks.clicked_pair import ClickedPair, Clicks, clicked_pair

Array = NDArray[np.float64]

PINHOLE = replace(scenes.CAMERA, k1=0.0, k2=0.0, p1=0.0, p2=0.0)
OFF = 5.0
"""Lines that miss a true place by so many of their own sigmas are off."""
FLOOR_PX = 0.05
"""What no geometry is asked for, 1 sigma."""
COLUMNS = ("sets", "refused", "named", "unchecked", "silent", "silent, off", "misnamed", "left", "matches", "wrong")


def pictures(shape: str, seed: int, camera: Camera, noise: float) -> tuple[list[Array], list[Pose], list[Array]]:
    """True places, poses, and noisy spots of 20 to 60 markers that both pictures have."""
    rng = np.random.default_rng(seed)
    if shape == "wing":
        xyz, normal = scenes.wing_body_walls(rng, 90)
    else:
        xyz = rng.uniform(-345, 345, (40, 3)) * ([1, 0.8, 0.6] if shape == "block" else [1, 0.8, 0])
        xyz[:, 2] += rng.normal(0, 3, len(xyz))
        normal = np.tile([0.0, 0.0, 1.0], (len(xyz), 1))
    half, way = np.radians(rng.uniform(5, 15)), rng.uniform(0, 2 * np.pi)
    middle = rng.uniform(-0.3, 0.3, 2)
    step = half * np.array([np.cos(way), np.sin(way)])
    poses = [scenes._station(rng, 345.0, *(middle + s * step), rng.normal(0, 0.1)) for s in (-1, 1)]
    both = np.ones(len(xyz), bool)
    for p in poses:
        xy, valid = camera.project(p.apply(xyz))
        both &= valid & camera.in_image(np.where(valid[:, None], xy, -9.0))
        if shape == "wing":
            both &= ~scenes.hidden(p.center, xyz) & (((p.center - xyz) * normal).sum(axis=1) > 0)
    true = [camera.project(p.apply(xyz[both]))[0] for p in poses]
    far = np.minimum(*(np.linalg.norm(t[:, None] - t[None], axis=2) for t in true)) + 1e9 * np.eye(int(both.sum()))
    kept: list[int] = []
    for k in range(len(far)):
        if not kept or far[k, kept].min() > 25:
            kept.append(k)
    true = [t[kept] for t in true]
    return true, poses, [t + rng.normal(0, noise, t.shape) for t in true]


def one(shape: str, number: int, seed: int, kind: str, wrong: bool) -> NDArray[np.int64] | None:
    """The columns of one set; None where the pictures share too few markers.

    ``kind`` is "no camera", "camera", or "bare": with a camera, and no spots but the clicked ones.
    """
    cameras = kind != "no camera"
    camera, noise = (scenes.CAMERA, 0.1) if cameras else (PINHOLE, 1.0)
    true, poses, spots = pictures(shape, seed, camera, noise)
    rng = np.random.default_rng([seed, number])
    if len(true[0]) < number + 3:
        return None
    picked = rng.permutation(len(true[0]))
    clicks = [s[picked[:number]] for s in spots]
    bad = int(rng.integers(number)) if wrong else -1
    if wrong and rng.random() < 0.5:
        clicks[1][bad] = spots[1][picked[number]]
    elif wrong:
        turn, far = rng.uniform(0, 2 * np.pi), np.exp(rng.uniform(np.log(15), np.log(200)))
        clicks[1][bad] = clicks[1][bad] + far * np.array([np.cos(turn), np.sin(turn)])
        spots[1] = np.vstack([spots[1], clicks[1][bad]])
    if kind == "bare":
        spots = clicks
    a, b = (Detections.make(s, sigma_px=noise) for s in spots)
    names = tuple(str(k) for k in range(number))
    try:
        found = clicked_pair(a, b, Clicks(*clicks, names), (camera, camera) if cameras else None)
    except ValueError:  # two clicks on one spot
        return None
    if not found:
        return np.array([1, 1] + 8 * [0])
    off = bool(found.wrong[bad] or found.unchecked[bad]) if wrong else bool(found.unchecked.any())
    named = bool(wrong and found.wrong[bad])
    right = np.arange(number) != bad
    count = [1, 0, named, (wrong and off and not named) or (not wrong and off), not off and not named,
             not off and is_off(found, true, poses, camera, noise), (found.wrong & right).sum(),
             (found.unchecked & right).sum(), len(found.spot_a),
             ((found.spot_a != found.spot_b) & ((found.click != bad) | (bad < 0))).sum()]  # fmt: skip
    return np.array(count, dtype=int)


def is_off(found: ClickedPair, true: list[Array], poses: list[Pose], camera: Camera, noise: float) -> bool:
    """Whether the lines of the true places miss them by more than their sigmas say."""
    if found.pose is not None:
        floor = FLOOR_PX**2 * np.eye(2)
        sigmas = epipolar_distance(
            *true, camera, camera, found.pose, cov_a=floor, cov_b=floor, cov_pose=found.pose_cov
        ).sigmas
        return bool(np.abs(sigmas).max() > OFF)
    assert found.estimate is not None
    far = sampson_distance(found.fundamental, *true)
    a, b = (np.column_stack([t, np.ones(len(t))]) for t in true)
    rows = (b[:, :, None] * a[:, None, :]).reshape(-1, 9)
    slope = (((a @ found.fundamental.T)[:, :2]) ** 2).sum(axis=1) + (((b @ found.fundamental)[:, :2]) ** 2).sum(axis=1)
    sigma = np.sqrt(np.einsum("ni,ij,nj->n", rows, found.estimate.cov, rows) / slope + FLOOR_PX**2)
    return bool((np.abs(far) / sigma).max() > OFF)
