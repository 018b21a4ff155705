"""`windmark calibrate --board`: a dot board drawn pixel by pixel, from pictures to files; wrong usage."""

import json

import numpy as np
import pytest

from windmark import io
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.synth import disc_image

SIZE = (640, 480)
CAMERA = Camera(SIZE, 800.0, k1=-0.1)
COLUMNS, ROWS, PITCH = 10, 7, 4.0
RINGS = ((2, 3), (7, 3), (2, 1))
FREE = ("--free", "focal_px,cx,cy,k1")


def draw(pose, rng):
    """Dark discs of 9 px or so on light paper, three of them with a light hole."""
    image = np.full(SIZE[::-1], 200.0)
    for row in range(ROWS):
        for column in range(COLUMNS):
            at = pose.apply(np.array([column * PITCH, row * PITCH, 0.0]))
            for radius, depth in ((1.0, 150.0), (0.4, -150.0))[: 2 if (column, row) in RINGS else 1]:
                seen = imaged_ellipse(CAMERA, at[None], -pose.rotation[:, 2][None], radius)
                first = np.rint(seen.xy[0]).astype(int) - 13
                if min(*first, *(np.array(SIZE) - first - 27)) < 0:
                    continue
                spot = disc_image(
                    (27, 27), seen.xy[0] - first, seen.axes_px[0], float(seen.angle[0]), depth=abs(depth), blur_px=0.6
                )
                image[first[1] : first[1] + 27, first[0] : first[0] + 27] += (spot - 200.0) * np.sign(depth)
    noisy = image + rng.normal(0, 1.0, image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Six pictures, tilted to all sides and rolled."""
    folder, rng, paths = tmp_path_factory.mktemp("board"), np.random.default_rng(41), []
    for k in range(6):
        around = k * np.pi / 3
        lean = Pose.from_rotvec(0.5 * np.array([np.cos(around), np.sin(around), 0]), np.zeros(3))
        turn = Pose.from_rotvec([0, 0, (k % 3 - 1) * 0.7], np.zeros(3))
        middle = Pose.from_rotvec(np.zeros(3), [-PITCH * (COLUMNS - 1) / 2, -PITCH * (ROWS - 1) / 2, 0])
        pose = Pose.from_rotvec(np.zeros(3), [0, 0, 85.0]) @ lean @ turn @ middle
        paths.append(folder / f"b{k}.png")
        io.write_image(paths[-1], draw(pose, rng))
    return paths


def call(windmark, pictures, folder, *more):
    return windmark("calibrate", *pictures, "--board", PITCH, "--unit", "mm", "-o", folder / "out", *more)


@pytest.fixture(scope="module")
def rings(windmark, pictures, tmp_path_factory, without_pictures):
    """The board by its rings: what the command says, and its folder; its report is not drawn."""
    folder = tmp_path_factory.mktemp("rings")
    with without_pictures():
        return call(windmark, pictures, folder, "--board-marks", "holes:0,0:5,0:0,-2", *FREE, "-r", 8), folder


@pytest.fixture(scope="module")
def plain(windmark, pictures, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    return call(windmark, pictures, folder, *FREE, "-r", 8), folder


@pytest.mark.parametrize(
    ("marks", "datum"),
    [
        pytest.param("rings", "Free network", marks=pytest.mark.slow),
        ("plain", "All markers are held"),
    ],
)
def test_pictures_of_a_board_and_its_pitch_are_enough(request, marks, datum):
    done, folder = request.getfixturevalue(marks)
    assert done.code == 0, done.err
    assert "6 of 6 pictures matched" in done.out
    camera, _ = io.read_camera(folder / "out" / "camera.json")
    assert abs(camera.focal_px - CAMERA.focal_px) < 4 * np.sqrt(camera.cov[0, 0])
    assert abs(camera.focal_px / CAMERA.focal_px - 1) < 0.005
    names = io.read_markers(folder / "out" / "markers.csv").name
    assert len(names) >= 60
    assert ("c-2r-3" in names) == (marks == "rings")
    page = (folder / "out" / "report.html").read_text()
    drawn = ("as taken, with the lens undone", "Half of the pictures", "Where the pictures were taken")
    for words in (datum, *(drawn if marks == "plain" else ())):
        assert words in page
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert summary["halves"]["ratio"] > 0
    assert summary["rms_px"] < 0.1


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_matches_of_a_board_calibrate_again(windmark, rings, tmp_path):
    out = rings[1] / "out"
    again = windmark("calibrate", out / "matches.csv", "-m", out / "markers.csv", "--size", "640x480", "--unit", "mm",
                     "--datum", "free", *FREE, "-o", tmp_path / "again")  # fmt: skip
    assert again.code == 0, again.err
    first, second = (io.read_camera(p / "camera.json")[0].focal_px for p in (out, tmp_path / "again"))
    assert first == pytest.approx(second, rel=1e-5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--board", "0"), "'--board': expected > 0, not 0"),
        (("--board-marks", "holes:0,0"), "two dots or more"),
        (("--board-marks", "rings:0,0:1,0"), "holes, large, small"),
        (("--board-marks", "holes:0,0:a,0"), "two dots or more"),
        (("--board-size", "12"), "--board-size: expected COLUMNSxROWS"),
        (("--board-layout", "round"), "square or staggered"),
        (("--board-layout", "staggered:x"), "LAYOUT:ASPECT"),
        (("-m", "rough.csv"), "either --markers"),
        (("--rig",), "must see the same dots"),
        (("--datum", "free"), "cannot be measured"),
        (("--label", "b0:c00r00=1,2"), "a board has none"),
        (("--images-of", "left=*0", "--images-of", "right=*1"), "fits the pattern of none"),
    ],
)
def test_wrong_usage_is_named(windmark, pictures, tmp_path, options, words):
    done = call(windmark, pictures[:3], tmp_path, *options)
    assert done.code == 2
    assert words in done.err
    assert not (tmp_path / "out").exists()


def test_a_table_is_no_picture_of_a_board(windmark, tmp_path):
    done = windmark("calibrate", tmp_path / "m.csv", "--board", 1, "--unit", "mm")
    assert done.code == 2
    assert "--board is for pictures" in done.err


def test_pictures_without_a_board_say_so(windmark, tmp_path):
    paths = [tmp_path / f"p{k}.png" for k in range(3)]
    for path in paths:
        io.write_image(path, np.full((60, 80), 9, np.uint8))
    done = call(windmark, paths, tmp_path, "-r", 3, "--json")
    assert done.code == 1
    assert "no board was found in any of 3 pictures" in done.json["reason"]
    assert not (tmp_path / "out").exists()
