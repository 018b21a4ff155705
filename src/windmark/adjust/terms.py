"""Terms of the cost: observation blocks and priors. Residuals are whitened, model minus observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust.blocks import Block
from windmark.adjust.loss import Loss
from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.rotations import hat

Array = NDArray[np.float64]
Values = Mapping[str, Any]

NO_LOSS = Loss()


class Linearised(NamedTuple):
    """Residuals of one term and their derivatives by the blocks that the term depends on."""

    residual: Array  # (n, d)
    jacobian: dict[str, Array]  # block name -> (n, d, k)


class Term(Protocol):
    """What the engine asks of a part of the cost: n observations of d coordinates each."""

    @property
    def blocks(self) -> tuple[str, ...]:
        """Names of the free blocks that the term depends on."""

    @property
    def loss(self) -> Loss:
        """The loss on the length of each observation's residual."""

    def residual(self, values: Values) -> Array | None:
        """Whitened residuals (n, d); None where the model has no prediction."""

    def linearise(self, values: Values) -> Linearised | None:
        """Whitened residuals and derivatives; None where the model has no prediction."""


@dataclass(frozen=True)
class Reprojection:
    """Observation block of one view: fixed points seen by one camera from one pose.

    Parameters
    ----------
    camera, pose : names under which the values (`Camera`, `Pose`) are found
    xyz : (N, 3) points in the pose's source frame
    xy : (N, 2) observed pixels
    whitener : (N, 2, 2) with ``whitener^T whitener = cov^-1``, or None for a covariance of 1 px^2
    free_pose : the pose is free
    free_camera : columns of the camera's free parameters in `geometry.PARAMETERS`; empty if it is fixed
    loss : robust loss
    """

    camera: str
    pose: str
    xyz: Array
    xy: Array
    whitener: Array | None = None
    free_pose: bool = True
    free_camera: Sequence[int] = ()
    loss: Loss = NO_LOSS

    @property
    def blocks(self) -> tuple[str, ...]:
        """See `Term`."""
        return (self.pose,) * self.free_pose + (self.camera,) * bool(self.free_camera)

    def residual(self, values: Values) -> Array | None:
        """See `Term`. None where a point is behind the camera or beyond the lens' one-to-one range."""
        camera: Camera = values[self.camera]
        pose: Pose = values[self.pose]
        xy, valid = camera.project(pose.apply(self.xyz))
        return self._whitened((xy - self.xy)[..., None])[..., 0] if valid.all() else None

    def linearise(self, values: Values) -> Linearised | None:
        """See `Term`."""
        camera: Camera = values[self.camera]
        pose: Pose = values[self.pose]
        xyz_cam = pose.apply(self.xyz)
        xy, valid, d_xyz, d_camera = camera.project_jacobian(xyz_cam)
        if not valid.all():
            return None
        jacobian = {}
        if self.free_pose:
            # d X_cam / d rotation = -[X_cam]x, d X_cam / d translation = I
            d_pose = np.concatenate([-(d_xyz @ hat(xyz_cam)), d_xyz], axis=-1)
            jacobian[self.pose] = self._whitened(d_pose)
        if self.free_camera:
            jacobian[self.camera] = self._whitened(d_camera[..., list(self.free_camera)])
        return Linearised(self._whitened((xy - self.xy)[..., None])[..., 0], jacobian)

    def _whitened(self, columns: Array) -> Array:
        return columns if self.whitener is None else self.whitener @ columns


@dataclass(frozen=True)
class _Known:
    """Gaussian knowledge of parameters of one block: whitened differences from a reference, as a `Term`."""

    name: str
    block: Block
    reference: Any
    loss: Loss = field(default=NO_LOSS, init=False)

    @property
    def blocks(self) -> tuple[str, ...]:
        """See `Term`."""
        return (self.name,)

    def residual(self, values: Values) -> Array:
        """See `Term`; (m, 1)."""
        return self.linearise(values).residual

    def linearise(self, values: Values) -> Linearised:
        """See `Term`."""
        difference, derivative = self.block.difference(values[self.name], self.reference)
        rows, whitener = self._known()
        jacobian = {self.name: (whitener @ derivative[rows])[:, None, :]}
        return Linearised((whitener @ difference[rows])[:, None], jacobian)

    def _known(self) -> tuple[list[int], Array]:
        """Which of the block's parameters (m,), and their whitener (m, m)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Prior(_Known):
    """Gaussian knowledge of parameters of one block: additional residuals (value - reference) / sigma.

    Parameters
    ----------
    name : the block's name
    block : the block
    reference : value about which the prior is centred
    sigma : parameter name -> standard deviation in the parameter's own unit
    """

    sigma: Mapping[str, float]

    def __post_init__(self) -> None:
        for name, sigma in self.sigma.items():
            if name not in self.block.names:
                raise UsageError(f"prior_sigma: {name!r} is not free; free are {', '.join(self.block.names)}")
            if not (np.isfinite(sigma) and sigma > 0):
                raise UsageError(f"prior_sigma: {name} must be finite and > 0, got {sigma}")

    def _known(self) -> tuple[list[int], Array]:
        return [self.block.names.index(name) for name in self.sigma], np.diag(1 / np.array(list(self.sigma.values())))


@dataclass(frozen=True)
class JointPrior(_Known):
    """Gaussian knowledge of several parameters of one block, with their correlations.

    Parameters
    ----------
    name : the block's name
    block : the block
    reference : value about which the prior is centred
    rows : (m,) which of the block's parameters
    whitener : (m, m) with ``whitener^T whitener = cov^-1``
    """

    rows: Sequence[int]
    whitener: Array

    def _known(self) -> tuple[list[int], Array]:
        return list(self.rows), self.whitener


def whitener(cov: ArrayLike, n: int) -> Array:
    """(n, 2, 2) inverse Cholesky factors of observation covariances.

    Raises
    ------
    ValueError
        When ``cov`` is not (n, 2, 2), finite, symmetric and positive definite.
    """
    c = np.asarray(cov, dtype=float)
    if c.shape != (n, 2, 2):
        raise ValueError(f"cov: expected ({n}, 2, 2) in px^2, got {c.shape}")
    a, b, d = c[:, 0, 0], c[:, 0, 1], c[:, 1, 1]
    with np.errstate(invalid="ignore"):
        good = np.isfinite(c).all(axis=(1, 2)) & (a > 0) & (a * d - b * b > 0)
        good &= np.abs(b - c[:, 1, 0]) <= 1e-9 * np.sqrt(np.abs(a * d))
    if not good.all():
        i = int(np.argmin(good))
        raise UsageError(f"cov: must be finite, symmetric and positive definite, observation {i} has {c[i].tolist()}")
    # Written out: the inverse of the Cholesky factor [[l, 0], [b / l, m]].
    out = np.zeros_like(c)
    first = np.sqrt(a)
    out[:, 0, 0] = 1 / first
    out[:, 1, 1] = 1 / np.sqrt(d - b * b / a)
    out[:, 1, 0] = -b / a * out[:, 1, 1]
    return out
