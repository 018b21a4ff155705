"""A deforming model followed through images of one or more cameras."""

from windmark.tasks.deform.follow import follow_deformation
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.states import identified_again, what_is_free
from windmark.tasks.deform.task import (
    DeformationTest,
    DeformedFrame,
    FrameImages,
    LookOptions,
    Reader,
    Shot,
    Sight,
    Station,
    as_given,
)

__all__ = [
    "DeformationTest", "DeformedFrame", "FrameImages", "LookOptions", "Reader", "Shot", "Sight", "Station", "as_given",
    "displaced", "follow_deformation", "identified_again", "what_is_free",
]  # fmt: skip
