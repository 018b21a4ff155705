"""Cameras with clocks of their own: which pictures tell of which instant, and spots between pictures."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from windmark.io import FileError
from windmark.pipeline.deform.entries import RECORDING
from windmark.pipeline.deform.frames import frames_on_disk, instants_of
from windmark.tasks.deform.between import interpolated, lagrange
from windmark.tasks.deform.spots import Labelled


def entry(name, **clock):
    known = {"rate_hz": None, "offset_s": 0.0, "times": None, **clock}
    has = known["rate_hz"] is not None or known["times"] is not None or known["offset_s"] != 0
    return SimpleNamespace(name=name, patterns=(f"{name}-*.tif",), has_clock=has, **known)


def project(folder, *cameras, pictures, **sequence):
    for camera, count in zip(cameras, pictures, strict=True):
        for k in range(count):
            (folder / f"{camera.name}-{k:03d}.tif").write_bytes(b"x")
    known = {"rate_hz": None, "clock": None, "max_lag_s": None, **sequence}
    return SimpleNamespace(path=folder / "p.toml", camera=cameras, sequence=SimpleNamespace(**known))


def table(folder, *rows, head="image,time_s"):
    (folder / "t.csv").write_text("\n".join([head, *rows]) + "\n")
    return folder / "t.csv"


def test_the_fastest_camera_gives_the_instants_and_the_other_one_its_pictures_on_both_sides(tmp_path):
    made = project(tmp_path, entry("a", rate_hz=10.0), entry("b", rate_hz=50.0), pictures=(3, 11))
    found = instants_of(made)
    assert found.clock == "b"
    assert [f.instant for f in found.frames] == pytest.approx(np.arange(11) / 50)
    first, second = found.frames[0], found.frames[2]
    assert first.lag("a") == 0.0
    assert not first.shots
    assert [s.instant for s in second.shots["a"]] == pytest.approx([0.0, 0.1])
    assert second.lag("a") == pytest.approx(-0.04)
    assert [s.instant for s in found.frames[7].shots["a"]] == pytest.approx([0.0, 0.1, 0.2])  # two before, one after


@pytest.mark.parametrize("rates", [(50.0, 0.05), (50.0, 50000.0)])
def test_rates_in_different_units_are_named(tmp_path, rates):
    """Of the slow camera two pictures were interpolated that stand 20 s apart, in a test of 0.14 s."""
    made = project(tmp_path, entry("a", rate_hz=rates[0]), entry("b", rate_hz=rates[1]), pictures=(8, 8))
    with pytest.raises(FileError, match="check the rates of both") as caught:
        instants_of(made)
    slow, fast = ("b", "a") if rates[1] < 1 else ("a", "b")
    assert f"camera {slow} took a picture every" in str(caught.value)
    assert f"camera {fast} all of its 8 in" in str(caught.value)


def test_at_the_ends_nothing_is_extrapolated(tmp_path):
    made = project(tmp_path, entry("a", rate_hz=10.0), entry("b", rate_hz=10.0, offset_s=0.03), pictures=(4, 4))
    frames = frames_on_disk(made)
    assert "b" not in frames[0].images
    assert "none is earlier to interpolate with" in frames[0].missing["b"]
    assert all("b" in f.shots for f in frames[1:])


def test_a_dropped_picture_is_a_gap_unless_the_lag_is_allowed(tmp_path):
    times = table(tmp_path, *(f"b-{k:03d}.tif,{0.1 * k + 0.05}" for k in range(8) if k != 3))
    cameras = entry("a", rate_hz=10.0), entry("b", times=times)
    made = project(tmp_path, *cameras, pictures=(8, 8))
    frames = instants_of(made)
    assert any("1 pictures have no time and are left out: b-003.tif" in r for r in frames.remarks)
    assert [f.key for f in frames.frames if "b" not in f.images] == ["0", "3", "4"]
    assert "gap of 0.2 s" in frames.frames[3].missing["b"]
    made.sequence.max_lag_s = 0.11
    assert [f.key for f in frames_on_disk(made) if "b" not in f.images] == ["0"]
    made.sequence.max_lag_s = 0.01
    with pytest.raises(FileError, match="nothing is seen together"):
        frames_on_disk(made)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["b-0,0", "b-1,nan", "b-2,0.2"], "time_s is 'nan'; expected a finite number"),
        (["b-0,0", "b-1,0.1", "b-01,0.2"], "frame 1, which is there before"),
        (["b-0,0", "b-1,0.3", "b-2,0.2"], "b-002.tif at 0.2 s is not after b-001.tif at 0.3 s"),
        (["b-0,0", "b-1,0.1", "b-2,0.1"], "is not after"),
        (["x-7,0", "x-8,0.1"], "has no time of any picture of camera b"),
        (["b-0,10", "b-1,10.1", "b-2,10.2"], "is near one of a"),
    ],
)  # fmt: skip
def test_bad_times_are_refused(tmp_path, rows, message):
    made = project(tmp_path, entry("a", rate_hz=10.0), entry("b", times=table(tmp_path, *rows)), pictures=(3, 3),
                   clock="a")  # fmt: skip
    with pytest.raises(FileError, match=message.replace("(", r"\(")):
        frames_on_disk(made)


def test_rows_in_any_order_and_of_pictures_that_are_not_there(tmp_path):
    times = table(tmp_path, "2,0.2", "9,0.9", "0,0.0", "1,0.1", head="frame,time_s")
    made = project(tmp_path, entry("a", rate_hz=10.0), entry("b", times=times), pictures=(3, 3))
    assert all(f.lag("b") == 0 and not f.shots for f in frames_on_disk(made))


def test_a_camera_without_any_time_is_refused_unless_the_recording_has_them(tmp_path):
    made = project(tmp_path, entry("a", rate_hz=10.0), entry("b"), pictures=(3, 3), clock="a")
    with pytest.raises(FileError, match="nothing says when b took its pictures"):
        frames_on_disk(made)
    frames = frames_on_disk(made, {"b": np.array([0.0, 0.05, 0.15])})
    assert [s.instant for s in frames[1].shots["b"]] == [0.0, 0.05, 0.15]
    with pytest.raises(ValueError, match="expected 3 times of camera b"):
        frames_on_disk(made, {"b": np.zeros(2)})


def labelled(marker, xy, sigma=0.05):
    n = len(marker)
    return Labelled(
        np.array(marker), np.array(xy, float), np.tile(sigma**2 * np.eye(2), (n, 1, 1)), np.full((n, 2), 3.0),
        np.zeros(n), np.full((n, 3), np.nan), n,
    )  # fmt: skip


def test_the_interpolation_is_exact_for_a_cubic_and_says_what_it_may_leave():
    def at(t):
        return [[1 + t - t**2 + 2 * t**3, 3 - t], [2 * t**2, t**3]]

    seen = {t: labelled([4, 7], at(t)) for t in (-2.0, -1.0, 0.0, 1.0)}
    spots = interpolated(seen, 0.4)
    assert spots.marker.tolist() == [4, 7]
    assert spots.xy == pytest.approx(np.array(at(0.4)))
    assert np.trace(spots.between_cov[0]) > 0.01  # the cubic part is large: it is not known how much comes after it
    still = interpolated({t: labelled([4, 7], at(0.0)) for t in (-2.0, -1.0, 0.0, 1.0)}, 0.4)
    assert still.between_cov == pytest.approx(np.zeros((2, 2, 2)))
    weight = lagrange([-2.0, -1.0, 0.0, 1.0], 0.4)
    assert still.cov[0, 0, 0] == pytest.approx((weight**2).sum() * 0.05**2)


def test_markers_must_be_seen_just_before_and_just_after():
    seen = {-1.0: labelled([1, 2, 3], np.zeros((3, 2))), 0.0: labelled([1, 2], np.zeros((2, 2))),
            1.0: labelled([3, 2], np.ones((2, 2)))}  # fmt: skip
    spots = interpolated(seen, 0.5)
    assert spots.marker.tolist() == [2]
    none = interpolated({0.0: labelled([1], [[0, 0]]), 1.0: labelled([2], [[0, 0]])}, 0.5)
    assert len(none.marker) == 0
    assert "before and after" in none.reason


def test_a_recordings_own_time_stamps(tmp_path):
    stamps = {"a": np.arange(6) * 0.02, "b": 0.005 + np.arange(4) * 0.03}
    for name, times in stamps.items():
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["images"] = np.zeros((len(times), 8, 9), np.uint16)
            file["time_s"] = times
    cameras = [replaced(entry(n, times=RECORDING), patterns=(f"{n}.h5",)) for n in stamps]
    made = SimpleNamespace(
        path=tmp_path / "p.toml", camera=cameras, sequence=SimpleNamespace(rate_hz=None, clock=None, max_lag_s=None)
    )
    found = instants_of(made)
    assert found.clock == "a"
    assert [f.time_s for f in found.frames] == pytest.approx(stamps["a"])
    assert [s.instant for s in found.frames[3].shots["b"]] == pytest.approx(stamps["b"][:3])
    assert found.frames[3].lag("b") == pytest.approx(0.065 - 0.06)
    (tmp_path / "c-000.tif").write_bytes(b"x")
    made.camera.append(replaced(entry("c", times=RECORDING)))
    with pytest.raises(FileError, match="hold no time stamps"):
        instants_of(made)


def replaced(made, **changes):
    return SimpleNamespace(**{**vars(made), **changes})
