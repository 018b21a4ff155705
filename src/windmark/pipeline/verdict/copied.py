"""The verdict on pictures of a job that are one: a ratio of a picture with itself is 1 whatever the wind does."""

from __future__ import annotations

from collections.abc import Iterable

from windmark.pipeline.same_picture import copies_among, copy_words
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding

_STEP = "take the picture that was meant, or leave the copy out: it measures nothing of its own"


def copied_findings(pictures: Iterable[tuple[str, bytes]]) -> list[Finding]:
    """Pictures that were there before under another name, from names and `same_picture.shown_by` of all."""
    return [Finding(DOUBTFUL, "file", f"it {copy_words(of)}", _STEP, name) for name, of in copies_among(pictures)]
