"""Deformation measurements: sequences of images of one or more cameras, live or from a disk."""

from windmark.pipeline.deform.frames import frames_on_disk
from windmark.pipeline.deform.live import Watch, watch
from windmark.pipeline.deform.load import Loaded, load
from windmark.pipeline.deform.pictures import follow_deformation
from windmark.pipeline.deform.project import Changes, DeformProject, read_deform_project
from windmark.pipeline.deform.record import FrameRecord
from windmark.pipeline.deform.run import run_sequence
from windmark.pipeline.deform.sequence import Sequence
from windmark.tasks.deform.memory import displaced
from windmark.tasks.deform.task import DeformationTest, DeformedFrame, FrameImages, LookOptions, Station
from windmark.tasks.deform.zero import Zero

__all__ = [
    "Changes", "DeformProject", "DeformationTest", "DeformedFrame", "FrameImages", "FrameRecord", "Loaded",
    "LookOptions", "Sequence", "Station", "Watch", "Zero", "displaced", "follow_deformation", "frames_on_disk", "load",
    "read_deform_project", "run_sequence", "watch",
]  # fmt: skip
