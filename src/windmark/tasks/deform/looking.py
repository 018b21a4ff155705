"""Pictures of an instant, and what is looked for in them: each camera in a thread of its own."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation
from windmark.errors import WindmarkError
from windmark.scene import Detections, MarkerSet
from windmark.tasks.deform.between import Shots, open_shots
from windmark.tasks.deform.memory import Memory, displaced, predicted
from windmark.tasks.deform.spots import MOST_PX, SIGMAS, Labelled, everything, near
from windmark.tasks.deform.task import DeformationTest, FrameImages, Image, Reader


class Looking:
    """Reads pictures and looks for markers in them; ``shots`` are those round an instant of cameras that took none."""

    def __init__(self, test: DeformationTest, pool: ThreadPoolExecutor, read: Reader) -> None:
        self._test, self._pool, self._reader = test, pool, read
        self.shots: dict[str, Shots] = {}

    @property
    def seen(self) -> dict[str, Shots]:
        """The shots without their pictures, as they are now."""
        return {name: replace(own, image={}, seen=dict(own.seen)) for name, own in self.shots.items()}

    def read(self, frame: FrameImages) -> tuple[dict[str, Image], dict[str, str]]:
        """The images that can be read, and what is wrong with the others, by camera."""
        images, troubles = {}, {}
        jobs = {
            n: self._pool.submit(self._reader, item, self._test.station(n))
            for n, item in frame.images.items() if not isinstance(item, np.ndarray)
        }  # fmt: skip
        for station in self._test.stations:
            name = station.name
            if name not in frame.images:
                troubles[name] = frame.missing.get(name, "no image")
                continue
            try:
                images[name] = jobs[name].result() if name in jobs else self._reader(frame.images[name], station)
            except WindmarkError as error:
                troubles[name] = str(error)
        return images, troubles

    def open(self, frame: FrameImages, images: dict[str, Image], troubles: dict[str, str]) -> None:
        """Pictures round the instant of cameras that took none just then; what was seen in them before is kept."""
        self.shots = {n: s for n, s in self.shots.items() if n in frame.shots}
        for name, shots in frame.shots.items():
            if name not in images:
                continue
            old = self.shots.get(name)
            seen = None if old is None else old.seen
            opened = open_shots(shots, self._test.station(name), frame.instant, images[name], seen, self._reader)
            if isinstance(opened, str):
                del images[name]
                self.shots.pop(name, None)
                troubles[name] = opened
            else:
                self.shots[name] = opened

    def near(
        self, images: dict[str, Image], state: Deformation, placed: MarkerSet, error_px: dict[str, float],
        before: dict[str, Labelled], hidden: dict[str, NDArray[np.bool_]], memory: Memory | None,
        instant: float | None = None,
    ) -> dict[str, Labelled]:  # fmt: skip
        """Markers near their places in ``state``; ``instant`` of it where it is a prediction by the memory."""

        def one(name: str, image: Image, state: Deformation, placed: MarkerSet, error: float) -> Labelled:
            station = self._test.station(name)
            return near(
                image, self._test, station, state.cameras.get(name, station.camera),
                state.cam_from_tunnel.get(name, station.cam_from_tunnel), placed, error, before.get(name),
                hidden.get(name),
            )  # fmt: skip

        def look(name: str) -> Labelled:
            error, shots = error_px.get(name, MOST_PX / SIGMAS), self.shots.get(name)
            if shots is None:
                return one(name, images[name], state, placed, error)

            def at(image: Image, when: float) -> Labelled:
                if instant is None or memory is None:  # how fast the model moves is not known
                    return one(name, image, state, placed, MOST_PX / SIGMAS)
                then = predicted(memory, when - memory.instant)
                return one(name, image, then, displaced(self._test.markers, then), error)

            return shots.look(at, again=instant is None)

        *others, own = images
        jobs = [self._pool.submit(look, name) for name in others]
        last = look(own)  # here: a thread less to wait for
        return {**{name: job.result() for name, job in zip(others, jobs, strict=True)}, own: last}

    def everything(self, images: dict[str, Image]) -> dict[str, Detections | str]:
        """All spots of every image; or why there are none."""
        jobs = {n: self._pool.submit(everything, i, self._test, self._test.station(n)) for n, i in images.items()}
        return {name: job.result() for name, job in jobs.items()}
