"""Heat that flows along the surface, frame by frame: what of it is sure, and what of it stays in the sigma."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.paint import NodeField, lateral_conductance, lateral_scales, widest_agreed
from windmark.pipeline.infrared.load import InfraredRun

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ALONG = "along the surface"
"""Name of the cause: heat that flows along the surface, which one-dimensional conduction leaves out."""
BY_CHANCE = 0.05
"""Part of the nodes that noise alone may flag, all scales together."""
REACH = 3.0
"""Radius of the widest discs, in lengths that heat has gone along the surface: sqrt(diffusivity t). Flows of longer
waves are less than a tenth of the flux."""


@dataclass(frozen=True, eq=False)
class AlongSurface:
    """Of V nodes in a frame.

    Parameters
    ----------
    sure : (V,) heat that surely flows along the surface, W / m2
    sigma : (V,) what may flow there: the best estimate and its noise, with the estimate's sign
    """

    sure: Array
    sigma: Array


class Sideways:
    """Asks one frame after the other for heat along the surface.

    Parameters
    ----------
    known : (V,) nodes that have a heat flux in most frames
    initial : (V,) temperature before the heating, and its variance by noise
    temperature : a frame's number -> its merged temperature; None without one
    frames : of which there are temperatures, in their order
    """

    def __init__(
        self, run: InfraredRun, known: Mask, initial: tuple[Array, Array],
        temperature: Callable[[int], NodeField | None], frames: Sequence[int],
    ) -> None:  # fmt: skip
        assert run.project.heat is not None
        self._run, self._initial, self._start = run, initial, run.project.heat.start_s
        scaled = replace(run.mesh, vertices=run.mesh.vertices * run.metres)
        widest = REACH * self._length(float(run.times[frames[-1]]) - self._start)
        self._scales = lateral_scales(scaled, known & np.isfinite(initial[0]), widest)
        self._times = self._excess = np.ones(0)
        if self._scales:
            from scipy.stats import norm

            self._times = norm.isf(BY_CHANCE / 2 / np.arange(1, len(self._scales) + 1))
            self._excess = self._more_than_said([temperature(i) for i in frames[-3:]])

    def _length(self, since: float) -> float:
        """Root of diffusivity times time: heat along the surface over heat taken up, of 1 K, in the slowest wall."""
        if since <= 0:
            return 0.0
        along = [lateral_conductance(w, since) * since / float(w.ramp_response([since])[0]) for w in self._run.walls]
        return float(np.sqrt(max(along)))

    def _more_than_said(self, last: Sequence[NodeField | None]) -> Array:
        """(S,) by how much the noise of each scale is more than that of independent nodes, from the last three frames.

        Nodes closer together than pixels share their noise, and the pattern of unequal pixels goes over a model that
        moves. What flows changes little from frame to frame: their second difference is noise.
        """
        out = np.ones(len(self._scales))
        fields = [f for f in last if f is not None]
        if len(fields) < 3:
            return out
        second = sum(k * np.where(f.known, f.value, np.nan) for k, f in zip((1, -2, 1), fields, strict=True))
        variance = sum(k * k * f.white for k, f in zip((1, -2, 1), fields, strict=True))
        for s, scale in enumerate(self._scales):
            ratio = np.abs(scale.laplacian(second)) / np.maximum(scale.noise(variance), 1e-30)
            if np.isfinite(ratio).any():
                out[s] = max(1.0, float(np.nanmedian(ratio)) / 0.6745)
        return out

    def of(self, index: int, temperature: NodeField) -> AlongSurface:
        """See `AlongSurface`; zero where it is not known."""
        none = np.zeros(len(temperature))
        since = float(self._run.times[index]) - self._start
        if not self._scales or since <= 0:
            return AlongSurface(none, none)
        reach = REACH * self._length(since)
        count = max(1, sum(s.radius <= reach for s in self._scales))
        rise = np.where(temperature.known, temperature.value, np.nan) - self._initial[0]
        variance = temperature.white + np.nan_to_num(self._initial[1])
        values = [s.laplacian(rise) for s in self._scales[:count]]
        noises = [e * s.noise(variance) for e, s in zip(self._excess, self._scales[:count], strict=False)]
        by = np.array([lateral_conductance(w, since) for w in self._run.walls])[self._run.wall_of]
        by = np.where(self._run.wall_of >= 0, by, 0.0)
        times = float(self._times[count - 1])
        sure = [np.nan_to_num(np.abs(v) - times * n) for v, n in zip(values, noises, strict=True)]
        best, noise = widest_agreed(values, noises, times)
        size = np.copysign(np.hypot(best, noise), best)
        return AlongSurface(by * np.maximum(np.max(sure, axis=0), 0.0), by * np.nan_to_num(size))
