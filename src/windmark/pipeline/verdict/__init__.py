"""One verdict on every job: good, doubtful or bad, with the reason and the next step. Results in, verdict out."""

from windmark.pipeline.verdict.errors import error_verdict
from windmark.pipeline.verdict.network import calibrate_verdict, reconstruct_verdict
from windmark.pipeline.verdict.paint import black_findings, lamp_findings, psp_verdict, reference_findings
from windmark.pipeline.verdict.registered import Sighting, registered_findings
from windmark.pipeline.verdict.run import run_verdict, units_findings
from windmark.pipeline.verdict.series import deform_verdict, infrared_verdict, track_verdict
from windmark.pipeline.verdict.verdict import BAD, CAUSES, DOUBTFUL, GOOD, WORDS, Finding, Verdict, Word

__all__ = [
    "BAD",
    "CAUSES",
    "DOUBTFUL",
    "GOOD",
    "WORDS",
    "Finding",
    "Sighting",
    "Verdict",
    "Word",
    "black_findings",
    "calibrate_verdict",
    "deform_verdict",
    "error_verdict",
    "infrared_verdict",
    "lamp_findings",
    "psp_verdict",
    "reconstruct_verdict",
    "reference_findings",
    "registered_findings",
    "run_verdict",
    "track_verdict",
    "units_findings",
]
