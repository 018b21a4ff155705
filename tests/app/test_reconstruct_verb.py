"""`windmark reconstruct`: drawn pictures of unknown markers, from files to files; refusals, wrong usage."""

import re

import numpy as np
import pytest
import reconstruct_scenes as scenes

from windmark import io
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.scene import MarkerSet
from windmark.synth import disc_image

PACKED = r'base64,[A-Za-z0-9+/=]+|<script type="text/plain".*?</script>'
"""Data, in which any letters may stand beside each other."""

CAMERA = Camera((1000, 750), 1020.0, 1.0, 503.0, 371.0, k1=-0.045)
RADIUS, HALF = 4.5, 12
NAMES = [f"P{k}" for k in range(6)]


def draw(case, view, rng):
    """Dark discs of 4 px or so for all spots on light paper; false ones are seen from the front."""
    image = np.full(CAMERA.size_px[::-1], 200.0)
    pose = Pose(case.poses.rotation[view], case.poses.translation[view])
    for xy, label in zip(case.detections[view].xy, case.labels[view], strict=True):
        axes, angle, middle = (3.5, 3.5), 0.0, xy
        if label >= 0:
            seen = imaged_ellipse(CAMERA, pose.apply(case.xyz[[label]]), pose.rotation[None, :, 2], RADIUS)
            axes, angle, middle = seen.axes_px[0], float(seen.angle[0]), seen.xy[0]
        first = np.rint(middle).astype(int) - HALF
        if min(*first, *(np.array(CAMERA.size_px) - first - 2 * HALF - 1)) < 0:
            continue
        disc = disc_image((2 * HALF + 1, 2 * HALF + 1), middle - first, axes, angle, depth=150.0, blur_px=0.6)
        image[first[1] : first[1] + 2 * HALF + 1, first[0] : first[0] + 2 * HALF + 1] += disc - 200.0
    return np.clip(np.rint(image + rng.normal(0, 1.0, image.shape)), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def wall():
    """A plate with 40 unknown markers, six of them known."""
    return scenes.make(21, "plate", "walk", views=6, points=40, missing=0.05, false=0.05, noise=0.0, camera=CAMERA)


@pytest.fixture(scope="module")
def folder(wall, tmp_path_factory):
    """Six pictures, one without any marker, the camera and the primaries."""
    place, rng = tmp_path_factory.mktemp("wall"), np.random.default_rng(5)
    for v in range(6):
        io.write_image(place / f"w{v}.png", draw(wall, v, rng))
    io.write_image(place / "empty.png", np.clip(rng.normal(200, 1, (750, 1000)), 0, 255).astype(np.uint8))
    io.write_camera(place / "camera.json", CAMERA)
    primary = wall.xyz[wall.primary]
    io.write_markers(place / "primary.csv", MarkerSet.make(NAMES, primary, sigma=np.full((6, 3), 0.02)))
    return place


def call(windmark, folder, out, *more, images=None, primary="primary.csv"):
    paths = [folder / f"{n}.png" for n in images or ["w0", "w1", "w2", "empty", "w3", "w4", "w5"]]
    unit = () if "--unit" in more else ("--unit", "mm")
    return windmark("reconstruct", *paths, "-c", folder / "camera.json", "-p", folder / primary, *unit, "-r", 3, "-r",
                    4.5, "-o", out, *more)  # fmt: skip


@pytest.fixture(scope="module")
def done(windmark, folder, tmp_path_factory):
    """One run with a pair of pictures."""
    out = tmp_path_factory.mktemp("out") / "result"
    return call(windmark, folder, out, "--pair", "w1", "w3"), out


@pytest.mark.slow
def test_markers_are_found_in_the_frame_of_the_primaries(done, wall):
    answer, out = done
    assert answer.code == 0, answer.err
    assert "6 of 7 pictures used" in answer.out
    assert "not used: empty: 0 spots" in answer.out
    found = io.read_markers(out / "markers.csv")
    assert set(found.name[found.role == "primary"].tolist()) == set(NAMES)
    gap = np.linalg.norm(found.xyz[:, None] - wall.xyz[None], axis=2)
    who = gap.argmin(axis=1)
    assert len(np.unique(who)) == len(who)
    assert np.isin(np.flatnonzero(wall.views_of >= 4), who).all()
    error, sigma = found.xyz - wall.xyz[who], np.sqrt((found.sigma**2).sum(axis=1).mean())
    assert np.sqrt((error**2).sum(axis=1).mean()) < 3 * sigma
    for k, name in enumerate(found.name):
        if name in NAMES:
            assert who[k] == wall.primary[NAMES.index(name)]


def test_normals_come_from_the_ellipses(done):
    """All markers of the plate face along z; half of the radius' pixels are its edge, so degrees are what there is."""
    _, out = done
    found, told = io.read_markers(out / "markers.csv"), io.read_json(out / "summary.json")
    known = np.isfinite(found.normal).all(axis=1)
    assert known.sum() == told["normals"] > 10
    off = np.degrees(np.arccos(np.clip(found.normal[known, 2], -1, 1)))
    assert np.median(off) < 3 * told["normal_sigma_deg"]
    assert 0 < told["normal_sigma_deg"] < 10
    assert abs(np.median(found.radius[known]) - RADIUS) < 0.05 * RADIUS


def test_every_file_can_be_read_back(done, wall):
    _, out = done
    matches = io.read_matches(out / "matches.csv")
    assert set(matches.image.tolist()) == {f"w{v}" for v in range(6)}
    table = io.read_table(
        out / "residuals.csv", required=(), known=("image", "name", "x", "y", "dx", "dy", "test", "used")
    )
    assert len(table) >= len(matches.name)
    _, pose = io.read_camera(out / "views" / "w2.json")
    true = Pose(wall.poses.rotation[2], wall.poses.translation[2])
    assert np.linalg.norm(pose.center - true.center) < 1.0
    assert io.read_camera(out / "camera.json")[0].focal_px == CAMERA.focal_px
    assert not (out / "views" / "empty.json").exists()
    assert io.read_json(out / "summary.json")["pictures"][3]["problem"].startswith("0 spots")


def test_the_pair_is_drawn_and_its_spots_are_on_their_lines(done):
    answer, out = done
    pair = io.read_json(out / "summary.json")["pair"]
    assert pair["images"] == ["w1", "w3"]
    assert pair["in_both"] > 25
    assert 0 < pair["rms_px"] < 0.2
    assert io.read_grey(out / "pair.png").shape[1] > 1000
    assert "pair.png" in answer.out


def test_the_report_has_pictures_and_words(done):
    page = (done[1] / "report.html").read_text()
    for words in (
        "6 of 7", "sigma0", "Primary markers", "Epipolar lines of two pictures", "Which spot is which marker",
        "Stations and markers", "one of the two that were matched first", "P3", "empty",
    ):  # fmt: skip
        assert words in page
    assert page.count('src="data:image/') == 7
    assert "http" not in re.sub(PACKED, "", page)


@pytest.mark.usefixtures("undrawn")
def test_labels_and_a_free_focal_length(windmark, folder, wall, tmp_path):
    seen = {int(m): wall.detections[2].xy[s] for s, m in enumerate(wall.labels[2])}
    known = [k for k, m in enumerate(wall.primary) if int(m) in seen][:4]
    rows = [f"w2.png,{NAMES[k]},{seen[int(wall.primary[k])][0] + 2:.2f},{seen[int(wall.primary[k])][1]:.2f}"
            for k in known]  # fmt: skip
    (tmp_path / "labels.csv").write_text("\n".join(["image,name,x,y", *rows]))
    done = call(windmark, folder, tmp_path / "out", "--labels", tmp_path / "labels.csv", "--free", "focal_px",
                "--pair", "w0", "empty", "--json")  # fmt: skip
    assert done.code == 0, done.err
    focal = done.json["cameras"]["camera"]["focal_px"]
    assert 0 < focal["sigma"] < 5
    assert abs(focal["value"] - CAMERA.focal_px) < 4 * focal["sigma"]
    assert done.json["primary"] == 6
    assert done.json["primaries_not_found"] == []
    assert done.json["pair"] is None
    assert done.json["dropped"].keys() == {"empty"}
    assert not (tmp_path / "out" / "pair.png").exists()


@pytest.mark.usefixtures("undrawn")
def test_poses_of_an_earlier_result_are_a_beginning(windmark, folder, done, wall, tmp_path):
    """Three primaries in a folder of poses, no labels: the poses say where they are."""
    io.write_markers(tmp_path / "three.csv", io.read_markers(folder / "primary.csv").take(np.arange(3)))
    again = call(windmark, folder, tmp_path / "out", "--poses", done[1] / "views", "--model-px", 0.05, "--json",
                 images=["w1", "w2", "w3", "w4"], primary=tmp_path / "three.csv")  # fmt: skip
    assert again.code == 0, again.err
    assert {p["pose"] for p in again.json["pictures"]} == {"given"}
    assert again.json["primary"] == 3
    found = io.read_markers(tmp_path / "out" / "markers.csv")
    place = {str(n): x for n, x in zip(found.name, found.xyz, strict=True)}
    assert all(np.linalg.norm(place[NAMES[k]] - wall.xyz[wall.primary[k]]) < 0.2 for k in range(3))


@pytest.mark.usefixtures("undrawn")
def test_the_data_say_no(windmark, folder, tmp_path):
    two = io.read_markers(folder / "primary.csv").take(np.arange(2))
    io.write_markers(tmp_path / "two.csv", two)
    done = call(windmark, folder, tmp_path / "out", "--json", images=["w0", "empty"], primary=tmp_path / "two.csv")
    assert done.code == 1
    assert done.json["cause"] == "few_primaries"
    assert done.json["reconstructed"] is False
    assert done.json["dropped"].keys() == {"empty"}
    assert "not reconstructed: 2 primary markers" in done.err
    assert "empty (0 spots" in done.err
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def failing(folder, wall):
    """More pictures: the first place four times, and another plate; primaries on a line, and some of each plate."""
    rng = np.random.default_rng(6)
    other = scenes.make(22, "plate", "walk", views=4, points=36, missing=0.05, false=0.0, noise=0.0, camera=CAMERA)
    for v in range(4):
        io.write_image(folder / f"other{v}.png", draw(other, v, rng))
    both = np.concatenate([wall.xyz[wall.primary[:3]], other.xyz[other.primary[:3]] + [900.0, 0, 0]])
    io.write_markers(folder / "both.csv", MarkerSet.make(NAMES, both))
    for v in range(4):
        io.write_image(folder / f"still{v}.png", draw(wall, 0, rng))
    line = np.outer(np.arange(6.0), [10.0, 20.0, 5.0])
    io.write_markers(folder / "line.csv", MarkerSet.make(NAMES, line))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("images", "primary", "cause", "words"),
    [
        (["w0", "w1"], "line.csv", "line", ("primary markers are on a line",)),
        (["still0", "still1", "still2", "still3"], "primary.csv", "baseline", ("taken from one place",)),
        (
            ["w0", "other0", "w1", "other1", "w2", "other2", "w3", "other3"], "both.csv", "unconnected",
            ("2 groups of pictures share no markers", "w0, w1, w2, w3", "other0, other1, other2, other3"),
        ),
    ],
)  # fmt: skip
def test_refusals_name_their_reason(windmark, failing, tmp_path, images, primary, cause, words):
    done = call(windmark, failing, tmp_path / "out", "--json", images=images, primary=primary)
    assert done.code == 1
    assert done.json["cause"] == cause
    for word in words:
        assert word in done.json["reason"]
        assert word in done.err
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--pair", "w0", "w9"), "--pair: expected the names of two different pictures"),
        (("--pair", "w0", "w0"), "got w0 and w0"),
        (("--free", "zoom"), "--free: 'zoom' is none of"),
        (("--unit", "miles"), "--unit must be one of"),
        (("--model-px", "-1"), "'--model-px': expected >= 0, not -1"),
        (("--poses", "nowhere"), "nowhere: has no pose of any picture; expected files such as w0.json"),
        (("--images-of", "left=w*"), "expected the same"),
        (("--polarity", "grey"), "polarity"),
    ],
)
def test_wrong_usage_is_named(windmark, folder, tmp_path, options, words):
    done = call(windmark, folder, tmp_path / "out", *options, images=["w0", "w1"])
    assert done.code == 2
    assert words in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("w9,P0,1,2", "labels.csv: line 2: a label is for the picture 'w9'"),
        ("w0,X,1,2", "labels.csv: line 2: 'X' is no primary marker"),
        ("w0,P0,1,2\nw0.png,P0,1,2", "labels.csv: line 3: P0 is already on line 2"),
        ("w0,P0,1,nan", "labels.csv: line 2: y is 'nan'"),
        ("w0,P0,999,0", "labels.csv: line 2: picture w0: label P0: no spot within 10 px"),
    ],
)
def test_wrong_labels_are_named(windmark, folder, tmp_path, rows, words):
    (tmp_path / "labels.csv").write_text(f"image,name,x,y\n{rows}\n")
    done = call(windmark, folder, tmp_path / "out", "--labels", tmp_path / "labels.csv", images=["w0", "w1"])
    assert done.code == 2
    assert words in done.err


def test_bad_files_are_named(windmark, folder, tmp_path):
    (folder / "broken.png").write_bytes(b"no picture")
    done = call(windmark, folder, tmp_path / "out", images=["w0", "broken"])
    assert done.code == 2
    assert "broken.png" in done.err
    io.write_image(folder / "small.png", np.full((60, 80), 200, np.uint8))
    done = call(windmark, folder, tmp_path / "out", images=["w0", "small"])
    assert done.code == 2
    assert "small has (80, 60) px" in done.err


@pytest.mark.slow
def test_without_its_pictures_the_reconstruction_is_there(windmark, folder, tmp_path, no_pictures):
    (folder / "damaged.png").write_bytes(b"no picture")
    names = ["w0", "w1", "w2", "damaged", "w3", "w4", "w5"]
    done = call(windmark, folder, tmp_path / "out", "--pair", "w1", "w3", "--json", images=names)
    unused = {p["image"]: p["problem"] for p in done.json["pictures"] if p["problem"]}
    assert list(unused) == ["damaged"]
    assert unused["damaged"].startswith("cannot be read: ")
    missing = no_pictures(done, len(done.json["not_drawn"]), tmp_path / "out" / "report.html")
    assert any(said.startswith("picture of the epipolar lines") for said in missing)
    assert not (tmp_path / "out" / "pair.png").exists()
    assert len(io.read_markers(tmp_path / "out" / "markers.csv")) > 30
