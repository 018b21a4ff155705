"""A layout of markers in 3D: error ellipsoids, what the check found in colour, partners of the worst symmetry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from windmark.app.run_scene import markers_shown
from windmark.app.scene3d import Cut, Scene3D
from windmark.tasks.marker_check import MarkerCheck

KINDS = {
    "close": ("#d55e00", "too close to another one"), "unseen": ("#cc79a7", "in sight from no direction"),
    "no-normal": ("#0072b2", "without a normal"), "no-radius": ("#56b4e9", "without a radius"),
}  # fmt: skip
OTHER, BROUGHT, NEW, MOVED = "#999999", "#f0e442", "#009e73", "#d50000"
"""Told apart by colour-blind people, as those of the cameras are."""


def check_scene(check: MarkerCheck) -> Scene3D:
    """The markers, each in the colour of the gravest that is said of it; where changes would put some, those, too."""
    table = check.stage.markers
    changes = check.proposals[0].changes if check.proposals else ()
    shown = markers_shown(table, check.unit)
    notes = [list(of) for of in shown.notes]
    colour: dict[int, tuple[str, str]] = {}
    number = {str(name): k for k, name in enumerate(table.name)}
    for finding in check.findings:
        for name in finding.markers:
            kind = KINDS.get(finding.kind, (OTHER, finding.kind))
            colour.setdefault(number[name], kind)
            notes[number[name]].append(kind[1])
    symmetry = check.symmetries[0] if check.symmetries else None
    links = [] if symmetry is None else [(int(k), int(symmetry.onto[k])) for k in np.flatnonzero(symmetry.onto >= 0)]
    links = [(i, j) for i, j in links if i != j]
    for i, j in links:
        colour.setdefault(i, (BROUGHT, "brought onto another one by the nearest symmetry"))
        notes[i].append(f"brought onto {table.name[j]} by the nearest symmetry")
    for change in changes:
        at = len(notes)
        new = change.old is None
        colour[at] = (NEW, "proposed: added") if new else (MOVED, "proposed: moved to here")
        notes.append(["proposed: added" if new else "proposed: moved to here"])
    groups = tuple((c, words, tuple(k for k, of in colour.items() if of == (c, words)))
                   for c, words in dict.fromkeys(colour.values()))  # fmt: skip
    places = np.array([*table.xyz, *(c.place for c in changes)])
    cov = shown.cov if shown.cov is None else np.concatenate([shown.cov, np.zeros((len(changes), 3, 3))])
    markers = replace(shown, names=(*shown.names, *(c.name for c in changes)), xyz=places, cov=cov,
                      notes=tuple(map(tuple, notes)), groups=groups)  # fmt: skip
    ends = np.array([table.xyz[k] for pair in links for k in pair]).reshape(-1, 3)
    cuts = [Cut("partners of the nearest symmetry", ends, np.repeat(np.arange(len(links)), 2))] if links else []
    up = np.array([0.0, 0.0, 1.0])
    faces = np.nan_to_num(table.normal).sum(axis=0)
    ahead = -faces / np.linalg.norm(faces) if np.linalg.norm(faces) > 0.1 * len(table) else np.array([0.0, 1.0, -0.5])
    if abs(ahead[2]) > 0.9 * float(np.linalg.norm(ahead)):  # seen from above: y is up
        up = np.array([0.0, 1.0, 0.0])
    return Scene3D(check.unit, ahead + np.array([0.25, 0.15, 0.1]), up, check.stage.mesh, markers=markers, cuts=cuts,
                   cuts_are="partners of the nearest symmetry", focus=places)  # fmt: skip
