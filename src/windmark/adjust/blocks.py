"""Parameter blocks: what can be free in an adjustment.

A block knows nothing of observations. It names its parameters, applies a tangent step to its value,
and says what a change "of order one" of each parameter is, its *natural unit*. Natural units make the
engine independent of inches or millimetres and give "not determined" a meaning (see `determinacy`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import PARAMETERS, Camera, Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]

POSE_PARAMETERS = ("rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z")
"""Names of the perturbation of a pose, ``exp(delta) @ pose``: axes of the target (camera) frame."""


class Block(Protocol):
    """What the engine asks of a set of parameters that are free together."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k parameters, in the order of a step."""

    def retract(self, value: Any, delta: Array) -> Any | None:
        """The value after a tangent step (k,); None where no such value exists."""

    def natural(self, value: Any) -> Array:
        """(k, k): column j is the tangent step that is one natural unit of parameter j."""

    def difference(self, value: Any, reference: Any) -> tuple[Array, Array]:
        """Tangent step (k,) from reference to value, and its derivative (k, k) by a step of value."""


@dataclass(frozen=True)
class PoseBlock:
    """A free pose; its value is a `Pose`.

    Parameters
    ----------
    pivot : (3,) point of the source (model) frame about which natural rotations turn, usually the
        centroid of the points: a rotation about the far camera and a translation look almost alike,
        about the points they do not.

    Natural units: 1 rad about the pivot; a shift by the distance of the pivot.
    """

    pivot: Array
    names: tuple[str, ...] = POSE_PARAMETERS

    def retract(self, value: Pose, delta: Array) -> Pose | None:
        """``exp(delta) @ value``."""
        if not np.isfinite(delta).all():
            return None
        return Pose.exp(delta) @ value

    def natural(self, value: Pose) -> Array:
        """See `Block`. A rotation w about the pivot c is delta = [w, -w x c]."""
        center = value.apply(self.pivot)
        basis = np.eye(6)
        basis[3:, :3] = hat(center)
        basis[3:, 3:] *= np.sqrt(center @ center)
        return basis

    def difference(self, value: Pose, reference: Pose) -> tuple[Array, Array]:
        """``log(value @ reference^-1)``; its derivative is the inverse left Jacobian of SE(3)."""
        delta = (value @ reference.inverse()).log()
        inverse = np.asarray(np.linalg.inv(se3_left_jacobian(delta)), dtype=float)
        return delta, inverse


def se3_left_jacobian(delta: Array) -> Array:
    """(6, 6) left Jacobian of SE(3) for delta = [rotation, translation]: sum of ad^n / (n + 1)!.

    The series is Barfoot (2017), eq. 7.85; for rotations up to pi its 30th term is below rounding.
    """
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = hat(delta[:3])
    ad[3:, :3] = hat(delta[3:])
    term = np.eye(6)
    total = np.eye(6)
    for n in range(2, 40):
        term = term @ ad / n
        total += term
    return total


@dataclass(frozen=True)
class CameraBlock:
    """Free interior parameters of one camera; its value is a `Camera`.

    Parameters
    ----------
    names : subset of `geometry.PARAMETERS`

    Natural units: the change that moves the corner of the image by about its distance to the centre
    (focal length: itself; principal point: half the diagonal; k1: 1 / r^2 with r the corner's ideal radius).
    """

    names: tuple[str, ...]

    def __post_init__(self) -> None:
        unknown = [name for name in self.names if name not in PARAMETERS]
        if unknown or len(set(self.names)) != len(self.names):
            raise ValueError(
                f"free: expected distinct camera parameters out of {', '.join(PARAMETERS)}, got {self.names}"
            )

    @property
    def columns(self) -> list[int]:
        """Where the free parameters stand in `geometry.PARAMETERS`."""
        return [PARAMETERS.index(name) for name in self.names]

    def retract(self, value: Camera, delta: Array) -> Camera | None:
        """Parameters plus delta; None where focal length or aspect would not stay positive."""
        parameters = value.parameters()
        parameters[self.columns] += delta
        if not np.isfinite(parameters).all() or parameters[0] <= 0 or parameters[1] <= 0:
            return None
        return value.with_parameters(parameters, cov=value.cov)

    def natural(self, value: Camera) -> Array:
        """See `Block`."""
        diagonal = float(np.hypot(*value.size_px)) / 2
        r = diagonal / value.focal_px
        last = (r**-8, 1.0, 1.0) if value.lens == "fisheye" else (r**-2, r**-4, r**-6)
        size = (value.focal_px, 1.0, diagonal, diagonal, r**-2, r**-4, 1 / r, 1 / r, r**-6, 1.0, 1.0, *last, 1.0)
        return np.diag([size[column] for column in self.columns])

    def difference(self, value: Camera, reference: Camera) -> tuple[Array, Array]:
        """Plain difference of the parameters."""
        return (value.parameters() - reference.parameters())[self.columns], np.eye(len(self.names))


@dataclass(frozen=True)
class VectorBlock:
    """Free plain numbers, such as the parameters of a deformation law; its value is an array (k,).

    Parameters
    ----------
    names : of the k numbers
    scale : (k,) a change of order one of each, its natural unit
    lower, upper : (k,) bounds; a step that would leave them ends there
    """

    names: tuple[str, ...]
    scale: Array
    lower: Array
    upper: Array

    def retract(self, value: Array, delta: Array) -> Array | None:
        """Value plus delta, within the bounds."""
        moved = np.clip(value + delta, self.lower, self.upper)
        return moved if np.isfinite(moved).all() else None

    def natural(self, value: Array) -> Array:
        """See `Block`."""
        return np.diag(self.scale)

    def pinned(self, value: Array, gradient: Array) -> NDArray[np.bool_]:
        """(k,) at a bound and pulled beyond it by the cost's gradient (k,): no step moves these (Bertsekas 1982)."""
        return ((value <= self.lower) & (gradient > 0)) | ((value >= self.upper) & (gradient < 0))

    def difference(self, value: Array, reference: Array) -> tuple[Array, Array]:
        """Plain difference."""
        return value - reference, np.eye(len(self.names))
