"""Datums of a calibration: what fixes position, direction and size. There is no default; a guess would be wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from windmark.scene import MarkerCovariance


@dataclass(frozen=True)
class Fixed:
    """Some markers stay where they are; at least three, not on one line.

    Parameters
    ----------
    markers : their names; None holds all, so that only cameras and poses are found

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> table = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)))
    >>> camera, eyes = wm.Camera((640, 480), 500.0), [(-3, 0, 6), (3, 0, 6)]
    >>> xy = [camera.project(wm.Pose.look_at(eye, [0, 0, 0], [1, 0, 0]).apply(table.xyz))[0] for eye in eyes]
    >>> seen = wm.Observations(*np.divmod(np.arange(40), 20), np.concatenate(xy), np.tile(0.01 * np.eye(2), (40, 1, 1)))
    >>> views = [wm.View("left"), wm.View("right")]
    >>> found = wm.self_calibrate(seen, table, {"camera": camera}, views, datum=wm.Fixed(), free=["focal_px"])
    >>> np.array_equal(found.markers.xyz, table.xyz)  # cameras and poses alone were found
    True
    """

    markers: Sequence[str] | None = None


@dataclass(frozen=True)
class Weighted:
    """Some markers are known with a standard deviation, that of the table or the one given, or with a joint covariance.

    Parameters
    ----------
    markers : their names; None takes all with a finite sigma in the table, and those of the covariance
    sigma : one standard deviation for all their coordinates, in the length unit; None takes the table's
    covariance : of those of them whose errors are correlated, as of one survey; it counts in place of their sigma

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> true = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)))
    >>> camera, eyes = wm.Camera((640, 480), 500.0), [(-3, 0, 6), (3, 0, 6), (0, 3, 6)]
    >>> xy = [camera.project(wm.Pose.look_at(eye, [0, 0, 0], [1, 0, 0]).apply(true.xyz))[0] for eye in eyes]
    >>> seen = wm.Observations(*np.divmod(np.arange(60), 20), np.concatenate(xy), np.tile(0.01 * np.eye(2), (60, 1, 1)))
    >>> rough = wm.MarkerSet.make(true.name, true.xyz + rng.normal(0.0, 0.005, (20, 3)))
    >>> views, surveyed = [wm.View(f"view{i}") for i in range(3)], wm.Weighted(sigma=0.005)
    >>> found = wm.self_calibrate(seen, rough, {"camera": camera}, views, datum=surveyed, free=[])
    >>> bool(found.markers.sigma.max() < 0.005)  # the pictures know more than the survey
    True
    """

    markers: Sequence[str] | None = None
    sigma: float | None = None
    covariance: MarkerCovariance | None = None


@dataclass(frozen=True)
class Free:
    """Free network: the markers neither shift, turn nor (without known distances) grow on average.

    Coordinates come out fitted to those of the table, covariances are the smallest there are.

    Parameters
    ----------
    markers : those that hold it, by name; None takes all

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> true = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)))
    >>> camera, eyes = wm.Camera((640, 480), 500.0), [(-3, 0, 6), (3, 0, 6), (0, 3, 6)]
    >>> xy = [camera.project(wm.Pose.look_at(eye, [0, 0, 0], [1, 0, 0]).apply(true.xyz))[0] for eye in eyes]
    >>> seen = wm.Observations(*np.divmod(np.arange(60), 20), np.concatenate(xy), np.tile(0.01 * np.eye(2), (60, 1, 1)))
    >>> rough = wm.MarkerSet.make(true.name, true.xyz + rng.normal(0.0, 0.02, (20, 3)))
    >>> views = [wm.View(f"view{i}") for i in range(3)]
    >>> found = wm.self_calibrate(seen, rough, {"camera": camera}, views, datum=wm.Free(), free=[])
    >>> shift = found.markers.xyz.mean(axis=0) - rough.xyz.mean(axis=0)
    >>> bool(abs(shift).max() < 1e-6)  # single markers moved, their centre did not
    True
    >>> bool(abs(found.markers.xyz - rough.xyz).max() > 0.01)
    True
    """

    markers: Sequence[str] | None = None


@dataclass(frozen=True)
class Distance:
    """A known distance between two markers.

    Parameters
    ----------
    first, second : names
    length, sigma : in the length unit

    Examples
    --------
    >>> import windmark as wm
    >>> scale_bar = wm.Distance("a", "b", 500.0, sigma=0.05)
    >>> round(scale_bar.sigma / scale_bar.length, 6)  # how well the scale of a free network becomes known by it
    0.0001
    """

    first: str
    second: str
    length: float
    sigma: float


Datum = Fixed | Weighted | Free
