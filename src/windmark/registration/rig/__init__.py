"""One registration from several cameras that see the model at once."""

from windmark.registration.rig.register import register_rig
from windmark.registration.rig.result import RigRegistration

__all__ = ["register_rig", "RigRegistration"]
