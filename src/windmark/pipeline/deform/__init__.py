"""Deformation measurements: sequences of images of one or more cameras, live or from a disk."""

from windmark.pipeline.deform.follow import displaced, follow_deformation
from windmark.pipeline.deform.task import DeformationTest, DeformedFrame, FrameImages, LookOptions, Station

__all__ = [
    "DeformedFrame",
    "FrameImages",
    "LookOptions",
    "Station",
    "DeformationTest",
    "displaced",
    "follow_deformation",
]
