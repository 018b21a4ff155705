"""Known markers that no picture has where the table says, and that have a spot beside that place in all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.calibration import Calibration
from windmark.errors import g2
from windmark.registration import Registration
from windmark.scene import Doubt, MarkerSet
from windmark.tasks.calibrate.picture import Picture
from windmark.tasks.odd import CHANCE, nearest_spots, together


def beside_their_place(
    result: Calibration, pictures: Sequence[tuple[Picture, Registration | None]], table: MarkerSet
) -> tuple[Doubt, ...]:
    """Of a calibration whose datum is the table: markers of it that took no part because they are elsewhere.

    Parameters
    ----------
    pictures : each with its matching
    table : in the frame of the result
    """
    taken = set(result.markers.name.tolist())
    alone = np.flatnonzero([str(n) not in taken for n in table.name])
    posed = {v.name: v for v in result.views if v.cam_from_model is not None}
    chances: dict[int, list[float]] = {}
    away: dict[int, list[float]] = {}
    for picture, matched in pictures:
        view = posed.get(picture.name)
        if view is None or view.cam_from_model is None or matched is None:
            continue
        camera, place = result.cameras[view.camera], view.cam_from_model.apply(table.xyz[alone])
        facing = ~((view.cam_from_model.rotate(table.normal[alone]) * place).sum(axis=1) >= 0)  # none: facing
        xy, valid = camera.project(place)
        seen = np.flatnonzero(facing & valid & camera.in_image(xy))
        free = np.delete(picture.detections.xy, matched.matching.detection, axis=0)
        far, chance = nearest_spots(xy[seen], free, camera.size_px)
        for k, px, p in zip(seen.tolist(), far.tolist(), chance.tolist(), strict=True):
            chances.setdefault(k, []).append(p)
            away.setdefault(k, []).append(px)
    out = []
    for k, of in chances.items():
        if len(chances) * together(of) < CHANCE:
            name, count = str(table.name[alone[k]]), len(of)
            words = (f"{{}} is not where its table says: {count} pictures have a spot without a marker "
                     f"{g2(np.median(away[k]))} px beside it (median), and none there")  # fmt: skip
            out.append(Doubt((name,), words, "marker"))
    return tuple(out)
