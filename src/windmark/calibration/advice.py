"""Which picture would help: what is not determined, asked of pictures that could be taken besides.

Not a rule of thumb: each candidate is added to the network, with the marks that it would have, and the covariance says
what it does (experimental design; Fraser, Photogrammetric Engineering 48, 1982, "first-order design").
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windmark.adjust.network import Network, NetworkProblem, NetworkState
from windmark.adjust.network.covariance import network_covariance
from windmark.adjust.network.datum import in_datum
from windmark.adjust.network.problem import camera_columns
from windmark.calibration.solve import Solved
from windmark.geometry import PARAMETERS, Pose

Array = NDArray[np.float64]

ROLL_DEG, TILT_DEG = 90.0, 35.0
NEARER, FARTHER = 0.6, 1.6
"""Distances of the candidates, in parts of that of the picture they start from."""
LEAST_MARKS = 4
ASKED = 30
"""Pictures of a network that take part, or up to twice as many."""
LOOSE = 10.0
"""1 sigma in natural units with which everything is known."""
ENOUGH, HELPS, MOST = 0.5, 2.0, 4
"""Pictures are added until the worst sigma is below this part of what counts as weak, and divided by so much at least;
no more than so many."""
SAME = 0.8
"""Of two candidates the first named one is taken unless the other's sigmas are smaller than this part of its."""


def helpful_pictures(
    solved: Solved, rough: NetworkState, poor: Sequence[tuple[int, str]], weak: float
) -> tuple[str, ...]:
    """Pictures that make the ``poor`` parameters sure, the best one first, in words; () where none do.

    One by one: the next is that with which the ones before leave the least open.

    Parameters
    ----------
    solved : the network that leaves them open
    rough : what the adjustment began with: where the pictures tell little it is nearer to the truth than the
        adjustment is, whose depths and directions are noise
    poor : number of the camera and name of each parameter
    weak : 1 sigma in natural units above which something is not determined
    """
    if not poor or rough.offsets is not None:  # of a rig a whole instant would have to be added
        return ()
    network, state = _some(_loosely_known(solved.problem, rough)), rough
    worst, named = _worst(network, state, poor), list[str]()
    before, target = worst, min(ENOUGH * weak / np.sqrt(solved.scale), worst / HELPS)
    first = int(np.bincount(network.view, minlength=len(network.view_camera)).argmax())
    while worst > target and len(named) < MOST:
        best: tuple[float, str, Network, NetworkState] | None = None
        for words, pose in _candidates(network, state, first):
            if words in named or (more := _with_picture(network, state, first, pose)) is None:
                continue
            left = _worst(*more, poor)
            if best is None or left < SAME * best[0]:
                best = left, words, *more
        if best is None:
            break
        worst, words, network, state = best
        named.append(words)
    return tuple(named) if worst <= before / HELPS else ()


def _candidates(network: Network, state: NetworkState, view: int) -> Iterator[tuple[str, Pose]]:
    """Words and pose of each picture that could be taken, starting from one that there is."""
    frame = network.view_frame[view]
    pose = Pose(state.frames.rotation[frame], state.frames.translation[frame])
    seen = pose.apply(state.points[network.point[network.view == view]])
    middle = seen.mean(axis=0)
    yield f"with the camera rolled by {ROLL_DEG:.0f} degrees", _turned(pose, [0, 0, ROLL_DEG], np.zeros(3))
    for axis in ([TILT_DEG, 0, 0], [0, TILT_DEG, 0], [-TILT_DEG, 0, 0], [0, -TILT_DEG, 0]):
        yield f"from {TILT_DEG:.0f} degrees to the side", _turned(pose, axis, middle)
    for part, words in ((NEARER, "from nearer"), (FARTHER, "from farther away")):
        yield words, Pose(pose.rotation, pose.translation + (part - 1) * middle)
    yield "with the markers in a corner of it", _turned(pose, _towards_corner(state, network, view), np.zeros(3))


def _turned(pose: Pose, degrees: ArrayLike, about: Array) -> Pose:
    """The pose after the scene turns about a point of the camera's frame."""
    turn = Pose.from_rotvec(np.radians(np.asarray(degrees, dtype=float)), np.zeros(3))
    return Pose(np.eye(3), about) @ turn @ Pose(np.eye(3), -about) @ pose


def _towards_corner(state: NetworkState, network: Network, view: int) -> Array:
    """Degrees that bring what is in the middle a quarter of the picture aside."""
    camera = state.cameras[network.view_camera[view]]
    width, height = camera.size_px
    up, across = np.degrees(np.arctan2([0.25 * height, 0.25 * width], camera.focal_px))
    return np.array([up, across, 0.0])


def _with_picture(network: Network, state: NetworkState, view: int, pose: Pose) -> tuple[Network, NetworkState] | None:
    """The network with one picture more, with marks of the markers that the ``view`` it starts from has."""
    mine = np.flatnonzero(network.view == view)
    camera = state.cameras[network.view_camera[view]]
    xy = camera.project(pose.apply(state.points[network.point[mine]]))[0]
    inside = camera.in_image(xy)
    mine, xy = mine[inside], xy[inside]
    if len(mine) < LEAST_MARKS:
        return None
    views, frames = len(network.view_camera), len(network.free_frame)
    wider = replace(
        network, view=np.r_[network.view, np.full(len(mine), views)], point=np.r_[network.point, network.point[mine]],
        xy=np.concatenate([network.xy, xy]), cov=np.concatenate([network.cov, network.cov[mine]]),
        view_camera=np.r_[network.view_camera, network.view_camera[view]],
        view_frame=np.r_[network.view_frame, frames], view_offset=np.r_[network.view_offset, -1],
        free_frame=np.r_[network.free_frame, True],
        free_change=_with_row(network.free_change, False), change_sigma=_with_row(network.change_sigma, np.inf),
        weight=None if network.weight is None else np.r_[network.weight, network.weight[mine]],
    )  # fmt: skip
    stations = Pose(
        np.concatenate([state.frames.rotation, pose.rotation[None]]),
        np.concatenate([state.frames.translation, pose.translation[None]]),
    )
    return wider, replace(state, frames=stations, change=_with_row(state.change, 0.0))


def _with_row(table: NDArray[Any] | None, value: float) -> NDArray[Any] | None:
    """One row more, all of the same value; None stays None."""
    return None if table is None else np.vstack([table, np.full_like(table[:1], value)])


def _some(network: Network) -> Network:
    """The marks of `ASKED` pictures, taken evenly: what all of a large network leave open these do, too."""
    used = np.flatnonzero(network.used_view)
    kept = np.isin(network.view, used[:: max(1, len(used) // ASKED)])
    weight = None if network.weight is None else network.weight[kept]
    return replace(
        network, view=network.view[kept], point=network.point[kept], xy=network.xy[kept], cov=network.cov[kept],
        weight=weight,
    )  # fmt: skip


def _loosely_known(problem: NetworkProblem, state: NetworkState) -> Network:
    """Everything known to `LOOSE` natural units: what pictures leave open has a large sigma then, no infinite one."""
    network, unit = problem.network, problem.units(state).camera
    sigma = [
        {name: float(LOOSE * unit[c, PARAMETERS.index(name)]) for name in free}
        for c, free in enumerate(network.free_camera)
    ]
    both = zip(state.cameras, sigma, strict=True)
    value = [{name: float(getattr(camera, name)) for name in own} for camera, own in both]
    return replace(
        network, camera_value=value, camera_sigma=sigma, point_value=state.points,
        point_sigma=np.full(state.points.shape, LOOSE * problem.layout.unit),
    )  # fmt: skip


def _worst(network: Network, state: NetworkState, poor: Sequence[tuple[int, str]]) -> float:
    """Largest 1 sigma of the parameters, in natural units."""
    problem = NetworkProblem(network, state)
    system = problem.linearise(state)
    assert system is not None
    covariance = in_datum(network_covariance(system, problem.layout))
    columns = [column for c, name, column in camera_columns(problem.layout) if (c, name) in poor]
    return float(np.sqrt(np.diagonal(covariance.dense())[columns].max(initial=0.0)))
