"""The state of one instant from labelled spots, and the spots near the markers' places in a state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windmark.deformation import Deformation, NotIdentified
from windmark.deformation.solve import Solved
from windmark.geometry import Camera
from windmark.scene import Observations
from windmark.tasks.deform.looking import Looking
from windmark.tasks.deform.memory import Memory, displaced
from windmark.tasks.deform.sizes import disc_size
from windmark.tasks.deform.spots import LEAST_PX, MOST_PX, SIGMAS, Labelled
from windmark.tasks.deform.states import implausible, start_pose, state_of
from windmark.tasks.deform.task import DeformationTest, Image
from windmark.tasks.deform.texture import Texture, texture_of, without_texture

Array = NDArray[np.float64]

FEWER = 0.6
"""A frame with less than this part of the markers of the frame before is looked at again without expectations."""


class Settler:
    """Labels and the state that they make, each from the other.

    Attributes
    ----------
    memory : what the frame before handed on
    hidden : camera -> (N,) markers that the grid hides from it
    texture : of the paint round the markers, as the last frame without expectations showed it
    solved : the adjustment of the last answer
    moved : whether that is a refusal because a camera moved
    weak : names of what was not determined in this frame
    """

    def __init__(self, test: DeformationTest, looking: Looking) -> None:
        self._test, self._looking = test, looking
        self.memory: Memory | None = None
        self.hidden: dict[str, NDArray[np.bool_]] = {}
        self.texture: Texture | None = None
        self.begin()

    def begin(self) -> None:
        """Begin a frame."""
        self.solved: Solved | None = None
        self.moved, self.weak = False, set[str]()

    def handed_on(self) -> dict[str, Any]:
        """What the next frame goes on with: all of it is made anew there."""
        return {name: getattr(self, name) for name in ("memory", "hidden", "texture")}

    def take_up(self, handed_on: Mapping[str, Any]) -> None:
        """Go on with what `handed_on` gave."""
        for name, value in handed_on.items():
            setattr(self, name, value)

    def identify(
        self, labelled: dict[str, Labelled], start: Deformation | None, *, free_moved: bool = True,
        test: DeformationTest | None = None,
    ) -> tuple[Any, Observations]:  # fmt: skip
        """`identify` with these labels, of a ``test`` that is otherwise in some way where one is given."""
        parts = list(labelled.values())
        view = np.repeat(np.arange(len(parts)), [len(s.marker) for s in parts])
        observations = Observations(
            view, np.concatenate([s.marker for s in parts]), np.concatenate([s.xy for s in parts]),
            np.concatenate([_own_cov(without_texture(s, self._test, self.texture), s) for s in parts]),
        )  # fmt: skip
        poses = {n: start_pose(self._test.station(n), s) for n, s in labelled.items()}
        known = self._test.marker_cov if self.texture is None else self.texture.place_cov
        known_off = [s.eccentricity_px for s in parts if s.eccentricity_px is not None]
        eccentricity = np.concatenate(known_off) if start is not None and len(known_off) == len(parts) else None
        self.solved = None
        answer = state_of(
            observations, poses, test or self._test, start, known, eccentricity, free_moved, self._keep,
            disc_size(parts, self._test.markers),
        )  # fmt: skip
        self.moved = isinstance(answer, NotIdentified) and answer.cause == "moved"
        if isinstance(answer, NotIdentified):
            self.weak.update(answer.weak)
        return answer, observations

    def _keep(self, solved: Solved) -> None:
        self.solved = solved

    def settled(self, images: dict[str, Image], seen: dict[str, Labelled], start: Deformation | None) -> Any:
        """State, spots and observations from first labels; or why not, as text."""
        # Rough labels, and pictures of another time than the instant: cameras need not agree yet.
        answer, _ = self.identify(seen, start, free_moved=False)
        if not isinstance(answer, Deformation):
            return str(answer.reason)
        self.hidden = {n: h for n in images if (h := self.hidden_from(n, answer)) is not None}
        # The markers that the labels left out, and cameras that have none, from what is known now.
        return self.there(images, answer, seen, max(LEAST_PX, 2 * answer.rms_px))

    def there(
        self, images: dict[str, Image], answer: Deformation, seen: dict[str, Labelled], reach_px: float,
        *, alike: bool = False,
    ) -> Any:  # fmt: skip
        """State, spots and observations near the markers' places in a state; or why not, as text.

        Those that are ``seen`` stay where most of them are not there. ``alike``: spots that are the same, with
        whatever labels, are measured as they were, and the texture is that of before: sums of squares compare.
        """
        error = dict.fromkeys(seen, reach_px / SIGMAS)
        again = self._looking.near(
            images, answer, displaced(self._test.markers, answer), error, seen, self.hidden, self.memory
        )
        if sum(len(s.marker) for s in again.values()) < FEWER * sum(len(s.marker) for s in seen.values()):
            again = seen
        if alike:
            again = {n: s.measured_as(seen[n]) if n in seen else s for n, s in again.items()}
        elif self._test.marker_cov is None:
            self.texture = texture_of(again, answer, self._test)
        settled, observations = self.identify(again, answer)
        if isinstance(settled, NotIdentified):
            return settled.reason
        # Nothing is known of the motion yet: the next frame is looked for as far as it may be.
        return implausible(settled) or (settled, again, observations, dict.fromkeys(again, MOST_PX / SIGMAS))

    def hidden_from(self, name: str, state: Deformation) -> NDArray[np.bool_] | None:
        """(N,) markers that the grid hides from a camera in a state; None without a grid."""
        if self._test.visible is None:
            return None
        pose = state.cam_from_tunnel.get(name, self._test.station(name).cam_from_tunnel)
        wall = self._test.markers.role == "wall"
        camera = own_camera(self._test, name)
        return np.asarray(~(self._test.visible(pose @ state.tunnel_from_model, camera) | wall))


def own_camera(test: DeformationTest, name: str) -> Camera:
    """The camera of a station as its file has it."""
    return test.station(name).camera


def _own_cov(cov: Array, spots: Labelled) -> Array:
    return cov if spots.between_cov is None else cov + spots.between_cov
