"""The job of a paint test: from a project file to pressure, Cp and loads of every point of a polar."""

from windmark.pipeline.psp.load import PspTest, load_psp
from windmark.pipeline.psp.made import made_with
from windmark.pipeline.psp.project import PspProject, read_psp_project
from windmark.pipeline.psp.record import FAILED, REDUCED, PointRecord, grouped
from windmark.pipeline.psp.run import reduced, run_psp

__all__ = [
    "FAILED", "REDUCED", "PointRecord", "PspProject", "PspTest", "grouped", "load_psp", "made_with",
    "read_psp_project", "reduced", "run_psp",
]  # fmt: skip
