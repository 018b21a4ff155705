"""One job, one length unit: what is in another one is refused by every verb, with both units and who says them."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import windmark as package
from windmark import io
from windmark.geometry import Camera, Pose
from windmark.pipeline.lengths import Lengths
from windmark.scene import MarkerSet, Mesh
from windmark.scene.units import IN_MM
from windmark.tasks.likely_unit import likely_unit, model_box

CAMERA = Camera((320, 240), 400.0)
POSE = Pose.look_at([0.0, 0, 500], [0, 0, 0], [0, 1, 0])
XYZ = np.array([[0, 0, 0], [50, 0, 0], [0, 50, 0], [50, 50, 5], [20, 30, 0], [80, 10, 0]], dtype=float)


@pytest.fixture
def mixed(tmp_path, monkeypatch):
    """Files in mm and the same in inches, side by side."""
    monkeypatch.chdir(tmp_path)
    mesh = Mesh.make(XYZ[:4], np.array([[0, 1, 2], [1, 3, 2]]))
    for unit in ("mm", "in"):
        io.write_camera(f"camera-{unit}.json", CAMERA, POSE, unit=unit)
        Path(f"picture-{unit}").mkdir()
        io.write_camera(f"picture-{unit}/p.json", CAMERA, POSE, unit=unit)
        io.write_rig(f"rig-{unit}.json", {"camera": POSE}, unit=unit)
        io.write_markers(f"markers-{unit}.csv", MarkerSet.make(list("ABCDEF"), XYZ), length_unit=unit)
        io.write_mesh(f"grid-{unit}.obj", mesh, length_unit=unit)
    io.write_camera("lens.json", CAMERA)
    io.write_image("p.png", np.full((240, 320), 200, np.uint8))
    io.write_image("q.png", np.full((240, 320), 190, np.uint8))
    Path("matches.csv").write_text("image,name,x,y\np,A,10,10\n")

    return tmp_path


M, C, G = ("-m", "markers-mm.csv"), ("-c", "camera-mm.json"), ("-g", "grid-mm.obj")
INCH = ("--unit", "in")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (("resect", "p.png", *C, "-g", "grid-in.obj", *INCH), "camera-mm.json: length unit: its pose is in mm"),
        (("resect", "p.png", "-c", "camera-in.json", *G, *INCH), "grid-mm.obj: length unit: its lengths are in mm"),
        (
            ("resect", "p.png", "-c", "camera-in.json", "-g", "grid-in.obj", *INCH, "--points", "markers-mm.csv"),
            "markers-mm.csv: length unit: its lengths are in mm",
        ),
        (("register", "p.png", *M, "-c", "lens.json", *INCH), "markers-mm.csv: length unit: its lengths are in mm"),
        (
            ("register", "p.png", "-m", "markers-in.csv", "-c", "lens.json", *INCH, "--prior", "camera-mm.json"),
            "camera-mm.json: length unit: its pose is in mm",
        ),
        (("align", "p.png", "q.png", "-m", "markers-in.csv", "-c", "lens.json", *G, *INCH), "grid-mm.obj: length unit"),
        (("track", "p.png", "q.png", *M, "-c", "lens.json", *INCH), "markers-mm.csv: length unit"),
        (
            ("track", "p.png", "q.png", "-m", "markers-in.csv", "-c", "lens.json", *INCH, "--prior", "camera-mm.json"),
            "camera-mm.json: length unit: its pose is in mm",
        ),
        (
            ("calibrate", "matches.csv", *M, "--size", "320x240", "--datum", "free", *INCH),
            "markers-mm.csv: length unit",
        ),
        (("reconstruct", "p.png", "q.png", "-c", "lens.json", "-p", "markers-mm.csv", *INCH), "markers-mm.csv: length"),
        (
            ("reconstruct", "p.png", "q.png", "-c", "lens.json", "--free-frame", "--poses", "picture-mm", *INCH),
            "p.json: length unit: its pose is in mm",
        ),
        (("markers", "check", *M[1:], *INCH), "markers-mm.csv: length unit"),
        (("pov", "camera-mm.json", *INCH), "camera-mm.json: length unit: its pose is in mm"),
    ],
    ids=lambda value: " ".join(str(v) for v in value[:1]) if isinstance(value, tuple) else "",
)
def test_what_is_in_another_unit_is_refused_by_every_verb(windmark, mixed, call, words):
    done = windmark(*call)
    assert done.code == 2, done.out
    assert words in done.err
    assert "in mm, --unit is in; expected the same (windmark convert --to-unit in)" in done.err


def test_without_a_unit_given_two_files_must_agree(windmark, mixed):
    words = "its lengths are in in, camera-mm.json is mm; expected the same"
    guided = windmark("detect", "p.png", "-c", "camera-mm.json", "-m", "markers-in.csv", "-r", 3)
    assert guided.code == 2
    assert f"markers-in.csv: length unit: {words}" in guided.err
    drawn = windmark("pov", "camera-mm.json", "-g", "grid-in.obj")
    assert drawn.code == 2
    assert f"grid-in.obj: length unit: {words}" in drawn.err
    two = windmark("pov", "camera-mm.json", "camera-in.json")
    assert two.code == 2
    assert "camera-in.json: length unit: its pose is in in, camera-mm.json is mm" in two.err


RUN = """
title = "t"
length_unit = "in"
[[camera]]
name = "camera"
file = "camera-in.json"
pose = "known"
[[image]]
file = "p.png"
[grid]
file = "grid-in.obj"
"""
DEFORM = """
title = "t"
length_unit = "in"
[[camera]]
name = "camera"
file = "camera-in.json"
images = "p.png"
[markers]
file = "markers-in.csv"
[grid]
file = "grid-in.obj"
"""


@pytest.mark.parametrize(
    ("verb", "text", "file"),
    [
        ("run", RUN, "camera"), ("run", RUN, "grid"), ("deform", DEFORM, "camera"), ("deform", DEFORM, "markers"),
        ("deform", DEFORM, "grid"),
    ],
)  # fmt: skip
def test_projects_name_the_file_and_their_own_key(windmark, mixed, verb, text, file):
    Path("job.toml").write_text(text.replace(f"{file}-in", f"{file}-mm"))
    done = windmark(verb, "job.toml")
    assert done.code == 2, done.out
    assert f"{file}-mm" in done.err
    assert "in mm, length_unit of job.toml is in; expected the same" in done.err


def test_a_table_without_scale_or_in_a_unit_unknown_here_is_refused(mixed):
    text = Path("markers-mm.csv").read_text()
    for unit, words in (("free; frame of w0", "without scale (a free reconstruction)"), ("furlong", "no unit known")):
        Path("odd.csv").write_text(text.replace("# length unit: mm", f"# length_unit: {unit}"))
        with pytest.raises(io.FileError) as refused:
            Lengths("mm").markers(Path("odd.csv"))
        assert words in str(refused.value)
    Path("word.csv").write_text(text.replace("length unit: mm", "length unit: Inches"))
    assert Lengths("in").markers(Path("word.csv")).length_unit == "in"


def test_a_pose_that_shows_nothing_of_the_grid_is_no_result(windmark, mixed):
    """Neither file says its unit here, so only the picture can tell: nothing of the grid is in it."""
    beside = POSE.translation / 25.4 + np.array([400.0, 0, 0])
    io.write_camera("far.json", CAMERA, Pose(POSE.rotation, beside), unit="mm")
    io.write_mesh("grid.stl", Mesh.make(XYZ[:4], np.array([[0, 1, 2], [1, 3, 2]])))
    done = windmark("resect", "p.png", "-c", "far.json", "-g", "grid.stl", "--unit", "mm", "-o", "out")
    assert done.code == 1
    assert "no node of the grid is visible (4 outside): is the pose of its frame and unit?" in done.err


@pytest.mark.parametrize("name", ["camera.yml", "camera.cameramodel", "model"])
def test_formats_without_a_place_for_the_unit_have_it_in_a_comment(mixed, name):
    io.write_camera(name, CAMERA, POSE, unit="in")
    assert io.read_camera_file(name).length_unit == "in"
    with pytest.raises(io.FileError, match="its pose is in in, --unit is mm"):
        Lengths("mm").camera(Path(name))


def test_nouns_carry_their_unit(mixed):
    markers = Lengths("mm").markers(Path("markers-mm.csv"))
    assert markers.take([0, 2]).length_unit == markers.length_unit == "mm"
    io.write_markers("again.csv", markers)
    assert io.read_marker_unit("again.csv") == "mm"
    for suffix in ("obj", "ply", "vtp", "nc"):
        io.write_mesh(f"grid.{suffix}", Mesh.make(XYZ[:4], np.array([[0, 1, 2], [1, 3, 2]])), length_unit="cm")
        assert io.read_mesh(f"grid.{suffix}").length_unit == "cm"


def test_no_verb_reads_lengths_past_the_check():
    """A camera's interior (`console.read_lens`) has none; `convert` and `undistort` hand the unit on as it is; `init`
    asks the files for theirs, and `check` lists all that differ."""
    readers = {"read_markers", "read_camera", "read_camera_file", "read_mesh", "read_points", "read_rig"}
    handing_on = {"lengths.py", "console.py", "undistort_verb.py", "convert_markers.py", "convert_cameras.py"}
    handing_on |= {"init_verb.py", "folder.py", "new_pictures.py"}
    root = Path(package.__file__).parent
    past = []
    checking = set((root / "pipeline" / "check").glob("*.py"))
    for path in sorted({*(root / "app").rglob("*.py"), *(root / "pipeline").rglob("*.py")} - checking):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in readers:
                owner = getattr(node.func.value, "id", "")
                past += [f"{path.name}: {node.func.attr}"] if owner == "io" and path.name not in handing_on else []
    assert past == []


# --- files that say no unit


UNITS = ("in", "mm", "m", "ft")
PLACES = np.array([[0.1, 0.1, 0], [0.9, 0.15, 0.02], [0.2, 0.8, 0.05], [0.8, 0.9, 0.03], [0.5, 0.5, 0.04]])


def placed(folder, unit, table, grid, says):
    """A table and a grid of a model of one metre, numbers in their own units; ``says``: those that tell theirs."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.1], [1, 1, 0.1]], dtype=float)
    size = {u: 1000.0 / IN_MM[u] for u in UNITS}
    mesh = Mesh.make(size[grid] * corners, np.array([[0, 1, 2], [1, 3, 2]]))
    markers = MarkerSet.make(list("ABCDE"), size[table] * PLACES)
    pose = Pose.look_at([0, 0, 3 * size[unit]], [0, 0, 0], [0, 1, 0])
    io.write_camera(folder / "camera.json", CAMERA, pose, unit=unit)
    io.write_markers(folder / "markers.csv", markers, length_unit=table if "table" in says else "")
    io.write_mesh(folder / "grid.obj", mesh, length_unit=grid if "grid" in says else "")
    return "pov", folder / "camera.json", "-m", folder / "markers.csv", "-g", folder / "grid.obj"


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("says", [(), ("table",), ("grid",), ("table", "grid")])
def test_every_mixture_of_units_is_right_refused_or_named(windmark, tmp_path, unit, says):
    for table in UNITS:
        for grid in UNITS:
            done = windmark(*placed(tmp_path, unit, table, grid, says))
            told = done.err.count("says no length unit; its lengths are taken in " + unit)
            if {"table": table, "grid": grid} == {"table": unit, "grid": unit}:
                assert (done.code, told) == (0, 2 - len(says)), done.err
                assert "rather in" not in done.err
            elif any({"table": table, "grid": grid}[file] != unit for file in says):
                assert done.code == 2
            elif {table, grid} == {"m", "ft"} and done.code == 0:  # three times too small may be a part of the model
                assert told == 2 - len(says)
            elif says and table != grid:  # the silent one is wrong
                wrong = "inch" if (other := grid if says == ("table",) else table) == "in" else other
                assert re.search(rf"(rather in|does not lie at .*, in) .*\b{wrong}\b", done.err), done.err
            elif unit in (table, grid):  # which of the silent ones is wrong, nobody can know
                assert "rather in" in done.err or "(which says none, either), in" in done.err
            elif table != grid:
                assert done.code == 2 or told == 2
            else:  # both alike, and both silent: only the camera says another unit
                assert (done.code, told) == (0, 2)


def test_points_beside_the_grid_name_the_unit_in_which_they_would_be_at_it(windmark, tmp_path):
    done = windmark(*placed(tmp_path, "in", "mm", "in", ("grid",)))
    assert done.code == 2
    assert "markers.csv: length unit: says none; in inch it does not lie at" in done.err
    assert "in mm it would (windmark convert --unit mm --to-unit in)" in done.err
    done = windmark(*placed(tmp_path, "mm", "in", "mm", ("grid",)))
    assert done.code == 0  # within the grid, but in a corner of it
    assert "its lengths are taken in mm, as" in done.err
    assert "by their size they are rather in inch" in done.err


def test_what_is_on_the_grid_or_anywhere_else_is_left_alone():
    rng = np.random.default_rng(0)
    box = np.zeros(3), np.array([10.0, 4, 1])
    assert likely_unit(rng.uniform(*box, (20, 3)), box, "mm")[0] == []
    assert likely_unit(rng.uniform(*box, (20, 3)) + 100, box, "mm")[0] == []  # another frame, no unit
    assert likely_unit(25.4 * rng.uniform(*box, (3, 3)), box, "in")[0] == []  # too few
    assert likely_unit(25.4 * rng.uniform(*box, (20, 3)), box, "in") == (["mm"], True)
    assert likely_unit(25.4 * rng.uniform(*box, (20, 3)), box, "mm", of_surface=True) == (["in"], True)
    assert likely_unit(rng.uniform(*box, (20, 3)) / 1000, box, "mm") == (["m", "ft"], False)
    far = Mesh.make(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-9e3, -9e3, 0], [9e3, -9e3, 0], [0, 9e3, 0]]),
                    np.array([[0, 1, 2], [3, 4, 5]]))  # fmt: skip
    assert model_box(replace(far, triangles=np.array([[0, 1, 2], [0, 2, 1], [3, 4, 5]]),
                             volume=np.array(["a", "a", "far"])))[1].tolist() == [1, 1, 0]  # fmt: skip
