"""What a room doubts of its own result, as a finding: the sentence it gives, and the next step by its cause."""

from __future__ import annotations

from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.scene import Doubt

STEPS = {
    "units": "correct the unit of places or radii in the table of markers",
    "swapped": "correct the names in the table of marks (or take the exchange as found), or the labels; label a marker "
    "in more pictures",
    "mirrored": "correct the table's axes (a sign, or two that are exchanged) or its normals, or take the pictures as "
    "the camera stores them",
    "marker": "measure it again, or leave it out",
    "picture": "see that this picture is of this camera and moment, its focus and its labels; else leave it out",
    "mixed": "give each camera its own pictures (--images-of NAME=PATTERN, or the column camera of a table of matches)"
    "; of one camera: lock focus and zoom, do not cut pictures",
    "scene": "take all pictures of one state (no load or wind that changes, nothing loose), or reconstruct each state "
    "from its own pictures",
    "sheared": "hold the camera still (a rolling shutter reads one row after the other), its stabiliser off, and take "
    "the pictures as it stores them: no program may straighten or scale them",
    "distorted": "see that these pictures are of this camera and zoom, as it stores them: no program may take out or "
    "add distortion; give another camera its own pictures (--images-of NAME=PATTERN)",
    "focal": "free the focal length (calibrate --free-focal PICTURE, reconstruct --free focal_px); lock focus and zoom",
    "principal": "free the principal points (calibrate --free-principal PICTURE, or all with --prior-sigma "
    "principal=10); switch the stabiliser off, do not cut pictures",
    "focus": "take more pictures, rolled and from several distances, or say how far the focus may have moved "
    "(calibrate --free-focal all --prior-sigma focus=0.003), and the principal point with it (--free-principal all "
    "--prior-sigma principal=10)",
    "control": "measure the named ones again, or leave the wrong one out",
    "table": "let the markers adjust (--datum free, or weighted with their sigma); of a board: mark three dots "
    "(--board-marks)",
    "discs": "check radii (not diameters, same unit) and normals of the table",
    "late": "pair the cameras' pictures by time (rate_hz or times, and offset_s, of [[camera]]), or by the right "
    "numbers: see which camera began at another picture or dropped one",
    "moved": "place this camera anew, or say that it moves; see that the markers on walls are where their table says",
    "attached": 'say what carries it: parent = "..." in its [[volume]]',
    "bent": "give the named volume a richer law: windmark laws lists them, windmark laws --compare PROJECT --law "
    "VOLUME/LAW tells which one the pictures ask for",
    "prior": "widen this sigma (of the volume's parameters), or leave it out",
    "bound": "widen this bound (lower, upper of the volume's parameters); where the model cannot go beyond it, see "
    "that markers, cameras and the other laws are right",
    "noise": "see which markers or laws leave residuals; give the table its true sigma",
    "lens": "calibrate the camera (windmark calibrate); check that the file is this camera's, at this zoom and focus",
    "camera": "check the value that was given for it",
    "layout": "label a marker in this picture, or leave it out",
    "twofold": "add a camera that sees the part from another side, or give the parameter a start and a sigma in its "
    "[[volume]]",
}
"""Next step of a `Doubt` by its cause."""


def doubt_finding(doubt: Doubt) -> Finding:
    """A doubt of a result as a finding."""
    return as_finding(str(doubt), doubt.cause)


def as_finding(words: str, cause: str) -> Finding:
    """A doubt that is kept as its sentence and its cause."""
    step = STEPS.get(cause, "see the sentence; the report has the figures")
    return Finding(DOUBTFUL, cause or "noise", words, step)
