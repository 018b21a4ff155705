"""Would a picture of another size than its camera's explain rigidly what a bent model was accepted for?

A camera file of which the size alone was changed with that of the pictures (binned, halved or doubled) still has the
focal length and the principal point of the old ones. A bent model can make up for much of that, and is accepted before
another camera is asked for so far off.
"""

from __future__ import annotations

from dataclasses import replace

from windmark.adjust.pose import refine_pose
from windmark.errors import WindmarkError, g2
from windmark.geometry import Camera, Pose
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.registration import Registration
from windmark.scene import Detections, MarkerSet

SIZES = (0.5, 2.0, 0.25, 4.0)
"""Of the pictures, in those that the camera was calibrated with: binned once or twice, or not binned."""


def resized(answer: Registration, spots: Detections, markers: MarkerSet) -> Finding | None:
    """A camera in pixels of another size that leaves no more without any bending than the given one with it; or none.

    A rigid model has fewer unknowns: what fits as well with fewer is the likelier explanation.
    """
    xyz, at = markers.xyz[answer.matching.marker], answer.matching.detection  # those matched are bent already
    pose, found = answer.cam_from_model, list[tuple[float, float]]()
    for size in SIZES:
        # What is as large in the picture is as many times nearer.
        near = Pose(pose.rotation, pose.translation * [1.0, 1.0, size])
        try:
            rms = refine_pose(in_pixels_of(answer.camera, size), near, xyz, spots.xy[at], spots.cov[at]).rms_px
        except WindmarkError:  # a start behind the camera, or places that give no pose
            continue
        found.append((rms, size))
    rms, size = min(found, default=(float("inf"), 1.0))
    if rms > answer.rms_px:
        return None
    camera = answer.camera
    times = f"{size:g} times"
    said = (
        f"the camera's focal length and principal point are those of another size of pictures: with {times} the focal "
        f"length of {camera.focal_px:.0f} px and the principal point at ({camera.cx:.0f}, {camera.cy:.0f}) the same "
        f"{len(at)} markers fit without any bending, to {g2(rms)} px beside {g2(answer.rms_px)} px with it"
    )
    step = f"give the camera of pictures of this size: focal length and principal point {times} as large"
    return Finding(DOUBTFUL, "camera", said, step)


def in_pixels_of(camera: Camera, size: float) -> Camera:
    """A camera of whose pictures ``size`` times as many pixels are across; the first pixel's centre is (0, 0)."""
    cx, cy = (size * (c + 0.5) - 0.5 for c in (camera.cx, camera.cy))
    return replace(camera, focal_px=size * camera.focal_px, cx=cx, cy=cy, cov=None)
