"""What follows from an identified state: twist and bending per station, the wind-off zero, single markers."""

import numpy as np
import pytest

from windmark.deformation import (
    Deformation,
    Stations,
    Volume,
    displacements,
    identify,
    marker_places,
    span_values,
    weak_directions,
    zero_markers,
)
from windmark.deformation.laws import Beam, Rigid
from windmark.geometry import Camera, Pose, imaged_ellipse
from windmark.scene import MarkerSet, Observations, View

NOISE = 0.03
CAMERA = Camera((1280, 1024), 2090.0, k1=-0.1)
WING = Volume("wing", Beam((60, 0, 0), (60, 500, 0), section=(0, 1, 0)))


def views():
    out = []
    for k, degrees in enumerate((-30, 30)):
        a = np.radians(degrees)
        eye = np.array([60.0, 250.0, 0.0]) + 1045 * np.array([np.sin(a), 0, np.cos(a)])
        out.append(View(f"v{k}", "c", "", Pose.look_at(eye, [60.0, 250.0, 0.0], [1, 0, 0])))
    return out


VIEWS = views()


def markers(radius=np.nan):
    rng = np.random.default_rng(2)
    xyz = rng.uniform([0, -60, -8], [120, 490, 8], (60, 3))
    volume = np.where(xyz[:, 1] > 0, "wing", "body")
    normal = np.column_stack([0.2 * rng.standard_normal((60, 2)), np.ones(60)])
    return MarkerSet.make([f"m{k}" for k in range(60)], xyz, volume=volume, radius=radius, normal=normal)


MARKERS = markers()


def observed(xyz, rng, noise=NOISE, set_of=MARKERS):
    """Both cameras see the centres of the discs' images."""
    view, point, xy = [], [], []
    for v, seen_from in enumerate(VIEWS):
        pose = seen_from.cam_from_model
        p = CAMERA.project(pose.apply(xyz))[0]
        if np.isfinite(set_of.radius).all():
            p = imaged_ellipse(CAMERA, pose.apply(xyz), pose.rotate(set_of.normal), set_of.radius).xy
        view += [v] * len(p)
        point += range(len(p))
        xy.append(p + noise * rng.standard_normal(p.shape))
    cov = np.tile(max(noise, 1e-4) ** 2 * np.eye(2), (len(view), 1, 1))
    return Observations(np.array(view), np.array(point), np.concatenate(xy), cov)


def bound():
    from windmark.deformation import Volumes

    return Volumes.of([WING]).bind(MARKERS.xyz, MARKERS.volume)


def state_of(q, motion, seed=0, noise=NOISE):
    xyz = motion.apply(bound().place(np.asarray(q, dtype=float)))
    answer = identify(observed(xyz, np.random.default_rng(seed), noise), MARKERS, [WING], CAMERA, VIEWS)
    assert isinstance(answer, Deformation), answer
    return answer


STATIONS = Stations.along((60, 0, 0), (60, 500, 0), 6, volume="wing", chord=(100, 0, 0))


def test_twist_and_bending_are_those_of_the_law():
    got = span_values(state_of([12.0, -4.0, 0.5, 0.7], Pose.identity(), noise=0.0), STATIONS)
    e = np.linspace(0, 1, 6)
    assert got.bending == pytest.approx(12 * e**2 - 4 * e**3, abs=1e-5)
    assert got.twist_deg == pytest.approx(0.5 * e + 0.7 * e**2, abs=5e-4)  # leaning sections look a little less turned


def test_pitch_adds_to_the_twist_in_the_tunnel_only():
    motion = Pose.from_rotvec(np.radians([0.0, 1.5, 0.0]), [1.0, 2.0, 3.0])
    state = state_of([12.0, -4.0, 0.5, 0.7], motion, noise=0.0)
    model, tunnel = span_values(state, STATIONS), span_values(state, STATIONS, frame="tunnel")
    assert tunnel.twist_deg - model.twist_deg == pytest.approx(1.5, abs=1e-3)
    assert tunnel.bending[0] == pytest.approx(3.0 - np.sin(np.radians(1.5)) * 60, abs=0.01)


def test_sigmas_of_the_stations_are_those_of_their_errors():
    z = []
    for seed in range(60):
        got = span_values(state_of([12.0, -4.0, 0.5, 0.7], Pose.identity(), seed), STATIONS, frame="tunnel")
        e = np.linspace(0, 1, 6)
        z.append(np.r_[(got.bending - 12 * e**2 + 4 * e**3) / got.bending_sigma,
                       (got.twist_deg - 0.5 * e - 0.7 * e**2) / got.twist_sigma_deg])  # fmt: skip
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.15


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"chord": (0, 0, 0)}, "chord"), ({"up": (1, 0, 0)}, "up"), ({"count": []}, "station"),
        ({"start": (0, 0)}, "start"), ({"start": (60, 500, 0)}, "differ"),
        ({"up": (0, 1, 0)}, r"up \(0, 1, 0\) is 0 degrees from the span"),
        ({"end": (400, 500, 0), "up": (0, 1, 0.3)}, "is 17 degrees from the span"),
        ({"end": (60, 0, 500)}, "is 0 degrees from the span"),  # a fin, with the wing's direction
    ],
)  # fmt: skip
def test_bad_stations_are_named(change, expected):
    with pytest.raises(ValueError, match=expected):
        Stations.along(**{"start": (60, 0, 0), "end": (60, 500, 0), "volume": "wing"} | change)


@pytest.mark.parametrize(
    "change",
    [
        {"end": (400, 500, 0)}, {"end": (60, 250, 400)}, {"end": (60, 0, 500), "up": (0, 1, 0)},
        {"start": (0, 0, 0), "end": (900, 0, 20)},  # chords along a body that droops
    ],
)  # fmt: skip
def test_a_direction_in_which_a_wing_a_fin_or_a_body_bends_is_taken(change):
    assert len(Stations.along(**{"start": (60, 0, 0), "end": (60, 500, 0), "volume": "wing"} | change)) == 11


def test_markers_alone_are_placed_within_their_sigma_and_displaced():
    discs = markers(radius=4.0)
    shift = np.array([1.0, -2.0, 3.0])
    z = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        before, after = (
            marker_places(observed(xyz, rng, set_of=discs), discs, CAMERA, VIEWS)
            for xyz in (discs.xyz, discs.xyz + shift)
        )
        off = before.xyz - discs.xyz
        z.append(np.linalg.solve(np.linalg.cholesky(before.cov), off[..., None])[..., 0])
        moved = displacements(before, after)
        assert len(moved.marker) == 60
        assert moved.vector.mean(axis=0) == pytest.approx(shift, abs=0.02)
        assert np.allclose(moved.cov, before.cov + after.cov)
    assert 0.93 < np.std(z) < 1.07
    assert np.abs(np.mean(z)) < 0.1  # the discs' eccentricity is taken off


def test_a_marker_that_one_camera_sees_has_a_reason():
    seen = observed(MARKERS.xyz, np.random.default_rng(0))
    keep = ~((seen.view == 1) & (seen.point == 7))
    part = Observations(seen.view[keep], seen.point[keep], seen.xy[keep], seen.cov[keep])
    places = marker_places(part, MARKERS, CAMERA, VIEWS)
    assert places.reason[7] == "fewer than two views"
    assert np.isnan(places.xyz[7]).all()
    with pytest.raises(ValueError, match="at least two views"):
        marker_places(part, MARKERS, CAMERA, VIEWS[:1])


def test_the_zero_takes_the_tables_errors_away():
    rng = np.random.default_rng(1)
    off = 0.3 * rng.standard_normal(MARKERS.xyz.shape)
    true = MARKERS.xyz + off
    seen = [observed(true, rng) for _ in range(4)]
    states = [identify(s, MARKERS, [WING], CAMERA, VIEWS) for s in seen]
    corrected = zero_markers(states, seen, [VIEWS] * 4, MARKERS)
    assert corrected.seen.all()
    # What a motion and the law's parameters can explain is not the markers': compare after the same fit.
    again = identify(observed(true, rng), corrected.markers, [WING], CAMERA, VIEWS, marker_cov=corrected.cov)
    assert np.median([s.sigma0 for s in states]) > 3
    assert 0.8 < again.sigma0 < 1.2
    left = corrected.markers.xyz - again.volumes.bind(MARKERS.xyz, MARKERS.volume).xyz - off
    assert np.sqrt(np.mean(np.square(left))) < 0.6 * np.sqrt(np.mean(np.square(off)))


def test_the_zero_needs_frames_that_fit_each_other():
    with pytest.raises(ValueError, match="at least one"):
        zero_markers([], [], [], MARKERS)


def test_a_rigid_part_has_no_bending():
    part = Volume("wing", Rigid(pivot=(60, 0, 0)))
    xyz = MARKERS.xyz.copy()
    wing = MARKERS.volume == "wing"
    turn = Pose.from_rotvec(np.radians([0.0, 2.0, 0.0]), np.zeros(3))
    pivot = np.array([60.0, 0.0, 0.0])
    xyz[wing] = turn.apply(xyz[wing] - pivot) + pivot
    state = identify(observed(xyz, np.random.default_rng(0), 0.0), MARKERS, [part], CAMERA, VIEWS, free_motion=False)
    got = span_values(state, STATIONS)
    assert got.twist_deg == pytest.approx(2.0, abs=1e-4)
    assert got.bending == pytest.approx(0.0, abs=1e-3)


def test_one_camera_sees_its_line_of_sight_least():
    seen = observed(MARKERS.xyz, np.random.default_rng(0))
    first = seen.view == 0
    part = Observations(seen.view[first], seen.point[first], seen.xy[first], seen.cov[first])
    centre = MARKERS.xyz.mean(axis=0)
    words = weak_directions(identify(part, MARKERS, [], CAMERA, VIEWS[:1]), centre, unit="mm")
    assert weak_directions(identify(part, MARKERS, [], CAMERA, VIEWS[:1]), centre, unit="mm", least=1e3) == ()
    ahead = VIEWS[0].cam_from_model.rotation[2]
    assert "shift along" in words[0]
    along = np.array([float(v) for v in words[0].split("(")[1].split(")")[0].split(",")])
    assert abs(along @ ahead) > 0.98
    assert "mm only" in words[0]
    both = weak_directions(identify(seen, MARKERS, [], CAMERA, VIEWS), centre, unit="mm")
    assert not any("shift" in w for w in both)


def test_a_law_that_looks_like_a_rigid_motion_is_named():
    xyz = MARKERS.xyz
    part = Volume("wing", Rigid(pivot=(60, 250, 0)))
    few = (MARKERS.volume == "wing") | (np.arange(60) == np.argmax(MARKERS.volume == "body"))
    seen = observed(xyz, np.random.default_rng(0))
    keep = few[seen.point]
    part_seen = Observations(seen.view[keep], seen.point[keep], seen.xy[keep], seen.cov[keep])
    sigma = np.diag([0.01] * 3 + [5.0] * 3) ** 2
    state = identify(part_seen, MARKERS, [part], CAMERA, VIEWS, motion_cov=sigma)
    words = weak_directions(state, xyz.mean(axis=0))
    assert any("wing." in w and "rigid motion" in w for w in words)
