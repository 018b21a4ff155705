"""A `Scene3D` as the data of a page: small, exact as far as it is shown, read by ``web/model.js``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from windmark.app.feature_edges import feature_edges
from windmark.app.packing import COARSE, FINE, Fineness, Packed, coordinates
from windmark.app.scene3d import Cut, Field, Frames, Markers, Scene3D, Shifts, Station
from windmark.app.space_pictures import RADIUS, magnification
from windmark.errors import g2
from windmark.scene import Mesh
from windmark.scene.plots import round_length

Array = NDArray[np.float64]
Document = dict[str, Any]

COLOURS, SIGMA_COLOURS, DIVERGING = "viridis", "magma", "coolwarm"
"""Colours that colour-blind people tell apart; those of sigmas differ from those of values at a glance."""
STOPS = 17
FEW_FIELDS = 12
"""Fields that are packed finely; of more each is told more coarsely, see `packing.COARSE`."""
OUTER = 0.5
"""Per cent of the values at either end that the colours do not reach."""
LOST = 1e-3
"""A sequence is described so well that no node is off by more than this part of the largest displacement."""
CUT_COLOURS = ("#d81b60", "#00838f", "#f9a825", "#5e35b1")


def documents(scene: Scene3D, ident: str) -> dict[str, str]:
    """Packed data by the id of its part of the page: the scene itself, and every field that is not shown first."""
    packed, out = Packed(), {}
    fields = []
    many = len(scene.fields) > FEW_FIELDS

    def made(k: int) -> tuple[Document, str]:
        entry = scene.fields[k]
        entry = entry if isinstance(entry, Field) else entry()
        fineness = COARSE if many or entry.coarse else FINE
        if k == scene.chosen:
            return {**_about(entry), **_content(packed, entry, fineness)}, ""
        own = Packed()
        return {**_about(entry), "blob": f"{ident}-field-{k}"}, own.text(_content(own, entry, fineness))

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for about, text in pool.map(made, range(len(scene.fields))):
            fields.append(about)
            if text:
                out[about["blob"]] = text
    moving = scene.frames is not None and bool(scene.frames.label)
    if scene.frames is not None and moving:
        fields.append(_moving_field(scene.frames))
    focus = _focus(scene)
    box = np.stack([focus.min(axis=0), focus.max(axis=0)])
    stations = [_station(s, box.mean(axis=0), scene.unit) for s in scene.stations]
    document = {
        "unit": scene.unit, "up": _list(scene.up), "ahead": _list(scene.ahead), "box": _list(box),
        "reach": _reach(scene, box, stations), "chosen": scene.chosen, "fields": fields, "cameras": stations,
        "surface": None if scene.mesh is None else _surface(packed, scene.mesh),
        "markers": None if scene.markers is None else _markers(scene.markers, box, scene.unit),
        "lines": [_cut(cut, CUT_COLOURS[k % len(CUT_COLOURS)]) for k, cut in enumerate(scene.cuts)],
        "linesAre": scene.cuts_are,
        "sequence": None if scene.frames is None else _sequence(packed, scene, scene.frames, box.mean(axis=0),
                                                                len(fields) - 1 if moving else None),
    }  # fmt: skip
    return {ident: packed.text(document), **out}


def low_rank(rows: NDArray[np.floating], lost: float) -> tuple[Array, Array]:
    """Weights (F, M) and modes (M, K) whose product is the rows (F, K), no number off by more than ``lost``."""
    data = np.asarray(rows, dtype=float)
    value, vector = np.linalg.eigh(data @ data.T)
    left = vector[:, ::-1]
    for count in range(int((value > 0).sum()) + 1):
        weights = left[:, :count]
        modes = weights.T @ data
        if np.abs(weights @ modes - data).max(initial=0.0) <= lost:
            break
    size = np.abs(modes).max(axis=1, initial=0.0) if count else np.zeros(0)
    size = np.where(size > 0, size, 1.0)
    return weights * size, modes / size[:, None]


def _focus(scene: Scene3D) -> Array:
    points = [scene.focus]
    if not len(scene.focus):
        if scene.mesh is not None:
            points.append(scene.mesh.vertices[scene.mesh.used])
        if scene.markers is not None:
            points.append(scene.markers.xyz)
    every = np.concatenate(points)
    every = every[np.isfinite(every).all(axis=1)]
    return every if len(every) else np.array([[-1.0, -1, -1], [1, 1, 1]])


def _reach(scene: Scene3D, box: Array, stations: Sequence[Document]) -> float:
    """How far from the middle anything is drawn."""
    middle = box.mean(axis=0)
    points = [box, *(np.array([s["center"], *s["corners"]]) for s in stations)]
    if scene.frames is not None:
        points += [np.array([s.cam_from_model.center for s in of]) for of in scene.frames.stations if of]
    if scene.mesh is not None:
        points.append(np.stack(scene.mesh.box))
    far = np.linalg.norm(np.concatenate(points) - middle, axis=1)
    return float(1.2 * np.nanmax(far)) or 1.0


def _surface(packed: Packed, mesh: Mesh) -> Document:
    """Nodes, triangles by volume, edges. What no triangle uses, or has no place, is left out."""
    good = np.asarray(np.isfinite(mesh.vertices).all(axis=1))
    kept = np.flatnonzero(good[mesh.triangles].all(axis=1))
    names, volume = np.unique(mesh.volume[kept], return_inverse=True)
    order = kept[np.argsort(volume, kind="stable")]
    triangles = mesh.triangles[order]
    vertices = np.full(mesh.vertices.shape, np.nan)
    used = np.unique(triangles)
    vertices[used] = mesh.vertices[used]
    count = np.bincount(volume, minlength=len(names))
    begin = np.cumsum(count) - count
    shown = Mesh.make(np.nan_to_num(vertices), triangles)
    return {
        "x": coordinates(packed, vertices, mesh.size), "corners": packed.ints(triangles),
        "edges": packed.ints(feature_edges(shown)),
        "volumes": [{"name": str(n), "first": int(b), "count": int(c)}
                    for n, b, c in zip(names, begin, count, strict=True)],
    }  # fmt: skip


def _about(entry: Field) -> Document:
    """What the page says of a field before it is unpacked."""
    out: Document = {
        "key": entry.key, "name": entry.name, "label": entry.label,
        "colours": _stops(DIVERGING if entry.diverging else COLOURS), "sigmaColours": _stops(SIGMA_COLOURS),
        "limits": _limits(entry.values, entry.diverging) if entry.limits is None else list(entry.limits),
        "sigmaLimits": None if entry.sigma is None else _limits(entry.sigma, False),
        "shifted": entry.shifts is not None, "frame": entry.frame,
    }  # fmt: skip
    return out


def _content(packed: Packed, entry: Field, fineness: Fineness) -> Document:
    return {
        "value": packed.field(entry.values, entry.sigma, fineness),
        "sigma": None if entry.sigma is None else packed.sigmas(entry.sigma, fineness),
        "shifts": None if entry.shifts is None else _shifts(entry.shifts),
    }


def _shifts(shifts: Shifts) -> Document:
    return {
        "vectors": [_list(v) if np.isfinite(v).all() else None for v in shifts.vectors], "factor": shifts.factor,
        "words": shifts.words, "notes": list(shifts.notes),
    }  # fmt: skip


def _moving_field(frames: Frames) -> Document:
    """The length of the displacement, which the page works out of the shapes."""
    size = np.linalg.norm(frames.moved, axis=2)
    return {
        "key": "displacement", "name": "displacement", "label": frames.label, "colours": _stops(COLOURS),
        "sigmaColours": _stops(SIGMA_COLOURS), "limits": [0.0, float(np.nanmax(size, initial=0.0)) or 1.0],
        "sigmaLimits": None if frames.sigma is None else [0.0, float(np.nanmax(frames.sigma, initial=0.0)) or 1.0],
    }  # fmt: skip


def _sequence(packed: Packed, scene: Scene3D, frames: Frames, middle: Array, number: int | None) -> Document:
    """Displacements as few modes; those of the markers stand behind those of the nodes."""
    count, nodes = frames.moved.shape[:2]
    moved, markers = frames.moved, scene.markers
    if frames.markers is not None and markers is not None:
        moved = np.concatenate([moved, frames.markers[:, np.isfinite(markers.xyz).all(axis=1)]], axis=1)
    rows = np.nan_to_num(moved.reshape(count, -1))
    weights, modes = low_rank(rows, LOST * float(np.abs(rows).max(initial=0.0)))
    shares, sigma_modes = np.zeros((count, 0)), np.zeros((0, nodes))
    if frames.sigma is not None:
        rows = np.nan_to_num(frames.sigma)
        shares, sigma_modes = low_rank(rows, 0.01 * float(rows.max(initial=0.0)))
    return {
        "labels": list(frames.labels), "first": _largest(frames) if frames.first is None else frames.first,
        "magnify": frames.magnify, "field": number,
        "weights": _list(weights), "sigmaWeights": _list(shares),
        "modes": [[packed.rounded(column, 1 / 8192) for column in mode.reshape(-1, 3).T] for mode in modes],
        "sigmaModes": [packed.rounded(mode, 1 / 512) for mode in sigma_modes],
        "cameras": [[_station(s, middle, scene.unit) for s in of] for of in frames.stations],
        "shifts": [None if s is None else _shifts(s) for s in frames.shifts],
    }  # fmt: skip


def _largest(frames: Frames) -> int:
    """The frame that is shown first: the one with the largest displacement."""
    return int(np.argmax(np.nanmax(np.linalg.norm(frames.moved, axis=2), axis=1, initial=0.0)))


def _station(station: Station, middle: Array, unit: str) -> Document:
    """The camera's place, and the corners of its picture as far away as the model is, or a part of that."""
    pose, camera = station.cam_from_model, station.camera
    width, height = camera.size_px
    corner = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    rays = np.asarray(camera.unproject(corner), dtype=float)
    ideal = np.column_stack([(corner - [camera.cx, camera.cy]) / [camera.focal_px, camera.focal_px * camera.aspect],
                             np.ones(4)])  # fmt: skip
    rays = np.where(np.isfinite(rays).all(axis=1, keepdims=True), rays, ideal)
    depth = float(pose.apply(middle)[2])
    if not depth > 0:
        depth = float(np.linalg.norm(middle - pose.center))
    at = rays / np.maximum(rays[:, 2:], 1e-6) * depth * station.far
    return {
        "name": station.name, "center": _list(pose.center), "corners": _list(pose.inverse().apply(at)),
        "colour": station.colour,
        "notes": [*station.notes, f"x, y, z: {', '.join(f'{v:.5g}' for v in pose.center)} {unit}",
                  f"{width} × {height} px, field of view {camera.fov_deg:.2f}°"],
    }  # fmt: skip


def _markers(markers: Markers, box: Array, unit: str) -> Document:
    good = np.isfinite(markers.xyz).all(axis=1)
    index = np.flatnonzero(good)
    out: Document = {
        "names": [markers.names[k] for k in index], "xyz": _list(markers.xyz[index]),
        "notes": [list(markers.notes[k]) if markers.notes else [] for k in index],
        "index": index.tolist(), "axes": None, "factor": 1.0, "axesWords": "",
        "groups": [{"colour": colour, "words": words, "of": np.flatnonzero(np.isin(index, of)).tolist()}
                   for colour, words, of in markers.groups],
    }  # fmt: skip
    if markers.cov is not None and len(index) and np.nan_to_num(markers.cov[index]).any():
        cov = np.nan_to_num(markers.cov[index])
        size = float(np.linalg.norm(np.ptp(markers.xyz[index], axis=0)))
        usual, top, factor = magnification(cov, 0.5 * size or float(np.linalg.norm(np.ptp(box, axis=0))))
        value, vector = np.linalg.eigh(cov)
        axes = vector * (RADIUS * np.sqrt(np.maximum(value, 0.0)))[:, None, :]
        out["axes"] = _list(np.swapaxes(axes, 1, 2).reshape(len(index), 9))
        out["factor"] = factor
        out["axesWords"] = (f"Ellipsoids: 95 %, drawn × {factor:g}; most semi-axes are below {g2(usual)} {unit}, the "
                            f"largest is {g2(top)} {unit}.")  # fmt: skip
    return out


def _cut(cut: Cut, colour: str) -> Document:
    """Neighbours of one piece as pairs of points."""
    joined = (np.diff(cut.piece) == 0) & np.isfinite(cut.xyz[:-1]).all(axis=1) & np.isfinite(cut.xyz[1:]).all(axis=1)
    at = np.flatnonzero(joined)
    pairs = np.concatenate([cut.xyz[at], cut.xyz[at + 1]], axis=1)
    return {"name": cut.name, "colour": colour, "pairs": _list(pairs.reshape(-1))}


def larger(vectors: Array, size: float) -> float:
    """A round factor by which the usual one of these vectors becomes 4 % of ``size``; 1 at least."""
    length = np.linalg.norm(vectors, axis=1)
    length = length[np.isfinite(length) & (length > 0)]
    return max(1.0, round_length(0.04 * size / float(np.sqrt(np.mean(length**2))))) if len(length) else 1.0


def _limits(values: Array, diverging: bool) -> list[float]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return [0.0, 1.0]
    low, high = np.percentile(finite, [OUTER, 100 - OUTER])
    if diverging:
        high = float(max(abs(low), abs(high)))
        low = -high
    if not high > low:
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    return [float(f"{low:.5g}"), float(f"{high:.5g}")]


def _stops(name: str) -> list[str]:
    return [to_hex(c) for c in colormaps[name](np.linspace(0, 1, STOPS))]


def _list(values: Any) -> Any:
    """Numbers with seven digits, nested as they are."""
    flat = np.asarray(values, dtype=float)
    rounded = np.array([float(f"{v:.7g}") for v in flat.ravel()]).reshape(flat.shape)
    return rounded.tolist()
