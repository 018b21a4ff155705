"""Lines of sight: the marker's spot in the other picture lies on them, although the model moved between them."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from windmark.app.viewer.sight_lines import lines_of_sight
from windmark.errors import UsageError
from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project

pytestmark = pytest.mark.slow

PROJECT = """\
title = "Two pictures"
length_unit = "mm"
[[camera]]
file = "camera.json"
[[image]]
file = "wind-*.tif"
[markers]
file = "markers.csv"
roles = ["model"]
[detect]
radius_px = 4.0
"""


@pytest.fixture(scope="module")
def result(virtual_test, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sight")
    for name in ("camera.json", "wind-off.tif", "wind-on.tif", "markers.csv"):
        shutil.copy(virtual_test[0] / name, folder)
    (folder / "project.toml").write_text(PROJECT)
    return run_project(read_project(folder / "project.toml"))


def off(line, point):
    """Distance of a point from a polyline."""
    a, b = line[:-1], line[1:]
    d = b - a
    t = np.clip(np.sum((point - a) * d, axis=1) / np.maximum(np.sum(d * d, axis=1), 1e-12), 0, 1)
    return np.linalg.norm(a + t[:, None] * d - point, axis=1).min()


def test_the_same_markers_spot_lies_on_the_line(result):
    one, other = result.images
    matches = [i.registered.matching for i in (one, other)]
    spots = [dict(zip(m.marker, m.detection, strict=True)) for m in matches]
    both = set(spots[0]) & set(spots[1])
    assert len(both) > 10
    for marker in both:
        lines = lines_of_sight(one, result, int(spots[0][marker]))
        assert set(lines) == {other.name}
        assert off(np.array(lines[other.name]), other.detections.xy[spots[1][marker]]) < 0.2
    lengths = [np.ptp(lines_of_sight(one, result, int(k))[other.name], axis=0).max() for k in spots[0].values()]
    assert max(lengths) > 1.0  # the model moved, so a line of sight is no single point there


def test_what_has_no_line_is_refused(result):
    one, other = result.images
    with pytest.raises(UsageError, match="has no pose"):
        lines_of_sight(replace(one, cam_from_model=None), result, 0)
    with pytest.raises(UsageError, match="no spot 9999"):
        lines_of_sight(one, result, 9999)
    with pytest.raises(UsageError, match="neither a grid nor a marker"):
        lines_of_sight(one, replace(result, markers=None), 0)
    alone = replace(result, images=(one, replace(other, cam_from_model=None)))
    assert lines_of_sight(one, alone, 0) == {}
