"""The page of `windmark epipolar`: both pictures with their lines, the matches, and with cameras all of it in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.app.epipolar_pictures import COLOURS, NAMED
from windmark.app.photo import Overlay, preview
from windmark.app.pictures import MISSING
from windmark.app.provenance import Provenance
from windmark.app.report import Report, measured, measured_rows
from windmark.app.scene3d import STATION_COLOURS, Markers, Scene3D, Station, looking_over
from windmark.app.svg import Chart
from windmark.app.verdict_words import put_verdict
from windmark.errors import g2
from windmark.geometry import Camera, Pose, Triangulation
from windmark.pipeline.verdict import Verdict
from windmark.scene import Detections
from windmark.tasks.clicked_pair import ClickedPair, Clicks, places
from windmark.tasks.reconstruct.pair import PairLines, Side

Array = NDArray[np.float64]

PHOTO_BYTES = 260_000
"""Of each of the two pictures."""
UNIT = "baselines"
WITHOUT = ("Without --camera there is no place in space, and the other spots are not matched: which of the spots on a "
           "line is meant, nothing tells.")  # fmt: skip
FILES = (
    ("matches.csv", "all matches: both places, the distance from the line, whether by hand"),
    ("clicks.csv", "the matches by hand: distances, wrong ones, what the others check"),
    ("labels.csv", "image, name, x, y of all matches: windmark reconstruct --labels takes it"),
    ("geometry.json", "fundamental matrix, epipoles, pose of the second camera, covariances"),
    ("epipolar.png", "both pictures with the lines of all matches"),
)


@dataclass(frozen=True)
class Pair:
    """What the page is of.

    Parameters
    ----------
    result, clicks, lines : what was found
    images, spots : of both pictures
    cameras : None without
    """

    result: ClickedPair
    clicks: Clicks
    lines: PairLines
    images: Sequence[NDArray[np.generic]]
    spots: tuple[Detections, Detections]
    cameras: tuple[Camera, Camera] | None


def epipolar_page(pair: Pair, verdict: Verdict, out: io.ResultFolder) -> Report:
    """The whole page, what could not be drawn in its ``failed``."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    page = Report("Epipolar lines of two pictures", f"windmark {windmark.__version__}, {when}", folder=out.target)
    put_verdict(page, verdict)
    _figures(page, pair)
    for note in pair.result.notes:
        page.text(f"{note[0].upper()}{note[1:]}.", "soft")
    page.heading("The pictures")
    page.text("The line of a spot has its colour in the other picture: the spot of the same marker there is on it "
              "(AIAA 2005-5007, Fig. 12).", "soft")  # fmt: skip
    for side, image, clicked in zip((pair.lines.a, pair.lines.b), pair.images,
                                    (pair.result.click_a, pair.result.click_b), strict=True):  # fmt: skip
        with page.part(f"{side.name}: picture of the lines"):
            page.raw(_photo(pair, side, image, clicked))
    found: Triangulation | None = None
    if pair.cameras is not None and pair.result.pose is not None:
        page.heading("In 3D")
        with page.part("places of the markers in space"):
            found = places(pair.result, pair.spots, pair.cameras)
        if found is not None:
            _space(page, pair, found)
    _matches(page, pair, found)
    _clicks(page, pair)
    page.heading("Files beside this report")
    page.table(["file", "content"], FILES)
    page.provenance(Provenance.of_verb(out))
    return page


def _figures(page: Report, pair: Pair) -> None:
    result, count = pair.result, len(pair.result.spot_a)
    rows: list[tuple[str, object]] = [
        ("matches", count), ("of them by hand", int(result.by_hand.sum())),
        ("wrong clicks", int(result.wrong.sum())), ("unchecked clicks", int(result.unchecked.sum())),
        *((f"spots of {side.name}", len(spots))
          for side, spots in zip((pair.lines.a, pair.lines.b), pair.spots, strict=True)),
        ("RMS distance from the lines, px", g2(np.sqrt(np.mean(result.distance_px**2)))),
        ("sigma0 (1: distances as large as the sigmas say)", f"{result.sigma0:.2f}"),
        *((f"epipole in {side.name}, px", f"{xy[0]:z.0f}, {xy[1]:z.0f}" if np.isfinite(xy).all() else "at infinity")
          for side, xy in zip((pair.lines.a, pair.lines.b), (result.epipole_a, result.epipole_b), strict=True)),
    ]  # fmt: skip
    page.table(["", "value"], rows)
    if result.pose is None:
        page.text(WITHOUT)


def _photo(pair: Pair, side: Side, image: NDArray[np.generic], clicked: Array) -> str:
    """A picture with its matched spots and the lines of the other one's, spots without a match, and wrong clicks."""
    over, names = Overlay((image.shape[1], image.shape[0])), pair.lines.names
    for k, colour in enumerate(COLOURS):
        some = [c for c in side.curves[k :: len(COLOURS)] if len(c)]
        over.lines(f"lines-{k}", _pieces(some), "", colour, 0.7)
    over.together([f"lines-{k}" for k in range(len(COLOURS))], "lines", f"lines ({len(side.curves)})")
    notes = [f"{n}: x {x:.2f}, y {y:.2f} px; {d:.3f} px from its line".replace("-", "−")
             for n, (x, y), d in zip(names, side.spots.tolist(), np.abs(side.distance_px).tolist(), strict=True)]
    over.rings(side.spots, np.full(len(side.spots), 6.0), np.ones(len(side.spots), bool), notes,
               (f"match ({len(names)})", ""))  # fmt: skip
    if len(side.alone):
        said = [f"x {x:.2f}, y {y:.2f} px: no match".replace("-", "−") for x, y in side.alone.tolist()]
        over.circles("alone", side.alone, np.full(len(side.alone), 6.0), said,
                     f"spot without a match ({len(side.alone)})", MISSING)  # fmt: skip
    wrong = np.asarray(pair.result.wrong & np.isfinite(clicked).all(axis=1))
    over.missing(clicked[wrong], np.array(pair.clicks.name)[wrong].tolist(), f"wrong click ({int(wrong.sum())})")
    if len(names) <= NAMED:
        over.names_at(side.spots, names)
    return over.html(preview(image, PHOTO_BYTES)[0], f"{side.name}: {len(names)} matches and their lines.")


def _pieces(curves: Sequence[Array]) -> list[Array]:
    """Lines without the rows of NaN that separate their pieces."""
    out = []
    for curve in curves:
        good = np.asarray(np.isfinite(curve).all(axis=1))
        for part in np.split(np.arange(len(curve)), np.flatnonzero(np.diff(good.astype(int))) + 1):
            if len(part) > 1 and good[part].all():
                out.append(curve[part])
    return out


def _space(page: Report, pair: Pair, found: Triangulation) -> None:
    """The matches in space and both cameras."""
    page.scene("3D view", lambda: _scene(pair, found), "The matched markers with their 95 % error ellipsoids, and both "
               "cameras; lengths in baselines, the distance of the cameras.")  # fmt: skip
    page.text("Ellipsoids: from the spots and the second camera's pose. All move together with the pose by more than "
              "against each other. No length here has a unit: two pictures do not tell one.", "soft")  # fmt: skip
    if lost := int((~found.valid).sum()):
        page.text(f"{lost} matches have no place in space: {', '.join(sorted(set(found.reason) - {''}))}.", "bad")


def _scene(pair: Pair, found: Triangulation) -> Scene3D | None:
    assert pair.cameras is not None
    assert pair.result.pose is not None
    good = np.flatnonzero(found.valid)
    if not len(good):
        return None
    xyz, cov = found.xyz[good], found.cov[good]
    sigma = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    notes = []
    for k, place in zip(good.tolist(), measured_rows(xyz, sigma), strict=True):
        lines = [f"x, y, z: {', '.join(place[:3])} {UNIT}", f"1 sigma: {', '.join(place[3:])} {UNIT}",
                 f"{abs(pair.result.distance_px[k]):.3f} px from its line"]  # fmt: skip
        notes.append(tuple(line.replace("-", "−") for line in lines))
    by_hand = tuple(np.flatnonzero(pair.result.by_hand[good]).tolist())
    shown = Markers(tuple(pair.lines.names[k] for k in good), xyz, cov if np.isfinite(cov).all() else None,
                    tuple(notes), (("#0072b2", "matched by hand", by_hand),) if by_hand else ())  # fmt: skip
    stations = [Station(side.name, camera, pose, STATION_COLOURS[0], far=0.4) for side, camera, pose in
                zip((pair.lines.a, pair.lines.b), pair.cameras, (Pose.identity(), pair.result.pose), strict=True)]
    ahead, up = looking_over(Pose.identity(), xyz)
    focus = np.concatenate([xyz, [np.zeros(3), pair.result.pose.center]])
    return Scene3D(UNIT, ahead, up, stations=stations, markers=shown, focus=focus)


def _matches(page: Report, pair: Pair, found: Triangulation | None) -> None:
    """Residuals as a drawing, and all matches as a table."""
    result, names = pair.result, pair.lines.names
    a, b = pair.spots[0].take(result.spot_a), pair.spots[1].take(result.spot_b)
    page.heading("Residuals")
    with page.part("drawing of the residuals"):
        top = 1.15 * max(float(np.abs(result.distance_px).max(initial=0.0)), 1e-3)
        width = pair.images[0].shape[1]
        chart = Chart((0.0, float(width)), (-top, top), (f"x in {pair.lines.a.name}, px", "distance, px"),
                      "Distance of each match from its epipolar line")  # fmt: skip
        said = [f"{n}: {d:+z.3f} px" for n, d in zip(names, result.distance_px.tolist(), strict=True)]
        chart.dots(a.xy[:, 0], result.distance_px, said, names)
        page.chart(chart.svg(), "Along the picture: a lens that is not right gives a curve, spots alone scatter.")
    head = ["match", "by", *(f"{axis} in {side.name}, px" for side in (pair.lines.a, pair.lines.b) for axis in "xy"),
            "distance, px"]  # fmt: skip
    sigma = [np.sqrt(np.diagonal(s.cov, axis1=1, axis2=2)) for s in (a, b)]
    rows: list[tuple[object, ...]] = [
        (names[k], "hand" if result.by_hand[k] else "its line",
         *(measured(float(s.xy[k, i]), float(e[k, i]))[0] for s, e in ((a, sigma[0]), (b, sigma[1])) for i in (0, 1)),
         f"{result.distance_px[k]:z.3f}")
        for k in range(len(names))
    ]  # fmt: skip
    if found is not None:
        head += [f"x, {UNIT}", "y", "z", "1 sigma x", "y", "z"]
        placed = measured_rows(found.xyz, np.sqrt(np.maximum(np.diagonal(found.cov, axis1=1, axis2=2), 0.0)))
        rows = [(*row, *place) for row, place in zip(rows, placed, strict=True)]
    page.table(head, rows, scroll=len(rows) > 15)


def _clicks(page: Report, pair: Pair) -> None:
    page.heading("Matches by hand")
    result = pair.result
    rows = []
    for k, name in enumerate(pair.clicks.name):
        state = "wrong" if result.wrong[k] else "unchecked" if result.unchecked[k] else "checked"
        off, shows = float(result.click_px[k]), float(result.shows_px[k])
        rows.append((name, state, f"{off:z.2f}" if np.isfinite(off) else None,
                     f"{shows:.1f}" if np.isfinite(shows) else None))  # fmt: skip
    page.table(["click", "is", "distance from its line, px", "an error shows from, px"], rows, scroll=len(rows) > 15)
