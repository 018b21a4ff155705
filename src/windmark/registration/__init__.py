"""Which spot is which marker and where the camera was, from unlabelled or labelled spots.

The way of `register`, to be read in this order: `register`, `task` (what is to be solved), `solve` (search, judge,
answer). The search: `search.layout` (the markers, prepared), `search.plane` (the spots), `search.links` (which spots
are taken for which markers), `search.search` and its kernel `_kernels.match`, `search.pool`. What it finds settles in
`settle.views`, `settle.settling` and `settle.solution`. The judge: `judge.source`, `judge.judge`,
`rules`. `result` is what comes of it. `track` follows a model from frame to frame by the same judge.
"""

from windmark.registration.candidates import PoseCandidates, pose_candidates
from windmark.registration.directions import WeakDirection
from windmark.registration.labelled import pose_from_labels
from windmark.registration.register import prepare, register, register_rig
from windmark.registration.result import (
    CAUSES,
    CONTRADICTED,
    Deformation,
    NotRegistered,
    Registration,
    RigRegistration,
    RunnerUp,
    Unchecked,
)
from windmark.registration.track import Motion, TrackState, predict, track

__all__ = [
    "register", "register_rig", "prepare", "pose_from_labels", "Registration", "RigRegistration", "Deformation",
    "NotRegistered", "PoseCandidates", "pose_candidates", "RunnerUp", "WeakDirection", "CAUSES", "CONTRADICTED",
    "track", "predict", "TrackState", "Motion", "Unchecked",
]  # fmt: skip
