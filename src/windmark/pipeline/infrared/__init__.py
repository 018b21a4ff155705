"""The job of an infrared run: from a project file to temperature and heat flux of every frame on the moving model."""

from windmark.pipeline.infrared.load import InfraredRun, load_infrared
from windmark.pipeline.infrared.outputs import reduced
from windmark.pipeline.infrared.project import InfraredProject, read_infrared_project
from windmark.pipeline.infrared.record import FAILED, REDUCED, FrameRecord
from windmark.pipeline.infrared.run import InfraredResult, made_with, run_infrared

__all__ = [
    "FAILED", "REDUCED", "FrameRecord", "InfraredProject", "InfraredResult", "InfraredRun", "load_infrared",
    "made_with", "read_infrared_project", "reduced", "run_infrared",
]  # fmt: skip
