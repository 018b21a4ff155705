"""What is found while a model is followed, in a deformation test, a paint test and an infrared run alike."""

from __future__ import annotations

from collections.abc import Sequence

from windmark.errors import g1, g2
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.doubts import as_finding
from windmark.pipeline.verdict.picture import series_blur, series_fields
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.series import copies_finding
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.scene.repeated import ONCE_MORE

AT_ONCE = ("layout", "twofold")
"""What one frame is enough to say: its numbers may be off by what no sigma has, not by a part of the noise."""


def followed_findings(instants: Sequence[Followed], unit: str) -> list[Finding]:
    """Of the instants that have a state; ``unit`` is that of the lengths."""
    return [
        *_copies(instants),
        *_doubts(instants),
        *_cameras(instants),
        *_odd_markers(instants, unit),
        *series_blur((name, s.blur_px, s.radius_px) for at in instants for name, s in at.cameras.items()),
        *series_fields((name, s.fields_px) for at in instants for name, s in at.cameras.items()),
    ]


def _copies(instants: Sequence[Followed]) -> list[Finding]:
    """Pictures that show what those before them show, noise and all."""
    copies = [(name, at.key) for at in instants for name, s in at.cameras.items() if ONCE_MORE in s.reason]
    if not copies:
        return []
    key = copies[0][1]
    names = [name for name, of in copies if of == key]
    said = "shows in {} what it showed before" if len(names) == 1 else "show in {} what they showed before"
    first = f"{' and '.join([', '.join(names[:-1]), names[-1]] if len(names) > 1 else names)} {said.format(key)}"
    return [copies_finding(first, len(copies) - len(names) + 1, "that")]


def _doubts(instants: Sequence[Followed]) -> list[Finding]:
    """What speaks against the states, by its cause, where it does so in more than some of them, or at once.

    Larger residuals count from where most of them is no noise: one spot of a hundred that is 5 sigma off is certain to
    be no accident, and the covariances, which have it, hardly change by it.
    """
    kinds: dict[str, list[tuple[str, str]]] = {}
    for at in instants:
        first = {c: words for c, words in reversed(at.doubts) if c != "noise" or at.sigma0 > rules.SIGMA0}
        for cause, words in first.items():
            kinds.setdefault(cause, []).append((at.key, words))
    return [
        as_finding(f"{of[0][0]}{_more(len(of))}: {of[0][1]}", cause)
        for cause, of in kinds.items()
        if cause in AT_ONCE or len(of) > rules.SOME * len(instants)
    ]


def _cameras(instants: Sequence[Followed]) -> list[Finding]:
    """The camera that saw least of what it should, or was left out, where that is in more than some of the instants."""
    sights = [(name, at.key, s) for at in instants for name, s in at.cameras.items()
              if s.reason and ONCE_MORE not in s.reason]  # fmt: skip
    if len({key for _, key, _ in sights}) <= rules.SOME * len(instants):
        return []
    name, key, sight = min(sights, key=lambda at: at[2].found / max(at[2].expected, 1))
    cause, step = told_by(sight.reason) or (
        "missing", "look at this picture: light, focus, or something before the model"
    )  # fmt: skip
    sees = f" sees {sight.found} of {sight.expected} markers" if sight.expected else ""
    return [Finding(DOUBTFUL, cause, f"{name}{sees} in {key}: {sight.reason}", step)]


def _odd_markers(instants: Sequence[Followed], unit: str) -> list[Finding]:
    """Markers that have a spot beside their place, in more than some of the instants."""
    seen: dict[str, dict[str, tuple[float, float, str]]] = {}
    for at in instants:
        for camera, sight in at.cameras.items():
            for marker, (px, length) in sight.odd.items():
                seen.setdefault(marker, {})[at.key] = (px, length, camera)
    often = {m: of for m, of in seen.items() if len(of) > rules.SOME * len(instants)}
    if not often:
        return []
    marker, of = max(often.items(), key=lambda item: (len(item[1]), item[0]))
    px, length, camera = next(iter(of.values()))
    more = f" (and {len(often) - 1} more)" if len(often) > 1 else ""
    return [
        Finding(
            DOUBTFUL,
            "marker",
            f"{marker}{more} is {g2(px)} px (about {g1(length)} {unit}) from where its table has it and takes "
            f"no part ({camera}, {next(iter(of))}{_more(len(of))})",
            "measure this marker again, or exchange the names if two of them are swapped",
        )
    ]


def _more(count: int) -> str:
    return f" and {count - 1} more" if count > 1 else ""
