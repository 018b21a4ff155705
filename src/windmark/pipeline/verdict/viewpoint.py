"""The verdict on points of view: the model out of the picture or behind the camera, a camera in it, poses left open."""

from __future__ import annotations

import numpy as np

from windmark import resection
from windmark.geometry import Camera, Pose
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.registration import PoseCandidates
from windmark.scene import Mesh

_STEP = "see that camera and model are in one frame and one unit; dz is how far ahead of the camera the model is"


def viewpoint_findings(camera: Camera, pose: Pose, points: np.ndarray, mesh: Mesh | None) -> list[Finding]:
    """What speaks against a point of view; ``points`` (N, 3) are those of the model, none where it is not known."""
    if not len(points):
        return []
    if mesh is not None and _inside(mesh, pose.center):
        return [Finding(BAD, "moved", "the camera stands inside the model", _STEP)]
    if not (pose.apply(points)[:, 2] > 0).any():
        return [Finding(BAD, "moved", "the whole model is behind the camera", _STEP)]
    xy, valid = camera.project(pose.apply(points))
    if not (valid & camera.in_image(xy)).any():
        return [Finding(BAD, "covered", "nothing of the model is in the picture", _STEP)]
    return []


def _inside(mesh: Mesh, point: np.ndarray) -> bool:
    """Whether a point is inside the model.

    Source: Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers",
    ACM TOG 32 (2013): more than half of all directions meet the surface from behind. Walls round the air count the
    other way.
    """
    a, b, c = np.moveaxis(resection.orient_outward(mesh).vertices[mesh.triangles] - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = np.einsum("nk,nk->n", a, np.cross(b, c))
    along = la * lb * lc + sum(
        np.einsum("nk,nk->n", u, v) * w for u, v, w in ((a, b, lc), (b, c, la), (c, a, lb))
    )  # fmt: skip
    return bool(2 * np.arctan2(triple, along).sum() > 2 * np.pi)


def viewpoint_verdict(
    found: list[Finding], count: int, shown: bool, written: str = "", drawn: str = ""
) -> Verdict:
    """Judge ``count`` points of view; ``shown``: whether a grid or markers say what is in the picture.

    ``written``, ``drawn``: the camera file and the picture of it that are made; "" none.
    """
    good = "the model is in the picture" if shown else "the seven numbers, station and directions are one pose"
    use = f"use {written} wherever a camera file is asked for" if written else "-o makes a camera file of it"
    step = f"{f'look at {drawn}' if drawn else '--picture draws it'}; {use}"
    step = step if shown else f"give -g or -m to see what it shows; {step}"
    return Verdict.of(found, count, good, step, what="views")


def candidates_verdict(found: PoseCandidates, names: list[str]) -> Verdict:
    """Judge the poses that labelled markers leave."""
    first, further = ", ".join(names[:3]), ", ".join(names[3:])
    left = int(found.compatible.sum())
    out = []
    if not len(found):
        said = f"no pose shows {first} where they are said to be"
        out = [Finding(BAD, "no match", said, "check the labels, their places and the camera")]
    elif not left:
        said = f"none of the {len(found)} poses that show {first} there shows {further} where they are"
        out = [Finding(BAD, "no match", said, "look for a wrong label or place, or another camera")]
    elif not further:
        said = f"{len(found)} pose{'s show' if len(found) > 1 else ' shows'} {first} there, and nothing checks it"
        out = [Finding(DOUBTFUL, "few", said, "give a fourth --label")]
    elif left > 1:
        out = [Finding(DOUBTFUL, "few", f"{left} poses fit all labels", "give another --label")]
    return Verdict.of(out, 1, f"one pose is left, and {further} agree{'s' * (len(names) == 4)} with it",
                      "use it (-o writes the camera file)")  # fmt: skip
