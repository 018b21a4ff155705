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
from windmark.deformation import Deformation, NotIdentified
from windmark.deformation.solve import Solved
from windmark.errors import UsageError
from windmark.geometry import Camera
from windmark.scene import Detections, Doubt, Observations
from windmark.scene.repeated import ONCE_MORE, print_of
from windmark.tasks.deform.cold import anywhere, reasons
from windmark.tasks.deform.looking import Looking
from windmark.tasks.deform.memory import Memory, displaced, predicted, velocity_of
from windmark.tasks.deform.series import OF_ONE_INSTANT, Series
from windmark.tasks.deform.sights import Usual, once_more, sight
from windmark.tasks.deform.slipped import Rival, Slips
from windmark.tasks.deform.spots import LEAST_PX, MOST_PX, SIGMAS, Labelled, around, near
from windmark.tasks.deform.states import both_reasons, implausible, start_pose, state_of
from windmark.tasks.deform.task import (
    DeformationTest,
    DeformedFrame,
    FrameImages,
    Image,
    Reader,
    Sight,
    as_given,
)
from windmark.tasks.deform.texture import Texture, texture_of, without_texture
from windmark.tasks.deform.walls import without_walls
from windmark.tasks.deform.why import set_otherwise

Array = NDArray[np.float64]

FEWER = 0.6
"""A frame with less than this part of the markers of the frame before is looked at again without expectations."""
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


_MADE_ANEW, _CHANGED_IN_PLACE = ("_memory", "_hidden", "_texture"), ("_usual", "_left_out", "_prints")


class _Follower:
    """What goes from frame to frame."""

    def __init__(self, test: DeformationTest, pool: ThreadPoolExecutor, read: Reader) -> None:
        self._test, self._pool, self._looking = test, pool, Looking(test, pool, read)
        self._memory: Memory | None = None
        self._hidden: dict[str, NDArray[np.bool_]] = {}
        self._texture: Texture | None = None
        self._usual = Usual()
        self._last: dict[str, Labelled] = {}
        self._copied: set[str] = set()  # cameras whose picture is that of the frame before, bit by bit
        self._left_out: dict[str, str] = {}  # cameras that contradict the others, and why
        self._prints: dict[str, int] = {}  # of the cameras' last pictures, see `print_of`
        self._series = Series.of(test)
        self._slips = Slips(test)
        self._solved: Solved | None = None  # the adjustment of the last answer
        self._moved = False  # whether that is a refusal because a camera moved

    def handed_on(self) -> dict[str, Any]:
        """What the next frame goes on with; pictures are not.

        It is a copy: the next frame may be broken off when it has changed a part of what it was given.
        """
        series = None if self._series is None else self._series.without()
        own = {name: deepcopy(getattr(self, name)) for name in _CHANGED_IN_PLACE}
        own |= {name: getattr(self, name) for name in _MADE_ANEW}
        known = (dict(self._slips.beyond), self._slips.asked)
        return {"_shots": self._looking.seen, "_series": series, "_slips": known, **own}

    def take_up(self, handed_on: Mapping[str, Any]) -> None:
        """Go on with what `handed_on` gave."""
        for name, value in handed_on.items():
            if name == "_shots":
                self._looking.shots = value
            elif name == "_slips":
                self._slips.beyond, self._slips.asked = value
            else:
                setattr(self, name, value)

    def frame(self, index: int, frame: FrameImages) -> DeformedFrame:
        """Follow one instant."""
        start = job_time()
        self._last, self._solved = {}, None
        images, bad = self._looking.read(frame)
        # Of a camera that took none just then the nearest picture is of another instant, where it may come once more.
        own = {n: print_of(image) for n, image in images.items() if n not in frame.shots}
        self._copied = {n for n, made in own.items() if self._prints.get(n) == made}
        self._prints |= own
        self._looking.open(frame, images, bad)
        troubles = [f"{n}: {why}" for n, why in {**frame.odd, **bad}.items()]
        status, why, found, spots = "tracked", "", None, {}
        if self._memory is not None and self._believed(images):
            found = self._tracked(images, frame.instant)
            if isinstance(found, str):
                why, found = found, None
        if found is None and images:
            status, spots = "cold", self._looking.everything(images)
            found = self._cold(images, spots)
            if isinstance(found, str):
                why = both_reasons(why, found)
                believed = self._believed(images)
                status, found = "tracked", self._nearest(believed, {n: spots[n] for n in believed})
                if found is not None:
                    troubles.append(f"labelled by the spots nearest to the last good frame's: {why}")
        if found is None:
            doubts = self._together(frame)
            reason = "; ".join([*map(str, doubts), *troubles, *([why] if why else [])]) or "no image"
            return DeformedFrame(
                index, frame.key, frame.instant, "lost", reason, None, seconds=job_time() - start,
                cameras=self._sights(frame, images, bad, self._last, None), series=doubts,
            )  # fmt: skip
        state, labelled, observations, errors = self._unslipped(found, images, frame, cold=status == "cold")
        troubles += [f"{n}: {why}" for n, why in self._left_out.items() if n in images]
        if status == "cold":
            self._usual.learn_odd(spots, self._test, labelled, state, self._hidden)
        self._usual.forget_odd(labelled, state.used)
        sights = self._sights(frame, images, bad, labelled, state)
        troubles += [f"{n}: {s.reason}" for n, s in sights.items() if ONCE_MORE in s.reason]
        doubts = self._together(frame, state, again=any(ONCE_MORE in s.reason for s in sights.values()))
        self._remember(state, labelled, errors, frame.instant, status)
        troubles += [f"{n}: {s.reason}" for n, s in labelled.items() if s.reason]
        self._usual.learn(images, self._test, labelled, sights, anew=status == "cold")
        return DeformedFrame(
            index, frame.key, frame.instant, status, "; ".join(troubles),
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
        solved = None if again or (state is None and not self._moved) else self._solved
        odd = state is None or any(d.cause in OF_ONE_INSTANT for d in state.doubts)
        self._series = self._series.without() if solved is None else self._series.plus(solved, frame, odd=odd)
        return self._series.doubts

    def _sights(
        self, frame: FrameImages, images: dict[str, Image], bad: dict[str, str], labelled: dict[str, Labelled],
        state: Deformation | None,
    ) -> dict[str, Sight]:  # fmt: skip
        memory = self._memory
        known = state if state is not None or memory is None else predicted(memory, frame.instant - memory.instant)
        out = {}
        for station in self._test.stations:
            name, lag = station.name, frame.lag(station.name)
            if name not in images:
                out[name] = Sight(reason=bad.get(name, ""), lag_s=lag)
            elif name in self._left_out and state is not None:
                out[name] = Sight(self._usual.markers.get(name, 0), 0, self._left_out[name], lag)
            else:
                spots, hidden = labelled.get(name, Labelled.none("")), self._hidden.get(name)
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

    # --- with expectations -----------------------------------------------------------------
    def _tracked(self, images: dict[str, Image], instant: float) -> Any:
        """`_guided` by the cameras that are believed; and by all of them once one can be believed again."""
        found = self._guided(self._believed(images), instant)
        if isinstance(found, str) or not self._left_out or not self._admitted(images, found[0]):
            return found
        again = self._guided(self._believed(images), instant)
        return found if isinstance(again, str) else again

    def _guided(self, images: dict[str, Image], instant: float) -> Any:
        """State, spots and observations near the prediction; or why not, as text."""
        assert self._memory is not None
        memory = self._memory
        expected = predicted(memory, instant - memory.instant)
        placed = displaced(self._test.markers, expected)
        labelled = self._looking.near(
            images, expected, placed, memory.error_px, memory.labelled, self._hidden, memory, instant
        )
        self._last = labelled
        if (gone := without_walls(self._test, labelled, memory.labelled)) is not None:
            return f"{gone} lost the markers on walls"
        count = sum(len(s.marker) for s in labelled.values())
        usual = sum(len(memory.labelled[n].marker) for n in images if n in memory.labelled)
        if count < FEWER * usual:
            return f"only {count} markers near their expected places after {usual}"
        answer, observations = self._identify(labelled, expected)
        if not isinstance(answer, Deformation):
            return answer.reason
        if (wrong := implausible(answer)) is not None:
            return wrong
        error = {n: min(s.off_px, MOST_PX / SIGMAS) for n, s in labelled.items()}
        if count < usual and SIGMAS * max(error.values()) > LEAST_PX:
            # The prediction was poor: markers may have been out of reach.
            again = self._settled(images, labelled, answer)
            if not isinstance(again, str) and len(again[2]) > count:
                return again
        return answer, labelled, observations, error

    def _identify(
        self, labelled: dict[str, Labelled], start: Deformation | None, *, free_moved: bool = True
    ) -> tuple[Any, Observations]:
        parts = list(labelled.values())
        view = np.repeat(np.arange(len(parts)), [len(s.marker) for s in parts])
        observations = Observations(
            view, np.concatenate([s.marker for s in parts]), np.concatenate([s.xy for s in parts]),
            np.concatenate([_own_cov(without_texture(s, self._test, self._texture), s) for s in parts]),
        )  # fmt: skip
        poses = {n: start_pose(self._test.station(n), s) for n, s in labelled.items()}
        known = self._test.marker_cov if self._texture is None else self._texture.place_cov
        known_off = [s.eccentricity_px for s in parts if s.eccentricity_px is not None]
        eccentricity = np.concatenate(known_off) if start is not None and len(known_off) == len(parts) else None
        self._solved = None
        answer = state_of(observations, poses, self._test, start, known, eccentricity, free_moved, self._keep)
        self._moved = isinstance(answer, NotIdentified) and answer.cause == "moved"
        return answer, observations

    def _keep(self, solved: Solved) -> None:
        self._solved = solved

    # --- without -----------------------------------------------------------------------------
    def _cold(self, images: dict[str, Image], spots: dict[str, Detections | str]) -> Any:
        """State, spots and observations from nothing; or why not, as text."""
        found = anywhere(spots, self._test, [n for n in spots if n not in self._looking.shots], self._pool)
        labelled, self._left_out = found.labelled, found.left_out
        last = {n: s for n, s in self._last.items() if n in labelled and n not in self._left_out}
        self._last = labelled | last
        seen = {n: s for n, s in labelled.items() if len(s.marker)}
        if not seen:
            return reasons(labelled)
        settled = self._settled(self._believed(images), seen, None)
        return set_otherwise(settled, self._test, seen, spots) if isinstance(settled, str) else settled

    def _believed(self, images: dict[str, Image]) -> dict[str, Image]:
        """Images of the cameras that do not contradict the others."""
        return {n: image for n, image in images.items() if n not in self._left_out}

    def _admitted(self, images: dict[str, Image], state: Deformation) -> bool:
        """Whether cameras are believed again, because they show the markers where the others say that they are."""
        before, placed = len(self._left_out), displaced(self._test.markers, state)
        for name in [n for n in self._left_out if n in images and n not in self._looking.shots]:
            station = self._test.station(name)
            there = near(
                images[name], self._test, station, station.camera, station.cam_from_tunnel, placed, 0.0, None,
                self._hidden_from(name, state),
            )  # fmt: skip
            if len(there.marker) > FEWER * there.expected:
                del self._left_out[name]
        return len(self._left_out) < before

    def _nearest(self, images: dict[str, Image], spots: dict[str, Detections | str]) -> Any:
        """State, spots and observations with every spot clearly nearest to a marker's last place; None if none fit."""
        memory = self._memory
        if memory is None:
            return None
        placed, last = displaced(self._test.markers, memory.state), memory.state
        labelled = {
            n: around(s, last.cameras.get(n, _camera(self._test, n)),
                      last.cam_from_tunnel.get(n, self._test.station(n).cam_from_tunnel), placed)
            for n, s in spots.items()
        }  # fmt: skip
        seen = {n: s for n, s in labelled.items() if len(s.marker)}
        usual = sum(len(memory.labelled[n].marker) for n in images if n in memory.labelled)
        if not seen or sum(len(s.marker) for s in seen.values()) < FEWER * usual:
            return None
        found = self._settled(images, seen, last)
        return None if isinstance(found, str) else found

    def _settled(self, images: dict[str, Image], seen: dict[str, Labelled], start: Deformation | None) -> Any:
        """State, spots and observations from first labels; or why not, as text."""
        # Rough labels, and pictures of another time than the instant: cameras need not agree yet.
        answer, _ = self._identify(seen, start, free_moved=False)
        if not isinstance(answer, Deformation):
            return str(answer.reason)
        self._hidden = {n: h for n in images if (h := self._hidden_from(n, answer)) is not None}
        # The markers that the labels left out, and cameras that have none, from what is known now.
        return self._there(images, answer, seen, max(LEAST_PX, 2 * answer.rms_px))

    def _there(
        self, images: dict[str, Image], answer: Deformation, seen: dict[str, Labelled], reach_px: float,
        *, alike: bool = False,
    ) -> Any:  # fmt: skip
        """State, spots and observations near the markers' places in a state; or why not, as text.

        Those that are ``seen`` stay where most of them are not there. ``alike``: spots that are the same, with
        whatever labels, are measured as they were, and the texture is that of before: sums of squares compare.
        """
        error = dict.fromkeys(seen, reach_px / SIGMAS)
        again = self._looking.near(
            images, answer, displaced(self._test.markers, answer), error, seen, self._hidden, self._memory
        )
        if sum(len(s.marker) for s in again.values()) < FEWER * sum(len(s.marker) for s in seen.values()):
            again = seen
        if alike:
            again = {n: s.measured_as(seen[n]) if n in seen else s for n, s in again.items()}
        elif self._test.marker_cov is None:
            self._texture = texture_of(again, answer, self._test)
        settled, observations = self._identify(again, answer)
        if isinstance(settled, NotIdentified):
            return settled.reason
        # Nothing is known of the motion yet: the next frame is looked for as far as it may be.
        return implausible(settled) or (settled, again, observations, dict.fromkeys(again, MOST_PX / SIGMAS))

    def _unslipped(self, found: Any, images: dict[str, Image], frame: FrameImages, *, cold: bool) -> Any:
        """What was found; or that with a part further on in its rows where it explains more; or that in doubt of it."""
        state, labelled, *rest = found
        own = {n: image for n, image in images.items() if n in labelled and n not in self._looking.shots}
        for rival in self._slips.rivals(state, labelled, own, self._hidden, cold=cold):
            # In wind-off frames all is relative to these, and nothing is slipped.
            if not rival.more and (frame.key in self._test.wind_off or (not cold and self._too_far(rival, frame))):
                continue
            before = self._solved
            other = self._there(self._believed(images), rival.state, labelled, LEAST_PX, alike=True)
            as_good = False
            if not isinstance(other, str):
                # The same spots are at the same place to the last bit.
                used = [set(map(tuple, o.xy[s.used].tolist())) for s, o in ((state, rest[0]), (other[0], other[2]))]
                as_good = rival.as_good(other[0], state, len(used[0] ^ used[1]))
            if as_good and rival.sure:
                return (rival.taken(other[0], state), *other[1:])
            self._solved = before
            # What explains more spots and is not taken may be right all the same.
            if as_good or rival.more:
                doubt = rival.doubt(state)
                names = tuple(dict.fromkeys((*state.suspect, *doubt.names)))
                return replace(state, doubts=(*state.doubts, doubt), suspect=names), labelled, *rest
        return found

    def _too_far(self, rival: Rival, frame: FrameImages) -> bool:
        """Whether a part would be farther on than it moves, by how well the frames before said where it would be."""
        memory = self._memory
        assert memory is not None
        expected = predicted(memory, frame.instant - memory.instant)
        return rival.farther(expected, {n: SIGMAS * e for n, e in memory.error_px.items()}, self._test)

    def _hidden_from(self, name: str, state: Deformation) -> NDArray[np.bool_] | None:
        if self._test.visible is None:
            return None
        pose = state.cam_from_tunnel.get(name, self._test.station(name).cam_from_tunnel)
        wall = self._test.markers.role == "wall"
        camera = _camera(self._test, name)
        return np.asarray(~(self._test.visible(pose @ state.tunnel_from_model, camera) | wall))

    def _remember(
        self, state: Deformation, labelled: dict[str, Labelled], errors: dict[str, float], instant: float, status: str
    ) -> None:
        before = self._memory
        if before is not None and status == "tracked":
            errors = {n: max(before.error_px.get(n, 0.0) * FORGET, e) for n, e in errors.items()}
        velocity = velocity_of(before, state, instant)
        kept = {n: s for n, s in (before.labelled if before else {}).items() if n not in labelled}
        for name, shots in self._looking.shots.items():
            if name in labelled:
                shots.keep()
        self._memory = Memory(state, instant, velocity, errors, {**kept, **labelled})


def _own_cov(cov: Array, spots: Labelled) -> Array:
    return cov if spots.between_cov is None else cov + spots.between_cov


def _camera(test: DeformationTest, name: str) -> Camera:
    return test.station(name).camera
