"""Pressure taps of the virtual half model: three chordwise rows on both sides of the wing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from windmark import io
from windmark.scene import MarkerSet
from windmark.synth import HalfModel

ETAS = (0.3, 0.55, 0.8)
"""Span stations of the rows, parts of the span."""
CHORDS = (0.03, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.92, 0.98)
"""Places of the taps in a row, parts of the chord."""
DIAMETER = 0.8


def tap_table(shape: HalfModel | None = None) -> MarkerSet:
    """The taps with their names such as U55-35 (upper side, 55 % span, 35 % chord), places, normals and radius."""
    shape = HalfModel() if shape is None else shape
    names, points, normals = [], [], []
    patches = shape.patches()
    for side, block in (("U", "wing_upper"), ("L", "wing_lower")):
        for eta in ETAS:
            t = (eta * shape.span - shape.wing_root) / (shape.span - shape.wing_root)
            s = np.arccos(1 - 2 * np.array(CHORDS)) / np.pi  # x/c = (1 - cos(pi s)) / 2
            xyz, normal = patches[block].place(s, np.full(len(s), t))
            names += [f"{side}{100 * eta:02.0f}-{100 * c:02.0f}" for c in CHORDS]
            points.append(xyz)
            normals.append(normal)
    return MarkerSet.make(
        names, np.round(np.concatenate(points), 4), normal=np.round(np.concatenate(normals), 6), volume="wing",
        role="tap", radius=DIAMETER / 2,
    )  # fmt: skip


def write_taps(folder: Path, shape: HalfModel) -> None:
    """Write ``taps.csv`` and ``taps.tgts``, see `tap_table`."""
    taps = tap_table(shape)
    xyz, normal = taps.xyz, np.round(taps.normal, 6)
    io.write_table(folder / "taps.csv", {
        "name": taps.name, **{a: xyz[:, k] for k, a in enumerate("xyz")},
        **{f"n{a}": normal[:, k] for k, a in enumerate("xyz")}, "volume": taps.volume, "role": taps.role,
    })  # fmt: skip
    rows = [
        " ".join([str(k + 1), *(f"{v:.4f}" for v in xyz[k]), *(f"{v:.6f}" for v in normal[k]), f"{DIAMETER}", "1 0 0",
                  name])
        for k, name in enumerate(taps.name.tolist())
    ]  # fmt: skip
    with io.atomic_write(folder / "taps.tgts") as stream:
        stream.write("# index x y z nx ny nz size zone i j name\n*Taps\n" + "\n".join(rows) + "\n")
