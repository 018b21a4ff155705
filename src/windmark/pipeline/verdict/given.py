"""Whether anything confirms a pose that was given: its markers in the picture, the grid, the points asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from windmark.errors import g2
from windmark.pipeline.results import ImageResult
from windmark.pipeline.verdict import rules
from windmark.pipeline.verdict.verdict import DOUBTFUL, Finding
from windmark.resection.reasons import BLANKED

NOTHING_MATCHED = "the poses were given, and nothing was matched that could contradict them"
_BELONG = "register the picture (windmark register), and see that pose, picture and table belong together"
_UNIT = "see that the camera's translation is in the unit of the grid and in its frame, and look at the grid over it"


def given_pose(item: ImageResult) -> list[Finding]:
    """What of a picture speaks against its given pose; of few markers in view none can, which is said."""
    seen = item.at_pose
    if seen is None:
        return _hardly_in_view(item)
    if seen.found < (1 - rules.MISSING) * seen.expected:
        said = f"{seen.found} of {seen.expected} markers are where the given pose has them"
        return [*_hardly_in_view(item), Finding(DOUBTFUL, "moved", said, _BELONG)]
    if seen.found and seen.off_px > 5 * rules.PLACE_PX:
        said = f"the markers are {g2(seen.off_px)} px (RMS per coordinate) from where the given pose has them"
        return [Finding(DOUBTFUL, "moved", said, _BELONG)]
    if seen.found < rules.CONFIRM:
        few = "no marker" if not seen.found else f"only {seen.found} marker{'s' if seen.found > 1 else ''}"
        said = f"from the given pose {few} of the table can be looked for in the picture: nothing could contradict it"
        return [*_hardly_in_view(item), Finding(DOUBTFUL, "few", said, _BELONG)]
    return []


def _hardly_in_view(item: ImageResult) -> list[Finding]:
    """A grid of which a given pose, that no markers confirm, has next to nothing in the picture."""
    nodes = item.nodes
    if nodes is None or item.registration is not None or item.cam_from_model is None:
        return []
    visible, of = int(nodes.visible.sum()), int((nodes.reason != BLANKED).sum())
    if visible >= rules.HARDLY_SEEN * of:
        return []
    said = f"from the given pose {visible} of {of} nodes of the grid are in view"
    return [Finding(DOUBTFUL, "units", said, _UNIT)]


def empty_lists(images: Sequence[ImageResult]) -> list[Finding]:
    """Lists of points and lines that have no value in any picture, each with the reason that most points have.

    Of those most of which are off the surface that is said already.
    """
    out: list[Finding] = []
    for stem in dict.fromkeys(table.of.stem for item in images for table in item.points):
        tables = [table for item in images for table in item.points if table.of.stem == stem]
        of = tables[0].of
        if any((t.values.reason == 0).any() for t in tables) or of.far.mean() > rules.FAR_POINTS:
            continue
        words, count = np.unique(np.concatenate([t.values.words for t in tables]), return_counts=True)
        why = f" (most: {words[count.argmax()]})" if len(words) else ""
        kind = "points" if of.kind == "points" else "line"
        said = f"{kind} {of.name}: none of {len(of.names)} points has a value in any picture{why}"
        step = f"see the reasons in {of.stem}.csv, and that pose, grid and these points belong together"
        out.append(Finding(DOUBTFUL, "lost", said, step))
    return out
