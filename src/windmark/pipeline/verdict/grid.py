"""The verdict on markers and grid: in different units, or the grid not where the markers are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.errors import g2, g3
from windmark.pipeline.alike import listed
from windmark.pipeline.likely_unit import likely_unit, model_box
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding
from windmark.resection.seat import OFF, Seat, seat
from windmark.scene import MarkerSet, Mesh
from windmark.scene.doubled import part_of
from windmark.scene.lone_nodes import LoneNode, lone_nodes, where
from windmark.scene.units import spelt

_STEP = "bring grid and table of markers into one frame, at one size: pictures are mapped to the grid where it stands"


def grid_findings(markers: MarkerSet, mesh: Mesh, unit: str) -> list[Finding]:
    """Nodes far from all their neighbours; markers and grid in different units, or the markers beside its surface."""
    model = markers.take(markers.role != "wall")
    if not (len(model) and len(mesh.triangles)):
        return []
    nodes = lone_nodes(mesh)
    # How large the grid is, and what is how far from it, does not hang on them.
    theirs = np.asarray(np.isin(mesh.triangles, [n.node for n in nodes]).any(axis=1))
    rest = part_of(mesh, ~theirs) if nodes else mesh
    seated = units_findings(markers, rest, unit) or _beside(seat(rest, model.xyz, model.normal), model, unit)
    return [*_alone(mesh, nodes, unit), *seated]


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
        said = f"{off}; with its {axes} as x, y, z it goes through them: its axes are exchanged"
        return [Finding(BAD, "grid", said, "turn the grid (or the table) to the other's axes")]
    if found.moved is not None and found.lead > rules.PATTERN_NATS and found.shift > rules.GRID_BESIDE * found.size:
        moved = _motion(found, markers.xyz, unit)
        said = f"the grid goes through the markers where it is {moved} ({found.lead:.0f} nats "
        said += f"ahead of scatter): it stands about {g2(found.shift)} {unit} beside them, and so do all values"
        return [Finding(DOUBTFUL, "grid", said, _STEP)]
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
