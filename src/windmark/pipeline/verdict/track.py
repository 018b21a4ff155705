"""The verdict on a followed sequence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from windmark.errors import g1, g2
from windmark.pipeline.focal_series import FocalSeries
from windmark.pipeline.misfits import lower_middle, misfits, turned
from windmark.pipeline.track_results import PoseRow
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.doubts import STEPS
from windmark.pipeline.verdict.focal import focal_findings
from windmark.pipeline.verdict.picture import PictureState, picture_findings, series_blur, series_fields
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.registered import what_is_left
from windmark.pipeline.verdict.series import bad_series, copies_finding, lost_findings, middle
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.scene.repeated import is_repeated


def track_verdict(
    rows: Sequence[PoseRow], unit: str, first: PictureState | None = None, names: Sequence[str] = (),
    focal: FocalSeries | None = None,
) -> Verdict:  # fmt: skip
    """Judge a followed sequence.

    ``first``: state of its first picture, where none gave a pose. Markers' ``names``. ``focal``: of `focal_series`.
    """
    good = [r for r in rows if r.cam_from_model is not None]
    if not good:
        reason = f"no image gave a pose; the first: {rows[0].reason if rows else 'there are no images'}"
        if first is not None and (seen := picture_findings(first)) and told_by(reason) is None:
            return Verdict.of([replace(f, word=BAD, reason=f"{reason}; {f.reason}") for f in seen], 1, "", "")
        return bad_series("no match", reason, "run windmark register on one image first")
    found = lost_findings([(r.name, r.reason) for r in rows if r.cam_from_model is None], len(rows), "images")
    found += [*_misfit(good, unit), *_standing_out(good), *_bent(good), *_off(good, names)]
    found += [] if focal is None else focal_findings(rows, focal, unit)
    found += series_blur(("", r.blur_px, r.radius_px) for r in good)
    found += series_fields(("", r.fields_px) for r in good)
    found += [*_few(good), *_missing(good), *_copies(rows)]
    rms, excess, spot = (middle([getattr(r, k) for r in good]) for k in ("rms_px", "excess_px", "spot_px"))
    beyond = excess if excess > rules.NOISE_TIMES * spot else 0.0
    return Verdict.of(
        found,
        1,
        f"{'the image has' if len(good) == 1 else f'all {len(good)} images have'} a pose, {what_is_left(rms, beyond)}",
        "use poses.csv",
    )


def _misfit(good: Sequence[PoseRow], unit: str) -> list[Finding]:
    """Residuals that are no noise: the pattern of another lens, or markers that are off their table."""
    excess, spot = lower_middle([r.excess_px for r in good]), middle([r.spot_px for r in good])
    if not excess > rules.NOISE_TIMES * spot:
        return []
    typical = sorted(good, key=lambda r: r.other.lead)[len(good) // 2]
    if typical.other.told:
        each = float(np.hypot(typical.excess_px, typical.spot_px))
        times = f"{each / typical.spot_px:.0f} times their spots' sigma"
        said = f"residuals of {g2(each)} px per coordinate, {times} ({typical.name}, as most of {len(good)} images)"
        return [typical.other.said(said, unit, typical.off_table)]
    if not excess > rules.PLACE_PX:
        return []
    return [
        Finding(
            DOUBTFUL, "table",
            f"markers about {g1(middle([r.off_table for r in good]))} {unit} off their table (median of {len(good)} "
            f"images): residuals are {np.hypot(excess, spot) / spot:.0f} times their spots' sigma",
            "measure the markers (windmark reconstruct), or calibrate the lens",
        )
    ]  # fmt: skip


def _standing_out(good: Sequence[PoseRow]) -> list[Finding]:
    """Images that do not fit as the others do: one is enough, its pose is off by what no sigma of it has."""
    upside = turned(good)
    found = [m for k, m in misfits(good).items() if k not in upside]
    out = []
    if upside:
        k, said = next(iter(upside.items()))
        more = f" (and {len(upside) - 1} more of {len(good)} images)" if len(upside) > 1 else ""
        out = [Finding(DOUBTFUL, "picture", f"{good[k].name}{more}: {said}", "turn the picture as the others are")]
    if not found:
        return out
    worst = max(found, key=lambda m: m.each_px / m.others_px)
    more = f" (and {len(found) - 1} more of {len(good)} images)" if len(found) > 1 else ""
    return [*out, Finding(DOUBTFUL, "picture", f"{worst.name}{more}: {worst.words}", STEPS["picture"])]


def _bent(good: Sequence[PoseRow]) -> list[Finding]:
    """A model that bends."""
    bent = [r for r in good if r.bent_px > rules.PLACE_PX]
    if not len(bent) > rules.SOME * len(good):
        return []
    far = max(r.bent_px for r in bent)
    return [
        Finding(
            DOUBTFUL, "bent",
            f"the model is bent in {len(bent)} of {len(good)} images (up to {g2(far)} px); its pose is that of a rigid "
            "one", "measure the deformation (windmark deform)",
        )
    ]  # fmt: skip


def _off(good: Sequence[PoseRow], names: Sequence[str]) -> list[Finding]:
    """Few markers that the others contradict wherever they are seen: one of many, the rest of which agrees.

    The pose's sigma holds what a deformation would change that looks like it, which is many times the others' noise.
    """
    seen: dict[int, list[tuple[float, float]]] = {}
    for row in good:
        noise = max(float(np.hypot(row.excess_px, row.spot_px)), np.finfo(float).tiny)
        for marker, far in zip(row.matches[0].tolist(), np.hypot(*row.matches[1][:, 2:].T).tolist(), strict=True):
            seen.setdefault(marker, []).append((far, far / noise))
    usual = {marker: np.median(np.array(all_), axis=0) for marker, all_ in seen.items()}
    off = sorted((m for m, (far, times) in usual.items() if far > rules.PLACE_PX and times > rules.GROSS),
                 key=lambda m: -usual[m][0])  # fmt: skip
    if not off or len(off) > max(1.0, rules.LEFT_OUT * len(seen)):
        return []
    name = names[off[0]] if len(names) else f"marker {off[0]}"
    rest = float(np.median([far for m, (far, _) in usual.items() if m not in off]))
    more = f" (and {len(off) - 1} more)" if len(off) > 1 else ""
    said = (
        f"{name} is {g2(usual[off[0]][0])} px from where the others have it, in most of {len(seen[off[0]])} images"
        f"{more}; theirs are {g2(rest)} px off. Sigmas hold a bend of the model that would do so"
    )
    return [Finding(DOUBTFUL, "marker", said, "measure it again, or leave it out of the table")]


def _copies(rows: Sequence[PoseRow]) -> list[Finding]:
    """Pictures that show what the one before them shows, noise and all; or are one long before, bit by bit."""
    copies = [(b.name, a.name) for a, b in pairwise(rows) if _same(a, b)]
    out, first = [], dict[int, str]()
    if copies:
        name, of = copies[0]
        out = [copies_finding(f"{name} is {of} once more", len(copies), "its pose")]
    told = {name for name, _ in copies}
    known = [row for row in rows if row.picture]
    earlier = [(row.name, first.setdefault(row.picture, row.name)) for row in known]
    exact = [(name, of) for name, of in earlier if of != name and name not in told]
    if exact:
        name, of = exact[0]
        more = f" (and {len(exact) - 1} more such images)" if len(exact) > 1 else ""
        out.append(Finding(DOUBTFUL, "file", f"{name}{more} is {of} bit by bit: it is of one of these instants",
                           "find that instant's own picture, or leave it out"))  # fmt: skip
    return out


def _same(a: PoseRow, b: PoseRow) -> bool:
    (marker_a, at_a), (marker_b, at_b) = a.matches, b.matches
    return is_repeated(marker_a, at_a[:, :2], marker_b, at_b[:, :2], b.spot_px)


def _few(good: Sequence[PoseRow]) -> list[Finding]:
    """Images that rest on few markers."""
    few = [r for r in good if r.matched < rules.FEW]
    if not len(few) > rules.SOME * len(good):
        return []
    words = f"{len(few)} of {len(good)} images rest on fewer than {rules.FEW} markers"
    return [Finding(DOUBTFUL, "few", words, "paint more markers, or choose roles that are seen")]


def _missing(good: Sequence[PoseRow]) -> list[Finding]:
    """Images that lack markers which should be seen."""
    gone = [r for r in good if r.matched < (1 - rules.MISSING) * r.expected]
    if not len(gone) > rules.SOME * len(good):
        return []
    worst = min(gone, key=lambda r: r.matched / max(r.expected, 1))
    return [
        Finding(
            DOUBTFUL, "missing",
            f"{len(gone)} of {len(good)} images lack over a third of their markers; "
            f"{worst.name}: {worst.matched} of {worst.expected}", "look at windmark detect on this image",
        )
    ]  # fmt: skip
