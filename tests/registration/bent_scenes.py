"""Virtual images of bent models: wings whose tips move, with and without twist, and rows of rivets beside the markers.

The table stays that of the straight model; only the picture is of the bent one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import registration_scenes as scenes
from numpy.typing import NDArray

from windmark.scene import Detections, MarkerSet

Array = NDArray[np.float64]

SHAPES = ("quadratic", "cantilever")
ROOT = 0.12
"""Where the wings of kind B begin (half the body's width); they end one unit farther out."""


@dataclass(frozen=True)
class Bend:
    """How a wing is bent.

    Parameters
    ----------
    tip : displacement of the tip as part of the span
    shape : a name in `SHAPES`: s^2 or that of a beam with a uniform load, s = 0 at the root and 1 at the tip
    twist_deg : of the tip, growing linearly from the root
    wings : which wings of kind B bend: "both" or "right"
    """

    tip: float
    shape: str = "quadratic"
    twist_deg: float = 0.0
    wings: str = "both"


def bent_xyz(markers: MarkerSet, kind: str, bend: Bend) -> Array:
    """(N, 3) where the markers are on the bent model; the wing keeps its length, the body its shape."""
    xyz = markers.xyz.copy()
    y = xyz[:, 1]
    out = np.abs(y) - ROOT if kind == "B" else y
    side = np.sign(y) if kind == "B" else np.ones(len(y))
    moves = out > 0
    if kind == "B":
        moves[30:] = False
        moves &= (side > 0) | (bend.wings == "both")
    # Of a model with two wings the span is from tip to tip.
    height = bend.tip * (2 * (1 + ROOT) if kind == "B" else 1.0)
    s = np.linspace(0, 1.3, 400)
    w = height * (s**2 if bend.shape == "quadratic" else s**2 * (6 - 4 * s + s**2) / 3)
    shorter = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(w) ** 2 / np.diff(s))])
    chord_axis = 0.35 * out + 0.4 * (0.45 - 0.2 * out) + (0.3 if kind == "B" else 0.0)
    twist = np.radians(bend.twist_deg) * out
    xyz[moves, 2] += (np.interp(out, s, w) - np.sin(twist) * (xyz[:, 0] - chord_axis))[moves]
    xyz[moves, 1] -= (side * np.interp(out, s, shorter))[moves]
    return xyz


def scene(
    seed: int, kind: str, bend: Bend, *, hidden: float = 0.0, false: float = 0.0, rivets: bool = False
) -> tuple[scenes.Scene, Array]:
    """A random image of a bent model of kind A or B with the straight table, and where its markers really are.

    With ``rivets`` two rows of false spots run beside rows of markers, 0.35 of the distance of the rows away.
    """
    rng = np.random.default_rng(seed)
    markers = scenes.wing_and_body(rng) if kind == "B" else scenes.wing(rng)
    camera, pose = scenes.random_view(rng, markers)
    xyz = bent_xyz(markers, kind, bend)
    image = scenes.image_of(rng, MarkerSet.make(markers.name, xyz, normal=markers.normal), camera, pose,
                            hidden=hidden, false=false)  # fmt: skip
    spots, label = image.detections.xy, image.label
    sigma = float(np.sqrt(image.detections.cov[0, 0, 0]))
    if rivets:
        row = _rivets(rng, xyz, kind)
        seen, _ = scenes.visible(MarkerSet.make([str(n) for n in range(len(row))], row), camera, pose)
        seen = seen[camera.in_image(seen)] + rng.normal(0, sigma, (int(camera.in_image(seen).sum()), 2))
        spots, label = np.concatenate([spots, seen]), np.concatenate([label, np.full(len(seen), -1)])
        order = rng.permutation(len(spots))
        spots, label = spots[order], label[order]
    return scenes.Scene(Detections.make(spots, sigma_px=sigma), markers, camera, pose, label), xyz


def _rivets(rng: np.random.Generator, xyz: Array, kind: str) -> Array:
    """Two rows of rivets along the (right) wing, each beside a row of markers."""
    rows, columns = (3, 5) if kind == "B" else (4, 6)
    grid = xyz[: rows * columns].reshape(columns, rows, 3)
    made = []
    for row in (0, rows - 2):
        line = 0.65 * grid[:, row] + 0.35 * grid[:, row + 1]
        t = np.linspace(0, columns - 1, 2 * columns)
        made.append(np.stack([np.interp(t, np.arange(columns), line[:, k]) for k in range(3)], axis=1))
    row_of = np.concatenate(made)
    return row_of + rng.normal(0, 0.001, row_of.shape)
