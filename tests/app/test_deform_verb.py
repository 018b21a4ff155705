"""`windmark deform`: a synthetic test end to end, users' laws, bad frames, live, and bad input."""

import csv
import json
import shutil
import threading
import time
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import imageio.v3
import numpy as np
import pytest
import xarray

from windmark import io
from windmark.app import deform_film, deform_verb
from windmark.geometry import Pose

FRAMES = 6


@pytest.fixture(scope="module")
def made(bending, tmp_path_factory):
    """A test of six frames, two of them without wind."""
    return bending(FRAMES, tmp_path_factory.mktemp("deform"))


@pytest.fixture(scope="module")
def done(made, windmark):
    """The command run on it."""
    return windmark("deform", made / "deform.toml", "--json")


@pytest.fixture
def copy(made, tmp_path):
    """A copy to spoil, without results; its zero is one frame, each of which costs as three others."""
    folder = tmp_path / "test"
    shutil.copytree(made, folder, ignore=shutil.ignore_patterns("deformation*"))
    edited(folder, ('zero = ["0", "1"]', 'zero = ["0"]'))
    return folder


@pytest.fixture
def bare(copy):
    """The same without grids, their values and points, for what is told of frames and cameras: half of a frame's time.

    What becomes of those where a camera or a frame is lost is tried with bad and with dropped frames.
    """
    without_grids(copy)
    return copy


def without_values(folder):
    """The project maps no picture onto the grid and writes none of it."""
    edited(folder, ('[values]\ncameras = ["cam1"]\nblack = 64\n', ""), ('grid = ["vtk"]\n', ""))


def without_grids(folder):
    """And has no points on it."""
    without_values(folder)
    edited(folder, ('[[points]]\nfile = "taps.csv"\n', ""))


def rows(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream))


def truth(folder):
    """Rise and twist of the tip in every frame."""
    return [(528 * float(r["tip_fraction"]), float(r["twist_deg"])) for r in rows(folder / "truth" / "states.csv")]


def edited(folder, *changes, name="deform.toml"):
    text = (folder / name).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.slow
def test_the_laws_parameters_are_those_of_the_truth(made, done):
    assert done.code == 0
    assert (done.json["frames"], done.json["lost"]) == (FRAMES, 0)
    for row, (rise, twist) in zip(rows(made / "deformation" / "deformation.csv"), truth(made), strict=True):
        for name, expected in (("bend_2", 1.5 * rise), ("bend_3", -0.5 * rise), ("twist_1", 0.0), ("twist_2", twist)):
            error = float(row[f"wing.{name}"]) - expected
            assert abs(error) < 4 * float(row[f"sigma_wing.{name}"]), (row["frame"], name)
    assert float(row["sigma_wing.twist_2"]) < 0.05


def test_the_rigid_motion_is_found_too(made, done):
    row = rows(made / "deformation" / "deformation.csv")[-1]
    assert float(row["turn_y_deg"]) == pytest.approx(2.0, abs=4 * float(row["sigma_turn_y_deg"]))
    assert float(row["alpha_deg"]) == pytest.approx(2.0, abs=0.01)  # the column of frames.csv went along
    known = json.loads((made / "deformation" / "units.json").read_text(encoding="utf-8"))["motion"]
    markers = io.read_markers(made / "markers.csv")
    assert known["shift_of_model_point"] == pytest.approx(
        markers.xyz[markers.role != "wall"].mean(axis=0), abs=0.02  # the zero has corrected their places
    )


def test_all_files_agree(made, done):
    folder = made / "deformation"
    with xarray.open_dataset(folder / "deformation.nc", engine="h5netcdf") as data:
        twist, sigma = data["twist"].values, data["twist_sigma"].values
        assert data.sizes["frame"] == FRAMES
        assert data["parameters"].attrs["names"].split()[0] == "wing.bend_2"
        assert data["time"].values == pytest.approx(np.arange(FRAMES) / 50)
    table = [r for r in rows(folder / "span.csv") if r["frame"] == str(FRAMES - 1)]
    assert [float(r["twist_deg"]) for r in table] == pytest.approx(twist[-1], rel=1e-6)
    assert [float(r["sigma_twist_deg"]) for r in table] == pytest.approx(sigma[-1], rel=1e-6)
    assert len(rows(folder / "markers.csv")) > 50 * FRAMES
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Bending and twist along the span" in page
    assert "Wind-off zero" in page
    zero = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["zero"]
    assert f"(marker {zero['marker']})" in page
    assert zero["deformed"] < 4 * zero["deformed_sigma"], "it was drawn undeformed"
    shown = page.count('<figure class="wm-photo">')  # both cameras, of the first and of the worst frame
    assert shown == page.count("What the cameras saw: frame") * 2 > 0
    photos = page.split('<figure class="wm-photo">')[1:]
    assert all(len(photo.partition("</figure>")[0]) < 150_000 for photo in photos)
    assert (folder / "deformation.gif").stat().st_size > 10_000
    assert "Values on the deformed grid" in page
    assert b"ratio_cam1" in (folder / "grid" / "4.vtp").read_bytes()
    steps = ET.parse(folder / "grid.pvd").getroot().findall("Collection/DataSet")
    assert [s.get("file") for s in steps] == [f"grid/{k}.vtp" for k in range(FRAMES)]
    assert [float(s.get("timestep")) for s in steps] == pytest.approx(np.arange(FRAMES) / 50)
    moved, rest = io.read_mesh(folder / "grid" / "0.vtp"), io.read_mesh(made / "model.grid")
    assert len(moved.vertices) == len(rest.vertices)


def test_the_film_has_its_scale_and_the_model_at_rest(made, done):
    images = imageio.v3.imread(made / "deformation" / "deformation.gif").astype(int)
    width = deform_film.FILM_SIZE[0]
    strip = images[0][:, width:]
    assert len(np.unique(strip.reshape(-1, 3), axis=0)) > 20, "the colours of the scale"
    assert (images[:, deform_film.CAPTION_PX:, width:] == strip[deform_film.CAPTION_PX:]).mean() > 0.9, "one for all"
    pale = np.abs(images[:, :, :width] - 255 * deform_film.GHOST).max(axis=3) < 3
    assert pale[-1].sum() > 1000, "beside the bent wing"
    assert pale[0].sum() < 0.1 * pale[-1].sum(), "behind the wing at rest"


def test_the_outline_of_what_the_frame_cuts_off_is_closed():
    shade = np.full((5, 6), np.nan, dtype=np.float32)
    shade[1:4, 2:] = 1.0
    ghost = deform_film.ghost_of(shade)
    assert (ghost[0] == 1.0).all()
    assert (ghost[2] == [1.0, 1.0, deform_film.OUTLINE, *[deform_film.GHOST] * 2, deform_film.OUTLINE]).all()
    assert (ghost[1, 2:] == deform_film.OUTLINE).all()


@pytest.mark.parametrize(("factor", "said"), [(1, "frame 3, 0.06 s: deformation"),
                                              (7, "frame 3, 0.06 s: deformation, drawn 7 times as large")])  # fmt: skip
def test_the_film_says_how_many_times_as_large_it_draws(factor, said):
    assert deform_film.caption(SimpleNamespace(key="3", time_s=0.06), factor) == said


def test_taps_move_with_the_wing_and_have_values(made, done):
    """Place of every tap in the last frame against the truth; ratio wind-off / frame of two cameras within sigma."""
    from windmark.pipeline.simulate_deforming import _states
    from windmark.synth import HalfModel, flex

    text = (made / "deformation" / "points-taps.csv").read_text()
    assert text.startswith("# length unit: mm")
    table = list(csv.DictReader(line for line in text.splitlines() if line[0] != "#"))
    assert len(table) == FRAMES * 2 * 54
    last = [r for r in table if r["frame"] == str(FRAMES - 1) and r["name"].startswith("U")]
    points = io.read_points(made / "taps.csv")
    taps = dict(zip(points.name, points.xyz, strict=True))
    state, shape = _states(FRAMES)[-1], HalfModel()
    for r in last:
        bent = flex(taps[r["name"]][None], state.tip_fraction, state.twist_deg, root=shape.body_radius, span=shape.span,
                    sweep_deg=shape.sweep_deg, axis_x=0.25 * shape.root_chord)  # fmt: skip
        assert np.linalg.norm(state.motion.apply(bent)[0] - [float(r[c]) for c in "xyz"]) < 0.15
    seen = {c: {r["name"]: r for r in last if r["camera"] == c and r["ratio"]} for c in ("cam1", "cam2")}
    both = sorted(set(seen["cam1"]) & set(seen["cam2"]))
    assert len(both) > 15
    a, b = (np.array([[float(seen[c][n][k]) for n in both] for k in ("ratio", "sigma_ratio")]) for c in seen)
    assert np.median(np.abs(a[0] - b[0]) / np.hypot(a[1], b[1])) < 1.2
    assert all(r["reason"] for r in table if not r["value"])
    assert not any(r["reason"] for r in table if r["value"])


def test_points_need_a_grid_and_a_table(copy, windmark):
    done = windmark("deform", edited(copy, ('file = "taps.csv"', 'file = "no.csv"')))
    assert done.code == 2
    assert "points[0].file" in done.err
    (copy / "no.csv").write_text("name,x,y,z\n")
    done = windmark("deform", copy / "deform.toml")
    assert done.code == 2
    assert "no points" in done.err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_one_camera_alone_and_cameras_that_move(made, windmark, tmp_path):
    twist = truth(made)[-1][1]
    folder = tmp_path / "test"
    shutil.copytree(made, folder, ignore=shutil.ignore_patterns("deformation*"))
    without_grids(folder)
    for k, options in enumerate((("--camera", "cam1"), ("--moves", "cam2"))):
        done = windmark("deform", folder / "deform.toml", *options, "-o", tmp_path / str(k), "--json")
        assert done.code == 0, done.err
        last = rows(tmp_path / str(k) / "deformation.csv")[-1]
        assert abs(float(last["wing.twist_2"]) - twist) < 5 * float(last["sigma_wing.twist_2"]) < 0.3
    with xarray.open_dataset(tmp_path / "0" / "deformation.nc") as found:
        assert found.sizes["camera"] == 1
    wrong = windmark("deform", folder / "deform.toml", "--camera", "cam9", "-o", tmp_path / "no")
    assert wrong.code == 2
    assert "expected one of cam1, cam2" in wrong.err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_users_own_law_gives_the_same(made, done, windmark):
    assert len([line for line in (made / "my_law.py").read_text().splitlines() if line.strip()]) <= 15
    alone = windmark("laws", made / "my_law.py", "-m", made / "markers.csv", "--volume", "wing")
    assert alone.code == 0
    assert "sound" in alone.out
    own = windmark("deform", made / "deform-own-law.toml", "--json")
    assert own.code == 0
    apart = np.subtract(own.json["last_twist_deg"], done.json["last_twist_deg"])
    assert np.abs(apart[1:]).max() < 4 * max(done.json["last_twist_sigma_deg"])


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_bad_frame_is_flagged_and_the_next_one_recovers(copy, windmark):
    images = copy / "images"
    (images / "cam2-0002.tif").write_bytes(b"II*\0 no image")  # one camera unreadable: the other goes on
    for name in ("cam1", "cam2"):
        image = io.read_image(images / f"{name}-0003.tif")
        io.write_image(images / f"{name}-0003.tif", np.zeros_like(image))
    done = windmark("deform", copy / "deform.toml", "--json")
    assert done.code == 0
    table = rows(copy / "deformation" / "deformation.csv")
    assert [r["status"] for r in table] == ["cold", "tracked", "tracked", "lost", table[4]["status"], "tracked"]
    assert table[4]["status"] in ("tracked", "cold")
    assert "cam2" in table[2]["reason"]
    assert table[3]["wing.bend_2"] == ""
    twist = truth(copy)[4][1]
    assert float(table[4]["wing.twist_2"]) == pytest.approx(twist, abs=4 * float(table[4]["sigma_wing.twist_2"]))


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_camera_that_contradicts_the_other_is_left_out_until_it_agrees(bare, windmark):
    """Something else in the first picture of a camera: the test goes on without it, and with it from the next."""
    edited(bare, ('zero = ["0"]', "zero = []"))
    image = io.read_image(bare / "images" / "cam2-0000.tif")
    io.write_image(bare / "images" / "cam2-0000.tif", image[::-1])
    done = windmark("deform", bare / "deform.toml", "--json")
    assert done.code == 0, done.err
    table = rows(bare / "deformation" / "deformation.csv")
    assert [r["status"] for r in table] == ["cold"] + ["tracked"] * (FRAMES - 1)
    assert table[0]["reason"].startswith("cam2: left out, it contradicts cam1: ")
    second = [r for r in rows(bare / "deformation" / "cameras.csv") if r["camera"] == "cam2"]
    assert [int(r["spots"]) > 20 for r in second] == [False] + [True] * (FRAMES - 1)
    assert second[0]["reason"].startswith("left out")


SECOND = '[[camera]]\nname = "cam2"\nfile = "cam2.json"\nimages = "images/cam2-*.tif"\n'


def turned_by_a_degree(folder):
    """The second camera is not where its file says."""
    camera, pose = io.read_camera(folder / "cam2.json")
    turned = Pose.from_rotvec([0.0, np.radians(1.0), 0.0], np.zeros(3)) @ pose
    io.write_camera(folder / "cam2.json", camera, turned, unit="mm")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_camera_that_is_not_where_its_file_says_is_named_by_the_markers_on_walls(bare, windmark):
    """The other one measures what it measures by itself."""
    shutil.copy(bare / "deform.toml", bare / "one.toml")
    one_camera = edited(bare, (SECOND, ""), name="one.toml")
    assert windmark("deform", one_camera, "-o", bare / "one", "--json").code == 0
    turned_by_a_degree(bare)
    done = windmark("deform", bare / "deform.toml", "-o", bare / "both", "--json")
    assert done.code == 0, done.err
    said = done.json["verdict"]
    assert (said["word"], said["cause"]) == ("doubtful", "moved")
    assert "cam2 in frame 0: it is not where it is said to be: 11 markers on walls are" in said["reason"]
    assert {r["spots"] for r in rows(bare / "both" / "cameras.csv") if r["camera"] == "cam2"} == {"0"}
    one, both = (rows(bare / name / "deformation.csv") for name in ("one", "both"))
    for a, b in zip(one, both, strict=True):
        for name in ("wing.bend_2", "shift_y"):
            assert float(a[name]) == pytest.approx(float(b[name]), abs=0.2 * float(a[f"sigma_{name}"]))


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("px", [3, 8])
def test_a_single_camera_that_was_bumped_measures_nothing(bare, windmark, px):
    """The model alone would fit, with a motion that is the camera's."""
    edited(bare, (SECOND, ""))
    for k in range(3, FRAMES):
        name = bare / "images" / f"cam1-{k:04d}.tif"
        io.write_image(name, np.roll(io.read_image(name), px, axis=1))
    done = windmark("deform", bare / "deform.toml", "--json")
    assert done.code == 0, done.err
    table = rows(bare / "deformation" / "deformation.csv")
    assert [r["status"] for r in table] == ["cold", "tracked", "tracked", "lost", "lost", "lost"]
    assert all("it is not where it is said to be" in r["reason"] for r in table[3:])
    assert all(f"are {px} px from their places" in r["reason"] for r in table[3:])


def test_of_two_cameras_without_walls_nobody_knows_which_one_was_moved(copy, windmark):
    """Nothing is measured, where one was by a degree."""
    text = (copy / "markers.csv").read_text().splitlines()
    (copy / "markers.csv").write_text("\n".join(line for line in text if not line.endswith("wall")) + "\n")
    turned_by_a_degree(copy)
    done = windmark("deform", copy / "deform.toml")
    assert done.code == 2
    assert "without cam1 or cam2 the rest is registered, so which of them is wrong is not clear" in done.err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_dropped_frames_leave_gaps(copy, windmark):
    (copy / "images" / "cam1-0002.tif").unlink()
    (copy / "images" / "cam1-0003.tif").unlink()
    (copy / "images" / "cam2-0003.tif").unlink()
    done = windmark("deform", copy / "deform.toml", "--json")
    assert (done.code, done.json["frames"], done.json["lost"]) == (0, FRAMES - 1, 0)
    table = rows(copy / "deformation" / "deformation.csv")
    assert [r["frame"] for r in table] == ["0", "1", "2", "4", "5"]
    assert "cam1: no image" in table[2]["reason"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_live_gives_the_same_as_from_the_disk(made, done, copy, windmark):
    edited(copy, ('zero = ["0"]', 'zero = ["0", "1"]'))
    incoming = copy / "incoming"
    incoming.mkdir()

    def deliver():
        for k in range(FRAMES):
            for name in ("cam2", "cam1"):
                file = copy / "images" / f"{name}-{k:04d}.tif"
                shutil.copy(file, incoming / f".{file.name}")
                (incoming / f".{file.name}").rename(incoming / file.name)
            time.sleep(0.05)

    sender = threading.Thread(target=deliver)
    sender.start()
    live = windmark("deform", copy / "deform.toml", "--watch", incoming, "--frames", FRAMES, "--idle", 60, "--json")
    sender.join()
    assert (live.code, live.json["frames"], live.json["lost"]) == (0, FRAMES, 0)
    assert live.json["median_latency_ms"] > 0
    # A first frame is found by the cameras that have delivered it; from another start the fits end 1e-4 deg apart.
    assert live.json["last_twist_deg"] == pytest.approx(done.json["last_twist_deg"], abs=1e-3)


def test_nothing_arrives(copy, windmark):
    (copy / "incoming").mkdir()
    done = windmark("deform", copy / "deform.toml", "--watch", copy / "incoming", "--idle", 0.1)
    assert done.code == 1
    assert "no frame arrived" in done.err


LAW_THAT_FAILS = """\
from windmark.deformation import law


@law(tip="mm")
def wing(xyz, tip):
    return xyz + tip * missing
"""
LAW_OF_WRONG_SHAPE = """\
def wing(xyz, tip):
    return xyz[:, :2] * tip
"""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (LAW_THAT_FAILS, ["my_law.py:6", "missing"]),
        (LAW_OF_WRONG_SHAPE, ["my_law.py:1", "(55, 3)"]),
        ("def wing(xyz, tip:\n", ["my_law.py:1"]),
        ("import numpy\n", ["my_law.py", "holds no law"]),
    ],
)  # fmt: skip
def test_a_wrong_law_is_told_with_its_file_and_line(copy, windmark, text, expected):
    (copy / "my_law.py").write_text(text)
    project = edited(copy, ("root = [103.283, 72, 0], end = [384.026, 600, 0]", ""), name="deform-own-law.toml")
    done = windmark("deform", project)
    assert done.code == 2
    for part in expected:
        assert part in done.err
    assert not (copy / "deformation-own-law").exists()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (('law = "beam"', 'law = "bean"'), ["volume[1].law", "bean", "modal_beam"]),
        (("section = [0, 1, 0]", "sections = [0, 1, 0]"), ["sections", "section"]),
        (("[stations]", "[station]"), ["station", "unknown key", "stations"]),
        (('name = "wing"', 'name = "wings"'), ["stations.volume", "'wing'", "did you mean wings?"]),
        (('file = "cam1.json"', 'file = "cam3.json"'), ["camera[0].file", "cam3.json"]),
        (("images/cam2-*.tif", "images/cam3-*.tif"), ["camera[1].images", "no file matches"]),
        (('images = "images/cam1-*.tif"', "images = []"), ["camera[0]", "images", "at least one name"]),
        (('zero = ["0"]', 'zero = ["77"]'), ["sequence.zero", "77"]),
        (('parent = "body"', 'parent = "fuselage"'), ["volume", "fuselage"]),
        (("chord = [150, 0, 0]", "chord = [0, 0, 0]"), ["stations", "chord"]),
        (('frames = "frames.csv"', 'frames = "none.csv"'), ["sequence.frames", "none.csv"]),
        (('grid = ["vtk"]', 'grid = ["stl"]'), ["output.grid"]),
        (('grid = ["vtk"]', 'grid = ["plot3d"]'), ["values", 'output.grid = ["vtk"]']),
        (('cameras = ["cam1"]', 'cameras = ["cam7"]'), ["values", "cam7"]),
    ],
)
def test_bad_projects_name_the_key(copy, windmark, change, expected):
    done = windmark("deform", edited(copy, change))
    assert done.code == 2
    for part in expected:
        assert part in done.err, done.err
    assert not (copy / "deformation").exists()


def test_a_law_needs_markers_of_its_volume(copy, windmark):
    text = (copy / "markers.csv").read_text()
    (copy / "markers.csv").write_text(text.replace(",wing,", ",flap,"))
    done = windmark("deform", copy / "deform.toml")
    assert done.code == 2
    assert "volume[1].name" in done.err
    assert "body, flap" in done.err


def test_a_camera_without_a_pose_is_no_station(copy, windmark):
    camera, _ = io.read_camera(copy / "cam1.json")
    io.write_camera(copy / "cam1.json", camera)
    done = windmark("deform", copy / "deform.toml")
    assert done.code == 2
    assert "cam1.json" in done.err
    assert "no pose" in done.err


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_images_of_another_size_lose_their_camera_only(bare, windmark):
    for k in range(FRAMES):
        image = io.read_image(bare / "images" / f"cam2-{k:04d}.tif")
        io.write_image(bare / "images" / f"cam2-{k:04d}.tif", image[:, :300])
    done = windmark("deform", bare / "deform.toml", "--json")
    assert (done.code, done.json["lost"]) == (0, 0)
    reason = rows(bare / "deformation" / "deformation.csv")[0]["reason"]
    assert "300 x 400 pixels" in reason


@pytest.mark.slow
def test_no_usable_frame_is_a_refusal(bare, windmark):
    for file in (bare / "images").iterdir():
        io.write_image(file, np.zeros((400, 640), np.uint8))
    done = windmark("deform", edited(bare, ('zero = ["0"]', "zero = []")))
    assert done.code == 1
    assert "no frame gave a deformation" in done.err
    done = windmark("deform", edited(bare, ("zero = []", 'zero = ["0"]')))
    assert done.code == 2
    assert "no wind-off frame can be used" in done.err


@pytest.mark.slow
def test_without_its_pictures_and_its_film_the_deformation_is_there(copy, windmark, no_pictures, monkeypatch):
    from windmark.app import deform_report

    def broken(*_):
        raise ValueError("no such colour (conftest.py:")

    monkeypatch.setattr(deform_report, "film", broken)
    done = windmark("deform", copy / "deform.toml", "--json")
    assert done.code == 0, done.err
    assert done.json["not_drawn"][-1].startswith("film: ValueError")
    assert done.json["lost"] == 0
    page = (copy / "deformation" / "report.html").read_text()
    assert page.count("This part is missing: ") == len(done.json["not_drawn"]) > 4
    assert len(rows(copy / "deformation" / "deformation.csv")) == FRAMES
    assert not (copy / "deformation" / "deformation.gif").exists()


def test_a_warning_is_counted_once_a_frame():
    """Several markers of one frame counted as frames: "17 of 8 frames"."""
    marker = "W{} is {} mm from where its table has it"
    rows = [
        SimpleNamespace(key="3", warnings=(marker.format(4, 0.4), marker.format(6, 0.5))),
        SimpleNamespace(key="4", warnings=("law of wing too simple: what is left looks like twist of 0.2 deg at W5",)),
        SimpleNamespace(key="5", warnings=("law of wing too simple: what is left looks like bending of 1 mm at W5",)),
    ]
    assert list(deform_verb.sentences(SimpleNamespace(good=rows), "warnings").items()) == [
        ("frame 4: law of wing too simple: what is left looks like twist of 0.2 deg at W5", 2),
        ("frame 3: W4 is 0.4 mm from where its table has it", 1),
    ]
