"""What is relative to the wind-off frames: the same in every output, with the covariance of the difference."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from swept_scenes import CAMERAS, MARKERS, MOTION, PARTS, VIEWS, VOLUMES, WALL, Q, observed, seen

from windmark.deformation import Stations, identify, zero_markers
from windmark.geometry import Pose
from windmark.pipeline.deform import DeformationTest, DeformedFrame, FrameImages, Station, Zero, grid_output, wind_off
from windmark.pipeline.deform.outputs import Writer
from windmark.pipeline.deform.record import record
from windmark.pipeline.verdict.deform import deform_verdict
from windmark.scene import Mesh
from windmark.tasks.deform.task import Sight
from windmark.tasks.deform.zero import displaced_since, noise_share

REST = Pose.identity()
LOADED = Q + np.array([6.0, 2.0, -0.3, 0.5])
STATIONS = Stations.along([205.0, 80.0, 0.0], [384.0, 600.0, 0.0], 4, volume="wing", chord=[100.0, 0.0, 0.0])


def state_at(q, motion, rng, markers=MARKERS, xyz=MARKERS.xyz, cov=None):
    """A state and its observations; markers really at ``xyz``."""
    spots = observed(seen(q=q, motion=motion, xyz=xyz), rng)
    return identify(spots, markers, PARTS, CAMERAS, VIEWS, marker_cov=cov), spots


def zero_of(rng, states, markers=MARKERS, xyz=MARKERS.xyz, stations=None):
    """The zero of frames with these parameters, and the markers as it has corrected them."""
    found, spots = zip(*(state_at(q, REST, rng, markers, xyz) for q in states), strict=True)
    fixed = zero_markers(found, spots, [VIEWS] * len(found), markers)
    again = [identify(o, fixed.markers, PARTS, CAMERAS, VIEWS, marker_cov=fixed.cov) for o in spots]
    share = noise_share(markers, fixed.cov, fixed.seen)
    return Zero.of(again, stations, fixed.markers, share), fixed, list(zip(again, spots, strict=True))


@pytest.fixture(scope="module")
def bent():
    """A model that is bent before there is wind: the zero, its corrected markers, its frames, and one under load."""
    rng = np.random.default_rng(5)
    zero, fixed, still = zero_of(rng, [Q, Q], stations=STATIONS)
    return zero, fixed, still, state_at(LOADED, MOTION, rng, fixed.markers, cov=fixed.cov)


def truth_since(q, motion):
    place = VOLUMES.bind(MARKERS.xyz, np.where(WALL, "", MARKERS.volume)).place
    return motion.apply(place(q)) - place(Q)


def test_displacements_are_those_since_wind_off(bent):
    zero, _, still, (loaded, _) = bent
    for state, q, motion in ((still[0][0], Q, REST), (loaded, LOADED, MOTION)):
        change, cov = displaced_since(zero, state, state.placed)
        off = (change - truth_since(q, motion))[~WALL] / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))[~WALL]
        assert np.abs(off).max() < 4.5
    assert np.abs(still[0][0].markers_displaced()[0]).max() > 5  # from the table
    from_table, _ = displaced_since(None, loaded, loaded.placed)
    assert (from_table == loaded.markers_displaced()[0]).all()


def test_the_table_of_markers_is_relative_to_wind_off(bent, tmp_path):
    zero, fixed, still, loaded = bent
    test = SimpleNamespace(markers=fixed.markers, volumes=VOLUMES)
    project = SimpleNamespace(sequence=SimpleNamespace(zero=("0", "1")))
    writer = Writer(tmp_path, SimpleNamespace(test=test, project=project), None, {}, zero=zero)
    assert writer._relative_to() == "the wind-off frames 0, 1: the mean of 2"
    for (state, spots), q, motion in ((still[0], Q, REST), (loaded, LOADED, MOTION)):
        writer._lines = {"markers.csv": []}
        writer._markers("0", DeformedFrame(0, "0", 0.0, "cold", "", state, spots, ("v0", "v1")), state)
        row = writer._lines["markers.csv"][3].split(",")
        k = list(MARKERS.name).index(row[1])
        place, moved, sigma = np.array(row[2:11], float).reshape(3, 3)
        assert np.abs((moved - truth_since(q, motion)[k]) / sigma).max() < 4.5
        assert place == pytest.approx(motion.apply(VOLUMES.bind(MARKERS.xyz[[k]], "wing").place(q))[0], abs=0.2)


def test_the_grid_is_relative_to_wind_off(bent, tmp_path, monkeypatch):
    zero, _, still, (loaded, _) = bent
    wing = np.flatnonzero(MARKERS.volume == "wing")[:4]
    mesh = Mesh(MARKERS.xyz[wing], np.array([[0, 1, 2], [1, 2, 3]]), np.array(["wing", "wing"]))
    project = SimpleNamespace(output=SimpleNamespace(grid=("vtk",), every=1), length_unit="mm")
    fields = {}
    monkeypatch.setattr(grid_output.io, "write_nodes_vtk", lambda path, moved, of, units: fields.update(of))
    for state, q, motion in ((still[0][0], Q, REST), (loaded, LOADED, MOTION)):
        frame = DeformedFrame(0, "0", 0.0, "cold", "", state, None, ())
        grid_output.write_grid(tmp_path, SimpleNamespace(project=project, mesh=mesh), frame, state, {}, zero)
        shift = np.column_stack([fields[f"displacement_{c}"] for c in "xyz"])
        assert np.abs(shift - truth_since(q, motion)[wing]).max() < 0.2
        size = np.linalg.norm(truth_since(q, REST)[wing], axis=1)
        assert np.abs(fields["deformation"] - size).max() < 4.5 * fields["sigma_deformation"].max() < 0.5


def test_a_table_that_is_better_than_the_images_leaves_their_noise_in_the_zero():
    """Its errors are in zero and frame alike, but the noise of a single wind-off frame is in no marker's place."""
    rng, off = np.random.default_rng(6), []
    said = replace(MARKERS, sigma=np.full((len(MARKERS), 3), 0.005))
    for _ in range(20):
        zero, fixed, _ = zero_of(rng, [0 * Q], said, MARKERS.xyz + rng.normal(0, 0.005, MARKERS.xyz.shape))
        state, spots = state_at(Q, REST, rng, fixed.markers, cov=fixed.cov)
        row = record(DeformedFrame(4, "4", 4.0, "tracked", "", state, spots, ("v0", "v1")), zero, None, fixed.markers,
                     MARKERS.xyz[~WALL].mean(axis=0), 0.0, float("nan"), len(Q))  # fmt: skip
        off.append(np.r_[(row.q - Q) / row.q_sigma, row.motion / row.motion_sigma])
    assert 0.85 < np.sqrt(np.mean(np.square(off))) < 1.18  # 1.35 without
    assert noise_share(said, fixed.cov, fixed.seen) < 0.2


def test_frames_of_one_state_add_nothing_to_the_sigmas(bent):
    zero, fixed, _, (state, spots) = bent
    assert zero.more is None
    assert zero.scatter is None
    assert zero.apart.max() < 6
    assert "not of one state" not in zero.words("mm")
    row = record(DeformedFrame(4, "4", 4.0, "tracked", "", state, spots, ("v0", "v1")), zero, STATIONS, fixed.markers,
                 np.zeros(3), 0.0, float("nan"), len(Q))  # fmt: skip
    assert row.q_sigma.tolist() == [state.sigma[n] for n in state.volumes.names]


def test_the_scatter_of_wind_off_frames_is_in_every_sigma_and_said(bent):
    rng = np.random.default_rng(7)
    off = np.array([3.0, 0.0, 0.0, 0.0])
    zero, fixed, still = zero_of(rng, [0 * Q, off], stations=STATIONS)
    assert zero.scatter[0] == "wing.bend_2"
    assert "they differ in wing.bend_2 by " in zero.words("mm")
    state, spots = state_at(Q, REST, rng, fixed.markers, cov=fixed.cov)
    row = record(DeformedFrame(4, "4", 4.0, "tracked", "", state, spots, ("v0", "v1")), zero, STATIONS, fixed.markers,
                 np.zeros(3), 0.0, float("nan"), len(Q))  # fmt: skip
    assert row.q_sigma[0] > 1.0 > 3 * state.sigma["wing.bend_2"]
    assert abs(row.q[0] - Q[0]) < 2.5 * row.q_sigma[0]  # the first frame is the true zero
    _, cov = displaced_since(zero, state, state.placed)
    own = state.moved(state.placed, "tunnel")[1]
    tip = int(np.argmax(MARKERS.xyz[:, 1] * (MARKERS.volume == "wing")))
    assert cov[tip, 2, 2] > 0.9**2 > 9 * own[tip, 2, 2]
    assert row.bending_sigma[-1] > 1.0
    # That they differ by much of what the wind does is still doubted, though the sigmas have it now.
    rows = [replace(row, index=k, key=str(k), q=s.q - zero.q) for k, (s, _) in enumerate(still)]
    rows.append(replace(row, index=2, key="2", q=3 * off))
    of = {"zero": ["0", "1"], "parameters": state.volumes.names}
    assert "the wind-off frames 0 and 1 differ in wing.bend_2" in deform_verdict(rows, **of, apart=zero.apart).reason


@dataclass(frozen=True)
class Project:
    """What `zeroed` needs of a loaded project."""

    test: DeformationTest
    project: SimpleNamespace
    stations: None = None


def test_a_wind_off_picture_that_is_there_three_times_is_one_measurement(monkeypatch):
    rng, found = np.random.default_rng(8), {}
    for key, pictures in (("0", (1, 2)), ("7", (1, 2)), ("8", (3, 4)), ("9", (1, 2))):
        state, spots = state_at(0 * Q, REST, rng)
        state = replace(state, cameras={v.name: CAMERAS[v.camera] for v in VIEWS})
        cameras = {v.name: Sight(picture=p) for v, p in zip(VIEWS, pictures, strict=True)}
        found[key] = DeformedFrame(0, key, 0.0, "cold", "", state, spots, ("v0", "v1"), 0.0, cameras)
    monkeypatch.setattr(wind_off, "follow_deformation", lambda frames, test, **_: iter([found[frames[0].key]]))
    stations = tuple(Station(v.name, CAMERAS[v.camera], v.cam_from_model) for v in VIEWS)
    project = SimpleNamespace(sequence=SimpleNamespace(zero=("0", "7", "8", "9")), path=None)
    frames = [FrameImages(key, float(key), {}) for key in found]
    loaded = Project(DeformationTest(stations, MARKERS, VOLUMES), project)
    _, zero, _, still = wind_off.zeroed(loaded, SimpleNamespace(frames=frames))
    assert zero.frames == 2
    assert [frame.key for frame, _ in still] == ["0", "8"]
