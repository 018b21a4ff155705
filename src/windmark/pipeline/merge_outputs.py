"""Merged images and values at points as files and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from windmark import io
from windmark.pipeline.merge import MergeResult
from windmark.pipeline.points import MergedTable, PointTable, merged_columns, point_columns, point_units
from windmark.pipeline.quantity import Quantity
from windmark.resection import MergedViews

if TYPE_CHECKING:
    from windmark.pipeline.results import ImageResult

Record = dict[str, Any]
TABLES = (".csv", ".dat", ".nc")
"""Formats of values at points: CSV, Tecplot, NetCDF."""


def write_points(item: ImageResult, place: Path, unit: str) -> None:
    """The values of one image at points and along lines."""
    for table in item.points:
        columns = point_columns(table, item.quantity.column)
        _write_table(place / table.of.stem, columns, unit, item.name, table, item.quantity)


def _write_table(stem: Path, columns: Mapping[str, NDArray], unit: str, image: str, table: PointTable | MergedTable,
                 quantity: Quantity) -> None:  # fmt: skip
    about = {"of": image, "max_distance": f"{table.of.limit:.9g}"}
    known = point_units(unit, quantity.column, quantity.unit_words)
    units = {k: v for k, v in known.items() if k in columns or k == "length"}
    for suffix in TABLES:
        io.write_point_values(stem.with_name(stem.name + suffix), columns, units=units, title=table.of.name,
                              about=about)  # fmt: skip


def node_fields(merged: MergedViews, quantity: Quantity) -> tuple[dict[str, NDArray], dict[str, str]]:
    """Merged values as fields of a grid, with their units; ``source`` counts the images from 0, -1 for none."""
    nodes = merged.nodes
    fields: dict[str, NDArray] = {
        quantity.column: nodes.value, "sigma": nodes.sigma, "source": nodes.source, "images": nodes.pictures,
    }  # fmt: skip
    return fields, {quantity.column: quantity.unit_words, "sigma": quantity.unit_words}


def write_merged(
    item: MergeResult,
    place: Path,
    unit: str,
    write_nodes: Callable[[Path, Mapping[str, NDArray], Mapping[str, str], Record], None],
) -> None:
    """One folder of merged values; only ``merged.json`` with the reason where nothing could be merged."""
    io.write_json(place / "merged.json", merge_summary(item))
    merged = item.merged
    if merged is None:
        return
    fields, units = node_fields(merged, item.quantity)
    write_nodes(place, fields, units, {"images": list(merged.names), "options": dict(merged.options)})
    for view in item.views:
        name, shown = view.view.name, view.view
        io.write_image(place / f"view-{name}.tif", shown.image, description=item.quantity.words)
        io.write_image(place / f"view-{name}-sigma.tif", view.values.sigma.astype(np.float32))
        io.write_image(place / f"view-{name}-source.tif", (view.values.source + 1).astype(np.uint8))
        io.write_camera(place / f"view-{name}.json", shown.camera, shown.cam_from_model, unit=unit)
    for table in item.points:
        columns = merged_columns(table, item.quantity.column)
        _write_table(place / table.of.stem, columns, unit, "merged " + ", ".join(merged.names), table, item.quantity)
    seams = merged.seams
    io.write_table(place / "seams.csv", {
        "node": seams.node, "x": merged.mesh.vertices[seams.node, 0], "y": merged.mesh.vertices[seams.node, 1],
        "z": merged.mesh.vertices[seams.node, 2], "first": np.array(merged.names)[seams.first],
        "second": np.array(merged.names)[seams.second], "step": seams.step, "sigma": seams.sigma,
        "in_sigmas": seams.in_sigmas,
    }, comment=f"length unit: {unit}\nstep, sigma: {item.quantity.unit_words}")  # fmt: skip


def merge_summary(item: MergeResult) -> Record:
    """Merged images in figures."""
    record: Record = {"point": item.point, "images": list(item.images), "left_out": item.missing}
    merged = item.merged
    if merged is None:
        return {**record, "merged": False, "reason": getattr(item.outcome, "reason", "")}
    nodes, gains, seams = merged.nodes, merged.gains, merged.seams
    relative = nodes.sigma / np.where(nodes.value == 0, np.nan, np.abs(nodes.value))
    known = relative[np.isfinite(relative)]
    return {
        **record,
        "merged": True,
        "quantity": vars(item.quantity),
        "legend": {str(k): name for k, name in enumerate(merged.names)},
        "nodes_with_value": int(np.isfinite(nodes.value).sum()),
        "nodes_by_source": {n: int((nodes.source == k).sum()) for k, n in enumerate(merged.names)},
        "nodes_of_several": int((nodes.pictures > 1).sum()),
        "sigma_percent": float(100 * np.median(known)) if len(known) else None,
        "gain": {n: {"gain": gains.gain[k], "sigma": gains.sigma[k], "offset": gains.offset[k],
                     "offset_sigma": gains.offset_sigma[k]} for k, n in enumerate(merged.names)},
        "gain_estimated": gains.estimated,
        "reference": merged.names[gains.reference],
        "overlap_nodes": gains.overlap,
        "systematic_percent": 100 * gains.systematic,
        "seams": {**seams.summary(), "nodes": len(seams), "edges": seams.edges, "unchecked_edges": seams.unchecked},
        "options": dict(merged.options),
        "points": [table_summary(table) for table in item.points],
    }  # fmt: skip


def table_summary(table: PointTable | MergedTable) -> Record:
    """Values at points in figures: how many there are, how many have a value, why others have none."""
    reason = table.values.words if isinstance(table, PointTable) else table.reason
    words, counts = np.unique(reason[reason != ""], return_counts=True)
    moved = table.of.surface.distance
    far = moved[np.isfinite(moved)]
    return {
        "kind": table.of.kind, "name": table.of.name, "points": len(reason), "with_value": int((reason == "").sum()),
        "without": dict(zip(words.tolist(), counts.tolist(), strict=True)),
        "largest_move": float(far.max()) if len(far) else None, "max_distance": table.of.limit,
    }  # fmt: skip
