"""A run that goes on is the same one where every file that it was made from is the same, also those nothing names."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from windmark import io
from windmark.io.errors import noted, reading, witness
from windmark.pipeline.deform.imported import imported_files
from windmark.pipeline.deform.load import _law
from windmark.pipeline.same_run import changed, made_with, with_all
from windmark.scene import Mesh


def write(path, text=""):
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    return path


def test_files_that_are_read_in_a_block_are_noted_and_those_of_a_block_within_it_too(tmp_path):
    a, b, c = (write(tmp_path / name) for name in "abc")
    with noted() as outer:
        with reading(a):
            pass
        with noted() as inner, reading(b):
            pass
    with reading(c):
        pass
    assert outer == {str(a), str(b)}
    assert inner == {str(b)}


def test_files_that_no_key_names_are_compared_by_their_paths(tmp_path):
    project, grid, part = (write(tmp_path / name, name) for name in ("p.toml", "g.vtm", "g/0.vts"))
    picture = write(tmp_path / "images" / "1.tif")
    read = [grid, part, picture, tmp_path / "gone"]

    def made():
        return made_with("x", {}, with_all([("grid.file", grid)], read, project, [picture]))

    before = made()
    assert [*before["files"]] == ["grid.file", "g/0.vts"]
    assert changed(before, made()) is None
    write(picture, "another")
    assert changed(before, made()) is None
    write(part, "longer")
    assert changed(before, made()) == "g/0.vts has changed since"
    part.unlink()
    assert changed(before, made()) == "other files take part now"


def test_the_parts_of_a_grid_of_several_files_are_read_too(tmp_path):
    plate = Mesh.make([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    (tmp_path / "in & out").mkdir()
    for name in ("a", "b"):
        io.write_mesh(tmp_path / "in & out" / f"{name}.vtp", plate)
    sets = "".join(f'<DataSet index="{k}" name="{n}" file="in &amp; out/{n}.vtp"/>' for k, n in enumerate("ab"))
    head = '<VTKFile type="vtkMultiBlockDataSet" version="1.0"><vtkMultiBlockDataSet>'
    whole = write(tmp_path / "grid.vtm", f"{head}{sets}</vtkMultiBlockDataSet></VTKFile>")
    names = [whole, *(tmp_path / "in & out" / f"{n}.vtp" for n in "ab")]
    with witness() as seen, noted() as read:
        assert len(io.read_mesh(whole).vertices) == 8
    assert read == set(map(str, names))
    assert set(seen) >= read
    with noted() as read:
        io.read_mesh(names[1])
    assert read == {str(names[1])}


@pytest.fixture
def laws(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    names = ("law_helper_x", "law_kit_x", "law_kit_x.deep")
    write(tmp_path / "law_helper_x.py", "import law_kit_x.deep\nSCALE = 2.0\n")
    write(tmp_path / "law_kit_x" / "__init__.py")
    write(tmp_path / "law_kit_x" / "deep.py", "import numpy, json\n")
    text = "import numpy as np\nfrom law_helper_x import SCALE\n\ndef bend(xyz, tip):\n    return SCALE * tip * xyz\n"
    yield write(tmp_path / "law.py", text)
    for name in names:
        sys.modules.pop(name, None)


def test_what_a_laws_file_imports_is_read_however_often_it_is_loaded(laws):
    folder = laws.parent
    project, entry = SimpleNamespace(path=folder / "p.toml"), SimpleNamespace(law="law.py", options={})
    for _ in range(2):
        with noted() as read:
            law = _law(project, entry, np.zeros((1, 3)))
        assert law.parameters
        assert read == {str(folder / n) for n in ("law.py", "law_helper_x.py", "law_kit_x/__init__.py",
                                                  "law_kit_x/deep.py")}  # fmt: skip


def test_pythons_own_and_installed_packages_are_no_users_files():
    assert imported_files("import os.path, numpy, scipy.linalg\nfrom windmark import io\nfrom . import x\n") == []
