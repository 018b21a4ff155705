"""Several cameras of one surface: do they contradict each other, everywhere or on a part of it?"""

from __future__ import annotations

from collections.abc import Sequence

from windmark.errors import g2
from windmark.paint import CamerasApart
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding


def apart_findings(
    moments: Sequence[Sequence[CamerasApart]], what: str, step: str, local: str, moment: str = ""
) -> list[Finding]:
    """Two cameras that contradict each other in more than some of the moments.

    Parameters
    ----------
    moments : of each frame, or of one point, each two of its cameras
    what : of which they are: "ratios of"
    step : what to do where they differ everywhere
    local : what may lie on the part of the surface where they do
    moment : plural of what a moment is, where there are several
    """
    by_pair: dict[tuple[str, str], list[CamerasApart]] = {}
    for moment_apart in moments:
        for one in moment_apart:
            by_pair.setdefault((one.first, one.second), []).append(one)
    out = []
    for (first, second), every in by_pair.items():
        far = [one.typical for one in every if one.typical > rules.APART]
        here = f" in {{}} of {len(every)} {moment}" if moment else ""
        if len(far) > rules.SOME * len(every):
            words = f"{what} {first} and {second} differ by {g2(max(far))} times their sigmas where both see"
            said = f"{words}{here.format(len(far))}; the merged values lie between them"
            out.append(Finding(DOUBTFUL, "cameras", said, step))
            continue
        parts = [one.beyond for one in every if one.beyond > rules.CONTRADICTED]
        if len(parts) > rules.SOME * len(every):
            part = f"{g2(100 * max(parts))} % of the nodes that both see"
            words = f"{what} {first} and {second} contradict each other on {part}"
            then = f"look at the map where they do: {local}, a reflection, dead pixels, or a marker that moved"
            out.append(Finding(DOUBTFUL, "cameras", f"{words}{here.format(len(parts))}", then))
    return out
