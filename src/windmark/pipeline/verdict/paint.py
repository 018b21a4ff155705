"""The verdict on a paint test: its points, and what its project says of lamps, loads and the level without light."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from windmark.errors import g2, g3
from windmark.paint.well_tests import DOUBTED
from windmark.pipeline.alike import alike
from windmark.pipeline.alike import listed as listed_of
from windmark.pipeline.psp import PointRecord
from windmark.pipeline.psp.incidence import SIDESLIP, listed
from windmark.pipeline.psp.response import QUIET, OddResponse
from windmark.pipeline.psp.shared import shared_pictures
from windmark.pipeline.psp.strangers import OF_NO_POINT
from windmark.pipeline.psp.table import PointRow
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.apart import apart_findings
from windmark.pipeline.verdict.followed import followed_findings
from windmark.pipeline.verdict.series import bad_series, lost_findings, middle
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.pipeline.verdict.wanted import valueless_findings
from windmark.tasks.psp.plausible import BESIDE_RECOVERY, EXTRAPOLATED, LACKING, UNFIT


def psp_verdict(
    records: Sequence[PointRecord],
    units: Sequence[Finding] = (),
    unit: str = "",
    sections: Sequence[str] = (),
    further: Sequence[Finding] = (),
) -> Verdict:
    """Judge a paint test; ``unit`` is that of lengths, ``sections`` the names of those that were asked for.

    ``further``: what is found in the project and not in a point, see `black_findings` and `lengths.reference_findings`.

    ``units`` of `grid_findings` explain why no point came out, or are doubts.
    """
    good = [r for r in records if r.status == "reduced"]
    if not good and units:
        return Verdict.of([replace(units[0], word=BAD)], 1, "", "")
    if not good:
        return bad_series(
            "no match",
            f"no point could be reduced; the first: {records[0].reason if records else 'none'}",
            "see the reason; where no marker was found, run windmark register on one of its pictures",
        )
    lost = [(r.name, r.reason) for r in records if r.status != "reduced"]
    found = [*units, *lost_findings(lost, len(records), "points")]
    found += followed_findings([replace(f, key=f"{f.key} of {r.name}") for r in good for f in r.followed], unit)
    found += further
    for r in good:
        said = (*_missing(r, sections), *_states(r), *_taps(r), *_wall(r), *_stream(r), *_calibrated(r), *_light(r))
        found += [f.at(r.name) for f in said]
    sigma, shown = middle([r.median_sigma_cp for r in good]), min(r.shown.get("all", 1.0) for r in good)
    return Verdict.of(
        found,
        len(records),
        f"{len(good)} points reduced, Cp to {g2(sigma)} (median, 1 sigma)"
        + _unchecked(good)
        + (f"; loads are of the {100 * shown:.0f} % of the area that cameras show" if shown < 1 else ""),
        "use loads and Cp with their sigmas; causes say what to improve",
        what="points",
    )


def _unchecked(good: Sequence[PointRecord]) -> str:
    """Of how many points no tap says whether the level is right."""
    free = sum(not (r.fit or _compared(r)) for r in good)
    of = "their level" if free == len(good) else f"the level of {free} of them"
    return f"; no tap checks {of}" if free else ""


def _compared(r: PointRecord) -> bool:
    """Whether taps say how far the paint is off."""
    return r.taps is not None and bool(r.taps.counting.any())


def _missing(r: PointRecord, sections: Sequence[str]) -> Iterator[Finding]:
    """What was asked for and is in no result: sections, loads, and most of the surface that cameras look at."""
    lacks = [name for name in sections if name not in {s.name for s in r.sections}]
    if lacks:
        one = f"section {lacks[0]}"
        words = next((said for said in r.remarks if said.startswith(f"{one}: ")), one)
        yield Finding(DOUBTFUL, "lost", f"left out: {words}", "correct it in the project, or take it out")
    if without := alike((s.name, s.why) for s in r.sections if s.why):
        words = "; ".join(f"{listed_of('section', names)}: {why}" for why, names in without.items())
        step = "see point and normal in the project, in its length unit, and the map of what has a Cp; or take it out"
        yield Finding(DOUBTFUL, "lost", f"no loads of {words}", step)
    yield from valueless_findings(r.remarks)
    refused = next((said for said in r.remarks if said.startswith("no loads: ")), "")
    if refused:
        step = "see the reason: correct grid or project, or take the loads out of the project"
        yield Finding(DOUBTFUL, "lost", refused.replace("integrate_loads: ", ""), step)
    for said in (said for said in r.remarks if said.startswith(LACKING)):
        yield Finding(DOUBTFUL, "covered", said, "see the temperature's maps, thermocouples or paint there")
    shown = r.shown.get("all", 1.0)
    if r.seen < rules.COVERED * shown:
        yield Finding(
            DOUBTFUL,
            "covered",
            f"{100 * r.seen:.0f} % of the surface has a Cp, and the cameras look at {100 * shown:.0f} % of it",
            "see which nodes are left out and why; loads are those of the seen part",
        )


def _states(r: PointRecord) -> Iterator[Finding]:
    """Pictures of a point that are not of one state: the mean is of neither, and what they differ by is no noise."""
    step = "see that the patterns of the point's pictures name those of this point alone"
    for words in r.several:
        yield Finding(DOUBTFUL, "picture", words, step)
    for words in (said for said in r.remarks if said.startswith(SIDESLIP) and r.loads):
        say = "say beta_deg in the table of points or in [conditions] (wind from starboard is positive); or "
        say += "points.beta_at_rest_deg, where the cameras' frame is not along the wind"
        yield Finding(DOUBTFUL, "picture", words, say)
    odd = [s for s in r.scatter if s.times > rules.SCATTER_TIMES and s.part > rules.SCATTER]
    if odd:
        worst = max(odd, key=lambda s: s.part)
        first, second = (listed(list(names)) for names in worst.groups)
        yield Finding(
            DOUBTFUL,
            "picture",
            f"pictures that are averaged differ by {g2(100 * worst.part)} % of the light from one to the other, "
            f"{g2(worst.times)} times their noise: {first} from {second}",
            f"{step}, and that neither the model nor the flow changed meanwhile",
        )


def _taps(r: PointRecord) -> Iterator[Finding]:
    """Paint against taps."""
    if r.taps is not None and r.taps.unfitted:
        words = f"the pressure is that of the calibration alone, not fitted to the taps: {r.taps.unfitted}"
        yield Finding(DOUBTFUL, "taps", words, "correct the readings' unit or the taps' table")
    if r.taps is not None and not r.fit and r.taps.typical > rules.APART:
        words = f"taps and paint, which is not fitted to them, differ by {g2(r.taps.rms)} in Cp (RMS), "
        step = 'see lamps, exposure and wind-off pictures; or fit the pressure to the taps (in_situ = "offset-slope")'
        yield Finding(DOUBTFUL, "taps", f"{words}{g2(r.taps.typical)} times their sigmas", step)
    if r.fit and r.fit["scatter_Pa"] > r.fit.get("noise_Pa", np.inf):  # more than half of it is no noise
        yield Finding(
            DOUBTFUL,
            "taps",
            f"taps and paint differ by {g3(r.fit['scatter_Pa'])} Pa beyond their sigmas, which explain "
            f"{g3(r.fit['noise_Pa'])} Pa",
            "check that the taps' readings are of this point and their names at their places; then lamps and flat "
            "pictures",
        )
    yield from _contradicted(r)
    # Taps that agree within their sigmas leave no scatter: what the fit leaves of those in it is the measure then.
    within = max(r.fit["scatter_Pa"], r.fit["rms_Pa"]) if r.fit else np.inf
    if r.taps is not None and r.fit and r.fit["leave_one_out_rms_Pa"] > rules.LEFT_OUT_TIMES * within:
        yield Finding(
            DOUBTFUL,
            "taps",
            f"taps left out of the fit are off by {g3(r.fit['leave_one_out_rms_Pa'])} Pa, those in it by "
            f"{g3(r.fit['rms_Pa'])} Pa",
            "look for blocked taps",
        )


def _contradicted(r: PointRecord) -> Iterator[Finding]:
    """A fit that moves the paint's own pressure by more than paint and taps may be off: a scatter does not show it.

    What the paint's sigmas do not contain (`UNFIT`) has the last word of neither.
    """
    if not r.fit or any(said.startswith((UNFIT, EXTRAPOLATED)) for said in r.remarks):
        return
    for words, value, sigma, unit, share in (
        ("read", r.fit.get("offset_Pa", np.nan), r.fit.get("offset_sigma_Pa", np.nan), "Pa",
         "the reference pressure (barometer)"),
        ("change by", 100 * (r.fit.get("slope", np.nan) - 1), 100 * r.fit.get("slope_sigma", np.nan), "%",
         "the span of the scanner"),
    ):  # fmt: skip
        if abs(value) > rules.FIT_CONTRADICTED * sigma:
            yield Finding(
                DOUBTFUL,
                "taps",
                f"the taps {words} {g3(abs(value))} {unit} {'more' if value > 0 else 'less'} than the paint's own "
                f"calibration says, {g2(abs(value) / sigma)} times what both leave open: the pressure is fitted to the "
                "taps, and what is wrong with all of them alike is in it and in no sigma",
                f"check {share} of the taps; p_off, T_off and T0; lamps that changed after wind-off. in_situ = "
                '"compare" shows the paint by itself',
            )
            return


def _stream(r: PointRecord) -> Iterator[Finding]:
    """Mach, p_inf and q_inf that contradict each other by more than all else leaves open of Cp."""
    if 2 * r.contradiction_cp**2 > r.median_sigma_cp**2:
        yield Finding(
            DOUBTFUL,
            "units",
            f"Mach, p_inf and q_inf of the table contradict each other, which makes {g2(r.contradiction_cp)} of the "
            f"{g2(r.median_sigma_cp)} in sigma(Cp)",
            "correct the one that is wrong; give Mach with all its digits, or leave it out where it is nominal",
        )


def _wall(r: PointRecord) -> Iterator[Finding]:
    """The wall's temperature."""
    for said in r.remarks:
        if said.startswith(DOUBTED):
            step = "check the readings, names and places; where the wall varies by so much, say temperature.sigma_K"
            yield Finding(DOUBTFUL, "temperature", said, step)
        # Taps that the paint is fitted to, or compared with, tell what a wrong temperature does to the level.
        if said.startswith(BESIDE_RECOVERY) and not r.fit and not _compared(r):
            step = "check the readings (cold junction, unit, point), T0 and Mach; where the wall is heated or slow to "
            step += "take the stream's temperature, say so by temperature.sigma_K, or leave recovery out"
            yield Finding(DOUBTFUL, "temperature", said, step)


def _calibrated(r: PointRecord) -> Iterator[Finding]:
    """A calibration that is used beyond its ends, where no taps say whether it holds there."""
    for said in r.remarks:
        if said.startswith(EXTRAPOLATED) and not r.fit and not _compared(r):
            step = "calibrate the paint over all pressures and temperatures of the test, or fit the pressure to taps"
            yield Finding(DOUBTFUL, "weak", said, step)


def _light(r: PointRecord) -> Iterator[Finding]:
    """What cameras and lamps leave open."""
    for said in r.remarks:
        if QUIET in said:
            step = "expose less, or say radiometry.saturation below that level; taps there that do not fit may be right"
            yield Finding(DOUBTFUL, "noise", f"{said}: what is as bright is wrong, and no sigma has it", step)
    yield from apart_findings(
        [r.apart], "ratios of", "check dark pictures, exposure and lamps of each camera", "oil or dirt"
    )
    # A fit to the taps takes out what is the same part for all nodes; an offset alone leaves it in the slope.
    if np.isnan(r.flicker) and not r.fit.get("slope_free"):
        yield Finding(
            DOUBTFUL,
            "weak",
            "no sigma has the lamps' flicker: every mean is of one picture, and nothing else says it",
            "take several pictures of a state, or give radiometry.lamp_flicker",
        )
    if r.flicker > rules.FLICKER and not r.fit.get("slope_free"):
        yield Finding(
            DOUBTFUL,
            "noise",
            f"the light differs by {g2(100 * r.flicker)} % from picture to picture (1 sigma)",
            "see lamps and exposure times, and that all pictures are of this point",
        )


def shared_findings(records: Sequence[PointRecord], rows: Sequence[PointRow]) -> list[Finding]:
    """Pictures that several points have, where their rows contradict each other: one point is not what it is said."""
    step = "give each point its own pictures (on, off in the table of points), or correct its conditions"
    return [Finding(DOUBTFUL, "picture", words, step, point) for point, words in shared_pictures(records, rows)]


def stranger_findings(remarks: Sequence[str]) -> list[Finding]:
    """Readings under names that no point has, of points that have none: they do not count."""
    step = "call the points in the readings as in the table of points, letter by letter"
    return [Finding(DOUBTFUL, "file", words, step) for words in remarks if OF_NO_POINT in words]


def black_findings(cameras: Sequence[str]) -> list[Finding]:
    """Of cameras of which nothing says the level without light."""
    if not cameras:
        return []
    return [
        Finding(
            DOUBTFUL,
            "weak",
            f"the level without light of {' and '.join(cameras)} is taken as 0, and no sigma has it: neither dark "
            "pictures nor radiometry.black are given",
            "take dark pictures, or say radiometry.black (0 where the camera takes it off itself)",
        )
    ]


def flat_findings(clipped: Mapping[str, float], most: float) -> list[Finding]:
    """Of cameras with flat pictures that are saturated on more than a part of the model's pixels."""
    step = "take flat pictures with a shorter exposure or less light, none of them saturated on the model"
    return [
        Finding(
            DOUBTFUL,
            "saturated",
            f"the flat pictures of {camera} are saturated on {g2(100 * part)} % of the pixels that show the model: "
            "what these show has no value",
            step,
        )
        for camera, part in clipped.items()
        if part > most
    ]


def response_findings(odd: Mapping[str, OddResponse | None]) -> list[Finding]:
    """Of cameras whose wind-off pictures' noise contradicts their levels."""
    found = []
    for camera, of in odd.items():
        if of is None:
            continue
        words, step = "the response is not straight (a gamma, a stretched range, a sensor near its full scale)", ""
        if not of.bent:
            how = "low" if of.level > 0 else "bright"
            words = f"the dark pictures are {g2(abs(of.level))} grey levels too {how}, or {words}"
            step = "take dark pictures with the exposure and settings of the others; "
        said = f"the noise of wind-off pictures of {camera} does not grow from that of the dark ones as light's does"
        step += "save pictures as the sensor has them, or give radiometry.linearity; see that nothing moved meanwhile"
        found.append(Finding(DOUBTFUL, "noise", f"{said}: {words}. Cp is wrong by it, and no sigma has it", step))
    return found
