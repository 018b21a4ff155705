"""Would another lens, focal length or principal point explain the residuals of an image, and where would it stand?"""

from __future__ import annotations

from collections.abc import Sequence
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
    likelier : nats that it is ahead of markers that are off their table smoothly, as a bent model's are
    shift : how far from the place that was found the camera would stand then, in the length unit
    sigmas : root mean square change of the pose's six numbers in their stated sigmas
    """

    lead: float = 0.0
    likelier: float = 0.0
    shift: float = 0.0
    sigmas: float = 0.0

    @property
    def told(self) -> bool:
        """Whether the residuals have its pattern, and no smooth error of the table is surely what made it."""
        return self.lead > rules.LENS_NATS and self.likelier > -rules.PATTERN_NATS

    def said(self, residuals: str, unit: str, off_table: float) -> Finding:
        """As a doubt of ``residuals`` in words: about the camera, or about the table where that is likelier."""
        if self.likelier < 0:
            rest = f"; another lens or focal length is {-self.likelier:.0f} nats less likely, which is not much"
            return table_finding(off_table, f"{residuals}{rest}", unit, lens=True)
        there = f"; with one that fits the camera may stand some {g1(self.shift)} {unit} elsewhere"
        times = f", {g2(self.sigmas)} of its sigmas" if self.sigmas > 1 else ""
        return Finding(
            DOUBTFUL, "lens",
            f"{residuals}, have the pattern of another lens, focal length or principal point "
            f"({self.lead:.0f} nats ahead of scattered markers){there}{times}",
            "calibrate the camera (windmark calibrate), and check that the file is this camera's",
        )  # fmt: skip


def table_finding(off_table: float, residuals: str, unit: str, *, lens: bool = False) -> Finding:
    """Markers that are so far off their table, of ``residuals`` in words; ``lens``: or the lens is another one."""
    step = "measure the markers (windmark reconstruct or calibrate), or give their sigma in the table"
    step = f"{step}; calibrate the camera" if lens else step
    return Finding(DOUBTFUL, "table", f"markers about {g1(off_table)} {unit} off their table: {residuals}", step)


NO_OTHER = OtherInterior()
"""None that explains anything."""


def other_interior(answer: Registration, spot_px: float) -> OtherInterior:
    """Judge it to first order, ``spot_px`` being the spots' own noise (1 sigma per coordinate).

    All explanations are evidences: the scatter's size is what the residuals make of it, the interior has a prior
    (`prior`), and a table that is off smoothly, as a bent model is, may be so by any amount. The pose's own columns are
    taken out first.
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
    bent = basis[:, 6:].T @ smooth(answer.matched_xyz, by_xyz @ answer.cam_from_model.rotation)
    # The pose gives way to the likeliest interior where both move the image alike.
    step = -np.linalg.solve(upper[:6], basis[:, :6].T @ (inner @ likeliest(free, b, spot_px))) / size
    lead = lead_over_scatter(free, b)
    return OtherInterior(
        lead, lead - lead_of_any_size(free, bent), float(np.linalg.norm(step[3:])), _in_sigmas(step, answer)
    )


def lead_over_scatter(free: Array, inner: Array) -> float:
    """Nats that a Gaussian prior of unit width on the columns' amounts is ahead of scatter alone.

    Parameters
    ----------
    free : (M,) residuals, what is estimated anyway taken out
    inner : (M, P) what one sigma of each amount does to them
    """
    return float(_evidences(free, inner, [1.0])[0] - _evidences(free, inner, [0.0])[0])


def lead_of_any_size(free: Array, columns: Array) -> float:
    """As `lead_over_scatter` of columns whose amounts all have one sigma, which is what the residuals make of it."""
    size, typical = float((free**2).mean()), float((columns**2).sum()) / len(free)
    if not (size > 0 and typical > 0):
        return 0.0
    alone, *of_size = _evidences(free, columns, [0.0, *(size / typical * np.geomspace(1e-3, 10.0, 40))])
    return float(max(of_size) - alone - 0.5 * np.log(len(free)))  # one number more to choose


def _evidences(free: Array, columns: Array, parts: Sequence[float]) -> list[float]:
    """Log evidence of columns whose amounts have each of the variances, and of scatter of the likeliest size."""
    left, value, _ = np.linalg.svd(columns, full_matrices=False)
    power = (left.T @ free) ** 2
    # What no column reaches is scatter alone; a basis of it would be as large as the residuals squared.
    rest, others = max(float((free**2).sum() - power.sum()), 0.0), len(free) - len(power)
    scatter = float((free**2).mean()) * np.geomspace(1e-3, 2.0, 200)
    beside = rest / scatter + others * np.log(scatter)
    out = []
    for part in parts:
        whole = scatter[:, None] + part * value**2
        out.append(float((-0.5 * ((power / whole + np.log(whole)).sum(axis=1) + beside)).max()))
    return out


def smooth(xyz: Array, by_place: Array) -> Array:
    """(2 K, 18) images of shifts quadratic in the places (K, 3), which a pose leaves; ``by_place`` (K, 2, 3)."""
    u = (xyz - xyz.mean(axis=0)) / max(float(np.ptp(xyz, axis=0).max()), 1e-300)
    square = np.stack([u[:, i] * u[:, j] for i in range(3) for j in range(i, 3)], axis=1)
    return np.einsum("kij,kq->kijq", by_place, square).reshape(2 * len(u), -1)


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
