"""Which spot is which marker and where the camera was, from unlabelled or labelled spots."""

from windmark.registration.candidates import PoseCandidates, pose_candidates
from windmark.registration.directions import WeakDirection
from windmark.registration.labelled import pose_from_labels
from windmark.registration.register import prepare, register, register_rig
from windmark.registration.result import CAUSES, Deformation, NotRegistered, Registration, RunnerUp, Unchecked
from windmark.registration.rig_result import RigRegistration
from windmark.registration.track import Motion, TrackState, predict, track

__all__ = [
    "register", "register_rig", "prepare", "pose_from_labels", "Registration", "RigRegistration", "Deformation",
    "NotRegistered", "PoseCandidates", "pose_candidates", "RunnerUp", "WeakDirection", "CAUSES", "track", "predict",
    "TrackState", "Motion", "Unchecked",
]  # fmt: skip
