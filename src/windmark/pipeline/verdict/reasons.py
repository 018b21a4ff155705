"""Refusals that reach a verdict as sentences (of a frame, a point, a file): what they are about, by their words."""

from __future__ import annotations

from windmark.pipeline.verdict.doubts import STEPS
from windmark.scene.units import SIGMAS_OFF

MOVED = ("place in the rig", "not where it is said to be", "not where cam_from_rig says")
"""Words of a refusal for a camera that does not fit, where its place is at fault and not its interior."""
EXCHANGED = "are exchanged: where cam_from_rig has the other"
"""Words of a refusal for two cameras of which each has the other's pictures or place."""
_STEPS = {
    "focal": "give the focal length that was found, or calibrate the camera again",
    "camera": "calibrate the lens of this camera (windmark calibrate); check that the file is this camera's",
    "exchanged": "give each camera its own pictures and its own file: two have each other's",
    "moved": "find the cameras' places anew (windmark calibrate), and see that each has its own file",
    "mirrored": "mirror the picture, or check the sign of the table's axes",
    "sign": "turn the sign of beta_deg in the table of points; where it is right, see the cameras' frame",
    "rows": "give each row of the table of points its own pictures; else see points.alpha_at_rest_deg or "
    "beta_at_rest_deg and the laws",
    "units": "correct the unit, the cell or the pictures that are named",
    "saturated": "expose shorter or dim the lamps",
    "film": "copy the film from the camera again; where the camera lost pictures, record each by itself",
    "size": "give the camera that was calibrated at this size of pictures, or the pictures as they were taken",
}
REASONS: tuple[tuple[str, str, str], ...] = (
    ("the given focal length of", "focal", _STEPS["focal"]),
    ("the given lens does not fit", "camera", _STEPS["camera"]),
    (EXCHANGED, "moved", _STEPS["exchanged"]),
    *((words, "moved", _STEPS["moved"]) for words in MOVED),
    ("are radii and normals right", "discs", STEPS["discs"]),
    ("its sign is the other one", "lost", _STEPS["sign"]),
    ("rows and pictures were exchanged", "lost", _STEPS["rows"]),
    ("are mixed, or", "units", _STEPS["units"]),
    (SIGMAS_OFF, "units", "give the markers' sigma in the unit of their places, 1 sigma of each coordinate"),
    ("the normals of the table", "discs", STEPS["discs"]),
    ("picture or the table is mirrored", "mirrored", _STEPS["mirrored"]),
    ("of the picture is saturated", "saturated", _STEPS["saturated"]),
    ("was lost from the film", "file", _STEPS["film"]),
    ("is not whole, or a frame that it is coded from", "file", _STEPS["film"]),
    ("as its camera says (width x height)", "camera", _STEPS["size"]),
    ("too simple: what is left looks like", "bent", STEPS["bent"]),
)
"""Words, the cause of the verdict, and the next step; the first that a sentence has."""


def told_by(reason: str) -> tuple[str, str] | None:
    """Cause and next step of a refusal by its words; None where they say none."""
    return next(((cause, step) for words, cause, step in REASONS if words in reason), None)
