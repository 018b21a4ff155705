"""A project with a grid tells the registration what the grid hides."""

import numpy as np
import pytest

from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project


@pytest.fixture(scope="module")
def with_walls(virtual_test):
    """Results of the first image with the wall's markers in the table, with and without occlusion."""
    folder, _ = virtual_test
    given = {"markers": {"roles": ("model", "wall")}}
    results = {}
    for occlusion in (True, False):
        project = read_project(folder / "project.toml", given | {"register": {"occlusion": occlusion}})
        project = project.model_copy(update={"image": project.image[:1], "view": (), "section": (), "align": None})
        results[occlusion] = run_project(project).images[0]
    return results


def test_markers_behind_the_wing_are_not_expected(with_walls):
    told, plain = with_walls[True], with_walls[False]
    assert told.registered
    assert plain.registered
    assert told.registered.n_expected < plain.registered.n_expected
    assert told.registered.score > plain.registered.score
    # What was expected is what the grid shows (but for markers at the image's border or at grazing incidence).
    assert set(told.registered.matching.marker.tolist()) <= set(told.expected.tolist())
    np.testing.assert_array_equal(told.registered.matching.marker, plain.registered.matching.marker)
