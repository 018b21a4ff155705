"""A refusal before any result (a bad file, wrong settings) as a verdict, so that every end of a job is said alike."""

from __future__ import annotations

from windmark.errors import WindmarkError
from windmark.io import FileError
from windmark.pipeline.verdict.registered import camera_at_fault
from windmark.pipeline.verdict.verdict import BAD, Finding, Verdict

UNITS = "length unit"
"""The key under which `pipeline.lengths` refuses."""


def error_verdict(error: WindmarkError) -> Verdict:
    """Bad, for the reason that the error says."""
    units = isinstance(error, FileError) and error.where == UNITS
    cause, step = (
        ("units", "say each file's unit, or convert it (windmark convert --to-unit)")
        if units
        else camera_at_fault(str(error))
        or ("file", "correct what is named; windmark check PROJECT lists everything at once")
    )
    return Verdict.of([Finding(BAD, cause, str(error), step)], 1, "", "")
