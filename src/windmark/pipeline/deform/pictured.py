"""The instants of a deformation test that its report shows by their pictures: the first one found, and the worst."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from windmark.pipeline.deform.followed import Standing
from windmark.pipeline.deform.record import FrameRecord
from windmark.tasks.deform import DeformationTest, DeformedFrame, FrameImages
from windmark.tasks.deform.memory import displaced

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Pictured:
    """One instant with what was where.

    Parameters
    ----------
    row : its numbers
    standing : model and cameras, and the spots that took part
    left_out : camera -> markers whose spots are gross errors, and these spots (K, 2)
    lost : camera -> markers that should be seen there and have no spot
    images : its pictures, or their files
    """

    row: FrameRecord
    standing: Standing
    left_out: Mapping[str, tuple[Ints, Array]]
    lost: Mapping[str, Ints]
    images: FrameImages

    @staticmethod
    def of(row: FrameRecord, frame: DeformedFrame, images: FrameImages, test: DeformationTest) -> Pictured | None:
        """Of an instant; None where the model was not found."""
        standing, state, seen = Standing.of(frame, test), frame.state, frame.observations
        if standing is None or state is None or seen is None:
            return None
        placed = displaced(test.markers, state)
        left_out, lost = {}, {}
        for name, (camera, pose) in standing.cameras.items():
            mine = seen.view == frame.views.index(name) if name in frame.views else np.zeros(len(seen.view), bool)
            gross = mine & ~state.used
            left_out[name] = seen.point[gross], seen.xy[gross]
            centre = pose.apply(placed.xyz)
            turned_away = (pose.rotate(placed.normal) * centre).sum(axis=1) >= 0  # without a normal: no
            sight = ~turned_away & camera.in_image(camera.project(centre)[0])
            if test.visible is not None:
                sight &= test.visible(pose @ state.tunnel_from_model, camera)
            lost[name] = np.setdiff1d(np.flatnonzero(sight), seen.point[mine])
        return Pictured(row, standing, left_out, lost, images)


@dataclass
class Gallery:
    """The first instant that was found and the one of the largest residuals so far; None before there is one."""

    first: Pictured | None = None
    worst: Pictured | None = None
    _worst_px: float = field(default=-1.0)

    def look(self, row: FrameRecord, frame: DeformedFrame, images: FrameImages, test: DeformationTest) -> bool:
        """One more instant, and whether it is shown now; what it was is worked out only then."""
        if frame.state is None or not (self.first is None or row.rms_px > self._worst_px):
            return False
        one = Pictured.of(row, frame, images, test)
        if one is None:
            return False
        self.first = self.first or one
        self.worst, self._worst_px = one, float(np.nan_to_num(row.rms_px))
        return True

    def shown(self) -> list[Pictured]:
        """Both, or the one that is both."""
        both = [self.first, None if self.worst is self.first else self.worst]
        return [one for one in both if one is not None]
