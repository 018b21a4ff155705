"""Which project is meant by a folder, and commands that can be copied from what is said."""

import os
import shlex

import pytest

from windmark.app.project_place import project_in
from windmark.errors import UsageError
from windmark.pipeline.typed import typed

RUN, DEFORM = '[[image]]\nfile = "a.tif"\n', '[[volume]]\nname = "wing"\n'


def test_of_several_projects_in_a_folder_the_verb_takes_its_own(tmp_path):
    (tmp_path / "project.toml").write_text(RUN)
    (tmp_path / "deform.toml").write_text(DEFORM)
    assert project_in(tmp_path, "run") == tmp_path / "project.toml"
    assert project_in(tmp_path, "deform") == tmp_path / "deform.toml"
    assert project_in(tmp_path / "deform.toml", "run") == tmp_path / "deform.toml"
    with pytest.raises(UsageError, match=r"several project files, say which: project\.toml, deform\.toml"):
        project_in(tmp_path)
    with pytest.raises(UsageError, match=r"no project of a paint test; it has project\.toml \(windmark run "):
        project_in(tmp_path, "psp")


def test_a_folder_without_a_project_says_how_one_is_made(tmp_path):
    place = tmp_path / "test of today"
    place.mkdir()
    with pytest.raises(UsageError) as found:
        project_in(place, "run")
    assert typed("windmark", "init", place) in str(found.value)
    (place / "broken.toml").write_text("[")
    with pytest.raises(UsageError, match=r"it has broken\.toml"):
        project_in(place, "run")


@pytest.mark.skipif(os.name == "nt", reason="Windows quotes otherwise")
def test_words_with_spaces_are_quoted_and_patterns_are_not():
    assert shlex.split(typed("windmark", "run", "a b/it's.toml")) == ["windmark", "run", "a b/it's.toml"]
    assert typed("x", "a b/*.tif") == "x 'a b'/*.tif"
    assert typed("x", "a/*.tif", "*.tif") == "x a/*.tif *.tif"


@pytest.mark.slow
def test_a_next_step_can_be_copied(windmark, tmp_path):
    made = windmark("simulate", tmp_path / "my test", "--seed", 3)
    (step,) = [line.removeprefix("next: ") for line in made.out.splitlines() if line.startswith("next: ")]
    said = windmark("check", tmp_path / "my test")
    assert f"next: {step}" in said.out
    if os.name != "nt":
        assert shlex.split(step) == ["windmark", "run", str(tmp_path / "my test" / "project.toml")]
