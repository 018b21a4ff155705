"""The verdict on the main job: every image, the cameras together, and the lengths of its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windmark.errors import g2
from windmark.paint.cameras import cameras_apart
from windmark.pipeline.results import ImageResult, RunResult
from windmark.pipeline.same_picture import shown_by
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.apart import apart_findings
from windmark.pipeline.verdict.copied import copied_findings
from windmark.pipeline.verdict.given import NOTHING_MATCHED, empty_lists, given_pose
from windmark.pipeline.verdict.grid import grid_findings
from windmark.pipeline.verdict.lengths import section_findings
from windmark.pipeline.verdict.picture import PictureState, picture_findings, picture_state
from windmark.pipeline.verdict.reasons import told_by
from windmark.pipeline.verdict.registered import Sighting, registered_findings, spot_px, what_is_left
from windmark.pipeline.verdict.verdict import BAD, DOUBTFUL, Finding, Verdict
from windmark.pipeline.verdict.wanted import far_findings
from windmark.resection import MergedViews, NotMerged
from windmark.resection.merging import regions
from windmark.scene import MarkerSet


def run_verdict(result: RunResult) -> Verdict:
    """Judge a finished job."""
    found: list[Finding] = []
    for item in result.images:
        found += [f.at(item.name) for f in _image(item, result)]
    found += copied_findings((item.name, shown_by(item.image)) for item in result.images if item.image is not None)
    if result.markers is not None and result.mesh is not None:
        seen = _seen(result)
        beside = grid_findings(result.markers, result.mesh, result.project.length_unit, seen, result.look)
        # Of a grid that hides the wrong markers no picture may be registered: it is the reason then.
        tried = [item for item in result.images if item.registration is not None]
        none = bool(tried) and all(item.registered is None for item in tried)
        found += [replace(f, word=BAD) for f in beside] if none else beside
    if result.mesh is not None:
        found += section_findings(result.mesh, result.project.section, result.project.length_unit)
    step = 'wind each of the two zones counter-clockwise seen from its air, with [grid] orientation = "file"'
    found += [Finding(DOUBTFUL, "grid", said, step) for said in result.unknown_sides]
    found += [_missing(said).at(item.name) for item in result.images for said in item.left_out]
    found += [_missing(said) for said in result.lost_views]
    for group in result.merged:
        if isinstance(group.outcome, NotMerged):
            found.append(
                Finding(
                    DOUBTFUL,
                    "lost",
                    f"not merged: {group.outcome.reason}",
                    "see the images that it lacks",
                    group.folder,
                )
            )
    merged = [group.merged for group in result.merged if group.merged is not None]
    found += _contradicted(merged) or _on_seams(merged)
    found += empty_lists(result.images)
    unmatched = all(item.registered is None and item.at_pose is None for item in result.images)
    if unmatched and all(f.word != BAD for f in found):
        table = "the marker table as well (-m, or [markers])" if result.markers is None else "the table its radii"
        step = f"give {table}, and look at the grid over the picture"
        found.append(Finding(DOUBTFUL, "few", NOTHING_MATCHED, step))
    return Verdict.of(found, len(result.images), *_good(result))


def _seen(result: RunResult) -> NDArray[np.bool_] | None:
    """(V,) nodes that a picture shows; None where nothing was mapped."""
    shown = [item.nodes.visible for item in result.images if item.nodes is not None]
    return np.any(shown, axis=0) if shown else None


def _contradicted(merged: Sequence[MergedViews]) -> list[Finding]:
    """Pictures whose values are not those of one surface: another curve of grey levels, light that went off."""
    return apart_findings(
        [cameras_apart(m.names, m.values, m.sigmas**2, m.well, m.gains.systematic, m.step_variances()) for m in merged],
        "values of",
        "check exposure, black level and gamma of each camera", "light that went off, oil or dirt",
        "points" if len(merged) > 1 else "",
    )  # fmt: skip


def _on_seams(merged: Sequence[MergedViews]) -> list[Finding]:
    """Pictures whose values differ along a part of their seam: one lens shades, or light comes from elsewhere."""
    out = []
    for m in merged:
        for (a, b), steps in m.seams.by_region(regions(m.mesh), m.step_variances()).items():
            if not (far := np.abs(steps) > rules.APART).any():
                continue
            first, second = m.names[a], m.names[b]
            words = (f"values of {first} and {second} differ by up to {g2(float(np.abs(steps).max()))} times their "
                     f"noise along their seam (in {int(far.sum())} of {len(steps)} parts of it): the gain between "
                     "them is that of where both see, and need not hold elsewhere")  # fmt: skip
            step = "correct each lens's shading (a flat), or let the pictures overlap more widely"
            out.append(Finding(DOUBTFUL, "cameras", words, step))
    return out


def _missing(said: str) -> Finding:
    """A view or a section that was asked for and is in no result."""
    return Finding(DOUBTFUL, "lost", f"left out: {said}", "correct it in the project, or take it out")


def _good(result: RunResult) -> tuple[str, str]:
    """Why it is good, and what can be done with it."""
    answers = [i.registered for i in result.images if i.registered is not None]
    seen = [i.at_pose for i in result.images if i.at_pose is not None]
    if not answers and seen:
        worst_seen = min(seen, key=lambda s: s.found / max(s.expected, 1))
        has = "pose has" if len(seen) == 1 else "poses have"
        said = f"{worst_seen.found} of {worst_seen.expected} markers are where the given {has} them"
        return said, "use the values; look at the grid over the picture"
    if not answers:
        return "every picture is left out", "see why"
    worst = max(a.rms_px for a in answers)
    beyond = max(_beyond(i) for i in result.images)
    fewest = min(len(a.matching) for a in answers)
    what = "the image" if len(answers) == 1 else "both images" if len(answers) == 2 else f"all {len(answers)} images"
    return (
        f"{what} registered with {fewest} markers{' or more' if len(answers) > 1 else ''}, "
        f"{what_is_left(worst, beyond)}",
        f"use {_use(result)}; the report says what these pictures could not check",
    )


def _use(result: RunResult) -> str:
    """What can be used of a good result."""
    if any(item.values is not None for item in result.images):
        return "the values"
    return "the pose in camera.json" if len(result.images) == 1 else "the poses in camera.json"


def _beyond(item: ImageResult) -> float:
    """What an image's residuals ask for beyond the noise, per coordinate; 0 where that is the smaller part of them."""
    answer, spots = item.registered, item.detections
    if answer is None or spots is None or not len(answer.matching):
        return 0.0
    return answer.excess_px if answer.excess_px > rules.NOISE_TIMES * spot_px(answer, spots) else 0.0


def _image(item: ImageResult, result: RunResult) -> list[Finding]:
    state = _state(item)
    found = [] if state is None else picture_findings(state)
    if item.saturated_part > rules.SATURATED_NODES and all(f.cause != "saturated" for f in found):
        found.append(Finding(DOUBTFUL, "saturated", item.saturated, "expose shorter or dim the lamps"))
    if item.dark_part > rules.SATURATED_NODES:
        found.append(Finding(DOUBTFUL, "black", item.dark, "light the model more, or subtract no dark level"))
    found += given_pose(item)
    unit = result.project.length_unit
    found += far_findings([table.of for table in item.points], unit)
    if item.registration is not None and item.detections is not None and result.markers is not None:
        found += registered_findings(_sighting(item, result, result.markers))
    elif item.problem and item.detections is not None and item.registration is None:
        spots = ("few", "look at the picture of the spots; give radius_px and polarity")
        cause, step = told_by(item.problem) or spots
        found.append(Finding(BAD, cause, item.problem, step))
    elif item.problem:
        found.append(_file(item.problem))
    if item.problem and all(f.word != BAD for f in found):
        found.append(_file(item.problem))
    return found


def _file(problem: str) -> Finding:
    return Finding(BAD, "file", problem, "correct the file, or leave this image out")


def _state(item: ImageResult) -> PictureState | None:
    """Of the picture, by the spots that are markers; by all spots where none is."""
    if item.image is None:
        return None
    spots, answer = item.detections, item.registered
    if spots is not None and answer is not None and len(answer.matching):
        spots = spots.take(answer.matching.detection)
    return picture_state(item.image, spots, item.polarity)


def _sighting(item: ImageResult, result: RunResult, markers: MarkerSet) -> Sighting:
    assert item.registration is not None
    assert item.detections is not None
    surface = None
    if item.nodes is not None and result.mesh is not None and item.nodes.visible.any():
        surface = result.mesh.vertices[item.nodes.visible]
    return Sighting(
        item.registration, item.detections, markers, item.expected, result.project.length_unit, surface, item.published
    )
