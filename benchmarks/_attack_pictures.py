"""From a model to a trial: a camera before it, its spots with hidden, false and badly stated ones, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from _attack_models import scenes
from windmark.adjust import refine_pose
from windmark.geometry import Camera, Pose
from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
SIZES = ((1936, 1216), (2048, 2048), (1024, 1024), (640, 512))
STATED = 1.5
"""Half of the pictures state sigmas that are wrong by this factor, either way, of spots with heavy tails."""
GRAZING_DEG = 75.0
LEAST_SEEN = 10
DRAWS = 60


@dataclass(frozen=True)
class Truth:
    """What is true of one picture.

    Parameters
    ----------
    camera : that took it
    poses : right answers; empty where none is right. Of a bent model without a root in view there are several
    xyz : (N, 3) where the markers of the table really are
    label : (M,) marker of every spot, or -1
    counted : (N,) bool: where the pose is judged; the markers in view, hidden ones too, or those that stand still
    within_px : mean displacement of these up to which a pose is right
    """

    camera: Camera
    poses: tuple[Pose, ...]
    xyz: Array
    label: Ints
    counted: Bools
    within_px: float = 1.0


@dataclass(frozen=True)
class Trial:
    """One call of `register`, and what is true.

    Parameters
    ----------
    unseen : names of faults that no picture of it can show
    must : nothing is wrong about it: no reason to refuse is a right one
    """

    detections: Detections
    markers: MarkerSet
    camera: Camera
    truth: Truth
    options: dict[str, Any] = field(default_factory=dict)
    unseen: frozenset[str] = frozenset()
    must: bool = False


@dataclass(frozen=True)
class SequenceTrial:
    """One call of `track` for each of some frames in a row."""

    frames: tuple[Trial, ...]


@dataclass(frozen=True)
class RigTrial:
    """One call of `register_rig`: what is true of each view, where the cameras are said to be, who is elsewhere.

    The right poses of the views belong together: the first of all, the second of all.
    """

    views: tuple[Trial, ...]
    cam_from_rig: tuple[Pose, ...]
    displaced: str
    options: dict[str, Any] = field(default_factory=dict)

    def arguments(self) -> tuple[list[Detections], MarkerSet, list[Camera], list[Pose]]:
        """What `register_rig` is given."""
        spots, cameras = [v.detections for v in self.views], [v.camera for v in self.views]
        return spots, self.views[0].markers, cameras, list(self.cam_from_rig)


@dataclass(frozen=True)
class Picture:
    """Spots of one model before a camera, ``label`` (M,) their markers or -1, who would be seen if not hidden (N,)."""

    detections: Detections
    label: Ints
    seen: Bools
    camera: Camera
    pose: Pose


def seen_by(markers: MarkerSet, camera: Camera, pose: Pose) -> tuple[Array, Bools]:
    """(N, 2) projections, and which markers are in the picture and not seen at grazing incidence."""
    xy, ok = camera.project(pose.apply(markers.xyz))
    to_eye = pose.center - markers.xyz
    cosine = np.einsum("ij,ij->i", markers.normal, to_eye) / np.linalg.norm(to_eye, axis=1)
    return xy, ok & camera.in_image(xy) & ~(cosine < np.cos(np.radians(GRAZING_DEG)))


def _own_view(
    rng: np.random.Generator, markers: MarkerSet, tilt_max: float, fov: tuple[float, float] | None
) -> tuple[Camera, Pose]:
    size = SIZES[rng.integers(len(SIZES))]
    angle = np.radians(rng.uniform(*fov)) if fov else np.radians(np.exp(rng.uniform(np.log(8), np.log(75))))
    focal = size[0] / (2 * np.tan(angle / 2))
    off = rng.normal(0, 0.01, 2) * size[0]
    # The lens bends the border by up to 1.5 % of the distance to the middle, and that is known.
    k1 = rng.uniform(-0.015, 0.015) / np.tan(angle / 2) ** 2
    camera = Camera(size, focal, cx=(size[0] - 1) / 2 + off[0], cy=(size[1] - 1) / 2 + off[1], k1=k1)
    middle, span = markers.xyz.mean(axis=0), np.ptp(markers.xyz, axis=0)
    tilt, turn = np.arccos(rng.uniform(np.cos(np.radians(tilt_max)), 1)), rng.uniform(0, 2 * np.pi)
    towards = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    distance = np.linalg.norm(span) * focal / (rng.uniform(0.45, 0.95) * min(size))
    distance = max(distance, 0.75 * np.linalg.norm(span))
    eye = middle + distance * towards
    return camera, Pose.look_at(eye, middle + 0.05 * span * rng.normal(size=3), rng.normal(size=3))


def view(
    rng: np.random.Generator,
    markers: MarkerSet,
    *,
    tilt_max_deg: float = 60.0,
    fov_deg: tuple[float, float] | None = None,
    least: int = LEAST_SEEN,
) -> tuple[Camera, Pose]:
    """A camera by this generator or by that of the registration tests, before which so many markers can be seen."""
    own = rng.random() < 0.5
    for _ in range(DRAWS):
        if own:
            camera, pose = _own_view(rng, markers, tilt_max_deg, fov_deg)
        else:
            camera, pose = scenes.random_view(rng, markers, fov_deg=fov_deg or (10, 60), tilt_max_deg=tilt_max_deg)
        if seen_by(markers, camera, pose)[1].sum() >= least:
            break
    return camera, pose


def picture(
    rng: np.random.Generator,
    markers: MarkerSet,
    camera: Camera,
    pose: Pose,
    *,
    keep: Bools | None = None,
    hidden: float = 0.0,
    false: float = 0.0,
    extra: Array | None = None,
    noise_px: float | None = None,
    honest: bool | None = None,
) -> Picture:
    """Spots of a model whose markers are where ``markers`` says, in random order.

    Parameters
    ----------
    keep : (N,) which markers nothing hides
    hidden : part of the visible ones that is hidden beside
    false : uniform false spots, as part of the visible markers
    extra : (K, 2) other spots that are no markers
    noise_px : 1 sigma of the spots; None draws 0.05 to 0.4
    honest : whether the noise is normal and as stated; None draws it
    """
    xy, seen = seen_by(markers, camera, pose)
    index = rng.permutation(np.flatnonzero(seen if keep is None else seen & keep))
    false_count = round(false * len(index))
    index = index[: len(index) - round(hidden * len(index))]
    noise = float(np.exp(rng.uniform(np.log(0.05), np.log(0.4)))) if noise_px is None else noise_px
    others = np.zeros((0, 2)) if extra is None else extra[camera.in_image(extra)]
    true = np.concatenate([xy[index], others])
    spots = np.concatenate([true, rng.uniform(0, 1, (false_count, 2)) * camera.size_px - 0.5])
    honest = bool(rng.random() < 0.5) if honest is None else honest
    if honest:
        spots[: len(true)] += rng.normal(0, noise, true.shape)
        stated = noise
    else:
        # Student's t with 4 degrees of freedom has a standard deviation of sqrt(2).
        spots[: len(true)] += rng.standard_t(4, true.shape) * noise / np.sqrt(2)
        stated = noise * STATED ** rng.choice([-1, 1])
    label = np.concatenate([index, np.full(len(spots) - len(index), -1)])
    order = rng.permutation(len(spots))
    return Picture(Detections.make(spots[order], sigma_px=max(stated, 0.02)), label[order], seen, camera, pose)


def trial_of(
    shot: Picture,
    markers: MarkerSet,
    *,
    real: Array | None = None,
    camera: Camera | None = None,
    poses: Sequence[Pose] | None = None,
    counted: Bools | None = None,
    unseen: Sequence[str] = (),
    must: bool = False,
    options: dict[str, Any] | None = None,
) -> Trial:
    """A trial with this table and, where they are other than the picture's, camera, real places and right poses."""
    truth = Truth(
        shot.camera, (shot.pose,) if poses is None else tuple(poses), markers.xyz if real is None else real, shot.label,
        shot.seen if counted is None else counted,
    )  # fmt: skip
    return Trial(shot.detections, markers, camera or shot.camera, truth, options or {}, frozenset(unseen), must)


def clutter_of(rng: np.random.Generator) -> dict[str, Any]:
    """Part of the markers hidden, and of false spots: none, some, or many."""
    hidden, false = ((0.0, 0.0), (0.25, 0.3), (0.4, 0.8))[rng.integers(3)]
    return {"hidden": hidden, "false": false}


def bent(xyz: Array, tip: float, *, axis: int = 1, root: float = 0.0) -> tuple[Array, Bools]:
    """Places of a model bent along z like s^2 from its root on, and which markers stay (N,).

    Parameters
    ----------
    tip : displacement at the far end, as part of the extent along the axis
    axis : along which the model bends
    root : part of the extent that stands still
    """
    low, extent = xyz[:, axis].min(), np.ptp(xyz[:, axis])
    s = np.clip(((xyz[:, axis] - low) / extent - root) / (1 - root), 0, None)
    out = xyz.copy()
    out[:, 2] += tip * extent * s**2
    # The length along the surface stays: what rises also comes nearer.
    out[:, axis] -= extent * (2 / 3) * tip**2 * s**3 / (1 - root)
    return out, s <= 1e-3


def rigid_fits(camera: Camera, pose: Pose, xyz: Array, real: Array, seen: Bools) -> tuple[Pose, ...]:
    """The poses of a bent model that a rigid one may stand for: root's, least squares in space, and in the picture."""
    here, there = xyz.mean(axis=0), real.mean(axis=0)
    turn = Rotation.align_vectors(real - there, xyz - here)[0].as_matrix()
    middle = pose @ Pose(turn, there - turn @ here)
    xy, ok = camera.project(pose.apply(real))
    use = seen & ok
    pictured = refine_pose(camera, middle, xyz[use], xy[use]).cam_from_model
    return pose, middle, pictured


def near(rng: np.random.Generator, pose: Pose, xyz: Array, angle_deg: float, scale: float = 0.0) -> Pose:
    """A pose turned by up to so much about the model's middle, and up to so much nearer or farther."""
    axis = rng.normal(size=3)
    turn = Pose.from_rotvec(axis / np.linalg.norm(axis) * np.radians(rng.uniform(0, angle_deg)), np.zeros(3)).rotation
    centre = xyz.mean(axis=0)
    rotation = pose.rotation @ turn
    return Pose(rotation, pose.apply(centre) * np.exp(rng.uniform(-scale, scale)) - rotation @ centre)
