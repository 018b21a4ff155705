"""A model followed through a sequence of images: labels and pose from frame to frame."""

from windmark.registration.track.state import Motion, TrackState, taken_up
from windmark.registration.track.track import predict, track

__all__ = ["Motion", "TrackState", "predict", "taken_up", "track"]
