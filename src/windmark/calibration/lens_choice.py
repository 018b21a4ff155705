"""Which lens model a camera has: judged by the evidence of one set of marks under each.

A wide lens fits no polynomial in the tangent of the angle: that grows beyond all bounds at 90 degrees. Rational and
fisheye models do, with more or other coefficients. They are compared as any explanations are: by what they leave of the
same marks, and what their coefficients cost (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.calibration.result import Calibration, NotCalibrated
from windmark.geometry import Camera
from windmark.geometry.camera import LENS_PARAMETERS

Array = NDArray[np.float64]

WIDE_DEG = 90.0
"""Field of view across the picture's corners from which on Brown's lens is doubted though it fits."""
LEAD = 10.0
"""Lead in nats that a wide lens needs over Brown's: the simpler one is the rule."""
GROSS = 25.0
"""A mark counts at most so much (squared sigmas): as a gross error, or one that a model does not reach."""
_SAMPLES, _INSIDE = 200, 0.98


@dataclass(frozen=True)
class LensTried:
    """One lens model on a set of marks.

    Parameters
    ----------
    lens : its name
    outcome : the calibration, or why there is none
    log_evidence : nats, up to a number that all of the set share; -inf without a calibration
    """

    lens: str
    outcome: Calibration | NotCalibrated
    log_evidence: float = -np.inf


def judged(outcomes: Mapping[str, Calibration | NotCalibrated], marks: int) -> tuple[LensTried, ...]:
    """The models with their evidence, the best first; Brown's before those that lead it by less than `LEAD`.

    Parameters
    ----------
    outcomes : by lens, from the same ``marks`` (their number), none of them refused for its size of residuals
    """
    there = [r for r in outcomes.values() if isinstance(r, Calibration)]
    # What the best leaves beyond the marks' covariances is noise for all.
    noise = max(1.0, min((r.sigma0 for r in there), default=1.0)) ** 2
    tried = [
        LensTried(lens, r, _log_evidence(r, noise, marks) if isinstance(r, Calibration) else -np.inf)
        for lens, r in outcomes.items()
    ]
    return tuple(sorted(tried, key=lambda t: -t.log_evidence - (LEAD if t.lens == "brown" else 0.0)))


def lens_words(tried: tuple[LensTried, ...]) -> str:
    """The choice in a sentence."""
    best, *others = tried
    behind = [
        f"{t.lens} by {best.log_evidence - t.log_evidence:.0f} nats" if np.isfinite(t.log_evidence) else
        f"{t.lens}, which led to no calibration" for t in others
    ]  # fmt: skip
    return f"lens: {best.lens}, which leads {', '.join(behind)}"


def _log_evidence(result: Calibration, noise: float, marks: int) -> float:
    obs = result.observations
    white = np.linalg.solve(np.linalg.cholesky(obs.cov), result.residuals[..., None])[..., 0]
    left = np.minimum(np.nan_to_num((white**2).sum(axis=1) / noise, nan=GROSS), GROSS)
    free = sum(int((np.diagonal(c.cov) > 0).sum()) for c in result.cameras.values() if c.cov is not None)
    chi2 = float(left.sum()) + GROSS * (marks - len(obs))
    return -0.5 * chi2 - 0.5 * free * float(np.log(2 * marks))


def field_deg(camera: Camera) -> float:
    """Angle between the rays of the picture's corners that are farthest apart from the axis, twice; 360 without one."""
    w, h = camera.size_px
    corner = camera.directions(np.array([[-0.5, -0.5], [w - 0.5, -0.5], [-0.5, h - 0.5], [w - 0.5, h - 0.5]]))
    if not np.isfinite(corner).all():
        return 360.0
    return float(2 * np.degrees(np.arccos(np.clip(corner[:, 2].min(), -1, 1))))


def as_lens(camera: Camera, lens: str) -> Camera:
    """The camera with another lens model that is as like it over the picture as its coefficients allow: a start.

    Focal length, aspect, shear, principal point and, where the model has them, decentring and tilts are kept; the
    coefficients follow by linear least squares from image radius and angle. Without a use (`valid` within half
    the picture) they are zero.
    """
    if camera.lens == lens:
        return camera
    keep: dict[str, Any] = dict.fromkeys(("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"), 0.0)
    if lens != "fisheye" and camera.lens != "fisheye":
        keep["p1"], keep["p2"] = camera.p1, camera.p2
    bare = replace(camera, **keep, lens=lens, cov=None)
    radial = replace(camera, p1=0.0, p2=0.0, tilt_x=0.0, tilt_y=0.0, aspect=1.0, shear=0.0, cx=0.0, cy=0.0, cov=None)
    reach = 0.5 * np.hypot(*camera.size_px)
    q = np.linspace(0, reach, _SAMPLES + 1)[1:]
    away = radial.directions(np.column_stack([q, 0 * q]))
    angle = np.arctan2(away[:, 0], away[:, 2])
    known = np.isfinite(angle) & ((angle < np.radians(85)) | (lens == "fisheye"))
    if known.sum() < _SAMPLES // 4:
        return bare
    angle, q = angle[known], q[known] / camera.focal_px
    names, design, wanted = _linear(lens, angle, q)
    found = np.linalg.lstsq(design, wanted, rcond=1e-10)[0]
    made = replace(bare, **dict(zip(names, found.tolist(), strict=True)))
    far = replace(radial, **{p: getattr(made, p) for p in LENS_PARAMETERS["rational"][4:]}, lens=lens)
    ray = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    good = far.project(ray)[1]
    return made if good[: int(_INSIDE * len(good))].all() else bare


def _linear(lens: str, angle: Array, q: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Coefficients' names, and the equations for them, each in parts of the image radius q."""
    if lens == "fisheye":
        t = angle**2
        return ("k1", "k2", "k3", "k4"), np.stack([t, t**2, t**3, t**4], axis=1) * (angle / q)[:, None], 1 - angle / q
    r = np.tan(angle)
    s, part = r**2, r / q
    rows = np.stack([s, s**2, s**3], axis=1) * part[:, None]
    if lens == "brown":
        return ("k1", "k2", "k3"), rows, 1 - part
    # N - (q / r) D = 0, divided by q / r.
    size = 1 / (1 + s**3)[:, None]
    return (
        ("k1", "k2", "k3", "k4", "k5", "k6"),
        np.concatenate([rows, -np.stack([s, s**2, s**3], axis=1)], axis=1) * size,
        (1 - part) * size[:, 0],
    )


def choose_lens(
    calibrate: Callable[[Mapping[str, Camera]], Calibration | NotCalibrated],
    starts: Mapping[str, Mapping[str, Camera]],
    marks: int,
) -> tuple[LensTried, ...]:
    """Calibrate with every lens model and judge them.

    Parameters
    ----------
    calibrate : makes a calibration from start values of the cameras
    starts : lens -> start values of the cameras; where a model leads to none from them, it starts from another's result
    marks : number of the marks that all are made from
    """
    outcomes = {lens: calibrate(cameras) for lens, cameras in starts.items()}
    best = next((t for t in judged(outcomes, marks) if isinstance(t.outcome, Calibration)), None)
    if best is not None and isinstance(best.outcome, Calibration):
        for lens in starts:
            if lens == best.lens:
                continue
            again = calibrate({k: as_lens(c, lens) for k, c in best.outcome.cameras.items()})
            both = {"given": outcomes[lens], "again": again}
            outcomes[lens] = judged(both, marks)[0].outcome
    return judged(outcomes, marks)
