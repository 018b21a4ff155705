"""What a layout is confused with: its near-symmetries, and the rivals that a campaign met."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.geometry import DegenerateGeometry, Pose, align
from windmark.registration import prepare
from windmark.tasks.marker_check.campaign import Campaign, Trial
from windmark.tasks.marker_check.stage import Stage

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MAPPED = 0.3
"""A marker takes another one's spot if it is nearer than this part of the markers' spacing in the image."""
SAME = 0.5
"""Two rivals are the same confusion if more than this share of their pairs is."""
NO_TURN_DEG = 5.0
SHOWN = 6
"""Names listed in words."""


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A motion that brings many markers onto others, nearly.

    Parameters
    ----------
    motion : of the model's frame
    onto : (N,) the marker onto which each one is brought, -1 for none
    rms : root mean square distance of the brought ones from the others, length unit; NaN where unknown
    rms_px : the same in the image of a typical view
    met : views of the campaign that could not be told from their rival by this motion
    from_table : found in the table of markers alone; otherwise it was met in the campaign only
    """

    motion: Pose
    onto: Ints
    rms: float
    rms_px: float
    met: int = 0
    from_table: bool = True

    @property
    def share(self) -> float:
        """Share of the markers that is brought onto others."""
        return float((self.onto >= 0).mean())

    def words(self, middle: Array, unit: str) -> str:
        """The motion in words."""
        angle = float(np.degrees(np.linalg.norm(self.motion.rotvec)))
        if angle < NO_TURN_DEG:
            shift = ", ".join(f"{g3(v)}" for v in _clean(self.motion.apply(middle) - middle))
            return f"shift by ({shift}) {unit}"
        axis = _clean(self.motion.rotvec / np.linalg.norm(self.motion.rotvec))
        if axis[np.argmax(np.abs(axis))] < 0:
            axis, angle = 0.0 - axis, -angle
        turn = "half a turn" if abs(abs(angle) - 180) < 2 else f"turn by {angle:.0f} deg"
        return f"{turn} about the axis ({', '.join(f'{g2(v)}' for v in axis)})"

    def record(self, stage: Stage, unit: str) -> dict[str, Any]:
        """For machines."""
        names = stage.markers.name
        brought = np.flatnonzero(self.onto >= 0)
        return {
            "motion": self.words(stage.middle, unit), "markers_brought": len(brought), "share": self.share,
            "rms": self.rms, "rms_px": self.rms_px, "views_confused": self.met, "from_table": self.from_table,
            "pairs": {str(names[i]): str(names[self.onto[i]]) for i in brought},
            "breaking": names[self.onto < 0].tolist(),
        }  # fmt: skip


def symmetries(stage: Stage, campaign: Campaign, scale_px: float) -> list[Symmetry]:
    """Near-symmetries of the table and rivals of the campaign, those that were met most first, then the most complete.

    A rival that the table's search has found is counted there. ``scale_px``: pixels per length unit in a typical view.
    """
    found = _of_table(stage, scale_px)
    for trial in campaign.trials:
        if trial.outcome not in ("symmetric", "wrong") or trial.rival is None:
            continue
        onto = brought_in_image(stage, trial)
        for k, known in enumerate(found):
            if _same(onto, known.onto):
                found[k] = replace(known, met=known.met + 1)
                break
        else:
            motion = trial.pose.inverse() @ trial.rival
            found.append(Symmetry(motion, onto, float("nan"), float("nan"), 1, False))
    return sorted(found, key=lambda s: (-s.met, -s.share, np.nan_to_num(s.rms, nan=np.inf)))


def px_per_length(stage: Stage, campaign: Campaign) -> float:
    """Pixels per length unit at the model's middle, in the median of the directions that count."""
    directions = campaign.directions[campaign.counted]
    if not len(directions):
        directions = campaign.directions
    fill = float(np.mean(stage.settings.fill))
    poses = (stage.pose(d, 0.0, fill) for d in directions[:: max(1, len(directions) // 20)])
    return float(np.median([stage.camera.focal_px / p.apply(stage.middle)[2] for p in poses]))


def brought_in_image(stage: Stage, trial: Trial) -> Ints:
    """(N,) the marker whose spot each one takes under the rival's pose of a view, -1 for none."""
    from scipy.spatial import cKDTree

    onto = np.full(len(stage.markers), -1)
    seen = np.flatnonzero(trial.seen)
    if trial.rival is None or len(seen) < 2:
        return onto
    spots = stage.camera.project(trial.pose.apply(stage.markers.xyz[seen]))[0]
    tree = cKDTree(spots)
    spacing = float(np.median(tree.query(spots, k=2)[0][:, 1]))
    rival, valid = stage.camera.project(trial.rival.apply(stage.markers.xyz))
    distance, index = tree.query(np.where(valid[:, None], rival, -1e9))
    near = np.flatnonzero(distance < MAPPED * spacing)
    # One to one: the nearest one takes the spot.
    near = near[np.argsort(distance[near], kind="stable")]
    _, first = np.unique(index[near], return_index=True)
    onto[near[first]] = seen[index[near[first]]]
    return onto


def _of_table(stage: Stage, scale_px: float) -> list[Symmetry]:
    """Near-symmetries of the table, each with the best motion for its pairs."""
    if len(stage.markers) < 5:
        return []
    layout = prepare(stage.markers)
    found, xyz = [], stage.markers.xyz
    for onto in layout.symmetries[0]:
        brought = np.flatnonzero(onto >= 0)
        try:
            fitted = align(xyz[brought], xyz[onto[brought]], scale=False)
        except DegenerateGeometry:
            continue  # markers on one line
        found.append(Symmetry(fitted.pose, onto.astype(np.int64), fitted.rms, fitted.rms * scale_px))
    return found


def _same(one: Ints, other: Ints) -> bool:
    both = (one >= 0) & (other >= 0)
    least = min((one >= 0).sum(), (other >= 0).sum())
    return bool(least > 0 and (one == other)[both].sum() > SAME * least)


def _clean(v: Array) -> Array:
    """Without the rounding that shows as -0 or 1e-17."""
    return np.asarray(np.where(np.abs(v) < 1e-6 * max(float(np.abs(v).max()), 1e-300), 0.0, v) + 0.0)


def name_list(names: NDArray[np.str_]) -> str:
    """A few names, and how many more."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN].tolist()) + (f" and {more} more" if more > 0 else "")
