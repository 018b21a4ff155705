"""The chosen model of two views, refined on all its pairs, with covariance and with what it leaves open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from windmark.errors import g2, g3
from windmark.geometry.pose import Pose
from windmark.geometry.two_view.candidates import GATE_LINE, GATE_POINT
from windmark.geometry.two_view.choice import chance_at_point, chance_on_line
from windmark.geometry.two_view.decompose import PlanePose, decompose_homography
from windmark.geometry.two_view.homography_refine import (
    across,
    homography_errors,
    plane_pose_covariance,
    refine_matrix,
    refine_rotation,
)
from windmark.geometry.two_view.matrices import essential_from_poses
from windmark.geometry.two_view.pairs import Pairs
from windmark.geometry.two_view.refine import inverse_normal, pose_covariance, refine_pose, sampson_errors
from windmark.geometry.two_view.result import TwoView
from windmark.geometry.two_view.search import PARALLAX, Candidate, behind, log10_false_alarms, ray_angles

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_DOUBT = 12.0  # sigma^2 by which another pose may be worse and still be possible
_LOOSE = 1.5**2  # the same as a factor where the noise is not white (a nearly flat sheet, a real lens: up to 1.44**2)
_LENS_PX = 0.1  # what a good lens model leaves, as an rms: no pose of that fit is refuted where no covariance is given
_WEAK_DEG = 10.0  # a direction known no better than this counts as not determined
_OTHER_RAD = 1e-3  # poses less apart are the same


def rotation_view(found: Candidate[Array], pairs: Pairs, known: bool) -> TwoView:
    """No baseline shows: a rotation on the pairs near it."""
    inliers = found.squares < GATE_POINT
    rotation, residual, normal = refine_rotation(found.model, pairs[inliers])
    squares = homography_errors(rotation, pairs)
    s0 = _sigma0(residual, 3)
    parallax, sigma = _parallax(Pose(rotation, np.zeros(3)), pairs[inliers])
    return TwoView(
        "rotation",
        inliers,
        np.sqrt(squares),
        f"no baseline: a rotation alone explains the pairs (parallax {g3(parallax)} deg, its sigma {g2(sigma)} deg)",
        ("baseline", "depth"),
        rotation=rotation,
        cov=inverse_normal("rotation", normal, ("rotation",)) * _scale(s0, known),
        homography=rotation,
        sigma0=s0,
        parallax_deg=parallax,
        parallax_sigma_deg=sigma,
        log10_nfa=log10_false_alarms(len(pairs), int(inliers.sum()), 2, 1, chance_at_point(rotation, pairs)),
    )


def plane_view(found: Candidate[Array], pairs: Pairs, known: bool) -> TwoView:
    """Points on a plane: the pose, often two, from the homography."""
    inliers = found.squares < GATE_POINT
    near = pairs[inliers]
    h, residual, normal = refine_matrix(found.model, near)
    directions = across(h).reshape(8, 9)
    s0 = _sigma0(residual, 8)
    cov9 = directions.T @ inverse_normal("homography", normal, ("homography",)) @ directions * _scale(s0, known)
    first, *others = _by_all_pairs(decompose_homography(h, near.a, near.b), pairs)
    parallax, sigma = _parallax(first.b_from_a, near)
    view = TwoView(
        "homography-plane",
        inliers,
        np.sqrt(homography_errors(h, pairs)),
        "points on a plane: two poses explain them equally well" if others else "",
        ("pose: one of two",) if others else (),
        first.b_from_a,
        first.b_from_a.rotation,
        plane_pose_covariance(first, h, cov9),
        h,
        first.normal,
        tuple(p.b_from_a for p in others),
        s0,
        parallax,
        sigma,
        log10_false_alarms(len(pairs), int(inliers.sum()), 4, 1, chance_at_point(h, pairs)),
    )
    return _with_weakness(view)


def essential_view(found: list[Candidate[Pose]], pairs: Pairs, sigma_px: float | None) -> TwoView | None:
    """Points in space: the best pose, and others nearly as good; None if fewer than five pairs agree.

    ``sigma_px``: where the covariances are not known, the sigma that they were given; else None.
    """
    known = sigma_px is None
    pose, inliers = _settled(found[0].model, pairs)
    if inliers.sum() < 5:
        return None
    near = pairs[inliers]
    pose, residual, normal = refine_pose(pose, near)
    cov = pose_covariance(pose, inverse_normal("essential", normal, ("relative pose",)))
    s0 = _sigma0(residual, 5)
    cost, dof = float(residual @ residual), len(residual) - 5
    loose = not known or (dof > 0 and cost > chdtri(dof, 0.01))
    others = _others(found, pose, near, max(_scale(s0, False), 1.0 if known else 0.0), loose, sigma_px)
    errors = sampson_errors(essential_from_poses(pose), pairs)
    parallax, sigma = _parallax(pose, near)
    view = TwoView(
        "essential",
        inliers,
        errors,
        "two or more poses explain the pairs equally well" if others else "",
        ("pose: one of several",) if others else (),
        pose,
        pose.rotation,
        cov * _scale(s0, known),
        alternatives=others,
        sigma0=s0,
        parallax_deg=parallax,
        parallax_sigma_deg=sigma,
        log10_nfa=log10_false_alarms(len(pairs), int(inliers.sum()), 5, 10, chance_on_line(pose, pairs)),
    )
    return _with_weakness(view)


def _settled(pose: Pose, pairs: Pairs) -> tuple[Pose, Mask]:
    """The pairs near the pose and in front of both cameras, after a refinement on them."""
    inliers = np.ones(len(pairs), dtype=bool)
    for _ in range(3):
        near = sampson_errors(essential_from_poses(pose), pairs) ** 2 < GATE_LINE
        near &= ~behind(pose, pairs)
        if (near == inliers).all() or near.sum() < 5:
            return pose, near
        inliers = near
        pose = refine_pose(pose, pairs[inliers])[0]
    return pose, inliers


def _others(
    found: list[Candidate[Pose]], best: Pose, near: Pairs, scale: float, loose: bool, sigma_px: float | None
) -> tuple[Pose, ...]:
    """Other poses that the pairs do not refute.

    Truncated costs are compared on the pairs that agree with either. White noise of a trusted sigma refutes a pose
    that is worse by `_DOUBT`; errors of a lens do not: ``loose`` keeps what leaves sigma up to 1.5 times as large,
    and where sigma itself is taken from the pairs, all poses that leave no more than a lens does. (Of a nearly flat
    scene the wrong pose takes part of the lens's errors for relief, and has the smaller sigma.)
    """
    share = 0.0 if sigma_px is None else (_LENS_PX / sigma_px) ** 2
    kept: list[Pose] = []
    for other in found[1:]:
        on = (found[0].squares < GATE_LINE) | (other.squares < GATE_LINE)
        least, cost = (float(np.minimum(c.squares[on], GATE_LINE).sum()) for c in (found[0], other))
        possible = cost < least + _DOUBT * scale or (loose and cost < max(_LOOSE * least, share * int(on.sum())))
        if not possible or any(_apart(other.model, k) < _OTHER_RAD for k in kept):
            continue
        if _apart(refine_pose(other.model, near)[0], best) > _OTHER_RAD:  # else the same minimum, one pair more or less
            kept.append(other.model)
    return tuple(kept)


def _apart(p: Pose, q: Pose) -> float:
    """Larger of the angles (radians) between rotations and between baselines."""
    across = np.linalg.norm(np.cross(p.translation, q.translation))
    return max(float(p.angle_to(q)), float(np.arctan2(across, p.translation @ q.translation)))


def _by_all_pairs(planes: tuple[PlanePose, ...], pairs: Pairs) -> list[PlanePose]:
    """Without copies, and first the one that more pairs off the plane agree with (too few to decide: see `choose`)."""
    cost = [np.minimum(sampson_errors(essential_from_poses(p.b_from_a), pairs) ** 2, GATE_LINE).sum() for p in planes]
    first, *others = (planes[k] for k in np.argsort(cost, kind="stable"))
    return [first, *(p for p in others if _apart(p.b_from_a, first.b_from_a) > _OTHER_RAD)]


def _with_weakness(view: TwoView) -> TwoView:
    """Adds a tiny baseline to the reasons: its direction, or the depth of most points, is not determined."""
    assert view.cov is not None
    direction = float(np.degrees(np.sqrt(np.linalg.eigvalsh(view.cov[3:, 3:])[-1])))
    shown = view.parallax_deg >= PARALLAX * view.parallax_sigma_deg
    weak = (*(("baseline direction",) if direction > _WEAK_DEG else ()), *(() if shown else ("depth",)))
    if not weak:
        return view
    words = (
        f"tiny baseline: parallax {g3(view.parallax_deg)} deg, its sigma {g2(view.parallax_sigma_deg)} deg; "
        f"direction of the baseline +- {g2(direction)} deg"
    )
    return replace(view, weak=(*view.weak, *weak), reason="; ".join(r for r in (view.reason, words) if r))


# --- numbers -------------------------------------------------------------------------------------
def _sigma0(residual: Array, parameters: int) -> float:
    dof = len(residual) - parameters
    return float(np.sqrt(residual @ residual / dof)) if dof > 0 else float("nan")


def _scale(s0: float, known: bool) -> float:
    """What covariances are multiplied by."""
    return 1.0 if known or not np.isfinite(s0) else s0**2


def _parallax(pose: Pose, pairs: Pairs) -> tuple[float, float]:
    angle, sigma = ray_angles(pose, pairs)
    return float(np.degrees(np.median(angle))), float(np.degrees(np.median(sigma)))
