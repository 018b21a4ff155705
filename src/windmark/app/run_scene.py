"""The main job in 3D: the grid with each picture's values and their sigma, cameras, markers, residuals, cuts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from windmark.app.residual_shifts import SeenBy, residual_shifts
from windmark.app.scene3d import STATION_COLOURS, Cut, Field, Markers, Scene3D, Shifts, Station, looking_over
from windmark.errors import earned_decimals, g2
from windmark.pipeline.results import ImageResult, RunResult
from windmark.scene import MarkerSet, Mesh

Array = NDArray[np.float64]

MOST_CUTS = 8
"""Images whose sections are drawn: the places of the others' are the same."""


def run_scene(result: RunResult, order: Sequence[ImageResult]) -> Scene3D | None:
    """The scene, fields in the given order of the images; None where no image has a pose."""
    located = [item for item in order if item.cam_from_model is not None]
    if not located:
        return None
    mesh, unit = result.mesh, result.project.length_unit
    merged = [] if mesh is None else [
        Field(f"merged-{k}", group.folder, group.quantity.label, group.merged.nodes.value, group.merged.nodes.sigma)
        for k, group in enumerate(result.merged) if group.merged is not None
    ]  # fmt: skip
    fields: list[Field | Callable[[], Field]] = list(merged)
    values: list[NDArray[np.floating]] = [f.values for f in merged]
    for item in located:
        if mesh is not None and item.values is not None:
            fields.append(partial(_field, item, result, mesh, coarse=item is not located[0]))
            values.append(item.values)
    focus = _focus(mesh, values, result.markers)
    first = located[0].cam_from_model
    assert first is not None
    ahead, up = looking_over(first, focus)
    cameras = list(dict.fromkeys(result.project.camera_of(e).name for e in result.project.image))
    colour = {
        entry.label: STATION_COLOURS[cameras.index(result.project.camera_of(entry).name) % len(STATION_COLOURS)]
        for entry in result.project.image
    }
    return Scene3D(
        unit, ahead, up, mesh, fields,
        [Station(i.name, i.camera, i.cam_from_model, colour[i.name], _station_notes(i))
         for i in located if i.cam_from_model is not None],
        None if result.markers is None else markers_shown(result.markers, unit), _cuts(located), focus=focus,
    )  # fmt: skip


def _focus(mesh: Mesh | None, fields: Sequence[NDArray[np.floating]], markers: MarkerSet | None) -> Array:
    """What has a value in any image, and the markers: the model, not the tunnel round it."""
    points = [np.zeros((0, 3))]
    if mesh is not None and fields:
        seen = np.zeros(len(mesh.vertices), dtype=bool)
        for one in fields:
            seen |= np.isfinite(one)
        points.append(mesh.vertices[seen])
    if markers is not None:
        points.append(markers.xyz[markers.role != "wall"] if (markers.role != "wall").any() else markers.xyz)
    return np.concatenate(points)


def _field(item: ImageResult, result: RunResult, mesh: Mesh, *, coarse: bool) -> Field:
    """Values of an image; ``coarse`` for all but the first, so that each costs little."""
    assert item.values is not None
    assert item.sigma is not None
    values, sigma = item.values.astype(float), item.sigma.astype(float)
    return Field(item.name, item.name, item.quantity.label, values, sigma, shifts=shifts(item, result),
                 coarse=coarse)  # fmt: skip


def shifts(item: ImageResult, result: RunResult) -> Shifts | None:
    """Residuals of an image at its markers: how far these would have to move, in the picture's plane, to fit."""
    answer, markers = item.registered, result.markers
    if answer is None or markers is None or item.detections is None or not len(answer.matching):
        return None
    seen = SeenBy(item.name, answer.camera, answer.cam_from_model, answer.matching.marker, answer.residuals)
    return residual_shifts(item.name, [seen], markers.xyz, result.project.length_unit)


def markers_shown(markers: MarkerSet, unit: str) -> Markers:
    """A table of markers, with the ellipsoids of its sigmas."""
    sigma = np.asarray(markers.sigma, dtype=float)
    cov = None
    if np.isfinite(sigma).all() and sigma.any():
        cov = np.zeros((len(markers), 3, 3))
        cov[:, range(3), range(3)] = sigma**2
    return Markers(tuple(str(n) for n in markers.name), markers.xyz, cov, marker_notes(markers, unit))


def marker_notes(markers: MarkerSet, unit: str) -> tuple[tuple[str, ...], ...]:
    """What a marker's pop-up says of it: volume and role, coordinates, as far as their sigma tells, and it."""
    out = []
    for k in range(len(markers)):
        what = ", ".join(str(v) for v in (markers.volume[k], markers.role[k]) if str(v))
        sigma = markers.sigma[k]
        known = np.isfinite(sigma).all() and (sigma > 0).all()
        decimals = earned_decimals(sigma) if known else 4
        place = ", ".join(f"{v:z.{decimals}f}" for v in markers.xyz[k])
        lines = [what, f"x, y, z: {place} {unit}"]
        if known:
            lines.append(f"1 sigma: {', '.join(f'{v:.{decimals}f}' for v in sigma)} {unit}")
        out.append(tuple(line.replace("-", "−") for line in lines if line))
    return tuple(out)


def _station_notes(item: ImageResult) -> tuple[str, ...]:
    answer = item.registered
    if answer is None or not len(answer.matching):
        return ()
    return (f"{len(answer.matching)} markers matched, RMS {g2(answer.rms_px)} px",)


def _cuts(items: Sequence[ImageResult]) -> list[Cut]:
    """Each section once: it is at the same place for all images."""
    known = {cut.name: Cut(cut.name, cut.xyz, cut.line) for item in items[:MOST_CUTS] for cut in item.sections}
    return list(known.values())
