"""Would another lens, focal length or principal point explain the residuals of an image, and where would it stand?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g1, g2
from windmark.geometry import PARAMETERS, Camera
from windmark.geometry.rotations import hat
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.registration import Registration

Array = NDArray[np.float64]

INTERIOR = ("k1", "k2", "p1", "p2", "focal_px", "cx", "cy")


@dataclass(frozen=True)
class OtherInterior:
    """What another interior of the camera would do.

    Parameters
    ----------
    lead : nats that it is ahead of scattered markers in explaining the residuals
    shift : how far from the place that was found the camera would stand then, in the length unit
    sigmas : root mean square change of the pose's six numbers in their stated sigmas
    """

    lead: float = 0.0
    shift: float = 0.0
    sigmas: float = 0.0

    def said(self, residuals: str, unit: str) -> Finding:
        """As a doubt about the camera, of ``residuals`` in words."""
        there = f"; with one that fits the camera may stand some {g1(self.shift)} {unit} elsewhere"
        times = f", {g2(self.sigmas)} of its sigmas" if self.sigmas > 1 else ""
        return Finding(
            DOUBTFUL, "lens",
            f"{residuals}, have the pattern of another lens, focal length or principal point "
            f"({self.lead:.0f} nats ahead of scattered markers){there}{times}",
            "calibrate the camera (windmark calibrate), and check that the file is this camera's",
        )  # fmt: skip


NO_OTHER = OtherInterior()
"""None that explains anything."""


def other_interior(answer: Registration, spot_px: float) -> OtherInterior:
    """Judge it to first order, ``spot_px`` being the spots' own noise (1 sigma per coordinate).

    Both explanations are evidences: the scatter's size is what the residuals make of it, the interior has a prior
    (`prior`). The pose's own columns are taken out first.
    """
    cam, k = answer.camera, len(answer.matching)
    if 2 * k < 6 + 2 * len(INTERIOR):
        return NO_OTHER
    xyz = answer.cam_from_model.apply(answer.matched_xyz)
    _, _, by_xyz, by_camera = cam.project_jacobian(xyz)
    columns = [PARAMETERS.index(p) for p in INTERIOR]
    inner = by_camera[..., columns].reshape(2 * k, len(INTERIOR)) * prior(cam)
    pose = by_pose(by_xyz, xyz).reshape(2 * k, 6)
    size = np.linalg.norm(pose, axis=0)
    basis, upper = np.linalg.qr(pose / size, mode="complete")
    r = -answer.residuals.reshape(2 * k)  # observed - projected
    free, b = basis[:, 6:].T @ r, basis[:, 6:].T @ inner
    # The pose gives way to the likeliest interior where both move the image alike.
    step = -np.linalg.solve(upper[:6], basis[:, :6].T @ (inner @ likeliest(free, b, spot_px))) / size
    return OtherInterior(lead_over_scatter(free, b), float(np.linalg.norm(step[3:])), _in_sigmas(step, answer))


def lead_over_scatter(free: Array, inner: Array) -> float:
    """Nats that a Gaussian prior of unit width on the columns' amounts is ahead of scatter alone.

    Parameters
    ----------
    free : (M,) residuals, what is estimated anyway taken out
    inner : (M, P) what one sigma of each amount does to them
    """
    left, value, _ = np.linalg.svd(inner)
    power = (left.T @ free) ** 2
    variance = np.concatenate([value**2, np.zeros(len(power) - len(value))])

    def evidence(part: float) -> float:
        scatter = float(power.mean()) * np.geomspace(1e-3, 2.0, 200)[:, None]
        whole = scatter + part * variance
        return float((-0.5 * (power / whole + np.log(whole)).sum(axis=1)).max())

    return evidence(1.0) - evidence(0.0)


def likeliest(free: Array, inner: Array, noise: float) -> Array:
    """(P,) the likeliest amounts of the columns, residuals having the 1 sigma ``noise``; see `lead_over_scatter`."""
    normal = inner.T @ inner + noise**2 * np.eye(inner.shape[1])
    return np.asarray(np.linalg.solve(normal, inner.T @ free))


def by_pose(by_xyz: Array, xyz: Array) -> Array:
    """(N, 2, 6) image by turns and shifts of the pose, from those by places (N, 3) in the camera's frame."""
    return np.concatenate([by_xyz @ -hat(xyz), by_xyz], axis=-1)


def _in_sigmas(step: Array, answer: Registration) -> float:
    """A step (6,) of the pose in its stated sigmas, root mean square; directions that are known exactly do not count.

    Turns and shifts may be all but one motion: their correlations are taken apart, which a factor need not survive.
    """
    sigma = np.sqrt(np.diagonal(answer.cov)[:6])
    value, axes = np.linalg.eigh(answer.cov[:6, :6] / np.outer(sigma, sigma))
    told = value > len(value) * np.finfo(float).eps * value.max()
    return float(np.sqrt(((axes.T @ (step / sigma))[told] ** 2 / value[told]).mean()))


def prior(cam: Camera) -> Array:
    """1 sigma of `INTERIOR` of a camera that was calibrated on another day.

    k1, k2, p1, p2 shift the corner of the picture by `rules.LENS_EDGE` of its distance; focal length and principal
    point are off by `rules.FOCAL_OFF` of themselves and of the picture's width.
    """
    far = np.hypot(*(np.array(cam.size_px) / 2)) / cam.focal_px
    edge, part = rules.LENS_EDGE, rules.FOCAL_OFF
    lens = (edge / far**2, edge / far**4, edge / (3 * far), edge / (3 * far))
    return np.array([*lens, part * cam.focal_px, part * cam.size_px[0], part * cam.size_px[0]])
