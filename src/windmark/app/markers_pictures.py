"""Pictures of a check of markers: where it is identified, how sure the pose is, what to change; and the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

import windmark
from windmark.app.check_scene import check_scene
from windmark.app.report import Report
from windmark.app.sphere_maps import Disc, discs, draw_map
from windmark.app.wording import named, setting
from windmark.errors import g2
from windmark.tasks.marker_check import Change, MarkerCheck
from windmark.tasks.marker_check.campaign import OUTCOMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

CAUSE_MARKS = {"symmetric": "X", "mirrored": "D", "few": "v", "weak": "s", "time": "P", "wrong": "*"}
RATE = "RdYlBu"
MARKER, FAR_SIDE, LINK, NEW, WEAK = "#1565c0", "#90a4ae", "#ef6c00", "#d50000", "#d50000"
MANY_NAMES = 90
PAGE_IN = 10.0
DPI = 110


def drawings(check: MarkerCheck) -> dict[str, Callable[[MarkerCheck], Figure]]:
    """What draws the pictures, by file name; without directions only the layout."""
    layout: dict[str, Callable[[MarkerCheck], Figure]] = {"layout": layout_picture}
    if not len(check.campaign.directions):
        return layout
    return {"directions": directions_picture, "pose": pose_picture, **layout}


def directions_picture(check: MarkerCheck) -> Figure:
    """Map of the directions by the share of identified views; bad ones marked by their cause."""
    campaign, maps = check.campaign, _maps(check)
    figure = Figure(figsize=(5.0 * len(maps) + 2.6, 6.0), layout="constrained")
    rate, bad, causes = 100 * campaign.rate(), campaign.bad(), campaign.causes()
    cells = np.atleast_1d(np.array(figure.subplots(1, len(maps))))
    for axes, disc in zip(cells, maps, strict=True):
        image = draw_map(axes, disc, campaign.directions, rate, cmap=RATE, vmin=0, vmax=100)
        for d in np.flatnonzero(bad & disc.within(campaign.directions)):
            place = disc.place(campaign.directions[d])
            axes.plot(*place, CAUSE_MARKS[causes[d]], color="black", ms=6.5, mec="white", mew=0.8)
    figure.colorbar(image, ax=list(cells), shrink=0.75, label="views identified, %")
    figure.suptitle(check.reason(), fontsize=11)
    handles: list[Any] = [
        Line2D([], [], ls="", marker=CAUSE_MARKS[c], color="black", ms=7, label=f"bad direction, {OUTCOMES[c]}")
        for c in CAUSE_MARKS
        if any(b and cause == c for b, cause in zip(bad, causes, strict=True))
    ]
    if not campaign.counted.all():
        handles.append(_grey("not checked: too few of the markers in sight"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(maps), frameon=False)
    return figure


def pose_picture(check: MarkerCheck) -> Figure:
    """Maps of the pose's sigma: where the surface is placed in the image, and the angle."""
    campaign, sigma, maps = check.campaign, check.sigma, _maps(check)
    rows = (
        (sigma.surface_px, "1 sigma of the surface\nin the image, px per coordinate"),
        (sigma.rotation_deg, "1 sigma of the angle about\nthe worst axis, degrees"),
    )
    shape, size = ((2, 2), (12.6, 10.6)) if len(maps) == 2 else ((1, 2), (13.0, 6.0))
    figure = Figure(figsize=size, layout="constrained")
    cells = np.array(figure.subplots(*shape)).reshape(2, len(maps))
    weak = check.weak_pose()
    for line, (values, label) in zip(cells, rows, strict=True):
        shown = np.where(campaign.counted, values, np.nan)
        finite = shown[np.isfinite(shown)]
        look: dict[str, Any] = {"cmap": "viridis_r"}
        if len(finite):
            look["norm"] = LogNorm(*_range(finite))
        for axes, disc in zip(line, maps, strict=True):
            image = draw_map(axes, disc, campaign.directions, shown, **look)
            for d in np.flatnonzero(weak & disc.within(campaign.directions)):
                axes.plot(*disc.place(campaign.directions[d]), "o", mfc="none", mec=WEAK, ms=8, mew=1.5)
        bar = figure.colorbar(image, ax=list(line), shrink=0.75, label=label)
        if len(finite):
            ticks = np.geomspace(*_range(finite), 6)
            bar.set_ticks(list(ticks), labels=[f"{g2(t)}" for t in ticks])
            bar.minorticks_off()
    figure.suptitle(_sigma_title(check), fontsize=11)
    handles = []
    if weak.any():
        words = "weak: the surface is placed worse than a spot is measured"
        handles.append(Line2D([], [], ls="", marker="o", mfc="none", mec=WEAK, mew=1.5, ms=8, label=words))
    if not campaign.counted.all():
        handles.append(_grey("not checked: too few of the markers in sight"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _maps(check: MarkerCheck) -> list[Disc]:
    """The discs on which something was checked; all if nothing was."""
    campaign, every = check.campaign, discs(check.stage.settings)
    some = [disc for disc in every if (campaign.counted & disc.within(campaign.directions)).any()]
    if len(some) in (0, len(every)):
        return every
    return [replace(disc, title=f"{disc.title}; nothing was checked on the other half") for disc in some]


def _sigma_title(check: MarkerCheck) -> str:
    settings = check.stage.settings
    return (
        f"Expected 1 sigma of the pose for spots of {settings.noise_px:g} px, {settings.hidden_percent:g} % of the"
        " markers hidden"
    )


def _range(values: Array) -> tuple[float, float]:
    """Limits of a logarithmic scale: all values, at least a factor of 1.5."""
    low, high = float(values.min()), float(values.max())
    return low, max(high, 1.5 * low)


def _grey(label: str) -> Line2D:
    return Line2D([], [], ls="", marker="s", color=colormaps["Greys"](1 / 8), mec="0.6", ms=9, label=label)


@dataclass(frozen=True)
class _Plane:
    """A projection of the layout along one axis, from the side that more markers face.

    ``u`` and ``v`` are the axes along the page and up it, ``across`` the one out of it; ``side`` is 1 where the reader
    is at its positive end, and ``mirrored`` whether u then runs to the left.
    """

    u: int
    v: int
    across: int
    side: float
    mirrored: bool
    limits: tuple[tuple[float, float], tuple[float, float]]

    @staticmethod
    def of(check: MarkerCheck, u: int, v: int, across: int) -> _Plane:
        """For axes by number."""
        markers = check.stage.markers
        right_handed = (u, v, across) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        faces = float(np.nansum(markers.normal[:, across]))
        side = 1.0 if faces > 0 or (faces == 0 and right_handed) else -1.0
        places = np.array([*markers.xyz, *(c.place for c in _changes(check))])
        room = 0.08 * float(np.ptp(places[:, u])) or 1.0
        low, high = places.min(axis=0) - room, places.max(axis=0) + room
        return _Plane(u, v, across, side, right_handed != (side > 0), ((low[u], high[u]), (low[v], high[v])))

    @property
    def height(self) -> float:
        """Over the width."""
        (left, right), (low, high) = self.limits
        return (high - low) / (right - left)


def layout_picture(check: MarkerCheck) -> Figure:
    """Two projections of the layout: the partners of the worst symmetry linked, proposed changes as arrows."""
    thin, middle, long = np.argsort(np.ptp(check.stage.markers.xyz, axis=0), kind="stable").tolist()
    # The face first; then a side, with the longest axis along the page in both.
    planes = (_Plane.of(check, long, middle, thin), _Plane.of(check, long, thin, middle))
    heights = [PAGE_IN * plane.height for plane in planes]
    figure = Figure(figsize=(PAGE_IN + 0.9, sum(heights) + 2.9), layout="constrained")
    cells = figure.subplots(2, 1, height_ratios=heights)
    for axes, plane in zip(cells, planes, strict=True):
        _draw_layout(axes, check, plane, named=plane is planes[0])
    figure.suptitle(_layout_title(check), fontsize=11)
    figure.legend(handles=_layout_handles(check, planes), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _away(check: MarkerCheck, plane: _Plane) -> NDArray[np.bool_]:
    """(N,) markers that face away from the reader."""
    return np.asarray(check.stage.markers.normal[:, plane.across] * plane.side < -0.3)


def _draw_layout(axes: Axes, check: MarkerCheck, plane: _Plane, *, named: bool) -> None:
    xyz, away, page = check.stage.markers.xyz, _away(check, plane), [plane.u, plane.v]
    for i, j in _links(check):
        axes.plot(*xyz[[i, j]][:, page].T, color=LINK, lw=0.8, alpha=0.6, zorder=1)
    axes.plot(*xyz[~away][:, page].T, "o", color=MARKER, ms=6, zorder=2)
    axes.plot(*xyz[away][:, page].T, "o", mfc="white", mec=FAR_SIDE, mew=1.4, ms=6, zorder=2)
    if named and len(xyz) <= MANY_NAMES:
        for name, place in zip(check.stage.markers.name, xyz, strict=True):
            axes.annotate(name, place[page], (4, 4), textcoords="offset points", fontsize=7, color="0.25", zorder=3)
    for change in _changes(check):
        _draw_change(axes, change, page, named)
    axes.set(xlabel=f"{'xyz'[plane.u]}, {check.unit}", ylabel=f"{'xyz'[plane.v]}, {check.unit}", aspect="equal")
    axes.set(xlim=plane.limits[0], ylim=plane.limits[1])
    if plane.mirrored:
        axes.invert_xaxis()
    axes.set_title(f"seen along {'-' if plane.side > 0 else '+'}{'xyz'[plane.across]}", fontsize=10, loc="left")
    axes.grid(alpha=0.25)


def _draw_change(axes: Axes, change: Change, page: list[int], named: bool) -> None:
    """An arrow to the new place, or a cross with the new name."""
    place = change.place[page]
    axes.plot(*place, "P" if change.old is None else "o", color=NEW, ms=8, mec="white", mew=0.8, zorder=5)
    if change.old is not None:
        old = change.old[page]
        if np.linalg.norm(place - old) > 0.2 * np.linalg.norm(change.place - change.old):
            arrow = {"arrowstyle": "-|>", "color": NEW, "lw": 1.6, "shrinkA": 3, "shrinkB": 3}
            axes.annotate("", (place[0], place[1]), (old[0], old[1]), arrowprops=arrow, zorder=4)
    elif named:
        look: dict[str, Any] = {"fontsize": 8, "color": NEW, "fontweight": "bold", "zorder": 6}
        axes.annotate(change.name, (place[0], place[1]), (6, -10), textcoords="offset points", **look)


def _changes(check: MarkerCheck) -> tuple[Change, ...]:
    """Those of the best proposal."""
    return check.proposals[0].changes if check.proposals else ()


def _links(check: MarkerCheck) -> list[tuple[int, int]]:
    """Partners of the symmetry that was met most, or is the most complete."""
    if not check.symmetries:
        return []
    onto = check.symmetries[0].onto
    return [(int(i), int(onto[i])) for i in np.flatnonzero(onto >= 0) if onto[i] != i]


def _layout_title(check: MarkerCheck) -> str:
    if not check.symmetries:
        return f"{len(check.stage.markers)} markers, no near-symmetry"
    worst = check.symmetries[0]
    met = f"in {worst.met} views they were confused so" if worst.met else "no view was confused so"
    return (
        f"{worst.words(check.stage.middle, check.unit)} brings {(worst.onto >= 0).sum()} of {len(worst.onto)} markers"
        f" onto others; {met}"
    )


def _layout_handles(check: MarkerCheck, planes: tuple[_Plane, ...]) -> list[Line2D]:
    """What is in the picture."""
    handles = [Line2D([], [], ls="", marker="o", color=MARKER, ms=6, label="marker")]
    if any(_away(check, plane).any() for plane in planes):
        handles.append(
            Line2D([], [], ls="", marker="o", mfc="white", mec=FAR_SIDE, mew=1.4, ms=6, label="marker facing away")
        )
    if _links(check):
        handles.append(Line2D([], [], color=LINK, lw=1.2, label="taken for each other by the symmetry"))
    if any(c.old is not None for c in _changes(check)):
        handles.append(Line2D([], [], color=NEW, lw=1.6, marker="o", mec="white", label="proposed: moved to here"))
    if any(c.old is None for c in _changes(check)):
        handles.append(Line2D([], [], ls="", color=NEW, marker="P", mec="white", ms=9, label="proposed: added"))
    return handles


def check_page(check: MarkerCheck, name: str, place: Path) -> Report:
    """The check on one HTML page that opens without a network; its pictures go into ``place``, too."""
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    report = Report(f"Check of the markers of {name}", f"windmark {windmark.__version__}, {when}, length unit:"
                    f" {check.unit}")  # fmt: skip
    head, *lines = check.lines()
    report.text(head, "good" if check.identifiable else "bad")
    for line in lines:
        report.text(line.strip())
    captions = {
        "directions": "Share of the virtual views that were identified, by the direction of the camera seen from the"
        " model (equal-area map; azimuth from x towards y, elevation from the x-y plane towards z)",
        "pose": "Expected uncertainty of the pose by direction",
        "layout": "The layout, what it is confused with, and what to change",
    }
    report.heading("In 3D")
    report.scene("3D view", lambda: check_scene(check), "The layout; markers in colour are those that something is "
                 "said of. Under the cursor: name, place, sigma, findings.")  # fmt: skip
    report.heading("Pictures")
    for key, draw in drawings(check).items():
        drawn = report.drawing(f"picture {key}.png", partial(draw, check), captions[key], dpi=DPI)
        if drawn is not None:
            (place / f"{key}.png").write_bytes(drawn)
    _symmetries(report, check)
    report.heading("Directions")
    _directions(report, check)
    report.heading("Assumptions")
    report.table(["assumption", "value"], [[named(k), setting(v)] for k, v in check.record()["settings"].items()])
    return report


def _directions(report: Report, check: MarkerCheck) -> None:
    """Table of the directions from which the layout was looked at; pose sigmas with two digits."""
    of = check.columns()
    text = [
        [f"{v:.1f}" for v in of["azimuth_deg"]], [f"{v:.1f}" for v in of["elevation_deg"]], of["in_sight"].tolist(),
        [int(n) if known else None for n, known in zip(of["views"], of["checked"], strict=True)],
        [f"{100 * v:.0f}" if known else None for v, known in zip(of["identified"], of["checked"], strict=True)],
        [str(v) or None for v in of["cause"]],
        *([g2(v) if np.isfinite(v) else None for v in of[f"sigma_{k}"]]
          for k in ("surface_px", "rotation_deg", "across", "along")),
    ]  # fmt: skip
    head = ["azimuth, °", "elevation, °", "markers in sight", "views tried", "identified, %", "why not",
            "on the surface, px", "angle, °", f"across the line of sight, {check.unit}",
            f"along it, {check.unit}"]  # fmt: skip
    report.text("From each direction: the virtual views that were tried and identified; 1 sigma of the pose.", "soft")
    report.table(head, zip(*text, strict=True), scroll=True)


def _symmetries(report: Report, check: MarkerCheck) -> None:
    """Table of near-symmetries."""
    if not check.symmetries:
        return
    report.heading("Near-symmetries of the layout")
    report.text(
        "Motions that bring many markers onto others. Each makes a rival of every pose; how far it is from exact, and"
        " the markers that it does not bring, are what tells them apart.", "soft",
    )  # fmt: skip
    rows = []
    for s in check.symmetries:
        names = check.stage.markers.name[s.onto < 0].tolist()
        rows.append([s.words(check.stage.middle, check.unit), f"{(s.onto >= 0).sum()} of {len(s.onto)}", s.rms,
                     s.rms_px, s.met, ", ".join(names)])  # fmt: skip
    head = ["motion", "markers brought", f"off, {check.unit} RMS", "off, px", "views confused", "not brought"]
    report.table(head, rows, scroll=True)
