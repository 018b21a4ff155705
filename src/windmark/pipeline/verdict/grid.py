"""The verdict on markers and grid: in different units, or the grid not where the markers are."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2, g3
from windmark.pipeline.alike import NAMED, listed
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding
from windmark.resection.bodies import Unborne, unborne
from windmark.resection.nearest import Search
from windmark.resection.seat import FAR, NEAR, OFF, Seat, seat
from windmark.scene import MarkerSet, Mesh
from windmark.scene.doubled import part_of, zone_of
from windmark.scene.lone_nodes import LoneNode, lone_nodes, where
from windmark.scene.units import spelt
from windmark.tasks.likely_unit import likely_unit, model_box

_STEP = "bring grid and table of markers into one frame, at one size: pictures are mapped to the grid where it stands"


class GridLook:
    """How a grid stands to a table of markers, each part looked at once, when it is asked for.

    Parameters
    ----------
    markers, mesh : with at least one marker of the model, and one triangle
    """

    def __init__(self, markers: MarkerSet, mesh: Mesh) -> None:
        self.markers, self.model, self.nodes = markers, markers.take(markers.role != "wall"), lone_nodes(mesh)
        # How large the grid is, and what is how far from it, does not hang on lone nodes.
        theirs = np.asarray(np.isin(mesh.triangles, [n.node for n in self.nodes]).any(axis=1))
        self.mesh, self.rest = mesh, part_of(mesh, ~theirs) if self.nodes else mesh

    @cached_property
    def _search(self) -> Search:
        return Search(self.rest)

    @cached_property
    def seat(self) -> Seat:
        """Of the model's markers."""
        return seat(self.rest, self.model.xyz, self.model.normal, lambda: self._search)

    @cached_property
    def bare(self) -> list[Unborne]:
        """Bodies without a marker."""
        return unborne(self.rest, self.markers.xyz, NEAR * self.rest.size, lambda: self._search)


def grid_look(markers: MarkerSet, mesh: Mesh) -> GridLook | None:
    """None where there is nothing to be looked at."""
    return GridLook(markers, mesh) if (markers.role != "wall").any() and len(mesh.triangles) else None


def grid_findings(
    markers: MarkerSet, mesh: Mesh, unit: str, seen: NDArray[np.bool_] | None = None, look: GridLook | None = None
) -> list[Finding]:
    """Nodes far from all their neighbours; markers and grid in different units, or the markers beside its surface; a
    body that is there as the mirror image of another one only. ``seen``: (V,) nodes that a picture shows; None for all.
    ``look``: where there is one already.
    """
    look = grid_look(markers, mesh) if look is None else look
    if look is None:
        return []
    seated = units_findings(markers, look.rest, unit) or _beside(look.seat, look.model, unit)
    return [*_alone(mesh, look.nodes, unit), *(seated or _copied(look, unit, seen))]


def grid_notes(markers: MarkerSet, mesh: Mesh, unit: str, look: GridLook | None = None) -> list[str]:
    """What of markers and grid nothing checks, in words: markers far beside the surface where that is no doubt of it
    (a part that the grid has not), and bodies that bear none. ``look``: where there is one already.
    """
    look = grid_look(markers, mesh) if look is None else look
    if look is None or likely_unit(look.model.xyz, model_box(look.rest), unit)[0]:
        return []
    found = look.seat
    if found.mirror is not None or found.moved is not None or found.most > OFF * found.size:
        return []  # a finding says it
    out = []
    if len(found.hanging):
        out.append(
            f"{_hanging(found, look.model, unit)}: on a part that the grid has not, or that it has elsewhere; the "
            "others do not tell which"
        )
    bare = [_name(look.rest, body) for body in look.bare]
    if bare:
        said = listed("part", list(dict.fromkeys(bare)))
        out.append(f"without a marker, and touching nothing that has one: {said}; that it is there is taken from the "
                   "grid")  # fmt: skip
    return out


def _name(mesh: Mesh, body: Unborne) -> str:
    return zone_of(mesh, int(body.triangles[0]))


def _copied(look: GridLook, unit: str, seen: NDArray[np.bool_] | None) -> list[Finding]:
    """Bodies without a marker that are mirror images of one with markers: a grid that was completed by symmetry."""
    out, mesh = [], look.rest
    for body in look.bare:
        if body.of < 0 or not (seen is None or seen[mesh.triangles[body.triangles]].any()):
            continue
        name, other = _name(mesh, body), zone_of(mesh, body.of)
        said = f"{name} bears no marker and is the mirror image of {other}, which bears some, about {'xyz'[body.axis]} "
        said += f"= {g3(_zero(body.about, mesh.size))} {unit}: a half model, or one with a part on one side, has none"
        step = "leave it out of the grid ([grid] volumes) if the tunnel has no such body: its values are those of what "
        out.append(Finding(DOUBTFUL, "grid", said, f"{step}is behind it; else put a marker on it"))
    return out


def _zero(value: float, size: float) -> float:
    return 0.0 if abs(value) < OFF * size else value


def _hanging(found: Seat, markers: MarkerSet, unit: str) -> str:
    """Which markers hang how far beside the grid."""
    first = found.hanging[np.argsort(-found.apart, kind="stable")]
    over = "over " if found.apart.max() >= FAR * found.size else "up to "
    said = f"{len(first)} of {len(markers)} markers are {over}{g2(found.apart.max())} {unit} beside the grid's surface"
    return f"{said} ({', '.join(markers.name[first[:NAMED]].tolist())}{', ...' if len(first) > NAMED else ''})"


def units_findings(markers: MarkerSet, mesh: Mesh, unit: str) -> list[Finding]:
    """Markers and grid in different units, by their sizes and places."""
    model = markers.role != "wall"
    units, sure = likely_unit(markers.xyz[model], model_box(mesh), unit)
    if not units:
        return []
    size = [float(np.linalg.norm(np.ptp(p, axis=0))) for p in (markers.xyz[model], mesh.vertices)]
    return [
        Finding(
            BAD if sure else DOUBTFUL,
            "units",
            f"markers over {g3(size[0])} {unit} on a grid of {g3(size[1])} {unit}: the table is "
            f"rather in {' or '.join(map(spelt, units))}",
            f"windmark convert --unit {units[0]} --to-unit {unit} for the table, or correct its length_unit",
        )
    ]


def _alone(mesh: Mesh, nodes: Sequence[LoneNode], unit: str) -> list[Finding]:
    if not nodes:
        return []
    first = nodes[0]
    more = f" (and {len(nodes) - 1} more)" if len(nodes) > 1 else ""
    said = f"{where(mesh, first.node)}{more} lies {g2(first.away)} {unit} away from its neighbours in the grid, which "
    said += f"lie within {g2(2 * first.around)} {unit}: a fill value or a typing error?"
    step = "correct it in the grid's file, or blank it (IBLANK): its triangles hide what is behind them"
    return [Finding(DOUBTFUL, "file", said, step)]


def _beside(found: Seat, markers: MarkerSet, unit: str) -> list[Finding]:
    off = f"most of the markers are over {g2(found.most)} {unit} off the grid's surface"
    if found.axes is not None:
        axes = ", ".join(("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in found.axes)
        hand = "" if np.linalg.det(found.axes) > 0 else ", and so its frame is left-handed"
        said = f"{off}; with its {axes} as x, y, z it goes through them: its axes are exchanged{hand}"
        return [Finding(BAD, "grid", said, "turn the grid (or the table) to the other's axes")]
    if found.moved is not None and found.lead > rules.PATTERN_NATS and found.shift > rules.GRID_BESIDE * found.size:
        moved = _motion(found, markers.xyz, unit)
        said = f"the grid goes through the markers where it is {moved} ({found.lead:.0f} nats "
        said += f"ahead of scatter): it stands about {g2(found.shift)} {unit} beside them, and so do all values"
        return [Finding(DOUBTFUL, "grid", said, _STEP)]
    if found.mirror is not None:
        return [_mirror(found, markers, unit)]
    if found.most > OFF * found.size:
        step = "see that it is this model's grid and in the table's frame: values are off by that, times the slant"
        return [Finding(DOUBTFUL, "grid", off, step)]
    if len(found.off):
        first = found.off[np.argsort(-found.by, kind="stable")]
        said = listed("marker", markers.name[first].tolist())
        said = f"{said}: up to {g2(found.by.max())} {unit} above or below the grid's surface, on which the others lie"
        step = "take a grid of the state that the table is of (bending, flaps, all parts in place and in one unit), or "
        return [Finding(DOUBTFUL, "grid", said, f"{step}correct the table: values there are from beside their place")]
    return []


def _mirror(found: Seat, markers: MarkerSet, unit: str) -> Finding:
    mirror = found.mirror
    assert mirror is not None
    axis = "xyz"[mirror.axis]
    off = f"{mirror.gained} markers are off the grid's surface"
    off = _hanging(found, markers, unit) if len(found.hanging) else off
    plane = f"about {axis} = {g3(_zero(mirror.about, found.size))} {unit}"
    rest = f"all but {mirror.still} of the markers" if mirror.still else "all markers"
    said = f"{off}; mirrored {plane} it goes through {rest}: the grid, or the table, is mirrored"
    step = f"give the grid (or the table) its other sign of {axis}: pictures are mapped to the grid where it stands"
    return Finding(DOUBTFUL, "grid", said, step)


def _motion(found: Seat, xyz: np.ndarray, unit: str) -> str:
    assert found.moved is not None
    middle = xyz.mean(axis=0)
    turn = np.degrees(np.arccos(np.clip((np.trace(found.moved.rotation) - 1) / 2, -1, 1)))
    shift = float(np.linalg.norm(found.moved.apply(middle) - middle))
    percent = 100 * (found.moved.scale - 1)
    least = rules.GRID_BESIDE * found.size
    parts = [f"turned by {g2(turn)} deg"] if np.radians(turn) * found.size > least else []
    parts += [f"shifted by {g2(shift)} {unit}"] if shift > least else []
    parts += [f"{g2(abs(percent))} % {'larger' if percent > 0 else 'smaller'}"] if abs(percent) > 0.005 else []
    return " and ".join(parts) or f"moved by {g3(found.shift)} {unit}"
