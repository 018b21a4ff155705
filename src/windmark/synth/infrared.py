"""A virtual infrared test: a model that heats up under the wind, plugs of plaster as warm markers.

The paper's Figure 1, left: plugs of an insulator are hotter than the metal or the resin round them, for the heat stays
where it comes in (the rise of a semi-infinite wall goes with one over its effusivity, sqrt(rho c k)). So a plug shows a
multiple of the *rise* round it: clear where the heat flux is high, barely visible where it is low.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from windmark.synth import degrade
from windmark.synth.paint import Paint
from windmark.synth.tunnel import WIND_ON, Shot, TunnelTest, wind_tunnel

_RISE = {"wing": 1.0, "body": 0.85, "wall": 0.04}
"""How much of the heat a surface shows; the wall of the test section stays nearly cold."""
KELVIN_PER_COUNT = 0.01
"""Of the 16-bit pictures: grey level times this is the temperature, as infrared cameras export it ("TLinear")."""


@dataclass(frozen=True)
class InfraredTest:
    """A virtual infrared test.

    Parameters
    ----------
    test : the tunnel with its truth; the intensities of its renderings are the temperature's rise over ``rise_K``
    frames : name -> (H, W) uint16 picture, `KELVIN_PER_COUNT` each
    rise_K : name -> the rise where the intensity is 1
    start_K : temperature before the wind
    """

    test: TunnelTest
    frames: dict[str, NDArray[np.uint16]]
    rise_K: dict[str, float]
    start_K: float

    def temperature(self, frame: str, intensity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Temperature in kelvin for a rendering's intensities in one of the frames."""
        return self.start_K + self.rise_K[frame] * intensity

    @property
    def shot(self) -> Shot:
        """The view of all frames."""
        return self.test.shot(WIND_ON)


def infrared_test(
    seed: int = 0,
    *,
    size_px: tuple[int, int] = (640, 512),
    rises_K: tuple[tuple[str, float], ...] = (("early", 1.5), ("late", 12.0)),
    start_K: float = 293.15,
    plug: float = 0.6,
    blur_px: float = 0.7,
    netd_K: float = 0.03,
) -> InfraredTest:
    """Make a test: same seed and options, same bytes.

    Parameters
    ----------
    seed : draws layout, unevenness, station and noise
    size_px : of the camera
    rises_K : name and mean rise of the wing's temperature of each frame, kelvin
    start_K : temperature before the wind
    plug : the rise on a marker is so much larger than round it
    blur_px : of the lens (1 sigma)
    netd_K : noise of a pixel, kelvin (1 sigma)
    """
    still = np.random.default_rng([seed, 12])
    paint = Paint.random(still, _RISE, (), unevenness=0.1, grain=0.0)
    test = wind_tunnel(seed, size_px=size_px, sensor=None, clutter=None, paint=paint, marker_contrast=-plug)
    test = replace(test, shots=(test.shot(WIND_ON),))
    seen = degrade.gaussian_blur(test.shots[0].perfect.image, blur_px)
    rng = np.random.default_rng([seed, 13])
    frames = {}
    for name, rise in rises_K:
        kelvin = start_K + rise * seen + netd_K * rng.standard_normal(seen.shape)
        frames[name] = np.clip(np.round(kelvin / KELVIN_PER_COUNT), 0, 65535).astype(np.uint16)
    return InfraredTest(test, frames, dict(rises_K), start_K)
