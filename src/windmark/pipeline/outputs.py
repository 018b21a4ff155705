"""Results as files: tables, poses, values on the grid. One folder per image, all or nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import windmark
from windmark import io
from windmark.geometry import Pose
from windmark.pipeline.clock import Clock
from windmark.pipeline.merge_outputs import merge_summary, table_summary, write_merged, write_points
from windmark.pipeline.results import FramedView, ImageResult, Instant, RunResult
from windmark.registration import NotRegistered, Registration, WeakDirection
from windmark.scene import Detections

Record = dict[str, Any]


def write_results(result: RunResult, folder: Path, clock: Clock) -> None:
    """Write everything but summary and report into ``folder`` (it exists already; see `io.atomic_folder`)."""
    for item in result.images:
        place = folder / item.name
        place.mkdir()
        with clock("write tables and images"):
            _write_image(item, result, place)
        if item.nodes is not None and item.values is not None:
            _write_image_nodes(item, result, place, clock)
    for group in result.merged:
        place = folder / group.folder
        place.mkdir()
        with clock("write merged images"):
            write_merged(group, place, result.project.length_unit, partial(_write_merged_nodes, result, clock))


def _write_image(item: ImageResult, result: RunResult, place: Path) -> None:
    if item.detections is not None:
        io.write_detections(place / "detections.csv", item.detections, image=item.name)
    answer, unit = item.registered, result.project.length_unit
    if answer is not None and item.detections is not None and result.markers is not None:
        io.write_matches(place / "matches.csv", item.detections, result.markers, answer.matching,
                         projected_xy(answer, item.detections), image=item.name)  # fmt: skip
    if item.cam_from_model is not None:
        cov = None if answer is None or not np.isfinite(answer.cov).all() else answer.cov[:6, :6]
        io.write_camera(place / "camera.json", item.camera, item.cam_from_model, unit=unit, pose_cov=cov)
    for view in item.views:
        io.write_image(place / f"view-{view.name}.tif", view.image, description=item.quantity.words)
        io.write_camera(place / f"view-{view.name}.json", view.camera, view.cam_from_model, unit=unit)
    for section in item.sections:
        io.write_table(
            place / f"section-{section.name}.csv",
            {
                "line": section.line, "arc": section.arc, "x": section.xyz[:, 0], "y": section.xyz[:, 1],
                "z": section.xyz[:, 2], item.quantity.column: section.value,
            },
            comment=f"length unit: {unit}\n{item.quantity.column}: {item.quantity.unit_words}",
        )  # fmt: skip
    if item.pixels is not None and item.image is not None:
        name = item.quantity.column
        io.write_pixels(
            place / "pixels.nc", item.light, item.pixels.xyz(),
            item.pixels.triangle_values(item.pixels.mesh.volume),
            {"obliquity_deg": item.pixels.obliquity_deg().astype(np.float32)}, length_unit=unit, name=name,
            units={name: item.quantity.unit_words, "obliquity_deg": "deg"}, history=_history(item, result),
        )  # fmt: skip
    write_points(item, place, unit)
    if item.aligned is not None:
        io.write_image(place / "aligned.tif", item.aligned, description=item.quantity.words)


def projected_xy(answer: Registration, spots: Detections) -> NDArray[np.float64]:
    """(K, 2) where the centres of the matched markers' imaged ellipses are expected, of the deformed model if it is.

    Not where the discs' centres are imaged: on a curved surface that is pixels from what a detector measures.
    """
    return np.asarray(spots.xy[answer.matching.detection] + answer.residuals)


def _write_image_nodes(item: ImageResult, result: RunResult, place: Path, clock: Clock) -> None:
    nodes, values = item.nodes, item.values
    assert nodes is not None
    assert values is not None
    assert item.sigma is not None
    name = item.quantity.column
    unit = item.quantity.unit_words
    fields = {name: values, "sigma": item.sigma, "obliquity_deg": np.where(nodes.visible, nodes.obliquity_deg, np.nan)}
    units = {name: unit, "sigma": unit, "obliquity_deg": "deg"}
    _write_nodes(result, place, clock, fields, units, _history(item, result))


def _write_merged_nodes(
    result: RunResult,
    clock: Clock,
    place: Path,
    fields: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
    of: Record,
) -> None:
    made = {"project": result.project.title, "windmark": windmark.__version__}
    _write_nodes(result, place, clock, fields, units, {**of, **made})


def _write_nodes(
    result: RunResult,
    place: Path,
    clock: Clock,
    fields: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
    history: Record,
) -> None:
    """Values at the nodes in all formats that are wanted."""
    mesh = result.mesh
    assert mesh is not None
    units = {**units, "length": result.project.length_unit}
    writers: dict[str, Callable[[], None]] = {
        "vtk": lambda: io.write_nodes_vtk(place / "nodes.vtp", mesh, fields, units=units),
        "tecplot": lambda: io.write_tecplot(place / "nodes.dat", mesh, fields, units=units),
        "plot3d": lambda: io.write_plot3d_function(
            place / "nodes.f", mesh, fields, units=units, layout=_layout(result)
        ),
        "csv": lambda: io.write_nodes_csv(place / "nodes.csv", mesh, fields, units=units),
        "netcdf": lambda: io.write_nodes_netcdf(place / "nodes.nc", mesh, fields, units=units, history=history),
    }
    wanted = result.project.output.nodes
    for kind in writers if wanted is None else wanted:
        if wanted is None and kind == "plot3d" and not mesh.blocks:
            continue  # "all that the grid allows"
        with clock(f"write nodes: {kind}"):
            writers[kind]()


def _history(item: ImageResult, result: RunResult) -> Record:
    return {
        "image": item.name, "quantity": vars(item.quantity), "project": result.project.title,
        "windmark": windmark.__version__,
    }  # fmt: skip


def _layout(result: RunResult) -> io.Plot3dLayout:
    """The grid file's own layout (byte order, precision, marks), so that what reads the grid reads the values."""
    grid = result.project.grid
    assert grid is not None
    try:
        return io.detect_plot3d(grid.file)
    except io.FileError:  # structured, but not from a PLOT3D file
        return io.Plot3dLayout()


def summary(result: RunResult, clock: Clock) -> Record:
    """The whole job in figures: what `--json` prints and summary.json holds."""
    return {
        "windmark": windmark.__version__,
        "title": result.project.title,
        "length_unit": result.project.length_unit,
        "markers": None if result.markers is None else len(result.markers),
        "grid_nodes": None if result.mesh is None else len(result.mesh.vertices),
        "views": [view_summary(view) for view in result.framed],
        "images": [image_summary(item, result) for item in result.images],
        "instants": [instant_summary(instant) for instant in result.instants],
        "merged": [merge_summary(group) for group in result.merged],
        "failed": [item.name for item in result.failed],
        "left_out": result.left_out,
        "notes": [f"{path}: {text}" for path, text in result.notes],
        "seconds": {**result.seconds, **clock.seconds},
        "options": result.project.model_dump(exclude={"path"}, by_alias=True),
    }


def view_summary(view: FramedView) -> Record:
    """A view of the job in figures: where it is seen from, the same for all images."""
    pov = view.cam_from_model.to_pov(view.camera.focal_px, view.camera.size_px[0])
    return {
        "name": view.name, "size_px": view.camera.size_px, "pov": vars(pov), "units_per_px": view.units_per_px,
        "how": view.how,
    }  # fmt: skip


def instant_summary(instant: Instant) -> Record:
    """What the cameras of a rig gave together at one instant, in figures."""
    done, found = instant.together, instant.registered
    record: Record = {"point": instant.point, "cameras": done.names, "left_out": dict(done.left_out)}
    if found is None:
        return {**record, "registered": False, "reason": done.answer.reason, "cause": done.answer.cause}  # type: ignore[union-attr]
    pose = found.rig_from_model
    return {
        **record, "registered": True, "matched": found.counts, "expected": found.n_expected, "rms_px": found.rms_px,
        "excess_px": found.excess_px, "log10_nfa": found.log10_nfa,
        "rig_from_model": {"rotation": pose.rotation, "translation": pose.translation, "covariance": found.cov},
    }  # fmt: skip


def image_summary(item: ImageResult, result: RunResult) -> Record:
    """One image in figures."""
    record: Record = {"name": item.name, "problem": item.problem, "seconds": item.seconds}
    if item.radius is not None:
        record["radius_estimate"] = item.radius.reason
    if item.detections is not None:
        record["spots"], record["polarity"] = len(item.detections), item.polarity
    if item.filled:
        record["filled"] = item.filled
    if item.saturated:
        record["saturated"] = item.saturated
    if item.dark:
        record["black"] = item.dark
    if item.dead:
        record["dead_pixels"] = item.dead
    if item.smoothed:
        record["noise"] = item.smoothed
    if item.said:
        record["polarity_decided"] = item.said
    answer = item.registered
    if answer is not None and result.markers is not None:
        unit = result.project.length_unit
        record["registration"] = registration_summary(answer, result.markers.name, item.published, unit)
    elif isinstance(item.registration, NotRegistered):
        no = item.registration
        record["registration"] = {
            "registered": False, "reason": no.reason, "cause": no.cause,
            "weak": [weak_record(w, result.project.length_unit) for w in no.weak],
        }  # fmt: skip
    if item.nodes is not None and item.values is not None:
        record["quantity"] = {**vars(item.quantity), "column": item.quantity.column}
        record["nodes_visible"] = int(item.nodes.visible.sum())
        record["nodes_with_value"] = int(np.isfinite(item.values).sum())
    if item.points:
        record["points"] = [table_summary(table) for table in item.points]
    record["views"] = {v.name: {"units_per_px": v.units_per_px, "valid_px": int(v.valid.sum())} for v in item.views}
    return record


def weak_record(weak: WeakDirection, unit: str) -> Record:
    """A weak direction in figures and in words."""
    return {**vars(weak), "words": weak.words(unit)}


def registration_summary(answer: Registration, names: NDArray[np.str_], published: Pose | None, unit: str) -> Record:
    """A registration in figures: labels, residual, pose with its sigma, confidence."""
    pov = answer.cam_from_model.to_pov(answer.camera.focal_px, answer.camera.size_px[0])
    record: Record = {
        "registered": True,
        "matched": len(answer.matching),
        "labels": [str(n) for n in names[answer.matching.marker]],
        "rms_px": answer.rms_px,
        "excess_px": answer.excess_px,
        "off_table": answer.off_table,
        "log10_nfa": answer.log10_nfa,
        "pov": vars(pov),
        "camera_station": answer.cam_from_model.center,
        "focal_px": answer.camera.focal_px,
        "cov": answer.cov,
        "weak": [weak_record(w, unit) for w in answer.weak],
        "unchecked": [{"what": u.what, "words": u.words} for u in answer.unchecked],
    }
    if answer.deformation is not None:
        bent = answer.deformation
        record["deformation"] = {
            "largest": bent.largest, "parameters": bent.parameters, "displacement": bent.displacement,
            "sigma": bent.sigma, "shift_px": bent.shift_px, "largest_px": bent.largest_px,
        }  # fmt: skip
    if published is not None:
        record["published_pose"] = pose_difference(answer.cam_from_model, published)
    return record


def pose_difference(pose: Pose, other: Pose) -> Record:
    """How far apart two poses of one camera are: angle in degrees, distance of the stations in length units."""
    return {
        "angle_deg": float(np.degrees(pose.angle_to(other))),
        "station_distance": float(np.linalg.norm(pose.center - other.center)),
    }
