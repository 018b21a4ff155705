"""Whether a board whose dots do not fit their places is no plane: folded, or two boards edge to edge.

Cut between two columns or rows, each part is a plane of its own: every picture has two poses then, one of each part.
Those of a flat board are one and the same within their uncertainty; those of a folded one differ by the same turn in
all pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Calibration, Fixed, NotCalibrated
from windmark.errors import g2
from windmark.geometry import Pose
from windmark.geometry.two_view.homography import fit_homography, transfer
from windmark.scene import Doubt, View
from windmark.tasks.calibrate.marks import Marks
from windmark.tasks.calibrate.run import Calibrated, CalibrateSettings, adjusted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Outcome = Calibrated | NotCalibrated

LEAST_LINES, LEAST_DOTS = 2, 8
"""Columns (or rows) and dots of a part in a picture that say how it lies."""
TRIED = 3
"""Cuts that are adjusted, the likeliest first: a lens bends both parts, and may hide which one is right."""
SIGMAS, ALIKE = 6.0, 1 / 3
"""The turn between the parts is so many times its sigma, and pictures differ in it by so large a part at most: what
bends a flat board's parts, a lens, is another turn in every picture."""


@dataclass(frozen=True)
class Cut:
    """Between two columns (axis 0) or rows (1): so many are before it, or behind it in pictures of the board turned."""

    axis: int
    before: int

    def behind(self, index: NDArray[np.int64], turned: bool) -> Mask:
        """Which dots of a picture, with these columns or rows (K,), are behind the cut there."""
        place = index - index.min()
        return np.asarray(place >= (place.max() + 1 - self.before if turned else self.before))


def with_shape(out: Outcome, marks: Marks, settings: CalibrateSettings) -> Outcome:
    """The outcome of all marks held at their places on a plane, with the reason if the pictures show that it is none.

    Parameters
    ----------
    out : asked if it is a refusal, or says that the dots are off their places
    marks : with the covariances of their detector: a misfit must not have enlarged them
    """
    doubts = () if isinstance(out, NotCalibrated) else out.result.doubts
    if out and not any(d.cause == "table" for d in doubts):
        return out
    for cut, turned in _likeliest(marks)[:TRIED]:
        parted = adjusted(_parted(marks, cut, turned), replace(settings, datum=Fixed(), max_sigma0=np.inf))
        turn = _turn(parted) if isinstance(parted, Calibration) else None
        if turn is None:
            continue
        words = _words(cut, turn)
        if isinstance(out, NotCalibrated):
            return replace(out, cause="not_flat", weak=(), reason=words)
        return replace(out, result=replace(out.result, doubts=(Doubt((), words, "table"), *doubts)))
    return out


def _words(cut: Cut, turn: float) -> str:
    """Where it is folded, and by how much."""
    lines = ("columns", "rows")[cut.axis]
    return (
        f"the dots are not on one plane: in all pictures {cut.before} {lines} at one side and the others are planes of "
        f"their own, {g2(np.degrees(turn))} degrees apart: the board is folded or bent, or two boards lie edge to edge"
    )


def _index(marks: Marks) -> NDArray[np.int64]:
    """(N, 2) column and row of every marker, by its place."""
    return np.stack([np.unique(c.round(9), return_inverse=True)[1].ravel() for c in marks.markers.xyz[:, :2].T], axis=1)


def _likeliest(marks: Marks) -> list[tuple[Cut, tuple[bool, ...]]]:
    """Cuts with which of the pictures are turned for each, those that leave least to two homographies first."""
    obs, index = marks.observations, _index(marks)
    of = [np.flatnonzero(obs.view == v) for v in range(len(marks.views))]
    out = []
    for axis in (0, 1):
        # Of those behind the middle each is one before it in turned pictures.
        for before in range(LEAST_LINES, int(index[:, axis].max() + 1) // 2 + 1):
            cut, left, turned = Cut(axis, before), 0.0, list[bool]()
            for mine in of:
                cells, xy = index[obs.point[mine]], obs.xy[mine]
                each = [_misfit(cells, xy, cut.behind(cells[:, axis], way)) for way in (False, True)]
                left += min(each)
                turned.append(each[1] < each[0])
            out.append((left, cut, tuple(turned)))
    return [(cut, turned) for left, cut, turned in sorted(out, key=lambda o: o[0]) if np.isfinite(left)]


def _misfit(cells: NDArray[np.int64], xy: Array, behind: Mask) -> float:
    """Median of what two homographies leave of a picture's dots, px; inf where a part has too few."""
    left = np.empty(len(xy))
    for part in (behind, ~behind):
        flat = cells[part].astype(float)
        h = fit_homography(flat, xy[part]) if part.sum() >= LEAST_DOTS else None
        if h is None:
            return np.inf
        left[part] = np.linalg.norm(transfer(h, flat) - xy[part], axis=1)
    return float(np.median(left))


def _parted(marks: Marks, cut: Cut, turned: tuple[bool, ...]) -> Marks:
    """The marks with every picture as two views, one of each part."""
    obs, index = marks.observations, _index(marks)
    view = 2 * obs.view
    for v, way in enumerate(turned):
        mine = np.flatnonzero(obs.view == v)
        view[mine] += cut.behind(index[obs.point[mine], cut.axis], way)
    views = tuple(
        View(f"{v.name}:{part}", v.camera, f"{v.frame}:{part}") for v in marks.views for part in (0, 1)
    )  # fmt: skip
    return replace(marks, observations=replace(obs, view=view), views=views)


def _turn(result: Calibration) -> float | None:
    """The angle between the two parts, radians; None where pictures do not agree in one that is no chance.

    The turn from the part before the cut to the one behind is the same in pictures that show the board turned by half.
    """
    poses = {v.name: (v.cam_from_model, c) for v, c in zip(result.views, result.pose_cov, strict=True)}
    turns, sigmas = [], []
    for name, (first, cov) in poses.items():
        other = poses.get(f"{name[:-2]}:1") if name.endswith(":0") else None
        if other is None or first is None or other[0] is None:
            continue
        turns.append(Pose(first.inverse().rotation @ other[0].rotation, np.zeros(3)).rotvec)
        sigmas.append(float(np.sqrt(np.trace(cov[:3, :3] + other[1][:3, :3]) / 3)))
    if len(turns) < 2:
        return None
    middle = np.median(np.array(turns), axis=0)
    angle = float(np.linalg.norm(middle))
    apart = np.linalg.norm(np.array(turns) - middle, axis=1)
    sure = angle > SIGMAS * float(np.median(sigmas)) and float(np.median(apart)) < ALIKE * angle
    return angle if sure else None
