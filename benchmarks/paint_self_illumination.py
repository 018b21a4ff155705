"""Self-illumination of a corner of two plates: ``python benchmarks/paint_self_illumination.py``.

Form factors of the floor's nodes towards the wall against the closed form (Howell's catalogue, B-4), for several grids
and numbers of facets; their sum over the floor against 0.20004; light of paint that is 0.6 reflecting, with all its
reflections, and what is left of the error when it is taken off again with a factor of other facets; thread seconds.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from numpy.typing import NDArray

from windmark.paint import NodeField, add_self_illumination, form_factors, remove_self_illumination
from windmark.paint.form_factors import _seats
from windmark.scene import Mesh, structured_triangles

Array = NDArray[np.float64]


def corner(n: int) -> Mesh:
    """Two unit squares at a right angle, n x n nodes each."""
    a, b = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    z, t = np.zeros_like(a), structured_triangles(n, n)
    xyz = np.concatenate([np.stack([a, b, z], axis=1), np.stack([z, a, b], axis=1)])
    return Mesh.make(xyz, np.concatenate([t, t + n * n]))


def wall_factor(x: Array, y: Array) -> Array:
    """The closed form."""

    def half(width: Array) -> Array:
        h, c = 1 / width, x / width
        s = np.hypot(h, c)
        return np.asarray((np.arctan(1 / c) - c / s * np.arctan(1 / s)) / (2 * np.pi))

    return half(y) + half(1 - y)


def main(quick: bool = False) -> dict[str, dict[str, float]]:
    """Measure, print the table, return it."""
    form_factors(corner(5), facets=10)  # compiled
    rows: dict[str, dict[str, float]] = {}
    cases = ((21, 100), (21, 1600)) if quick else ((21, 100), (21, 1600), (41, 400), (41, 1500), (61, 1500))
    fine = corner(cases[-1][0])
    reference = form_factors(fine, facets=cases[-1][1])
    for n, facets in cases:
        mesh = corner(n)
        start = time.thread_time()
        factors = form_factors(mesh, facets=facets)
        seconds = time.thread_time() - start
        at = _seats(mesh)
        floor = (np.arange(len(at)) < n * n) & (at[:, 1] > 1e-3) & (at[:, 1] < 1 - 1e-3)
        off = np.abs(factors.seen[floor] - wall_factor(at[floor, 0], at[floor, 1]))
        weight = np.bincount(mesh.triangles[: 2 * (n - 1) ** 2].ravel(), minlength=len(at))
        row = {"mean error": float(off.mean()), "largest error": float(off.max()),
               "whole floor (0.20004)": float(weight @ factors.seen / weight.sum()), "cpu-s": seconds}  # fmt: skip
        if n == cases[-1][0]:
            own = 1 + 0.5 * np.sin(5 * mesh.vertices @ [1.0, 0.7, 0.4])
            light, bounces = add_self_illumination(own, reference, 0.6)
            got = remove_self_illumination(NodeField.make(light), factors, 0.6).field.value
            row |= {"bounces": bounces, "light before, worst %": float(100 * np.abs(light / own - 1).max()),
                    "light after, worst %": float(100 * np.abs(got / own - 1).max())}  # fmt: skip
            coarse = remove_self_illumination(NodeField.make(light), form_factors(mesh, facets=facets // 4), 0.6)
            row["after, a quarter of the facets, worst %"] = float(100 * np.abs(coarse.field.value / own - 1).max())
        rows[f"{2 * n * n} nodes, {facets} facets"] = row
    for name, row in rows.items():
        print(name)
        for key, value in row.items():
            print(f"    {key:45}{value:12.5g}")
    return rows


if __name__ == "__main__":
    main(quick="--quick" in sys.argv)
