"""A project checked as a whole before it is run."""

from windmark.pipeline.check.problems import Checked, Problem
from windmark.pipeline.check.project import check_project

__all__ = ["Checked", "Problem", "check_project"]
