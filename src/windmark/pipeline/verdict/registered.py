"""The verdict on one registered image: residuals against sigma, what explains them, and what is asked of the pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.geometry import Pose
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.doubts import STEPS
from windmark.pipeline.verdict.lens import by_pose, other_interior, table_finding
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.resized import resized
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding
from windmark.pipeline.verdict.without_spot import missing, odd_markers
from windmark.registration import NotRegistered, Registration
from windmark.registration.task import MIN_COUNT
from windmark.scene import Detections, MarkerSet
from windmark.scene.detections import middle_sigma

Array = NDArray[np.float64]

REFUSALS = {
    "too_few": ("few", "look at the detected spots; check radius, polarity and focus; paint more markers"),
    "degenerate": ("one-sided", "use markers that do not lie on one line"),
    "nothing": ("no match", "check that table, camera and picture belong together, and the roles that take part"),
    "weak": ("few", "more markers in view, or a prior pose ([register] prior)"),
    "misfit": ("table", "check the marker table against the model, or allow more with [register] tolerance_px"),
    "ambiguous": ("layout", "label a marker in the picture ([[image]] labels), or give a prior pose if there was none"),
    "focal": ("weak", "give the focal length (windmark calibrate), or a prior pose"),
    "wrong_focal": ("focal", "correct the focal length in the camera file, or set [register] free_focal = true"),
    "wrong_camera": ("camera", "calibrate the camera (windmark calibrate); check that the file is this camera's"),
    "exchanged": ("moved", "give each camera its own pictures and its own file: two have each other's"),
    "mirrored": ("mirrored", "mirror the picture, or check the sign of the table's axes"),
    "one_pair": ("few", "paint more markers, or label one ([[image]] labels)"),
    "discs": ("discs", STEPS["discs"]),
    "labels": ("swapped", "check the named labels: one is at another marker's spot"),
    "time": ("time", "allow more time ([register] max_time_s), or give a prior pose"),
}
"""Cause of a `NotRegistered` -> cause of the verdict, and the next step."""


@dataclass(frozen=True)
class Sighting:
    """What was seen of one image.

    Parameters
    ----------
    answer : the registration, or why there is none
    spots : detected
    markers : the table that it was registered with
    expected : markers that must be in view from the pose found; None unknown
    unit : length unit
    surface : (N, 3) places whose projections are asked for (nodes of the grid that are seen); None: the pose itself
    published : a pose that the camera's file holds, and that is that of a camera that stands still
    """

    answer: Registration | NotRegistered
    spots: Detections
    markers: MarkerSet
    expected: NDArray[np.int64] | None = None
    unit: str = ""
    surface: Array | None = None
    published: Pose | None = None


def registered_findings(seen: Sighting) -> list[Finding]:
    """Everything that speaks against the registration of an image."""
    if isinstance(seen.answer, NotRegistered):
        return [refused(seen.answer, len(seen.markers))]
    answer = seen.answer
    if not len(answer.matching):
        return []
    return [
        *_bent(seen, answer),
        *odd_markers(seen, answer),
        *_misfit(seen, answer),
        *_moved(seen, answer),
        *missing(seen, answer),
        *_few(answer),
        *_reach(seen, answer),
    ]


def refused(no: NotRegistered, count: int) -> Finding:
    """A refusal as a finding; ``count`` is that of the table's markers."""
    cause, step = REFUSALS[no.cause]
    if no.cause == "too_few" and count < MIN_COUNT:
        step = "give the table more markers, or let other roles of it take part ([markers] roles)"
    told = told_by(no.reason)
    labels = no.options.get("fixed")
    if isinstance(labels, Mapping) and labels and no.cause in ("nothing", "weak", "misfit", "one_pair"):
        which = f"label {next(iter(labels.values()))}" if len(labels) == 1 else f"labels {', '.join(labels.values())}"
        step = f"check the {which}: all else has to follow a label; then: {step}"
    if no.cause == "misfit" and told is not None and told[0] == "units":
        cause, step = told
    if no.cause == "wrong_camera" and told is not None and told[0] == "moved":
        cause, step = "moved", "find the cameras' places anew (windmark calibrate), or register them without the rig"
    return Finding(BAD, cause, f"not registered: {no.reason}", step)


def _bent(seen: Sighting, answer: Registration) -> list[Finding]:
    bent = answer.deformation
    if bent is None or bent.largest_px < rules.PLACE_PX:
        return []
    other = resized(answer, seen.spots, seen.markers)  # explains the bending, and stands before it
    return [
        *([] if other is None else [other]),
        Finding(
            DOUBTFUL,
            "bent",
            f"the model is bent by {g2(100 * bent.largest)} % of its size (up to "
            f"{g2(bent.largest_px)} px); the grid is taken "
            "as rigid",
            "measure the deformation (windmark deform) and map onto the bent grid",
        ),
    ]


def _misfit(seen: Sighting, answer: Registration) -> list[Finding]:
    """Residuals beyond the noise: the pattern of another lens, or markers that are off their table."""
    spot = spot_px(answer, seen.spots)
    if answer.excess_px < rules.NOISE_TIMES * spot:
        return []
    each = float(np.hypot(answer.excess_px, spot))
    times = f"{each / spot:.0f} times their spots' sigma of {g2(spot)} px"
    residuals = f"residuals of {g2(each)} px per coordinate, {times}"
    other = other_interior(answer, spot)
    # However small: what moves the surface by less than `PLACE_PX` may move the camera by many of its sigmas.
    if other.told:
        return [other.said(residuals, seen.unit, answer.off_table)]
    return [] if answer.excess_px < rules.PLACE_PX else [table_finding(answer.off_table, residuals, seen.unit)]


def _moved(seen: Sighting, answer: Registration) -> list[Finding]:
    """A camera that stands still, by markers on the walls, and is not where its file says."""
    walls = seen.markers.role[answer.matching.marker] == "wall"
    if seen.published is None or walls.sum() < 3:
        return []
    xyz = seen.markers.xyz[answer.matching.marker[walls]]
    there, ok = answer.camera.project(seen.published.apply(xyz))
    here = answer.camera.project(answer.cam_from_model.apply(xyz))[0]
    if not ok.all():
        far = np.inf
    else:
        far = float(np.sqrt(((there - here) ** 2).sum(axis=1).mean()))
    spread = 5.0 * max(rules.PLACE_PX, answer.excess_px)
    if far < spread:
        return []
    return [
        Finding(
            DOUBTFUL,
            "moved",
            f"the camera is not where its file says: markers on the walls are {g2(far)} px from where they would be",
            "keep the pose found here, or place the camera anew (windmark register) before poses of the file are used",
        )
    ]


def _few(answer: Registration) -> list[Finding]:
    if len(answer.matching) >= rules.FEW:
        return []
    return [
        Finding(
            DOUBTFUL,
            "few",
            f"{len(answer.matching)} markers hold the pose: a wrong one among them would hardly show",
            f"paint or use at least {rules.FEW} markers, spread over the model",
        )
    ]


def _reach(seen: Sighting, answer: Registration) -> list[Finding]:
    """What the pose's sigma does to what was asked for: places of the surface, or the pose itself."""
    if seen.surface is None or not len(seen.surface):
        return _angles(seen, answer)
    there = _projected_sigma(answer, seen.surface)
    here = _projected_sigma(answer, answer.matched_xyz)
    worst, own = float(np.quantile(there, 0.95)), float(np.median(here))
    if worst < max(5 * rules.PLACE_PX, rules.SPREAD * own):
        return []
    return [
        Finding(
            DOUBTFUL,
            "one-sided",
            f"the markers are on one side of what is asked for: the surface is placed to {g2(worst)} "
            f"px (1 sigma) beside "
            f"{g2(own)} px at the markers",
            "add markers where values are wanted, or a second camera",
        )
    ]


def _angles(seen: Sighting, answer: Registration) -> list[Finding]:
    weak = [
        (m, np.degrees(s))
        for w in answer.weak
        for m, s in zip(w.motions, w.sigma, strict=True)
        if m.startswith("rotation") and np.degrees(s) > rules.ANGLE_DEG
    ]
    if not weak:
        return []
    motion, sigma = max(weak, key=lambda pair: pair[1])
    return [
        Finding(
            DOUBTFUL,
            "weak",
            f"the pictures hardly tell a {motion}: {g2(sigma)} deg (1 sigma)",
            "spread the markers in depth, come nearer, or add a second camera",
        )
    ]


def _projected_sigma(answer: Registration, xyz: Array) -> Array:
    """(N,) 1 sigma per coordinate of projected places by the pose's covariance."""
    some = xyz[:: max(1, len(xyz) // 2000)]
    place = answer.cam_from_model.apply(some)
    _, valid, by_xyz, _ = answer.camera.project_jacobian(place)
    moved, cov = by_pose(by_xyz, place)[valid], answer.cov[:6, :6]
    return np.sqrt(np.einsum("nij,jk,nik->n", moved, cov, moved) / 2)


def spot_px(answer: Registration, spots: Detections) -> float:
    """1 sigma per coordinate of the matched spots, of the middle one."""
    return middle_sigma(spots.cov[answer.matching.detection])


def what_is_left(rms_px: float, beyond_px: float) -> str:
    """Residuals that are not doubted, in words; ``beyond_px``: the part of them that is no noise, 0 for none."""
    if not beyond_px:
        return f"residuals of {g2(rms_px)} px RMS are the spots' noise"
    return f"residuals of {g2(rms_px)} px RMS ({g2(beyond_px)} px per coordinate of it table and lens, not noise)"
