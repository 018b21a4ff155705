"""Pictures of deformation laws: a model at rest and moved by one parameter at a time, in perspective."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from windmark.app.laws_examples import UNIT, Shown
from windmark.app.pictures import BLUE, RED, WIDTH_IN
from windmark.deformation import Parameter
from windmark.errors import g3
from windmark.geometry import Camera, Pose
from windmark.scene.plots import round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

GREY = "#b0b0b0"
SHOWN = 6
"""Parameters that get a panel."""
MOST, MOST_DEG = 75.0, 20.0
"""A panel moves no point by more than this, and turns by no more than this; rounded down."""
COLUMNS = 3


def law_picture(name: str, shown: Shown) -> Figure:
    """One panel for each parameter: grey at rest, blue moved."""
    parameters = shown.law.parameters
    picked = parameters[:SHOWN]
    columns = min(len(picked), COLUMNS)
    rows = -(-len(picked) // columns)
    project = _camera(shown)
    states = [_state(shown, j) for j in range(len(picked))]
    frame = _frame(shown, [moved for _, moved in states], project)
    height = WIDTH_IN / COLUMNS * frame[1] / frame[0] + 0.55
    figure = Figure(figsize=(WIDTH_IN * max(columns, 2) / COLUMNS, height * rows + 0.7), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.ravel():
        axes.set_axis_off()
    for parameter, state, axes in zip(picked, states, grid.ravel(), strict=False):
        _draw(axes, shown, parameter, *state, frame, project)
    rest = f"; {len(parameters) - len(picked)} more parameters" if len(parameters) > len(picked) else ""
    figure.suptitle(f"{name}: one parameter at a time, {shown.model}{rest}", fontsize=11)
    handles = [Line2D([], [], color=GREY, label="at rest"), Line2D([], [], color=BLUE, label="moved")]
    if shown.axis is not None:
        handles.append(Line2D([], [], color=RED, ls="--", label=shown.axis_name))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, frameon=False)
    return figure


def amount(parameter: Parameter, size: float) -> float:
    """A round value of a parameter that shows, one unit of which moves the farthest point by ``size``."""
    most = MOST / size if size > 0 else 1.0
    return round_length(min(most, MOST_DEG) if parameter.unit == "deg" else most)


def _camera(shown: Shown) -> Callable[[Array], Array]:
    """Perspective from behind and above, the span to the right, so that bending, twist and sway all show."""
    every = np.concatenate(_framed(shown))
    target = (every.min(axis=0) + every.max(axis=0)) / 2
    far = 2.2 * float(np.ptp(every, axis=0).max())
    pose = Pose.look_at(target + far * np.array([0.72, 0.42, 0.5]), target, [0.0, 0.0, 1.0])
    camera = Camera((1000, 1000), 1500.0)
    return lambda xyz: camera.project(pose.apply(xyz))[0]


def _framed(shown: Shown) -> list[Array]:
    return [*shown.moving, *shown.still, *([] if shown.axis is None else [shown.axis])]


def _state(shown: Shown, j: int) -> tuple[float, Array]:
    """A value of a parameter that shows, and where the moving lines' points are then."""
    points, q = np.concatenate(shown.moving), np.array([p.start for p in shown.law.parameters])
    bound = shown.law.bind(points)
    size = float(np.linalg.norm(bound.linearise(q)[1][..., j], axis=1).max())
    q[j] += amount(shown.law.parameters[j], size)
    return float(q[j]), bound.place(q)


def _frame(shown: Shown, moved: list[Array], project: Callable[[Array], Array]) -> tuple[float, float, Array]:
    """Width, height and middle of what all panels show, the same for all so that they can be compared."""
    every = project(np.concatenate([*_framed(shown), *moved]))
    low, high = every.min(axis=0), every.max(axis=0)
    size = 1.12 * (high - low)
    return float(size[0]), float(size[1]), (low + high) / 2


def _draw(
    axes: Axes,
    shown: Shown,
    parameter: Parameter,
    value: float,
    moved: Array,
    frame: tuple[float, float, Array],
    project: Callable[[Array], Array],
) -> None:
    rest, ends = np.concatenate(shown.moving), np.cumsum([len(line) for line in shown.moving])[:-1]
    for lines, colour in (([*shown.beyond, *shown.still, *shown.moving], GREY), (np.split(moved, ends), BLUE)):
        axes.add_collection(LineCollection([project(v) for v in lines], colors=colour, linewidths=0.9))
    if shown.axis is not None:
        axes.plot(*project(shown.axis).T, color=RED, lw=1.2, ls="--")
    width, height, (x, y) = frame
    axes.set(xlim=(x - width / 2, x + width / 2), ylim=(y + height / 2, y - height / 2), aspect="equal")
    farthest = float(np.linalg.norm(moved - rest, axis=1).max())
    unit = f" {parameter.unit}" if parameter.unit else ""
    axes.set_title(f"{parameter.name} = {value:g}{unit}\nlargest displacement {g3(farthest)} {UNIT}", fontsize=9.5)
