"""NASA's plate: the target table is the floor, and the verdict says so."""

from pathlib import Path

import pytest

from windmark.pipeline.job import run_project
from windmark.pipeline.project import read_project
from windmark.pipeline.verdict import DOUBTFUL
from windmark.pipeline.verdict.run import run_verdict

PROJECT = Path(__file__).parents[2] / "examples" / "nasa-upsp-cam5.toml"
DATA = (PROJECT.parent / "../../shared/data/nasa-upsp-cam5").resolve()


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no data of NASA's test at {DATA}")
def test_markers_are_off_their_table():
    verdict = run_verdict(run_project(read_project(PROJECT)))
    assert (verdict.word, verdict.cause) == (DOUBTFUL, "table")
    assert "markers about 0.01 in off their table" in verdict.reason
