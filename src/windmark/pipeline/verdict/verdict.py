"""The one verdict on a result: a word, its reason, and what to do next. Every job's judge says it in these nouns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from windmark.errors import UsageError

Word = Literal["good", "doubtful", "bad"]
GOOD: Word = "good"
DOUBTFUL: Word = "doubtful"
BAD: Word = "bad"
WORDS: tuple[Word, ...] = (GOOD, DOUBTFUL, BAD)

CAUSES = {
    "usage": "a command that lacks something, or has something that there is not",
    "units": "units that differ or are mixed",
    "file": "a file that cannot be read, or does not fit the others",
    "format": "what a format does not hold, or holds less exactly",
    "saturated": "a picture at its highest grey level",
    "black": "a picture clipped at black, where noise ends at its lowest grey level",
    "interlaced": "a picture of two fields, taken one after the other",
    "blurred": "a picture out of focus, or moved while it was taken",
    "swapped": "names exchanged",
    "mirrored": "a picture or a table that is mirrored",
    "discs": "radii or normals of the table that contradict the picture",
    "grid": "a grid that is not where the markers are",
    "lamps": "lamps that are not where they should be",
    "mixed": "pictures of two cameras under one name",
    "scene": "a scene that changed between the pictures",
    "focus": "pictures of which nothing checks that they have one focus",
    "sheared": "pictures that are sheared or stretched against each other",
    "distorted": "pictures with a distortion that is not the other pictures'",
    "twofold": "a parameter of a law that fits a second time",
    "focal": "a focal length that does not fit",
    "principal": "a principal point that is not the other pictures'",
    "late": "pictures of a camera that are of another time than the others'",
    "moved": "a camera that is not where it should be",
    "camera": "an interior of the camera, or a lens, that does not fit",
    "picture": "a picture that contradicts the others",
    "lens": "residuals with the pattern of another lens, focal length or principal point",
    "attached": "a part of the model that moves with another one and is not attached to it",
    "bound": "a law's parameter stands at a bound that the pictures contradict",
    "prior": "the pictures contradict what a law's parameter is said to be",
    "bent": "a model that is bent, taken as rigid; or a law that is too simple",
    "marker": "a marker that is not where its table says",
    "table": "markers that are off their table",
    "cameras": "cameras that contradict each other",
    "noise": "residuals larger than the stated noise",
    "control": "what is known of markers or distances contradicts itself",
    "layout": "a pattern of markers that fits in several ways",
    "missing": "markers that should be seen and are not",
    "few": "few markers",
    "one-sided": "markers on one side, the rest is extrapolated",
    "weak": "directions that the pictures hardly determine",
    "lost": "pictures, points, views or sections that gave no result",
    "taps": "paint and taps that do not agree",
    "temperature": "thermocouples that do not agree",
    "covered": "little of the surface seen",
    "no match": "nothing that explains the spots",
    "time": "a time limit that came first",
}
"""What a verdict can rest on, in words. What explains others stands before them: of two findings of the same weight the
first one here is the reason."""
_RANK = {cause: n for n, cause in enumerate(CAUSES)}
_WEIGHT = {word: n for n, word in enumerate(WORDS)}



@dataclass(frozen=True)
class Finding:
    """Something that speaks against a result.

    Parameters
    ----------
    word : "doubtful" or "bad"
    cause : key of `CAUSES`
    reason : one sentence, with its numbers
    next_step : what the user can do about it
    where : image, camera, frame or point; "" for the whole job
    """

    word: Word
    cause: str
    reason: str
    next_step: str
    where: str = ""

    def __post_init__(self) -> None:
        if self.cause not in CAUSES or self.word not in (DOUBTFUL, BAD):
            raise UsageError(
                f"Finding: expected a cause of {', '.join(CAUSES)} and doubtful or bad, got "
                f"{self.cause!r}, {self.word!r}"
            )

    def at(self, where: str) -> Finding:
        """The same of a named place."""
        return replace(self, where=where)


@dataclass(frozen=True)
class Verdict:
    """What is to be thought of a result.

    Parameters
    ----------
    word : good, doubtful or bad
    cause : key of `CAUSES`; "" where it is good
    reason : one sentence
    next_step : one sentence
    findings : everything that was found, what counts most first
    """

    word: Word
    cause: str
    reason: str
    next_step: str
    findings: tuple[Finding, ...] = ()

    @staticmethod
    def of(findings: Iterable[Finding], of: int, good: str, next_step: str, *, what: str = "images") -> Verdict:
        """From findings at up to ``of`` places (``what``); without any it is good, for the reason ``good``.

        What is found at some of several places only makes the whole doubtful, not bad: the others have their result.
        """
        every = sorted(findings, key=lambda f: (-_WEIGHT[f.word], _RANK[f.cause]))
        if not every:
            return Verdict(GOOD, "", good, next_step)
        bad = {f.where for f in every if f.word == BAD}
        whole = "" in bad or (bool(bad) and len(bad) >= of)
        counted = every if whole else sorted(every, key=lambda f: _RANK[f.cause])
        first = counted[0]
        word = BAD if whole else DOUBTFUL
        alike = list(dict.fromkeys(f.where for f in every if f.cause == first.cause and f.where))
        place = ""
        if of > 1 and alike:
            rest = f" and {len(alike) - 1} more of {of} {what}" if len(alike) > 1 else ""
            place = f"{alike[0]}{rest}: "
        return Verdict(word, first.cause, place + first.reason, first.next_step, tuple(every))

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "word": self.word,
            "cause": self.cause,
            "reason": self.reason,
            "next_step": self.next_step,
            "findings": [vars(f) for f in self.findings],
        }

    @staticmethod
    def of_record(record: dict[str, Any]) -> Verdict:
        """From `record`."""
        found: Sequence[dict[str, Any]] = record.get("findings", ())
        return Verdict(
            record["word"],
            record["cause"],
            record["reason"],
            record["next_step"],
            tuple(Finding(**f) for f in found),
        )
