"""The verdict on markers that were looked for in pictures: none found, pictures at fault."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from windmark.errors import g2
from windmark.pipeline.verdict.picture import PictureState, picture_findings
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict

WHY_NOT = "register says which marker each is; --explain, why others are none"


@dataclass(frozen=True)
class Looked:
    """What was found in a picture: number of spots, their middle sigma (NaN without any), and a hint or reason."""

    state: PictureState
    spots: int
    sigma_px: float
    said: str


def detect_verdict(found: Mapping[str, Looked], unread: Mapping[str, str], shown: bool = False) -> Verdict:
    """Judge detections.

    Parameters
    ----------
    found : by picture
    unread : pictures that could not be read, and why
    shown : whether a picture or a page of them was asked for
    """
    out = [Finding(BAD, "file", why, "read the reason; export the picture again", name) for name, why in unread.items()]
    for name, one in found.items():
        out += [f.at(name) for f in [*picture_findings(one.state), *_few(one)]]
    number, pictures = sum(one.spots for one in found.values()), len(found) + len(unread)
    where = "1 picture" if pictures == 1 else f"{pictures} pictures"
    sigma = sorted(one.sigma_px for one in found.values() if one.spots)
    typical = f", typically known to {g2(sigma[len(sigma) // 2])} px" if sigma else ""
    return Verdict.of(
        out, pictures, f"{number} spots in {where}{typical}",
        f"look at them{'' if shown else ' (--report or --picture)'}; {WHY_NOT}", what="pictures",
    )  # fmt: skip


def _few(one: Looked) -> list[Finding]:
    step = "try what the hint says; --explain lists what was rejected and why"
    if not one.spots:
        return [Finding(BAD, "few", f"no marker was found: {one.said}", step)]
    if one.said:
        return [Finding(DOUBTFUL, "few", f"{one.spots} spots; {one.said}", step)]
    return []
