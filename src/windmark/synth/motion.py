"""How the model moves: a beam's bending law, the gradient of any law, and hand-held or mounted cameras."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.geometry import Pose

Array = NDArray[np.float64]


def bend(
    xyz: ArrayLike,
    tip_fraction: float,
    twist_deg: float,
    *,
    root: float = 72.0,
    span: float = 600.0,
    sweep_deg: float = 28.0,
    axis_x: float = 65.0,
) -> Array:
    """A wing that bends up like a cantilever beam and twists about its swept quarter-chord line.

    Parameters
    ----------
    xyz : (..., 3) points of the undeformed wing
    tip_fraction : rise of the tip as a fraction of span - root
    twist_deg : nose-up twist of the tip
    root, span : y of the clamped section and of the tip
    sweep_deg, axis_x : the twist axis passes z = 0 at x = axis_x + y tan(sweep)

    Returns
    -------
    (..., 3)
        z rises by tip_fraction (span - root) (3 e^2 - e^3) / 2 with e = (y - root) / (span - root)
        (a point load at the tip); the section turns by twist_deg e^2. Inside the root nothing moves.
    """
    p = np.asarray(xyz, dtype=float)
    e = np.maximum((p[..., 1] - root) / (span - root), 0.0)
    angle = np.radians(twist_deg) * e * e
    dx = p[..., 0] - axis_x - np.tan(np.radians(sweep_deg)) * p[..., 1]
    x = p[..., 0] + (np.cos(angle) - 1) * dx + np.sin(angle) * p[..., 2]
    z = np.cos(angle) * p[..., 2] - np.sin(angle) * dx
    z = z + tip_fraction * (span - root) * e * e * (3 - e) / 2
    return np.stack([x, p[..., 1], z], axis=-1)


def flex(
    xyz: ArrayLike,
    tip_fraction: float,
    twist_deg: float,
    *,
    root: float = 72.0,
    span: float = 600.0,
    sweep_deg: float = 28.0,
    axis_x: float = 65.0,
) -> Array:
    """A wing as `bend` has it, but with the kinematics of a real beam, by numerical integration along its axis.

    The swept axis keeps its length while it rises (so the tip comes inboard and forward), and the streamwise sections
    lean with it, after their twist.

    Parameters
    ----------
    xyz, tip_fraction, twist_deg, root, span, sweep_deg, axis_x : see `bend`; the rise is a function of the arc length

    Returns
    -------
    (..., 3)
    """
    p = np.asarray(xyz, dtype=float).reshape(-1, 3)
    along = np.array([np.tan(np.radians(sweep_deg)), 1.0, 0.0])
    length = float(np.linalg.norm(along)) * (span - root)
    along = along / np.linalg.norm(along)
    up = np.array([0.0, 0.0, 1.0])
    start = np.array([axis_x + np.tan(np.radians(sweep_deg)) * root, root, 0.0])
    e = np.maximum((p[:, 1] - root) / (span - root), 0.0)
    # The axis as a curve: its height is given, its slope follows, the rest is what keeps the arc length.
    grid = np.linspace(0.0, max(1.0, float(e.max(initial=1.0))), 4001)
    height = tip_fraction * (span - root) * grid**2 * (3 - grid) / 2
    slope = np.gradient(height, grid * length, edge_order=2)
    forward = np.concatenate(
        [[0.0], np.cumsum(np.diff(grid) * length * np.sqrt(1 - (slope[1:] + slope[:-1]) ** 2 / 4))]
    )
    at, rise, lean = (np.interp(e, grid, v) for v in (forward, height, np.arcsin(slope)))
    foot = start + (e * length)[:, None] * along
    twist = Pose.from_rotvec(
        np.radians(twist_deg) * (e * e)[:, None] * np.array([0.0, 1.0, 0.0]), np.zeros((len(p), 3))
    )
    tilt = Pose.from_rotvec(lean[:, None] * np.cross(along, up), np.zeros((len(p), 3)))
    arm = tilt.rotation @ (twist.rotation @ (p - foot)[..., None])
    moved = start + at[:, None] * along + rise[:, None] * up + arm[..., 0]
    return np.asarray(moved.reshape(np.shape(xyz)))


def gradient(law: Callable[[Array], Array], xyz: Array, step: float = 1e-3) -> Array:
    """(N, 3, 3) derivative of a deformation law at points (N, 3), by central differences."""
    columns = []
    for k in range(3):
        d = np.zeros(3)
        d[k] = step
        columns.append((law(xyz + d) - law(xyz - d)) / (2 * step))
    return np.stack(columns, axis=-1)


def random_poses(
    rng: np.random.Generator,
    n: int,
    target: ArrayLike,
    distance: float,
    *,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    max_angle_deg: float = 35.0,
    max_roll_deg: float = 180.0,
    distance_spread: float = 0.15,
    target_spread: float = 0.0,
    up: ArrayLike = (0.0, 1.0, 0.0),
) -> list[Pose]:
    """Stations of a camera held by hand round a target.

    Parameters
    ----------
    n : how many
    target : (3,) point looked at
    distance : mean distance of the camera
    axis : (3,) direction from the target round which the stations lie
    max_angle_deg : half angle of that cone; directions are uniform over its cap
    max_roll_deg : the image is rolled by a uniform angle up to this, either way
    distance_spread : relative half width of the (uniform) distance
    target_spread : the point aimed at varies by a uniform shift up to this, in each coordinate
    up : (3,) what is up in an unrolled image; must not be parallel to ``axis``

    Returns
    -------
    list of cam_from_target-frame poses

    Raises
    ------
    ValueError
        Where an angle or spread has no meaning, or ``up`` is parallel to a line of sight.
    """
    if not (0 <= max_angle_deg <= 180 and 0 <= distance_spread < 1 and distance > 0):
        raise ValueError("random_poses: need 0 <= max_angle_deg <= 180, 0 <= distance_spread < 1 and distance > 0")
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross(np.asarray(up, dtype=float), z)
    if np.linalg.norm(x) < 1e-9:
        raise ValueError("random_poses: up must not be parallel to axis")
    x = x / np.linalg.norm(x)
    y = np.cross(z, x)
    poses = []
    for _ in range(n):
        cos = rng.uniform(np.cos(np.radians(max_angle_deg)), 1.0)
        around, roll = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(-max_roll_deg, max_roll_deg))
        sin = np.sqrt(1 - cos * cos)
        direction = sin * np.cos(around) * x + sin * np.sin(around) * y + cos * z
        aim = np.asarray(target, dtype=float) + target_spread * rng.uniform(-1, 1, 3)
        eye = aim + distance * (1 + distance_spread * rng.uniform(-1, 1)) * direction
        poses.append(Pose.from_rotvec([0, 0, roll], np.zeros(3)) @ Pose.look_at(eye, aim, up))
    return poses
