"""Which spot is which marker and where the camera was, from unlabelled or labelled spots."""

from windmark.registration.register import register
from windmark.registration.result import CAUSES, NotRegistered, Registration, RunnerUp

__all__ = ["register", "Registration", "NotRegistered", "RunnerUp", "CAUSES"]
