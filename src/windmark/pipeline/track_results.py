"""A followed sequence as tables: one row per image for the pose, one per marker for the matches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose, PoV
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.lens import NO_OTHER, OtherInterior, other_interior
from windmark.registration import Unchecked
from windmark.scene import MarkerSet
from windmark.scene.detections import middle_sigma
from windmark.tasks.follow import FollowedFrame

Array = NDArray[np.float64]

POV = ("rx_deg", "ry_deg", "rz_deg", "dx", "dy", "dz")
"""The paper's point of view: angles of the model before the camera, and distances in length units."""


@dataclass(frozen=True)
class PoseRow:
    """What is kept of one image: a row of the table, and its matches as columns.

    Parameters
    ----------
    frame : the FollowedFrame without its spots
    pov, sigma : (6,) the point of view (`POV`) and its 1 sigma, NaN where there is no pose
    matches : marker, x, y, dx, dy (projected - detected) of the K matches
    time_s : by the recording's clock; NaN where unknown
    unchecked : what the image cannot tell; of those that were followed, besides that of the one they go on from
    excess_px, off_table : of the registration; ``spot_px`` is the median sigma of its spots, ``bent_px`` the largest
        shift of a marker by a deformation
    fields_px : how far rows of odd number are from those of even number, see `FollowedFrame`
    other : what another interior of the camera would do, where the residuals are more than the spots' noise
    blur_px, radius_px : how blurred the spots are, and their median radius, see `FollowedFrame`
    picture : see `FollowedFrame`; 0 where there is no pose
    """

    index: int
    name: str
    instant: float
    status: str
    reason: str
    guided: bool
    seconds: float
    matched: int
    expected: int
    rms_px: float
    pov: Array
    sigma: Array
    cam_from_model: Pose | None
    matches: tuple[NDArray[np.int64], Array]
    time_s: float = np.nan
    unchecked: tuple[Unchecked, ...] = ()
    excess_px: float = np.nan
    spot_px: float = np.nan
    off_table: float = np.nan
    bent_px: float = 0.0
    blur_px: float = np.nan
    radius_px: float = np.nan
    fields_px: float = 0.0
    other: OtherInterior = NO_OTHER
    picture: int = 0

    @staticmethod
    def of(frame: FollowedFrame) -> PoseRow:
        """The row of an image."""
        answer = frame.registered
        common = (
            frame.index, frame.name, frame.instant, frame.status, frame.reason, frame.guided, frame.seconds
        )  # fmt: skip
        if answer is None or frame.detections is None:
            none = (np.zeros(0, np.int64), np.zeros((0, 4)))
            return PoseRow(*common, 0, 0, np.nan, np.full(6, np.nan), np.full(6, np.nan), None, none, frame.time_s)
        xy = frame.detections.xy[answer.matching.detection]
        matches = (answer.matching.marker, np.concatenate([xy, answer.residuals], axis=1))
        pov, sigma = pov_with_sigma(answer.cam_from_model, answer.cov)
        spot = middle_sigma(frame.detections.cov[answer.matching.detection])
        misfits = answer.excess_px > rules.NOISE_TIMES * spot
        return PoseRow(
            *common, len(answer.matching), answer.n_expected, answer.rms_px, pov, sigma, answer.cam_from_model, matches,
            frame.time_s, answer.unchecked, answer.excess_px, spot, answer.off_table,
            0.0 if answer.deformation is None else answer.deformation.largest_px,
            frame.blur_px, float(np.median(frame.detections.radius_px[answer.matching.detection])),
            frame.fields_px, other_interior(answer, spot) if misfits else NO_OTHER, frame.picture,
        )  # fmt: skip


def pov_with_sigma(pose: Pose, cov: Array) -> tuple[Array, Array]:
    """(6,) point of view (`POV`) of a pose and its 1 sigma.

    Parameters
    ----------
    cov : (6, 6) of [rotation, translation] for ``exp(delta) @ pose``

    At ry = +-90 degrees rx and rz are not determined apart; their sigma is then infinite.
    """
    return pov_of(pose), _numbers(pose.pov_sigma(cov[:6, :6]))


def pov_of(pose: Pose) -> Array:
    """(6,) point of view (`POV`) of a pose."""
    return _numbers(pose.to_pov())


def _numbers(pov: PoV) -> Array:
    return np.array([pov.rx_deg, pov.ry_deg, pov.rz_deg, pov.dx, pov.dy, pov.dz])


def pose_columns(rows: list[PoseRow]) -> dict[str, Any]:
    """``frame,image,instant[,time_s],status,matched,expected,rms_px``, `POV`, their sigmas, station, reason."""
    pov, sigma = (np.array([getattr(row, key) for row in rows]).reshape(-1, 6) for key in ("pov", "sigma"))
    station = np.array([np.full(3, np.nan) if r.cam_from_model is None else r.cam_from_model.center for r in rows])
    return {
        "frame": [row.index for row in rows],
        "image": [row.name for row in rows],
        "instant": [row.instant for row in rows],
        **({"time_s": [row.time_s for row in rows]} if any(row.time_s == row.time_s for row in rows) else {}),
        "status": [row.status for row in rows],
        "matched": [row.matched for row in rows],
        "expected": [row.expected for row in rows],
        "rms_px": [row.rms_px for row in rows],
        **{name: pov[:, k] for k, name in enumerate(POV)},
        **{f"sigma_{name}": sigma[:, k] for k, name in enumerate(POV)},
        **{f"camera_{axis}": station.reshape(-1, 3)[:, k] for k, axis in enumerate("xyz")},
        "reason": [row.reason for row in rows],
    }


def match_columns(rows: list[PoseRow], markers: MarkerSet) -> dict[str, Any]:
    """``image,name,x,y,dx,dy,distance_px`` of all images, as `io.write_matches` has them for one."""
    values = np.concatenate([np.zeros((0, 4)), *(row.matches[1] for row in rows)])
    names = [str(name) for row in rows for name in markers.name[row.matches[0]]]
    return {
        "image": [row.name for row in rows for _ in row.matches[0]],
        "name": names,
        "x": values[:, 0], "y": values[:, 1], "dx": values[:, 2], "dy": values[:, 3],
        "distance_px": np.hypot(values[:, 2], values[:, 3]),
    }  # fmt: skip


def sequence_summary(rows: list[PoseRow], camera: Camera, unit: str) -> dict[str, Any]:
    """A followed sequence in figures."""
    status = [row.status for row in rows]
    good = [row for row in rows if row.cam_from_model is not None]
    # What an image that is followed cannot tell is only what it has besides that of the one it goes on from.
    alone, all_of = (
        next((row.unchecked for row in reversed(rows) if row.unchecked and keep(row)), ())
        for keep in (lambda row: row.status != "tracked", lambda row: True)
    )
    unchecked = {u.what: u for u in (*alone, *all_of)}.values()
    return {
        "images": len(rows),
        **{key: status.count(key) for key in ("cold", "tracked", "reacquired", "lost")},
        "guided": sum(row.guided for row in rows),
        "length_unit": unit,
        "focal_px": camera.focal_px,
        "median_rms_px": float(np.median([row.rms_px for row in good])) if good else np.nan,
        "median_matched": float(np.median([row.matched for row in good])) if good else 0.0,
        "median_seconds": float(np.median([row.seconds for row in rows])) if rows else np.nan,
        "unchecked": [{"what": u.what, "words": u.words} for u in unchecked],
        "lost_images": {row.name: row.reason for row in rows if row.status == "lost"},
    }
