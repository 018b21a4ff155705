"""A deforming model followed through the images of all its cameras: predict, look, identify; start again when lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.compiling import job_time
from windmark.deformation import Deformation
from windmark.errors import UsageError
from windmark.scene import Doubt
from windmark.scene.repeated import ONCE_MORE, print_of
from windmark.tasks.deform.finding import Finder, Found
from windmark.tasks.deform.looking import Looking
from windmark.tasks.deform.memory import Memory, predicted, velocity_of
from windmark.tasks.deform.series import OF_ONE_INSTANT, Series
from windmark.tasks.deform.settling import Settler
from windmark.tasks.deform.sights import Usual, once_more, sight
from windmark.tasks.deform.spots import Labelled
from windmark.tasks.deform.task import (
    DeformationTest,
    DeformedFrame,
    FrameImages,
    Image,
    Reader,
    Sight,
    as_given,
)

Array = NDArray[np.float64]

FORGET = 0.5
"""How fast large prediction errors are forgotten."""


def follow_deformation(
    frames: Iterable[FrameImages], test: DeformationTest, *, read: Reader = as_given,
    handed_on: dict[str, Any] | None = None,
) -> Iterator[DeformedFrame]:  # fmt: skip
    """Deformation in every frame, one after the other; memory does not grow with their number.

    The first frame is found without help: all spots are detected, matched to the model, and the law is identified.
    From then on every marker is looked for near its predicted place in every camera. A frame that does not fit is
    looked at again without expectations: matched to the model like the first one or, where that is refused, each marker
    to the spot that is clearly nearest to its place in the last good frame. If that fails, too, the frame is flagged;
    the next one starts from the last good one. Cameras are read and searched in threads.

    Parameters
    ----------
    frames : images of all cameras of each instant, in order; they may come slowly
    test : what does not change
    read : makes grey images of what the frames have in place of them, such as paths; it runs in threads
    handed_on : takes what every frame hands on to the next, before the frame is yielded; where it holds what an earlier
        sequence of the same test left in it, the frames go on with that

    Raises
    ------
    ValueError
        For instants that do not increase, or images of a camera that the test does not have.
    """
    with ThreadPoolExecutor(max_workers=len(test.stations)) as pool:
        follower = _Follower(test, pool, read)
        kept = {} if handed_on is None else handed_on
        follower.take_up(kept.get("follower", {}))
        first, last = kept.get("index", 0), kept.get("instant", -np.inf)
        for index, frame in enumerate(frames, first):
            if frame.skipped is not None:
                status, why = frame.skipped
                kept["index"] = index + 1
                yield DeformedFrame(index, frame.key, frame.instant, status, why, None)
                continue
            if not (np.isfinite(frame.instant) and frame.instant > last):
                raise UsageError(f"frames: instants must increase, {frame.key} is {frame.instant:g} after {last:g}")
            unknown = sorted(set(frame.images) - {s.name for s in test.stations})
            if unknown:
                raise UsageError(f"frames: {frame.key} has an image of camera {unknown[0]}, which the test has not")
            last = frame.instant
            followed = follower.frame(index, frame)
            kept.update(follower=follower.handed_on(), index=index + 1, instant=last)
            yield followed


class _Follower:
    """What goes from frame to frame."""

    def __init__(self, test: DeformationTest, pool: ThreadPoolExecutor, read: Reader) -> None:
        self._test, self._looking = test, Looking(test, pool, read)
        self._settler = Settler(test, self._looking)
        self._finder = Finder(test, pool, self._looking, self._settler)
        self._usual, self._series = Usual(), Series.of(test)
        self._copied: set[str] = set()  # cameras whose picture is that of the frame before, bit by bit
        self._prints: dict[str, int] = {}  # of the cameras' last pictures, see `print_of`

    def handed_on(self) -> dict[str, Any]:
        """What the next frame goes on with; pictures are not.

        It is a copy: the next frame may be broken off when it has changed a part of what it was given.
        """
        series = None if self._series is None else self._series.without()
        own = {"_usual": deepcopy(self._usual), "_prints": dict(self._prints), "_series": series}
        return {**own, "shots": self._looking.seen, "settler": self._settler.handed_on(),
                "finder": self._finder.handed_on()}  # fmt: skip

    def take_up(self, handed_on: Mapping[str, Any]) -> None:
        """Go on with what `handed_on` gave."""
        for name, value in handed_on.items():
            if name == "shots":
                self._looking.shots = value
            elif name in ("settler", "finder"):
                getattr(self, f"_{name}").take_up(value)
            else:
                setattr(self, name, value)

    def frame(self, index: int, frame: FrameImages) -> DeformedFrame:
        """Follow one instant."""
        start = job_time()
        images, bad = self._looking.read(frame)
        # Of a camera that took none just then the nearest picture is of another instant, where it may come once more.
        own = {n: print_of(image) for n, image in images.items() if n not in frame.shots}
        self._copied = {n for n, made in own.items() if self._prints.get(n) == made}
        self._prints |= own
        self._looking.open(frame, images, bad)
        troubles = [f"{n}: {why}" for n, why in {**frame.odd, **bad}.items()]
        found = self._finder.find(images, frame)
        troubles += found.troubles
        if found.answer is None:
            doubts = self._together(frame)
            reason = "; ".join([*map(str, doubts), *troubles, *([found.why] if found.why else [])]) or "no image"
            return DeformedFrame(
                index, frame.key, frame.instant, "lost", reason, None, seconds=job_time() - start,
                cameras=self._sights(frame, images, bad, self._finder.last, None), series=doubts,
            )  # fmt: skip
        state, labelled, observations, errors = found.answer
        cold = found.status == "cold"
        troubles += [f"{n}: {why}" for n, why in self._finder.left_out.items() if n in images]
        if cold:
            self._usual.learn_odd(found.spots, self._test, labelled, state, self._settler.hidden)
        self._usual.forget_odd(labelled, state.used)
        sights = self._sights(frame, images, bad, labelled, state)
        troubles += [f"{n}: {s.reason}" for n, s in sights.items() if ONCE_MORE in s.reason]
        doubts = self._together(frame, state, again=any(ONCE_MORE in s.reason for s in sights.values()))
        self._remember(state, labelled, errors, frame.instant, found)
        troubles += [f"{n}: {s.reason}" for n, s in labelled.items() if s.reason]
        self._usual.learn(images, self._test, labelled, sights, anew=cold)
        return DeformedFrame(
            index, frame.key, frame.instant, found.status, "; ".join(troubles),
            state if self._series is None else self._series.judged(state), observations, tuple(labelled),
            job_time() - start, sights, doubts,
        )  # fmt: skip

    def _together(
        self, frame: FrameImages, state: Deformation | None = None, *, again: bool = False
    ) -> tuple[Doubt, ...]:
        """Add a frame to what all of them say together; what that is.

        A frame that was refused counts where a camera was called moved, which one that is late looks like; one with a
        picture that is there ``again`` does not.
        """
        if self._series is None:
            return ()
        solved = None if again or (state is None and not self._settler.moved) else self._settler.solved
        odd = state is None or any(d.cause in OF_ONE_INSTANT for d in state.doubts)
        self._series = self._series.without() if solved is None else self._series.plus(solved, frame, odd=odd)
        return self._series.doubts

    def _sights(
        self, frame: FrameImages, images: dict[str, Image], bad: dict[str, str], labelled: dict[str, Labelled],
        state: Deformation | None,
    ) -> dict[str, Sight]:  # fmt: skip
        memory = self._settler.memory
        known = state if state is not None or memory is None else predicted(memory, frame.instant - memory.instant)
        out = {}
        for station in self._test.stations:
            name, lag = station.name, frame.lag(station.name)
            if name not in images:
                out[name] = Sight(reason=bad.get(name, ""), lag_s=lag)
            elif name in self._finder.left_out and state is not None:
                out[name] = Sight(self._usual.markers.get(name, 0), 0, self._finder.left_out[name], lag)
            else:
                spots, hidden = labelled.get(name, Labelled.none("")), self._settler.hidden.get(name)
                out[name] = sight(
                    images[name], self._test, station, spots, self._usual, state is None, known, hidden, lag
                )  # fmt: skip
                # Between the same two pictures two instants may differ by a small part of their noise.
                if memory is not None and name not in self._looking.shots and not out[name].reason:
                    said = once_more(memory.labelled.get(name), spots, copied=name in self._copied)
                    out[name] = replace(out[name], reason=said)
            if name in images and name not in self._looking.shots:
                out[name] = replace(out[name], picture=self._prints[name])
        return out

    def _remember(
        self, state: Deformation, labelled: dict[str, Labelled], errors: dict[str, float], instant: float, found: Found
    ) -> None:
        before = self._settler.memory
        if before is not None and found.status == "tracked":
            errors = {n: max(before.error_px.get(n, 0.0) * FORGET, e) for n, e in errors.items()}
        velocity = {} if found.jumped else velocity_of(before, state, instant)
        kept = {n: s for n, s in (before.labelled if before else {}).items() if n not in labelled}
        for name, shots in self._looking.shots.items():
            if name in labelled:
                shots.keep()
        self._settler.memory = Memory(state, instant, velocity, errors, {**kept, **labelled})
