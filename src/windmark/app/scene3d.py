"""What a page shows in 3D, said once: surface, fields with sigma, cameras, markers, cuts, a sequence of shapes.

`windmark.app.scene_document` makes the page's data of it, ``web/`` draws it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.geometry import Camera, Pose
from windmark.scene import Mesh

Array = NDArray[np.float64]

STATION_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00")
"""Told apart by colour-blind people: M. Okabe, K. Ito, Color Universal Design (2008)."""


@dataclass(frozen=True, eq=False)
class Shifts:
    """Where markers seem to be, less where they are, as the chosen picture has it.

    Parameters
    ----------
    vectors : (N, 3) in length units; NaN for markers without
    factor : by which they are drawn larger
    words : what they are, with the factor
    notes : one line per marker for its pop-up, "" for none
    """

    vectors: Array
    factor: float
    words: str
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Field:
    """Values at the nodes of the surface.

    Parameters
    ----------
    key : by which the page finds it
    name : as it is chosen
    label : of the colour bar, with the unit
    values, sigma : (V,), NaN where there are none; no sigma: None
    diverging : colours that diverge from zero
    limits : of the colours; by default all values but the outermost
    shifts : of the markers, beside this field
    frame : of a sequence, which this is of; with the slider go the fields of one label
    coarse : packed as `packing.COARSE` is, as all are where there are many
    """

    key: str
    name: str
    label: str
    values: Array
    sigma: Array | None = None
    diverging: bool = False
    limits: tuple[float, float] | None = None
    shifts: Shifts | None = None
    frame: int | None = None
    coarse: bool = False


@dataclass(frozen=True, eq=False)
class Station:
    """A camera: its name, its lens and its place; ``notes`` for its pop-up; cameras of one ``colour`` are one.

    ``far``: how far its view is drawn, of the way to the middle of the model.
    """

    name: str
    camera: Camera
    cam_from_model: Pose
    colour: str = STATION_COLOURS[0]
    notes: tuple[str, ...] = ()
    far: float = 1.0


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers as they are shown.

    Parameters
    ----------
    names, xyz : (N,), (N, 3)
    cov : (N, 3, 3) for the ellipsoids; None for none
    notes : lines per marker for its pop-up
    groups : colour, words and numbers of the markers that are drawn in another colour than the others
    """

    names: tuple[str, ...]
    xyz: Array
    cov: Array | None = None
    notes: tuple[tuple[str, ...], ...] = ()
    groups: tuple[tuple[str, str, tuple[int, ...]], ...] = ()


@dataclass(frozen=True, eq=False)
class Cut:
    """A line: points (N, 3), and of which piece each is (N,)."""

    name: str
    xyz: Array
    piece: NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Frames:
    """Several times: shapes of the surface, places of markers and cameras.

    Parameters
    ----------
    labels : what the slider says of each
    moved : (F, V, 3) displacement of the nodes; V is 0 without a surface
    sigma : (F, V) of its length; None without
    magnify : by which it is drawn larger at first
    label : of the colour bar of its length; "" where it is no field
    markers : (F, N, 3) displacement of the scene's markers; None: they stand still
    stations : the cameras of each time, beside the scene's, which stand still
    shifts : of the markers at each time; those of fields that have a ``frame`` stand there
    first : the time that is shown first; None: of the largest displacement
    """

    labels: tuple[str, ...]
    moved: NDArray[np.float32]
    sigma: NDArray[np.float32] | None
    magnify: float
    label: str
    markers: NDArray[np.float32] | None = None
    stations: tuple[tuple[Station, ...], ...] = ()
    shifts: tuple[Shifts | None, ...] = ()
    first: int | None = None


@dataclass(frozen=True, eq=False)
class Scene3D:
    """Everything that turns.

    Parameters
    ----------
    unit : of lengths
    ahead, up : the first look: direction of sight, and what is upwards
    focus : (N, 3) points that must be in view; the surface and the markers by default
    fields : what the surface can be coloured by; one may be made when it is packed, several at a time
    chosen : the field that is shown first
    cuts_are : what the cuts are called
    """

    unit: str
    ahead: Array
    up: Array
    mesh: Mesh | None = None
    fields: Sequence[Field | Callable[[], Field]] = ()
    stations: Sequence[Station] = ()
    markers: Markers | None = None
    cuts: Sequence[Cut] = ()
    frames: Frames | None = None
    focus: Array = field(default_factory=lambda: np.zeros((0, 3)))
    chosen: int = 0
    cuts_are: str = "sections"


def looking_over(pose: Pose, focus: Array) -> tuple[Array, Array]:
    """Direction of sight and upwards, from a little higher and more to the left than a camera, so that relief shows."""
    right, down = pose.rotation[0], pose.rotation[1]
    ahead = focus.mean(axis=0) - pose.center if len(focus) else pose.rotation[2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-300)
    return ahead + 0.35 * down + 0.5 * right, -down
