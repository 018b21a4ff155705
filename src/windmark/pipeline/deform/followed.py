"""What was said of an instant while the model was followed: what a verdict on any series looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from windmark.tasks.deform.task import DeformedFrame, Sight


@dataclass(frozen=True)
class Followed:
    """One instant.

    Parameters
    ----------
    key : what it is called, in words
    cameras : camera -> what it saw
    doubts : cause (see `Doubt`) and sentence of what speaks against the state
    sigma0 : residuals over what is stated; 1 without a state
    """

    key: str
    cameras: Mapping[str, Sight] = field(default_factory=dict)
    doubts: tuple[tuple[str, str], ...] = ()
    sigma0: float = 1.0

    @staticmethod
    def of(frame: DeformedFrame, key: str) -> Followed:
        """Of an instant under a name."""
        if frame.state is None:
            return Followed(key, frame.cameras)
        doubts = tuple((d.cause, str(d)) for d in frame.state.doubts)
        return Followed(key, frame.cameras, doubts, frame.state.sigma0)
