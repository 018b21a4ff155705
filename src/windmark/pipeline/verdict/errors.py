"""A refusal before any result (a bad file, wrong settings) as a verdict, so that every end of a job is said alike."""

from __future__ import annotations

from windmark.errors import WindmarkError
from windmark.io import FileError
from windmark.pipeline.typed import typed
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.verdict import BAD, Finding, Verdict

CORRECT = "correct what is named"
UNITS = "length unit"
"""The key under which `pipeline.lengths` refuses."""


def usage_verdict(said: str, command: str) -> Verdict:
    """Bad, for a command that is not one of those that there are: `windmark VERB` that lacks or misspells something."""
    step = f"correct the command; {command} --help says what it takes"
    return Verdict.of([Finding(BAD, "usage", said, step)], 1, "", "")


def error_verdict(error: WindmarkError) -> Verdict:
    """Bad, for the reason that the error says."""
    if isinstance(error, FileError) and error.where == UNITS:
        cause, step = "units", "say each file's unit, or convert it (windmark convert --to-unit)"
    elif (camera := told_by(str(error))) is not None:
        cause, step = camera
    else:
        cause, step = "file", CORRECT
        if isinstance(error, FileError) and str(error.path).endswith(".toml"):
            step += f"; {typed('windmark', 'check', error.path)} lists everything at once"
    return Verdict.of([Finding(BAD, cause, str(error), step)], 1, "", "")
