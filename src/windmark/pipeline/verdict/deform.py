"""The verdict on a deformation test."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from windmark.deformation.wall_places import TOGETHER
from windmark.errors import g2
from windmark.pipeline.deform.followed import Followed
from windmark.pipeline.deform.record import MISFIT, FrameRecord
from windmark.pipeline.deform.series import NOT_TRIED
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.doubts import as_finding
from windmark.pipeline.verdict.followed import followed_findings
from windmark.pipeline.verdict.series import bad_series, lost_findings, middle
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding, Verdict
from windmark.scene.repeated import ONCE_MORE


def deform_verdict(
    records: Sequence[FrameRecord],
    weak: Sequence[str] = (),
    unit: str = "",
    zero: Sequence[str] = (),
    parameters: Sequence[str] = (),
    grid: Sequence[Finding] = (),
    apart: NDArray[np.float64] | None = None,
) -> Verdict:
    """Judge a deformation test; ``weak`` is what its set-up hardly determines, in words; ``unit`` that of lengths.

    ``zero``: keys of the wind-off frames; ``parameters``: names of those of the laws;
    ``grid`` of `grid_findings`; ``apart`` of `Zero`.
    """
    good = [r for r in records if r.status in ("cold", "tracked", MISFIT)]
    if not good:
        reason = records[0].reason if records else "no frame arrived"
        cause = "moved" if "not where it should be" in reason else "no match"
        step = "place the named camera anew" if cause == "moved" else "see the reason of the first frame"
        return bad_series(cause, f"no frame gave a deformation; the first: {reason}", step)
    found = [*grid, *lost_findings([(r.key, r.reason) for r in records if r.status == "lost"], len(records), "frames")]
    together = _together(records)
    found += followed_findings([_followed(r, {f.cause for f in together}) for r in good], unit)
    found += [*together, *_copies(good), *_standing_out(good), *_zero(good, zero, parameters, apart)]
    if weak:
        found.append(
            Finding(
                DOUBTFUL,
                "weak",
                f"weakly determined: {weak[0]}",
                "add a camera or markers for it, or take it out of the law",
            )
        )
    s0, rms = middle([r.sigma0 for r in good]), middle([r.rms_px for r in good])
    return Verdict.of(
        found,
        1,
        f"{len(good)} frames identified, residuals of {g2(rms)} px RMS are {g2(s0)} times the spots' noise",
        "use deformation.csv with its sigmas",
    )


def _together(records: Sequence[FrameRecord]) -> list[Finding]:
    """What all frames say together, as the last one of them knows it, and which of them have it in their sigmas."""
    tried = [r for r in records if r.status not in NOT_TRIED]
    out = []
    for cause, words in tried[-1].series if tried else ():
        since = next((k for k in range(len(tried), 0, -1) if cause not in dict(tried[k - 1].series)), 0)
        more = f"; sigmas contain it from frame {tried[since].key} on" if since else ""
        out.append(as_finding(words + more, cause))
    return out


def _followed(record: FrameRecord, told: Collection[str]) -> Followed:
    """An instant; ``told``: causes of which more is known than it says by itself, but for other markers of its own."""
    doubts = tuple(
        d for d in zip(record.causes, record.warnings, strict=True)
        if d[0] not in told or (d[0] == "marker" and TOGETHER not in d[1])
    )  # fmt: skip
    return Followed(f"frame {record.key}", record.cameras, doubts, record.sigma0)


def _copies(good: Sequence[FrameRecord]) -> list[Finding]:
    """Pictures that are those of a frame long before, bit by bit; of the frame before `followed_findings` has them."""
    first: dict[tuple[str, int], str] = {}
    copies: dict[str, tuple[str, list[str]]] = {}
    for row in good:
        for name, sight in row.cameras.items():
            of = first.setdefault((name, sight.picture), row.key) if sight.picture else row.key
            if of != row.key and ONCE_MORE not in sight.reason:
                copies.setdefault(row.key, (of, []))[1].append(name)
    if not copies:
        return []
    key, (of, names) = next(iter(copies.items()))
    more = f" (and {len(copies) - 1} more such frames)" if len(copies) > 1 else ""
    seen_by = " and ".join(names)
    reason = f"the picture of {seen_by} in frame {key}{more} is that of frame {of} bit by bit: it is of one of them"
    return [Finding(DOUBTFUL, "file", reason, "find that frame's own pictures, or leave it out")]


def _standing_out(good: Sequence[FrameRecord]) -> list[Finding]:
    """Frames that the laws do not explain as they do the others: so few that `followed_findings` leaves them out.

    One is enough, as it is of pictures that are there twice: it may be torn, and its values are off by what no sigma
    has.
    """
    usual = max(1.0, middle([r.sigma0 for r in good]))
    odd = [r for r in good if r.status == MISFIT and r.sigma0 > rules.SIGMA0 * usual]
    if not odd or len(odd) > rules.SOME * len(good):
        return []
    worst = max(odd, key=lambda r: r.sigma0)
    more = f" (and {len(odd) - 1} more of {len(good)})" if len(odd) > 1 else ""
    said = f": {worst.warnings[0]}" if worst.warnings else ""
    reason = (
        f"frame {worst.key}{more} does not fit as the others do: residuals are {g2(worst.sigma0)} times the spots' "
        f"noise, in other frames {g2(usual)}{said}"
    )
    return [Finding(DOUBTFUL, "picture", reason, "see that its pictures are whole, of this frame and of one moment")]


def _zero(
    good: Sequence[FrameRecord], zero: Sequence[str], parameters: Sequence[str], sigmas: NDArray[np.float64] | None
) -> list[Finding]:  # fmt: skip
    """Wind-off frames that differ by a part of what the wind does: one of them is not wind-off.

    ``sigmas`` by which they differ; None by the records', which contain such a difference where there is a `Zero`.
    """
    off = [r for r in good if r.key in zero]
    if len(off) < 2 or not len(off[0].q):
        return []
    q, sigma = np.array([r.q for r in off]), np.max([r.q_sigma for r in off], axis=0)
    every = np.ptp([r.q for r in good], axis=0)
    apart = np.ptp(q, axis=0)
    times = apart / np.maximum(sigma, 1e-300) if sigmas is None else sigmas[: len(apart)]
    bad = (times > rules.WIND_OFF_SIGMAS) & (apart > rules.WIND_OFF * every)
    if not bad.any():
        return []
    k = int(np.argmax(np.where(bad, apart / np.maximum(every, 1e-300), 0.0)))
    first, last = off[int(q[:, k].argmin())].key, off[int(q[:, k].argmax())].key
    name = parameters[k] if k < len(parameters) else f"parameter {k + 1}"
    return [
        Finding(
            DOUBTFUL,
            "table",
            f"the wind-off frames {first} and {last} differ in {name} by {100 * apart[k] / every[k]:.0f} % of all that "
            "is seen of it",
            "see that sequence.zero names frames without load",
        )
    ]
