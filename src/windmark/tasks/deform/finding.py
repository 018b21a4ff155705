"""Labels and state of one instant: near what is expected, from nothing, or by parts that moved far."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from windmark.deformation import Deformation
from windmark.scene import Detections, Observations
from windmark.tasks.deform.cold import anywhere, reasons
from windmark.tasks.deform.looking import Looking
from windmark.tasks.deform.memory import displaced, predicted
from windmark.tasks.deform.rival import Rival
from windmark.tasks.deform.set_anew import Thin, Whereabouts, holding, parts_of, thin_parts, whereabouts
from windmark.tasks.deform.settling import FEWER, Settler, own_camera
from windmark.tasks.deform.slipped import Slips
from windmark.tasks.deform.spots import LEAST_PX, MOST_PX, SIGMAS, Labelled, around, near
from windmark.tasks.deform.states import both_reasons, doubted, implausible
from windmark.tasks.deform.task import DeformationTest, FrameImages, Image
from windmark.tasks.deform.walls import without_walls
from windmark.tasks.deform.way import LEAST, REACH_PX
from windmark.tasks.deform.why import set_otherwise

Spots = dict[str, Detections | str]


@dataclass
class Found:
    """What one instant's images gave.

    Parameters
    ----------
    status : "tracked" near what was expected or by the nearest spots, "cold" without expectations
    answer : state, labelled spots, observations and prediction errors; None where nothing fits
    why : then the reason
    troubles : what else is to be said
    spots : camera -> spots of the whole image, where it was searched
    jumped : whether a part was set anew, which tells no velocity
    """

    status: str = "tracked"
    answer: tuple[Deformation, dict[str, Labelled], Observations, dict[str, float]] | None = None
    why: str = ""
    troubles: list[str] = field(default_factory=list)
    spots: Spots = field(default_factory=dict)
    jumped: bool = False


class Finder:
    """How an instant is looked for: predicted, cold, or each spot to the nearest marker.

    Attributes
    ----------
    last : labels of this frame, of whatever came of them
    left_out : cameras that contradict the others, and why
    slips : parts that may be one place further on in their rows
    thin : parts most of whose markers in view have no spot
    """

    def __init__(self, test: DeformationTest, pool: ThreadPoolExecutor, looking: Looking, settler: Settler) -> None:
        self._test, self._pool, self._looking, self._settler = test, pool, looking, settler
        self.last: dict[str, Labelled] = {}
        self.left_out: dict[str, str] = {}
        self.slips, self._parts, self.thin = Slips(test), parts_of(test), Thin()
        self._anew = list[Whereabouts]()  # parts that were found set anew in this frame

    def handed_on(self) -> dict[str, Any]:
        """A copy of what the next frame goes on with."""
        slips = (dict(self.slips.beyond), self.slips.asked, self.slips.open)
        return {"left_out": dict(self.left_out), "thin": deepcopy(self.thin), "slips": slips}

    def take_up(self, handed_on: Mapping[str, Any]) -> None:
        """Go on with what `handed_on` gave."""
        self.left_out, self.thin = handed_on["left_out"], handed_on["thin"]
        self.slips.beyond, self.slips.asked, self.slips.open = handed_on["slips"]

    def find(self, images: dict[str, Image], frame: FrameImages) -> Found:
        """The state of one instant."""
        self.last, self._anew = {}, list[Whereabouts]()
        self._settler.begin()
        out = Found()
        if self._settler.memory is not None and self.believed(images):
            found = self._tracked(images, frame.instant)
            out.why, out.answer = (found, None) if isinstance(found, str) else ("", found)
        if out.answer is None and images:
            self._find_anywhere(images, out)
        if out.answer is None:
            return out
        self._find_parts(images, out)
        if out.jumped:
            found = out.answer[0]
            out.troubles += [f"{w.part.name} was found set anew: {w.part.values(found)}" for w in self._anew]
            out.answer = (doubted(found, *(d for w in self._anew for d in w.doubt(found))), *out.answer[1:])
        state, labelled, *rest = self._unslipped(out.answer, images, frame, cold=out.status == "cold")
        thin = thin_parts(self._parts, self._test, state, labelled, self._settler.hidden)
        out.answer = (self.thin.doubted(self._parts, state, labelled, out.spots, thin), labelled, *rest)
        return out

    def believed(self, images: Mapping[str, Any]) -> dict[str, Any]:
        """Those of the cameras that do not contradict the others."""
        return {n: of for n, of in images.items() if n not in self.left_out}

    def _find_anywhere(self, images: dict[str, Image], out: Found) -> None:
        """Search the images as a whole."""
        guided = self.last
        out.status, out.spots = "cold", self._looking.everything(images)
        found, seen = self._cold(images, out.spots)
        if isinstance(found, str):
            anew = self._moved_parts(images, (seen, guided), out.spots)
            out.jumped = anew is not None
            found = anew or (set_otherwise(found, self._test, seen, out.spots) if seen else found)
        if isinstance(found, str):
            out.why, out.status = both_reasons(out.why, found), "tracked"
            found = self._nearest(self.believed(images), self.believed(out.spots))
            if found is not None:
                out.troubles.append(f"labelled by the spots nearest to the last good frame's: {out.why}")
        out.answer = found

    # --- with expectations -------------------------------------------------------------------
    def _tracked(self, images: dict[str, Image], instant: float) -> Any:
        """`_guided` by the cameras that are believed; and by all of them once one can be believed again."""
        found = self._guided(self.believed(images), instant)
        if isinstance(found, str) or not self.left_out or not self._admitted(images, found[0]):
            return found
        again = self._guided(self.believed(images), instant)
        return found if isinstance(again, str) else again

    def _guided(self, images: dict[str, Image], instant: float) -> Any:
        """State, spots and observations near the prediction; or why not, as text."""
        assert self._settler.memory is not None
        memory = self._settler.memory
        expected = predicted(memory, instant - memory.instant)
        placed = displaced(self._test.markers, expected)
        labelled = self._looking.near(
            images, expected, placed, memory.error_px, memory.labelled, self._settler.hidden, memory, instant
        )
        self.last = labelled
        if (gone := without_walls(self._test, labelled, memory.labelled)) is not None:
            return f"{gone} lost the markers on walls"
        count = sum(len(s.marker) for s in labelled.values())
        usual = sum(len(memory.labelled[n].marker) for n in images if n in memory.labelled)
        if count < FEWER * usual:
            return f"only {count} markers near their expected places after {usual}"
        answer, observations = self._settler.identify(labelled, expected)
        if not isinstance(answer, Deformation):
            return answer.reason
        if (wrong := implausible(answer)) is not None:
            return wrong
        error = {n: min(s.off_px, MOST_PX / SIGMAS) for n, s in labelled.items()}
        if count < usual and SIGMAS * max(error.values()) > LEAST_PX:
            # The prediction was poor: markers may have been out of reach.
            again = self._settler.settled(images, labelled, answer)
            if not isinstance(again, str) and len(again[2]) > count:
                return again
        return answer, labelled, observations, error

    # --- without expectations ----------------------------------------------------------------
    def _cold(self, images: dict[str, Image], spots: Spots) -> tuple[Any, dict[str, Labelled]]:
        """State, spots and observations from nothing, or why not, as text; and the spots that have markers."""
        found = anywhere(spots, self._test, [n for n in spots if n not in self._looking.shots], self._pool)
        labelled, self.left_out = found.labelled, found.left_out
        last = {n: s for n, s in self.last.items() if n in labelled and n not in self.left_out}
        self.last = labelled | last
        seen = {n: s for n, s in labelled.items() if len(s.marker)}
        if not seen:
            return reasons(labelled), seen
        return self._settler.settled(self.believed(images), seen, None), seen

    def _admitted(self, images: dict[str, Image], state: Deformation) -> bool:
        """Whether cameras are believed again, because they show the markers where the others say that they are."""
        before, placed = len(self.left_out), displaced(self._test.markers, state)
        for name in [n for n in self.left_out if n in images and n not in self._looking.shots]:
            station = self._test.station(name)
            there = near(
                images[name], self._test, station, station.camera, station.cam_from_tunnel, placed, 0.0, None,
                self._settler.hidden_from(name, state),
            )  # fmt: skip
            if len(there.marker) > FEWER * there.expected:
                del self.left_out[name]
        return len(self.left_out) < before

    def _nearest(self, images: dict[str, Image], spots: Spots) -> Any:
        """State, spots and observations with every spot clearly nearest to a marker's last place; None if none fit."""
        memory = self._settler.memory
        if memory is None:
            return None
        placed, last = displaced(self._test.markers, memory.state), memory.state
        labelled = {
            n: around(s, last.cameras.get(n, own_camera(self._test, n)),
                      last.cam_from_tunnel.get(n, self._test.station(n).cam_from_tunnel), placed)
            for n, s in spots.items()
        }  # fmt: skip
        seen = {n: s for n, s in labelled.items() if len(s.marker)}
        usual = sum(len(memory.labelled[n].marker) for n in images if n in memory.labelled)
        if not seen or sum(len(s.marker) for s in seen.values()) < FEWER * usual:
            return None
        found = self._settler.settled(images, seen, last)
        return None if isinstance(found, str) else found

    # --- parts that their own laws moved far ---------------------------------------------------
    def _moved_parts(self, images: dict[str, Image], labels: tuple[dict[str, Labelled], ...], spots: Spots) -> Any:
        """State, spots and observations with parts set anew that nothing, or wrong labels, told; None if none are.

        Each of some ``labels`` is tried, then what is found without any part that has a law of its own.
        """
        believed = self.believed(images)
        for seen in labels:
            if (found := self._moved_by(believed, seen, spots)) is not None:
                return found
        aside = np.unique(np.concatenate([np.zeros(0, np.int64), *(p.own for p in self._parts)]))
        if not len(aside):
            return None
        in_step = [n for n in spots if n not in self._looking.shots]
        found = anywhere(self.believed(spots), self._test, in_step, self._pool, aside)
        return self._moved_by(believed, {n: s for n, s in found.labelled.items() if len(s.marker)}, spots)

    def _moved_by(self, images: dict[str, Image], seen: dict[str, Labelled], spots: Spots) -> Any:
        """`_moved_parts` by some labels."""
        q = self._test.volumes.start if self._settler.memory is None else self._settler.memory.state.q
        own = {p: sum(np.isin(s.marker, p.own).sum() for n, s in seen.items() if n in images) for p in self._parts}
        parts = [p for p, count in own.items() if count < LEAST or p.is_named(self._test, self._settler.weak)]
        gone = np.concatenate([np.zeros(0, np.int64), *(p.own for p in parts)])
        others = {n: s.without(gone) for n, s in seen.items() if n in images}
        others = {n: s for n, s in others.items() if len(s.marker)}
        if not parts or not others:
            return None
        state, _ = self._settler.identify(others, None, free_moved=False, test=holding(self._test, parts, q))
        if not isinstance(state, Deformation):
            return None
        state = replace(state, placed=self._test.volumes.bind(state.placed.xyz, state.placed.names))
        return self._set_anew(images, state, others, spots)

    def _find_parts(self, images: dict[str, Image], out: Found) -> None:
        """Set parts anew that lost most of their markers since the frame before: the images are searched as a whole."""
        assert out.answer is not None
        state, labelled, *_ = out.answer
        thin = thin_parts(self._parts, self._test, state, labelled, self._settler.hidden)
        if not thin.keys() - self.thin.more.keys():
            return
        believed, before = self.believed(images), self._settler.solved
        out.spots = out.spots or self._looking.everything(believed)
        anew = self._set_anew(believed, state, labelled, out.spots)
        if anew is None:
            self._settler.solved = before
        else:
            out.answer, out.jumped = anew, True

    def _set_anew(
        self, images: dict[str, Image], state: Deformation, seen: dict[str, Labelled],
        spots: Spots,
    ) -> Any:  # fmt: skip
        """State, spots and observations with parts where most of their markers have spots; None where nothing tells."""
        thin = thin_parts(self._parts, self._test, state, seen, self._settler.hidden)
        anew = list[Whereabouts]()
        q, own = state.q, {n: s for n, s in spots.items() if n not in self._looking.shots}  # of the same instant
        for part in self._parts:
            if part.name in thin:
                found = whereabouts(part, replace(state, q=q), seen, own, self._test)
                q = q if found is None else found.q
                anew += [] if found is None else [found]
        if not anew:
            return None
        found = self._settler.there(images, replace(state, q=q), seen, REACH_PX)
        if isinstance(found, str):
            return None
        still = thin_parts(self._parts, self._test, found[0], found[1], self._settler.hidden)
        if len(still) >= len(thin):
            return None
        self._anew += anew
        return found

    def _unslipped(self, found: Any, images: dict[str, Image], frame: FrameImages, *, cold: bool) -> Any:
        """What was found; or that with a part further on in its rows where it explains more; or that in doubt of it."""
        state, labelled, *rest = found
        was_open, self.slips.open = self.slips.open, ""
        own = {n: image for n, image in images.items() if n in labelled and n not in self._looking.shots}
        for rival in self.slips.rivals(state, labelled, own, self._settler.hidden, cold=cold):
            # In wind-off frames all is relative to these, and nothing is slipped.
            if not rival.more and (frame.key in self._test.wind_off or self._told(rival, state, frame, cold, was_open)):
                continue
            before = self._settler.solved
            other = self._settler.there(self.believed(images), rival.state, labelled, LEAST_PX, alike=True)
            as_good = False
            if not isinstance(other, str):
                # The same spots are at the same place to the last bit.
                used = [set(map(tuple, o.xy[s.used].tolist())) for s, o in ((state, rest[0]), (other[0], other[2]))]
                as_good = rival.as_good(other[0], state, len(used[0] ^ used[1]))
            if as_good and rival.sure:
                return (rival.taken(other[0], state), *other[1:])
            self._settler.solved = before
            # What explains more spots and is not taken may be right all the same.
            if as_good or rival.more:
                # A tie in a first frame is one of the whole series, which is said there.
                self.slips.open = rival.slide.volume if rival.more or not cold else ""
                return doubted(state, rival.doubt(state)), labelled, *rest
        return found

    def _told(self, rival: Rival, state: Deformation, frame: FrameImages, cold: bool, was_open: str) -> bool:
        """Whether the frames before tell that a part is where it was found; not if it was in doubt in the last one."""
        if cold or was_open == rival.slide.volume:
            return False
        memory = self._settler.memory
        assert memory is not None
        expected = predicted(memory, frame.instant - memory.instant)
        return rival.told(state, expected, {n: SIGMAS * e for n, e in memory.error_px.items()}, self._test)
