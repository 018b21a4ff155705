"""Every picture asked again: would the finished structure put it where it is?

A picture that joins early is placed by the few points that are known then; nothing that comes later looks at it again,
and in a network of many pictures its few marks are outvoted, not noticed. So each one is registered once more, from
nothing, to the points that other pictures have, and has to say the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.calibration import Calibration
from windmark.errors import g2
from windmark.registration import CONTRADICTED, NotRegistered, Registration, prepare, register
from windmark.registration.search.layout import Layout
from windmark.scene import Detections, Doubt, MarkerSet
from windmark.tasks.reconstruct.structure import Structure
from windmark.tasks.reconstruct.task import Task

Ints = NDArray[np.int64]

LINKS_OF_OTHERS = 3
"""Links of a point that takes part: two pictures hold it without the one that is asked."""
LEAST_POINTS = 8
"""Points below which nothing can be asked."""
BY_PICTURES = ("register", "neighbour", "pair")
"""Ways in which nothing but the spots gave a pose; labels and given poses decide what spots cannot."""
NEAR_DEG, NEAR_SCALE = 5.0, 1.1
"""How far from its pose a picture is looked for where it is not recognised without one."""
FOCAL_SIGMAS = 4.0
"""How far a picture's own focal length is off the camera's to be the reason: by chance of one in 16,000."""


@dataclass(frozen=True)
class Answers:
    """What the pictures said.

    Parameters
    ----------
    moved : {view: where it is instead, or for the first time, with the points (K,) of the answer's pairs}
    out : {view: why it cannot stay, or come in}
    changed : whether the structure is another one then
    doubts : of pictures that stay where they are though they would fit elsewhere as well
    """

    moved: Mapping[int, tuple[Registration, Ints]]
    out: Mapping[int, str]
    changed: bool
    doubts: tuple[Doubt, ...] = ()

    @property
    def silent(self) -> bool:
        """Whether none said otherwise."""
        return not (self.moved or self.out or self.doubts)

    def applied(self, structure: Structure) -> Structure:
        """The structure with the pictures where they belong."""
        gone = [*self.out, *self.moved]
        stays = ~np.isin(structure.view, gone)
        out = replace(
            structure, point=structure.point[stays], view=structure.view[stays], spot=structure.spot[stays],
            poses={v: p for v, p in structure.poses.items() if v not in gone},
            pose_cov={v: c for v, c in structure.pose_cov.items() if v not in gone},
        )  # fmt: skip
        for v, (answer, point) in self.moved.items():
            out = out.with_view(v, answer.cam_from_model, answer.matching.detection, point)
            out = replace(out, pose_cov={**out.pose_cov, v: answer.cov})
        return out


def asked_again(
    task: Task, views: Sequence[int], structure: Structure, done: Calibration, names: Sequence[str],
    found_by: Mapping[int, str], last: bool,
) -> Answers:  # fmt: skip
    """Register each of some pictures to the points of the others; ``names`` are those of the structure's points.

    Pictures without a pose are asked, too. ``last``: pictures that would move are left out instead.
    """
    row = {str(n): k for k, n in enumerate(done.markers.name)}
    links = np.bincount(structure.point, minlength=len(structure.xyz))
    point = np.array([p for p in np.flatnonzero(links >= LINKS_OF_OTHERS).tolist() if names[p] in row], dtype=np.int64)
    if len(point) < LEAST_POINTS:
        return Answers({}, {}, False)
    at = [row[names[p]] for p in point.tolist()]
    markers = MarkerSet.make([names[p] for p in point.tolist()], done.markers.xyz[at], sigma=done.markers.sigma[at])
    layout = prepare(markers)
    moved: dict[int, tuple[Registration, Ints]] = {}
    out: dict[int, str] = {}
    tied: dict[int, str] = {}
    for v in views:
        spots = _as_uncertain(task.detections[v], done.sigma0)
        answer = _asked(task, structure, v, spots, markers, layout)
        if isinstance(answer, Registration):
            its = point[answer.matching.marker]
            if not _same(structure, v, answer.matching.detection, its):
                moved[v] = answer, its
        elif answer.cause == "ambiguous":
            if found_by.get(v, "register") in BY_PICTURES:
                tied[v] = answer.reason
        else:
            out[v] = _why(answer)
    if last:
        spots_of = {v: _as_uncertain(task.detections[v], done.sigma0) for v in moved}
        out |= {v: _elsewhere(task, structure, v, spots_of[v], markers, layout) for v in moved}
        moved = {}
    stay = [v for v in tied if v in structure.poses] if 2 * len(tied) >= len(structure.poses) else []
    out |= {v: f"it fits in two places: {why}" for v, why in tied.items() if v not in stay}
    words = "{} fits the markers in two places about equally well, and is where its neighbours put it"
    doubts = tuple(Doubt((str(v),), words, "layout") for v in stay)
    return Answers(moved, out, bool(moved) or not structure.poses.keys().isdisjoint(out), doubts)


def _asked(
    task: Task, structure: Structure, view: int, spots: Detections, markers: MarkerSet, layout: Layout
) -> Registration | NotRegistered:
    """Recognised from nothing, or else near its pose, where few spots are not enough for the former."""
    camera = structure.cameras[task.views[view].camera]
    answer = register(spots, markers, camera, layout=layout, max_deformation=0.0, seed=task.seed)
    settled = isinstance(answer, Registration) or answer.cause == "ambiguous" or answer.cause in CONTRADICTED
    if settled or view not in structure.poses:
        return answer
    return register(
        spots, markers, camera, layout=layout, prior=structure.poses[view], prior_max_angle_deg=NEAR_DEG,
        prior_max_scale=NEAR_SCALE, max_deformation=0.0, seed=task.seed,
    )  # fmt: skip


def _elsewhere(
    task: Task, structure: Structure, view: int, spots: Detections, markers: MarkerSet, layout: Layout
) -> str:
    """Why a picture is left out that fits elsewhere, but in the end not there: its focal length, where that is off."""
    camera = structure.cameras[task.views[view].camera]
    free = register(spots, markers, camera, layout=layout, free_focal=True, max_deformation=0.0, seed=task.seed)
    if isinstance(free, Registration):
        off, sigma = free.camera.focal_px - camera.focal_px, float(np.sqrt(free.cov[6, 6]))
        if abs(off) > FOCAL_SIGMAS * sigma:
            change = "longer" if off > 0 else "shorter"
            return (
                f"another focal length: it shows {free.camera.focal_px:.0f} px, {g2(100 * abs(off) / camera.focal_px)} "
                f"% {change} than the camera's ({abs(off) / sigma:.0f} sigma)"
            )
    return "it fits the points of the other pictures elsewhere, and not there either"


def _as_uncertain(spots: Detections, sigma0: float) -> Detections:
    """Spots as uncertain as the adjustment found them to be."""
    return spots if sigma0 <= 1 else replace(spots, cov=sigma0**2 * spots.cov)


def _same(structure: Structure, view: int, spot: Ints, point: Ints) -> bool:
    """Whether most of the spots have the points that an answer gives them."""
    mine = structure.view == view
    own = dict(zip(structure.spot[mine].tolist(), structure.point[mine].tolist(), strict=True))
    agree = [own.get(s) == p for s, p in zip(spot.tolist(), point.tolist(), strict=True)]
    return 2 * sum(agree) > len(agree)


def _why(no: NotRegistered) -> str:
    if no.cause in CONTRADICTED:
        return f"it contradicts the other pictures: {no.reason}"
    return f"the points of the other pictures do not show where it was taken: {no.reason}"
