"""Attack 5: a regular board of which the table knows only a part; synthetic ones, and real pictures.

The real pictures lie beside the checkout (`../shared/data`); their spots are windmark's own, their truth is published
labels (PIV-E, MyPTV) or the lattice of the spots (DICe, whose orientation is free).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import _attack_models as models
import _matching_real_cases as real_cases
from _attack_pictures import Array, Trial, Truth, near, picture, trial_of, view
from _reference import label_lattice
from windmark.detection import detect
from windmark.geometry import Camera, Pose
from windmark.io import read_image
from windmark.registration import pose_from_labels
from windmark.scene import Detections

PRIOR_DEG, PRIOR_SCALE = 1.0, 0.01
"""A "true" prior is known to so much."""
REAL_PX = 4.0
"""The true pose of a real picture is known to so much; the neighbouring row is ten times as far."""
MOST_CUT = 0.25
"""Part of the rows on a side that the table may lack."""


def board(seed: int, *, prior: bool = False, missing: int = 0, labels: int = 0, cut: bool = False) -> Trial:
    """A board whose spots go on beyond the rows of its table, by a lens with 0.1 to 0.5 px that nobody knows.

    Parameters
    ----------
    prior : the true pose is given
    missing : the table is of 20 x 11 dots, and so many of those are not in the picture; 0 takes any size
    labels : so many spots are labelled by hand
    cut : the border of the picture cuts off up to a fifth of the board, at any side
    """
    rng = np.random.default_rng(seed)
    columns, rows = (20, 11) if missing else (int(rng.integers(6, 13)), int(rng.integers(5, 10)))
    left, right, top, bottom = rng.integers(0, 4, 4) if rng.random() < 0.8 else (1, 0, 0, 0)
    whole = models.grid(columns + left + right, rows + top + bottom)
    index = np.round(whole.xyz[:, :2]).astype(int)
    inside = (index >= [left, top]).all(axis=1) & (index < [left + columns, top + rows]).all(axis=1)
    camera, pose = view(rng, whole, tilt_max_deg=40, least=len(whole.xyz) - 6)
    pose = _turned(rng, whole.xyz, camera, pose) if cut else pose
    far = np.hypot(*np.array(camera.size_px)) / 2
    k1 = camera.k1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.5) / (far * (far / camera.focal_px) ** 2)
    keep = np.ones(len(whole), dtype=bool)
    keep[rng.permutation(np.flatnonzero(inside))[:missing]] = False
    shot = picture(rng, whole, replace(camera, k1=k1), pose, keep=keep, noise_px=0.05)
    known = _renumbered(shot.label, inside)
    markers = models.table(whole.xyz[inside], whole.normal[inside])
    prior_given = {"prior": near(rng, pose, markers.xyz, PRIOR_DEG, PRIOR_SCALE)} if prior else {}
    shot = replace(shot, label=known, seen=shot.seen[inside])
    return trial_of(
        shot, markers, camera=camera, must=labels > 0, unseen=("shift",) if cut else (),
        options={**prior_given, **_labelled(rng, known, labels)},
    )  # fmt: skip


def window(seed: int, *, labels: int = 1, hidden: float = 0.0, hexagonal: bool = False) -> Trial:
    """A board of which only a part is in view, all round of which the board goes on, with labels by hand.

    With one label its turns about that spot, as many as the lattice has, explain all spots where the turned part is on
    the table; so no answer is asked for, and only the right one is right.
    """
    rng = np.random.default_rng(seed)
    columns, rows, part = (*rng.integers(12, 30, 2), int(rng.integers(5, 9)))
    whole = models.grid(int(columns), int(rows))
    xyz = whole.xyz.copy()
    if hexagonal:
        xyz[:, 0] += 0.5 * (np.round(xyz[:, 1]) % 2)
        xyz[:, 1] *= np.sqrt(0.75)
    markers = models.table(xyz, whole.normal)
    low = rng.integers(0, [columns - part, rows - part])
    index = np.round(whole.xyz[:, :2]).astype(int)
    seen = (index >= low).all(axis=1) & (index < low + part).all(axis=1)
    camera, pose = view(rng, models.table(xyz[seen], whole.normal[seen]), tilt_max_deg=30, least=int(seen.sum()) - 4)
    keep = np.ones(len(whole), dtype=bool)
    keep[rng.random(len(whole)) < hidden] = False
    shot = picture(rng, markers, camera, pose, keep=keep, noise_px=0.05)
    return trial_of(shot, markers, camera=camera, must=labels > 1, options=_labelled(rng, shot.label, labels))


def _turned(rng: np.random.Generator, xyz: Array, camera: Camera, pose: Pose) -> Pose:
    """The camera turned about its eye, to any side, until it has lost a part of the markers."""
    around, least = rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 1.0)
    step = Pose.from_rotvec(0.004 * np.array([np.cos(around), np.sin(around), 0.0]), np.zeros(3))
    while camera.in_image(camera.project(pose.apply(xyz))[0]).mean() > least:
        pose = step @ pose
    return pose


def _renumbered(label: NDArray[np.int64], inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Labels (M,) as indices into the part ``inside`` (N,) of the table; -1 of what is outside."""
    number = np.where(inside, np.cumsum(inside) - 1, -1)
    return np.where(label >= 0, number[label], -1)


def _labelled(rng: np.random.Generator, label: NDArray[np.int64], count: int) -> dict[str, Any]:
    """The option `fixed` with so many true labels; none without any."""
    spots = rng.permutation(np.flatnonzero(label >= 0))[:count]
    return {"fixed": {int(s): int(label[s]) for s in spots}} if count else {}


# --- real boards ------------------------------------------------------------------------------


@dataclass(frozen=True)
class RealBoard:
    """One real picture: spots (M), the board's points (N), their columns and rows, the label of each spot, the pose."""

    detections: Detections
    xyz: Array
    index: NDArray[np.int64]
    label: NDArray[np.int64]
    camera: Camera
    pose: Pose


@cache
def dice(picture_name: str) -> RealBoard:
    """A DICe picture; camera and pose are fitted to the lattice of its spots."""
    image = read_image(real_cases.DATA / "dice-stereo-dots" / "images" / f"{picture_name}.jpeg")
    spots = detect(image, radius_px=46.0)
    index = label_lattice(spots.xy)
    on = index[:, 0] > -9999
    xyz = np.column_stack([3.5 * index[on], np.zeros(int(on.sum()))])
    fit = pose_from_labels(spots.xy[on], xyz, Camera((2448, 2048), 12_400.0), free=("k1",), loss="cauchy")
    label = np.where(on, np.cumsum(on) - 1, -1)
    return RealBoard(spots, xyz, index[on], label, replace(fit.camera, cov=None), fit.cam_from_model)


@cache
def _plate_fit(camera: int) -> Any:
    labels = [real_cases.plate_labels(camera, position) for position in range(1, 8)]
    raised = np.concatenate([xyz + np.array([0, 0, 0.1 * (n - 3)]) for n, (_, xyz) in enumerate(labels)])
    xy = np.concatenate([xy for xy, _ in labels])
    return pose_from_labels(xy, raised, Camera((1024, 1024), 6000.0), free=("focal_px", "k1"))


@cache
def plate(camera: int, position: int) -> RealBoard:
    """The two-level plate of the PIV challenge, by the fit of all its published labels; the rows are half a pitch."""
    fit = _plate_fit(camera)
    pose = fit.cam_from_model @ Pose(np.eye(3), np.array([0.0, 0.0, 0.1 * (position - 4)]))
    folder = real_cases.DATA / "piv-challenge-e-calib" / f"camera{camera}"
    image = read_image(folder / f"E_camera_{camera}_z_{position}.tif")
    spots = detect(image, radius_px={1: 19.0, 3: 27.0}[camera], polarity="bright")
    xyz = real_cases.plate_table(3).xyz
    index = np.round(2 * xyz[:, :2] / real_cases.PITCH_CM).astype(int)
    return _by_nearest(spots, xyz, index, fit.camera.project(pose.apply(xyz))[0], fit.camera, pose, 6.0)


@cache
def ridge(number: int) -> RealBoard:
    """MyPTV's block: published labels, camera and pose fitted to them."""
    folder = real_cases.DATA / "myptv-ridge-3cam"
    rows = np.loadtxt(folder / f"cam{number}_cal_points")
    xy, xyz = rows[:, :2], rows[:, 2:]
    fit = pose_from_labels(xy, xyz, Camera((1024, 1024), 3000.0), free=("focal_px", "k1", "cx", "cy", "p1", "p2"))
    spots = detect(read_image(folder / f"cam{number}.tif"), radius_px=(1.2, 1.5, 2.0, 2.6), polarity="bright")
    index = np.stack([np.unique(xyz[:, k].round(3), return_inverse=True)[1] for k in (0, 1)], axis=1)
    return _by_nearest(spots, xyz, index, xy, fit.camera, fit.cam_from_model, 3.0)


def _by_nearest(
    spots: Detections, xyz: Array, index: NDArray[np.int64], xy: Array, camera: Camera, pose: Pose, gate: float
) -> RealBoard:
    """Every spot is the point (N, 2) that is nearest within the gate, and each point one spot's."""
    distance, nearest = cKDTree(xy).query(spots.xy)
    label = np.full(len(spots), -1)
    for spot in np.argsort(distance):
        if distance[spot] < gate and nearest[spot] not in label:
            label[spot] = nearest[spot]
    return RealBoard(spots, xyz, index, label, replace(camera, cov=None), pose)


DICE = tuple(f"CalB-sys2-{n:04d}_{side}" for n in (1, 8) for side in (0, 1))
PICTURES: dict[str, tuple[Callable[[], RealBoard], ...]] = {
    "dice": tuple(lambda name=name: dice(name) for name in DICE),  # type: ignore[misc]
    "plate": tuple(lambda c=c, z=z: plate(c, z) for c in (1, 3) for z in (1, 4, 7)),  # type: ignore[misc]
    "ridge": tuple(lambda n=n: ridge(n) for n in (1, 2, 3)),  # type: ignore[misc]
}


def real_board(seed: int, *, kind: str, labels: int = 0, prior: bool = True) -> Trial:
    """A real picture with the table of only a part of its rows, and the true pose, true labels or both as a help."""
    rng = np.random.default_rng(seed)
    made = PICTURES[kind][seed % len(PICTURES[kind])]()
    present = np.isin(np.arange(len(made.xyz)), made.label)
    low, high = made.index[present].min(axis=0), made.index[present].max(axis=0)
    most = np.maximum(MOST_CUT * (high - low), 2).astype(int)
    cut_low, cut_high = rng.integers(0, most), rng.integers(0, most)
    cut_low[0] += not (cut_low.any() or cut_high.any())
    inside = (made.index >= low + cut_low).all(axis=1) & (made.index <= high - cut_high).all(axis=1)
    known = _renumbered(made.label, inside)
    markers = models.table(made.xyz[inside])
    options: dict[str, Any] = {"prior": near(rng, made.pose, markers.xyz, PRIOR_DEG, PRIOR_SCALE)} if prior else {}
    truth = Truth(made.camera, (made.pose,), markers.xyz, known, present[inside], within_px=REAL_PX)
    options |= _labelled(rng, known, labels)
    return Trial(made.detections, markers, made.camera, truth, options, must=labels > 0)
