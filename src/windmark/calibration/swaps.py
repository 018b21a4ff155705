"""Exchanged identities among the gross errors: two marks of one view that fit each other's marker."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from windmark.adjust import exchanged_pairs
from windmark.geometry import Camera, Pose

if TYPE_CHECKING:
    from windmark.calibration.setup import Job
    from windmark.calibration.solve import Solved


def swapped(job: Job, solved: Solved, views: list[tuple[Camera, Pose]]) -> tuple[tuple[str, str, str], ...]:
    """(first, second, view): names of markers whose marks were exchanged, among the marks that were left out."""
    obs, found = job.observations, []
    bad = np.flatnonzero(solved.taken)[~solved.used]
    for v in np.unique(obs.view[bad]):
        mine = bad[obs.view[bad] == v]
        camera, pose = views[int(v)]
        seen, valid = camera.project(pose.apply(solved.state.points[obs.point[mine]]))
        sigma = np.sqrt(np.trace(obs.cov[mine], axis1=1, axis2=2) / 2) * solved.sigma0
        for a, b in exchanged_pairs(obs.xy[mine], np.where(valid[:, None], seen, np.nan), sigma):
            names = job.markers.name[obs.point[mine[[a, b]]]]
            found.append((str(names[0]), str(names[1]), job.views[int(v)].name))
    return tuple(found)
