"""One verdict on every job: good, doubtful or bad, with the reason and the next step. Results in, verdict out.

Each job's verdict is imported from its own module, so that a command loads no other job than its own.
"""

from windmark.pipeline.verdict.verdict import BAD, CAUSES, DOUBTFUL, GOOD, WORDS, Finding, Verdict, Word

__all__ = ["BAD", "CAUSES", "DOUBTFUL", "GOOD", "WORDS", "Finding", "Verdict", "Word"]
