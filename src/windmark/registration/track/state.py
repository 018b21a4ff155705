"""What one frame hands on to the next: pose, motion, their covariance, and how the following went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from windmark.errors import UsageError
from windmark.geometry import Camera, Pose
from windmark.geometry.described import described
from windmark.scene import MarkerSet

if TYPE_CHECKING:
    from windmark.registration.track._kernels.motion import Estimate
    from windmark.registration.track.prepared import Prepared

Array = NDArray[np.float64]
Status = Literal["cold", "tracked", "reacquired", "lost"]


@dataclass(frozen=True)
class Motion:
    """How the motion is expected to change from frame to frame (1 sigma per axis); only a start, it is adapted.

    Parameters
    ----------
    rotation_rad : change of the rotation per frame, radians
    translation : change of the translation per frame, as part of the markers' distance from the camera
    first : the motion itself, before any of it was seen, is so many times as large as its change
    """

    rotation_rad: float = 0.005
    translation: float = 0.003
    first: float = 6.0

    def __post_init__(self) -> None:
        for name in ("rotation_rad", "translation", "first"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise UsageError(f"Motion: {name} must be > 0 and finite, got {value}")

    @property
    def change(self) -> Array:
        """(2,) the changes of rotation and translation."""
        return np.array([self.rotation_rad, self.translation])


@described(lambda s: {
    "status": s.status, "reason": s.reason or "none", "matched": len(s.marker), "good frames": s.n_frames,
    "missed": f"{s.missed:g}",
})  # fmt: skip
@dataclass(frozen=True, eq=False)
class TrackState:
    """What is known after a frame. Hand it on to the next one.

    Parameters
    ----------
    status : "cold" (registered without help), "tracked" (labelled from the prediction), "reacquired" (registered again
        after a jump or a loss) or "lost"
    reason : why it is lost or had to be registered again; "" otherwise
    estimate : pose and motion in the matcher's own units; None before the first good frame
    change : (2,) how much the motion changes per frame, as seen lately; see `Motion`
    marker : (K,) markers that were matched in the last good frame
    n_frames : good frames since the motion was last unknown
    missed : frames (or time, in units of ``dt``) since the last good one
    prepared : markers and camera
    bends : evidence of the frames so far (nats) that the model bends

    Examples
    --------
    >>> import numpy as np
    >>> import windmark as wm
    >>> rng = np.random.default_rng(1)
    >>> markers = wm.MarkerSet.make([f"m{i}" for i in range(20)], rng.uniform(-1.0, 1.0, (20, 3)) * [2.0, 1.0, 0.2])
    >>> camera, pose = wm.Camera((640, 480), 800.0), wm.Pose.look_at([0.5, 0.3, 6.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    >>> spots = wm.Detections.make(camera.project(pose.apply(markers.xyz))[0].round(1))
    >>> _, state = wm.track(None, spots, markers, camera)
    >>> _, dark = wm.track(state, spots.take([]), markers, camera)  # a frame that shows nothing
    >>> state.status, dark.status, dark.n_frames, dark.missed
    ('cold', 'lost', 1, 1.0)
    """

    status: Status
    reason: str
    estimate: Estimate | None = field(repr=False)
    change: Array
    marker: NDArray[np.int64]
    n_frames: int
    missed: float
    prepared: Prepared = field(repr=False)
    bends: float = 0.0

    @property
    def lost(self) -> bool:
        """Whether the last frame gave no pose."""
        return self.status == "lost"

    @property
    def cam_from_model(self) -> Pose | None:
        """Pose by this frame and those before (Kalman); while lost that of the last good frame."""
        if self.estimate is None:
            return None
        return self.prepared.layout.frame.pose(self.estimate.rotation, self.estimate.translation)

    @property
    def velocity(self) -> Array:
        """(6,) change per frame.

        Rotation vector of the model about the markers' centre, in radians along the camera's axes, and translation of
        that centre in length units; zero before the first good frame.
        """
        if self.estimate is None:
            return np.zeros(6)
        return self.estimate.velocity * _units(self.prepared)[:6]

    @property
    def cov(self) -> Array:
        """(12, 12) covariance of [rotation, translation, velocity], in the coordinates of the velocity."""
        if self.estimate is None:
            return np.full((12, 12), np.nan)
        units = _units(self.prepared)
        return self.estimate.cov * (units[:, None] * units)

    def told(self) -> dict[str, Any]:
        """Its fields but for what markers and camera alone make, so that it can be kept; `taken_up` makes it again."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "prepared"}

    def without(self, reason: str, dt: float) -> TrackState:
        """The state after a frame that gave no pose: what was known stays, only time goes on."""
        return replace(self, status="lost", reason=reason, missed=self.missed + dt)


def taken_up(told: Mapping[str, Any], markers: MarkerSet, camera: Camera) -> TrackState:
    """The state that `TrackState.told` told of, with the same markers and camera."""
    from windmark.registration.track.prepared import Prepared  # this brings numba

    return TrackState(**told, prepared=Prepared.of(markers, camera))


def _units(prepared: Prepared) -> Array:
    return np.tile([1.0, 1.0, 1.0, *[prepared.layout.frame.scale] * 3], 2)
