"""Pairs of pictures matched from nothing: each once."""

from __future__ import annotations

from dataclasses import dataclass, field

from windmark.epipolar import NotMatched, PairMatching, match_pair
from windmark.geometry import Camera
from windmark.tasks.reconstruct.task import Task

Key = tuple[int, int, bytes, bytes]


@dataclass
class PairMatcher:
    """`match_pair` of the pictures of a task, which keeps what it found: on a regular sheet one pair takes seconds."""

    task: Task
    found: dict[Key, PairMatching | NotMatched] = field(default_factory=dict)

    def __call__(self, a: int, b: int, camera_a: Camera, camera_b: Camera) -> PairMatching | NotMatched:
        """Pairs of spots of views a and b, with these cameras."""
        key = (a, b, camera_a.parameters().tobytes(), camera_b.parameters().tobytes())
        if key not in self.found:
            spots = self.task.detections
            self.found[key] = match_pair(spots[a], spots[b], camera_a, camera_b, seed=self.task.seed)
        return self.found[key]
