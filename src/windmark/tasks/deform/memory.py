"""What one frame of a sequence hands on to the next, and where it says that everything will be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.deformation.ends import tried
from windmark.deformation.sighting import in_tunnel
from windmark.deformation.turned import rotated, turns
from windmark.geometry import Pose
from windmark.scene import MarkerSet
from windmark.tasks.deform.spots import Labelled

Array = NDArray[np.float64]

KEEP = 0.7
"""How fast the velocity follows the last change."""


@dataclass(frozen=True)
class Memory:
    """What one frame hands on to the next.

    Parameters
    ----------
    state : the last good state
    instant : when it was
    velocity : change per frame: laws' parameters, motion (6,), pose (6,) of each moving camera
    error_px : camera -> root mean square prediction error lately
    labelled : camera -> its spots
    """

    state: Deformation
    instant: float
    velocity: dict[str, Array] = field(default_factory=dict)
    error_px: dict[str, float] = field(default_factory=dict)
    labelled: dict[str, Labelled] = field(default_factory=dict)


def displaced(markers: MarkerSet, state: Deformation) -> MarkerSet:
    """All markers where they are now, in the tunnel; the walls stand still. Normals go along.

    ``markers`` are those that the state was identified with, which it holds bound to their laws.
    """
    wall = markers.role == "wall"
    place, motion = state.placed.linearise(state.q)[0], state.tunnel_from_model  # of use again in `identify`
    turned = turns(state.placed, state.q, markers.normal)
    normal, form = rotated(turned, markers.normal), rotated(turned, markers.curvature)
    return replace(
        markers, xyz=in_tunnel(place, wall, motion),
        normal=np.where(wall[:, None], markers.normal, motion.rotate(normal)),
        curvature=np.where(wall[:, None, None], markers.curvature, motion.rotate_form(form)),
    )  # fmt: skip


def predicted(memory: Memory, dt: float) -> Deformation:
    """The state with everything moved on by constant velocity; laws stay where they give no place further on."""
    state, v = memory.state, memory.velocity
    poses = {
        n: Pose.exp(dt * v[f"pose {n}"]) @ p if f"pose {n}" in v else p for n, p in state.cam_from_tunnel.items()
    }  # fmt: skip
    motion = state.tunnel_from_model
    q = state.q
    if "law" in v:
        lower, upper = (np.array([getattr(p, side) for p in state.volumes.parameters]) for side in ("lower", "upper"))
        on = np.clip(q + dt * v["law"], lower, upper)
        # An arcsin beyond 1, say; the derivative is of use again in `displaced`.
        q = on if tried(state.placed, on, state.placed.linearise) is not None else q
    return replace(
        state, q=q,
        tunnel_from_model=Pose.exp(dt * v["motion"]) @ motion if "motion" in v else motion, cam_from_tunnel=poses,
    )  # fmt: skip


def velocity_of(before: Memory | None, state: Deformation, instant: float) -> dict[str, Array]:
    """Change per frame, smoothed; none after a first frame."""
    if before is None:
        return {}
    dt = instant - before.instant
    now = {
        "law": (state.q - before.state.q) / dt,
        "motion": (state.tunnel_from_model @ before.state.tunnel_from_model.inverse()).log() / dt,
    }
    for name, pose in state.cam_from_tunnel.items():
        old_pose = before.state.cam_from_tunnel.get(name)
        if old_pose is not None and old_pose is not pose:  # one that stands still is the same object
            now[f"pose {name}"] = (pose @ old_pose.inverse()).log() / dt
    old = before.velocity
    return {n: v if n not in old else KEEP * v + (1 - KEEP) * old[n] for n, v in now.items()}
