"""Heat flux of all nodes from the stored temperatures of all frames: by camera, so that cameras' offsets drop out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.io.atomic import atomic_path
from windmark.paint import FluxOperator, NodeField, before_start, flux_operator
from windmark.pipeline.infrared.load import InfraredRun
from windmark.pipeline.infrared.sideways import ALONG, Sideways
from windmark.pipeline.infrared.store import MODES, VALUE, WEIGHT, WHITE, Store
from windmark.tasks.infrared import (
    CURVED,
    FLAGS,
    LATE,
    LATERAL,
    NO_WALL,
    CameraTemperature,
    behind_gaps,
    history_flux,
    merged_temperature,
)
from windmark.tasks.infrared.histories import TESTED, TIME_STEP

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Flags = NDArray[np.uint16]

BLOCK = 4096
"""Nodes whose histories are in memory at a time."""
NEW = ("registration:1", "registration:2", "registration:3")
"""Causes that are new in every frame."""
WALL = "wall"
MOST = 0.5
"""Part of the nodes that could have a heat flux from which a frame without it is told."""
OFTEN = 0.9
"""Part of the frames in which a node has a heat flux from which it counts for heat along the surface."""


def make_fluxes(run: InfraredRun, store: Store, indices: Sequence[int]) -> tuple[int, ...]:
    """Write each camera's heat flux into the store, from the frames that have temperatures; (F,) those frames.

    Nothing is written where no wall was given, or fewer than two frames are there or none of them before the heating.
    """
    heat = run.project.heat
    if heat is None or not run.walls or len(indices) < 2:
        return ()
    times = run.times[list(indices)]
    before = before_start(times, heat.start_s)
    if not before.any() or before.all():
        return ()
    for camera in store.cameras:
        rows = flux_rows(store, camera)
        own = _own_frames(run, store, camera, indices, before)
        operators = [flux_operator(times[own], wall, heat.start_s) for wall in run.walls]
        shape = (len(indices), len(rows), len(run.mesh.vertices))
        with atomic_path(store.flux_file(camera)) as new:
            out = np.lib.format.open_memmap(new, mode="w+", dtype=np.float32, shape=shape)
            for first in range(0, shape[2], BLOCK):
                nodes = slice(first, min(first + BLOCK, shape[2]))
                out[:, :, nodes] = _block(run, store, camera, indices, operators, nodes, rows, own, before)
            out.flush()
            del out
    return tuple(indices)


def flux_rows(store: Store, camera: str) -> tuple[str, ...]:
    """What a camera's file of heat flux has of every node and frame."""
    lasting = [m for m in (*MODES, *store.rows(camera)[4 + len(MODES) :]) if m not in NEW]
    return (VALUE, WHITE, WEIGHT, "flags", *lasting, *(f"{m} {w}" for m in NEW for w in ("now", "before")),
            TIME_STEP, WALL)  # fmt: skip


def _own_frames(run: InfraredRun, store: Store, camera: str, indices: Sequence[int], before: Mask) -> Mask:
    """(F,) frames in which a camera has a temperature: of the others no node's history can be whole.

    All of them where it has none before the heating or none after: its nodes then have no flux, and are told why.
    """
    seen = [store.values(index, camera, len(run.mesh.vertices)) for index in indices]
    own = np.array([v is not None and bool(np.isfinite(v).any()) for v in seen])
    return own if (own & before).any() and (own & ~before).any() else np.ones(len(indices), bool)


def _block(
    run: InfraredRun, store: Store, camera: str, indices: Sequence[int], operators: Sequence[FluxOperator],
    nodes: slice, rows: tuple[str, ...], seen: Mask, before: Mask,
) -> Array:  # fmt: skip
    """(F, R, H) of a block of nodes; ``operators`` are of the frames (F,) that the camera has ``seen``."""
    assert run.project.heat is not None
    have = store.histories(camera, indices, nodes)
    out = np.zeros((len(indices), len(rows), nodes.stop - nodes.start), np.float32)
    out[:, rows.index(VALUE)] = np.nan
    out[:, rows.index(WEIGHT)] = have[WEIGHT].T
    wall_of, longest = run.wall_of[nodes], run.project.heat.longest_gap
    out[:, rows.index("flags")] = np.where(wall_of < 0, NO_WALL, 0)[None]
    lasting = [r for r in rows if r in have and r not in (VALUE, WHITE, WEIGHT, "flags")]
    for k, (operator, wall) in enumerate(zip(operators, run.walls, strict=True)):
        own = np.flatnonzero(wall_of == k)
        if not len(own):
            continue
        at = np.ix_(seen, own)
        temperature = have[VALUE][own][:, seen]
        whole = temperature[np.isfinite(temperature).all(axis=1)]
        tried = whole[np.linspace(0, len(whole) - 1, min(TESTED, len(whole))).astype(int)] if len(whole) else None
        done = history_flux(
            temperature, have[WHITE][own][:, seen], {m: have[m][own][:, seen] for m in lasting}, operator, wall,
            curvature=run.curvature[nodes][own], longest_gap=longest,
            once={m: have[m][own][:, seen] for m in NEW}, tried=tried,
            behind=behind_gaps(~np.isfinite(have[VALUE][own]), before, longest)[:, seen],
        )  # fmt: skip
        results: dict[str, NDArray[Any]] = {
            VALUE: done.flux, WHITE: done.white, "flags": done.flags, **done.modes,
            WALL: wall.relative_sigma * np.nan_to_num(done.flux),
        }  # fmt: skip
        for name, columns in results.items():
            out[:, rows.index(name)][at] = columns.T
    return out


@dataclass(frozen=True, eq=False)
class FrameFields:
    """What is known of a frame at the V nodes.

    Parameters
    ----------
    temperature, flux : kelvin, W / m2; ``flux`` None without walls
    flags : (V,) bits of `tasks.infrared.FLAGS`
    source : (V,) int8, which camera counts most for the temperature
    no_flux : why most nodes that have a heat flux in other frames, and a temperature in this one, have none in it
    """

    temperature: NodeField
    flux: NodeField | None
    flags: Flags
    source: NDArray[np.int8]
    no_flux: str = ""


class FieldMaker:
    """Makes the fields of one frame after the other from the store."""

    def __init__(self, run: InfraredRun, store: Store, frames: Sequence[int]) -> None:
        self._run, self._store, self._place = run, store, {index: f for f, index in enumerate(frames)}
        self._files = {c: np.load(store.flux_file(c), mmap_mode="r") for c in store.cameras} if frames else {}
        heat = run.project.heat
        self._initial: tuple[Array, Array] | None = None
        if frames and heat is not None:
            before = before_start(run.times[list(frames)], heat.start_s)
            self._before = [i for i, b in zip(frames, before, strict=True) if b]
            self._initial = self._mean(self._before)
            count = self._with_flux()
            self._ever = count > 0 if count.any() else np.asarray(run.wall_of >= 0)
            often = count >= OFTEN * max(count.max(), 1)
            self._sideways = Sideways(run, often, self._initial, self._merged, frames)

    def _with_flux(self) -> NDArray[np.int64]:
        """(V,) in how many frames nodes have a heat flux."""
        count = np.zeros(len(self._run.mesh.vertices), np.int64)
        for place in self._place.values():
            count += np.any([np.isfinite(of[place][0]) for of in self._files.values()], axis=0)
        return count

    def _merged(self, index: int) -> NodeField | None:
        merged, _ = merged_temperature(self._store.temperatures(index))
        return None if merged is None else merged.field

    def _mean(self, indices: Sequence[int]) -> tuple[Array, Array]:
        """(V,) mean of merged temperatures over frames, and its variance by noise."""
        values, noise = [], []
        for index in indices:
            if (field := self._merged(index)) is not None:
                values.append(np.where(field.known, field.value, np.nan))
                noise.append(np.where(field.known, field.white, np.nan))
        stack, white = np.array(values), np.array(noise)
        count = np.isfinite(stack).sum(axis=0)
        total = np.where(count > 0, np.nansum(stack, axis=0), np.nan) / np.maximum(count, 1)
        return total, np.nansum(white, axis=0) / np.maximum(count, 1) ** 2

    def fields(self, index: int) -> FrameFields:
        """Of a frame that has temperatures."""
        merged, flags = merged_temperature(self._store.temperatures(index))
        assert merged is not None
        place = self._place.get(index)
        if place is None:
            return FrameFields(merged.field, None, flags, merged.source)
        own = {c: self._of_camera(c, place) for c in self._store.cameras}
        done, why = merged_temperature(own)
        if done is None:
            count = len(merged.field)
            nothing = NodeField(np.full(count, np.nan), np.zeros(count), np.zeros((count, 0)), (), "W/m2")
            said = self._missing(index, merged.field, nothing, flags | why)
            return FrameFields(merged.field, nothing, flags | why, merged.source, said)
        flux = replace(done.field, unit="W/m2")
        kept = np.bitwise_and.reduce([np.where(c.field.known, c.flags, 0xFFFF).astype(np.uint16) for c in own.values()])
        flags = flags | np.where(flux.known, kept, why).astype(np.uint16)
        said = self._missing(index, merged.field, flux, flags)
        flux, flags = self._with_sideways(index, merged.field, flux, flags)
        return FrameFields(merged.field, flux, flags, merged.source, said)

    def _missing(self, index: int, temperature: NodeField, flux: NodeField, flags: Flags) -> str:
        """See `FrameFields.no_flux`: what is said of most of these nodes, in words."""
        wanted = self._ever & temperature.known
        missing = wanted & ~flux.known
        if index in self._before or missing.sum() <= MOST * wanted.sum():
            return ""
        count = {bit: int((flags[missing] & bit > 0).sum()) for bit in FLAGS if bit not in (LATE, LATERAL, CURVED)}
        bit = max(count, key=lambda b: count[b])
        return FLAGS[bit] if count[bit] else "it is not known why"

    def _of_camera(self, camera: str, place: int) -> CameraTemperature:
        """A camera's heat flux of a frame, with its weight."""
        rows, data = flux_rows(self._store, camera), np.asarray(self._files[camera][place], dtype=float)
        modes = [k for k in range(4, len(rows)) if data[k].any()]
        names = tuple(_renamed(rows[k]) for k in modes)
        good = np.isfinite(data[0])
        field = NodeField(data[0], np.where(good, data[1], 0.0), data[modes].T * good[:, None], names, "W/m2")
        return CameraTemperature(field, np.where(good, data[2], 0.0), data[3].astype(np.uint16))

    def _with_sideways(
        self, index: int, temperature: NodeField, flux: NodeField, flags: Flags
    ) -> tuple[NodeField, Flags]:
        """What flows along the surface put into the sigma, and flagged where it surely is too large a part."""
        heat = self._run.project.heat
        assert heat is not None
        along = self._sideways.of(index, temperature)
        column = np.where(flux.known, along.sigma, 0.0)
        modes = np.concatenate([flux.modes, column[:, None]], axis=1)
        sure = flux.known & (along.sure > heat.most_lateral * np.abs(np.nan_to_num(flux.value)))
        return (replace(flux, modes=modes, names=(*flux.names, ALONG)),
                np.where(sure, flags | LATERAL, flags).astype(np.uint16))  # fmt: skip


def _renamed(row: str) -> str:
    """``registration:2 now`` is the second column of the cause ``registration now``."""
    cause, _, rest = row.partition(":")
    number, _, word = rest.partition(" ")
    return row if not word else f"{cause} {word}:{number}"


