"""The kinds of project files, told by what only they have: the verb of another kind can then name the right one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

VERBS = {"Project": "run", "DeformProject": "deform", "PspProject": "psp", "InfraredProject": "infrared"}
"""Name of a project's model -> the verb that carries it out."""
KINDS = {
    "run": "images mapped onto a grid", "deform": "a deformation test", "psp": "a paint test",
    "infrared": "an infrared run",
}  # fmt: skip
"""Verb -> what its projects are of."""
_OWN = {
    "run": ("image", "detect", "register", "resect", "view", "line", "merge", "align", "rig"),
    "psp": ("paint", "temperature", "radiometry", "taps", "lamp", "loads", "patches", "self_illumination"),
    "infrared": ("surface", "wall", "heat"),
    "deform": ("stations", "watch", "values"),
}
"""Keys that only one kind has."""
_SHARED = ("volume", "motion", "look", "sequence")
"""Keys that all kinds but `run` have; alone they are a deformation test's."""


def kind_of(settings: Mapping[str, Any]) -> str | None:
    """The verb that a project file's settings are for; None where they are of none or of several kinds."""
    found = [verb for verb, keys in _OWN.items() if any(key in settings for key in keys)]
    shared = any(key in settings for key in _SHARED)
    if not found and (shared or _camera_has_images(settings)):
        return "deform"
    if len(found) != 1 or (found == ["run"] and shared):
        return None
    return found[0]


def _camera_has_images(settings: Mapping[str, Any]) -> bool:
    cameras = settings.get("camera")
    return isinstance(cameras, list) and any(isinstance(c, dict) and "images" in c for c in cameras)


def other_kind(settings: Mapping[str, Any], model: str) -> str | None:
    """What to say where settings are surely of another kind than ``model`` (name of its class); None otherwise."""
    kind, wanted = kind_of(settings), VERBS.get(model)
    if kind is None or wanted is None or kind == wanted:
        return None
    return f"this is the project of {KINDS[kind]}, not of {KINDS[wanted]}: windmark {kind}"
