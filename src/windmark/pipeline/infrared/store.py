"""What the frames leave for the histories: arrays on the disk, a file for each frame and camera, gone with the journal.

Histories need all frames at once and frames all nodes at once. Files are written frame by frame and read by blocks of
nodes: memory does not grow with the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from windmark.errors import DataError
from windmark.io.atomic import atomic_path
from windmark.io.errors import reading
from windmark.paint import NodeField
from windmark.pipeline.resume import HIDDEN
from windmark.tasks.infrared import CameraTemperature

Array = NDArray[np.float64]

VALUE, WHITE, WEIGHT, FLAGS = "value", "white", "weight", "flags"
_FIRST = (VALUE, WHITE, WEIGHT, FLAGS)
MODES = ("emissivity", "surroundings", "window", "registration:1", "registration:2", "registration:3")
"""Of every camera; `calibration NAME:1` to 3 come behind them."""


@dataclass(frozen=True)
class Store:
    """The files of a run.

    Parameters
    ----------
    folder : of the results
    cameras : names
    """

    folder: Path
    cameras: tuple[str, ...]

    @property
    def place(self) -> Path:
        """Where they are, beside the journal: with it they go."""
        return self.folder / HIDDEN / "store"

    def rows(self, camera: str) -> tuple[str, ...]:
        """What a camera's file has of every node."""
        return (*_FIRST, *MODES, *(f"calibration {camera}:{k}" for k in (1, 2, 3)))

    def temperature_file(self, index: int, camera: str) -> Path:
        """Of a frame and camera."""
        return self.place / f"{index:07d}-{self.cameras.index(camera)}.npy"

    def grid_file(self, index: int) -> Path:
        """The grid's vertices in a frame."""
        return self.place / f"{index:07d}-grid.npy"

    def flux_file(self, camera: str) -> Path:
        """Heat flux by a camera, all frames."""
        return self.place / f"flux-{self.cameras.index(camera)}.npy"

    def put(self, index: int, vertices: Array, cameras: Mapping[str, CameraTemperature]) -> None:
        """Write a frame."""
        self.place.mkdir(parents=True, exist_ok=True)
        _save(self.grid_file(index), vertices)
        for name, of in cameras.items():
            rows = self.rows(name)
            out = np.zeros((len(rows), len(of.field)), np.float32)
            known = of.field.known
            out[0], out[1] = np.where(known, of.field.value, np.nan), of.field.white
            out[2], out[3] = of.weight, of.flags
            for mode, column in zip(of.field.names, of.field.modes.T, strict=True):
                out[rows.index(mode)] = column
            _save(self.temperature_file(index, name), out)

    def vertices(self, index: int) -> Array:
        """(V, 3) the grid in a frame."""
        return np.asarray(_load(self.grid_file(index)), dtype=float)

    def temperatures(self, index: int) -> dict[str, CameraTemperature]:
        """A frame as it was put."""
        out = {}
        for name in self.cameras:
            path = self.temperature_file(index, name)
            if not path.is_file():
                continue
            rows, data = self.rows(name), np.asarray(_load(path), dtype=float)
            modes = tuple(r for k, r in enumerate(rows) if k >= len(_FIRST) and data[k].any())
            field = NodeField(data[0], data[1], np.stack([data[rows.index(m)] for m in modes], axis=1)
                              if modes else np.zeros((data.shape[1], 0)), modes, "K")  # fmt: skip
            out[name] = CameraTemperature(field, data[2], data[3].astype(np.uint16))
        return out

    def values(self, index: int, camera: str, most: int) -> Array | None:
        """(N,) kelvin of at most so many nodes, evenly taken, in a frame; None where the camera has none."""
        path = self.temperature_file(index, camera)
        if not path.is_file():
            return None
        row = _load(path)[0]
        return np.asarray(row[:: every(len(row), most)], dtype=float)

    def histories(self, camera: str, indices: Sequence[int], nodes: slice) -> dict[str, Array]:
        """Row -> (H, F) of a block of nodes in some frames; NaN and 0 where the camera has none."""
        rows = self.rows(camera)
        count = nodes.stop - nodes.start
        out = {r: np.full((count, len(indices)), np.nan if r == VALUE else 0.0) for r in rows}
        for f, index in enumerate(indices):
            path = self.temperature_file(index, camera)
            if path.is_file():
                data = _load(path)[:, nodes]
                for k, r in enumerate(rows):
                    out[r][:, f] = data[k]
        return out


def every(count: int, most: int) -> int:
    """Which nodes are taken where at most so many of them are: every first, second and so on."""
    return max(1, -(-count // most))


def _save(path: Path, array: NDArray[np.floating]) -> None:
    with atomic_path(path) as new, open(new, "wb") as stream:
        np.save(stream, array.astype(np.float32))


def _load(path: Path) -> Array:
    with reading(path):
        try:
            return np.load(path, mmap_mode="r", allow_pickle=False)
        except ValueError:
            raise DataError(f"{path} is damaged: it holds no array") from None
