"""Built-in deformation laws at work on a model that everybody has: the half model of the virtual wind tunnel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Law
from windmark.deformation.laws import CATALOG, CantileverModes, make_law
from windmark.synth import HalfModel

Array = NDArray[np.float64]

UNIT = "mm"
MODEL = HalfModel()
HALF = f"a half wing of {MODEL.span:g} {UNIT} span"


@dataclass(frozen=True)
class Shown:
    """A law on the lines of a model.

    Parameters
    ----------
    law : the law
    model : what it is shown on, in words
    moving, still : lines (n, 3) that it moves and that it does not
    beyond : lines that are drawn where they fall into the picture of the others
    axis : (2, 3) line drawn in red, None for none
    axis_name : what it is
    """

    law: Law
    model: str
    moving: Sequence[Array]
    still: Sequence[Array] = ()
    beyond: Sequence[Array] = ()
    axis: Array | None = None
    axis_name: str = ""


def example(kind: str) -> Shown:
    """A built-in law with the options of its example, on the virtual wind tunnel's half model."""
    options: dict[str, Any] = dict(CATALOG[kind].example)
    points = wing_points()
    law = make_law(kind, options, unit=UNIT, points=points, table=_plate_modes(points))
    wing, body = wing_lines(), body_lines()
    if kind == "hinge":
        flap = wing_lines(s=(2 / 3, 1.0), y=(180.0, 480.0), count=(4, 7))
        return Shown(law, f"flap of {HALF}", flap, wing, body, _ends(options, "start", "end"), "hinge line")
    if kind == "sting":
        whole = [line * side for line in [*wing, *body] for side in ([1, 1, 1], [1, -1, 1])]
        words = f"model of {2 * MODEL.span:g} {UNIT} span"
        return Shown(law, words, whole, axis=_ends(options, "root", "end"), axis_name="sting")
    if kind == "rigid":
        return Shown(law, f"half model of {MODEL.span:g} {UNIT} span", [*wing, *body])
    if "root" in options:
        return Shown(law, HALF, wing, beyond=body, axis=_ends(options, "root", "tip"), axis_name="elastic axis")
    return Shown(law, HALF, wing, beyond=body)


def of_user(law: Law) -> Shown:
    """A user's law on the half wing."""
    return Shown(law, HALF, wing_lines(), beyond=body_lines())


def wing_points() -> Array:
    """(48, 3) points on the wing's upper surface, as markers would be."""
    s, t = np.meshgrid(np.linspace(0.15, 0.85, 6), np.linspace(0.08, 0.98, 8))
    return MODEL.wing_surface(s.ravel(), t.ravel(), 1.0)


def wing_lines(
    s: tuple[float, float] = (0.0, 1.0),
    y: tuple[float, float] = (MODEL.body_radius, MODEL.span),
    count: tuple[int, int] = (6, 10),
) -> list[Array]:
    """Lines of the wing's upper surface along the span and along the chord."""  # fmt: skip
    t0, t1 = ((v - MODEL.wing_root) / (MODEL.span - MODEL.wing_root) for v in y)
    return _net(lambda a, b: MODEL.wing_surface(a, t0 + b * (t1 - t0), 1.0), s, count)


def body_lines() -> list[Array]:
    """Lines of the half body."""
    return _net(MODEL.body_surface, (0.0, 1.0), (11, 5))


def _net(surface: Callable[[Array, Array], Array], s: tuple[float, float], count: tuple[int, int]) -> list[Array]:
    fine = np.linspace(0, 1, 41)
    across, along = (np.linspace(*ends, n) for ends, n in zip((s, (0.0, 1.0)), count, strict=True))
    lines = [surface(np.full(41, v), fine) for v in across]
    return lines + [surface(s[0] + fine * (s[1] - s[0]), np.full(41, v)) for v in along]


def _plate_modes(nodes: Array) -> tuple[Array, Array]:
    """Two modes as a structural model would give them at nodes of the wing: up, by the span."""
    station = (nodes[:, 1] - MODEL.body_radius) / (MODEL.span - MODEL.body_radius)
    shapes = np.zeros((len(nodes), 3, 2))
    shapes[:, 2] = CantileverModes(2).value(np.clip(station, 0.0, None))
    return nodes, shapes


def _ends(options: Mapping[str, Any], a: str, b: str) -> Array:
    return np.array([options[a], options[b]], dtype=float)
