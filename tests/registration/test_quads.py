"""The quad search against slow, readable twins."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import registration_scenes as scenes
from slow_twins import RULES, TOLERANCE, kernel_case, slow_growth, slow_neighbourhood

from windmark.geometry import Pose, p3p
from windmark.registration._kernels import best as kept
from windmark.registration._kernels import growth as growth
from windmark.registration._kernels import match as match
from windmark.registration._kernels import quad as quads
from windmark.registration._kernels import rival as rival
from windmark.registration.options import default_tolerance
from windmark.registration.search import links
from windmark.registration.search.layout import DIRECTIONS, Layout, sphere
from windmark.registration.search.plane import Plane
from windmark.registration.search.search import Search
from windmark.registration.task import Task

CHECK = 0.5 * TOLERANCE


def plane_of(scene, **more):
    return Plane(Task(scene.markers, scene.camera, scene.detections.xy, scene.detections.cov, 6.0, **more))


@pytest.fixture(scope="module")
def scene():
    return scenes.scene(5, "B", hidden=0.2, false=0.3, noise_px=0.2)


def coordinates(a, b, c, d):
    """Barycentric coordinates of a in the triangle b, c, d, by linear equations; and twice its signed area."""
    system = np.array([[b[0], c[0], d[0]], [b[1], c[1], d[1]], [1.0, 1.0, 1.0]])
    return np.linalg.solve(system, [a[0], a[1], 1.0]), np.linalg.det(system)


@pytest.mark.parametrize("kind", ["A", "A0", "B"])
def test_no_rival_grows_beyond_its_promise(kind):
    """What a near-symmetry makes of the right pose: not grown where its promise is too low, so that must be enough."""
    grown = 0
    for seed in range(12):
        scene = scenes.scene(seed, kind, hidden=0.25 * (seed % 2), false=0.5)
        plane = plane_of(scene)
        picture, gates = plane.picture(len(scene.detections)), plane.gates()
        rotation, translation = plane.frame.unit(scene.cam_from_model)
        for onto, turn, shift in zip(*plane.layout.symmetries, strict=True):
            match = np.full(len(onto), -1, np.int32)
            for spot, marker in enumerate(scene.label.tolist()):
                if marker >= 0 and onto[marker] >= 0:
                    match[onto[marker]] = spot
            r = rotation @ turn.T
            t = translation - r @ shift
            room = np.empty((7, 7)), np.empty(7)
            if (match >= 0).sum() < 4 or not growth.refine(
                plane.model.xyz, picture.p, match, r, t, scene.camera.focal_px, *room, 6, gates.sigma**2
            )[0]:
                continue
            promised = rival.promise(plane.model, picture, gates, r, t, scene.camera.focal_px)
            score = growth.grow(
                plane.model, picture, gates, match, r, t, scene.camera.focal_px, int((match >= 0).sum())
            )[0]  # fmt: skip
            grown += score > -np.inf
            assert score <= promised
    assert grown > 1


def test_barycentric_coordinates_do_not_change_under_affine_maps():
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = rng.normal(size=(4, 2))
        (u, v, _), area = coordinates(*points)
        got = quads.barycentric(*points.ravel())
        np.testing.assert_allclose(got, [u, v, area], rtol=1e-6)
        affine = rng.normal(size=(2, 2))
        moved = quads.barycentric(*(points @ affine.T + [3.0, -1.0]).ravel())
        np.testing.assert_allclose(moved[:2], got[:2], rtol=1e-6)
        assert moved[2] == pytest.approx(got[2] * np.linalg.det(affine))


def test_cells_tile_the_keys():
    assert quads.cell_of(-1.2, 0.0) == quads.cell_of(0.0, 1.2) == -1
    side = 2 * quads.REACH / quads.CELLS
    centres = -quads.REACH + side * (np.arange(quads.CELLS) + 0.5)
    cells = [quads.cell_of(u, v) for u in centres for v in centres]
    assert cells == list(range(quads.CELLS**2))


def seen_from(xyz, direction):
    """Orthographic image, y down, of markers seen by a camera in the given direction."""
    pose = Pose.look_at(np.zeros(3) + direction, np.zeros(3), [0.3, 0.5, 0.8])
    return (xyz @ pose.rotation.T)[:, :2]


def test_table_holds_every_quad_seen_from_a_tabled_direction(scene):
    layout = Layout(scene.markers)
    table, model = layout.table(7), layout.model
    entries = [
        {tuple(q) for q in table.quad[table.entry[table.first[c] : table.first[c + 1]]].tolist()}
        for c in range(quads.CELLS**2)
    ]
    checked = 0
    for direction in sphere(DIRECTIONS)[3:30:6]:
        xy = seen_from(model.xyz, direction)
        for a in range(0, len(xy), 7):
            for b, c, d in combinations(model.near[a, :7].tolist(), 3):
                if not (model.normal[[a, b, c, d]] @ direction > quads.FACING).all():
                    continue
                (u, v, w), area = coordinates(xy[a], xy[b], xy[c], xy[d])
                corners = xy[[b, c, d]]
                longest2 = max(((corners[i] - corners[i - 1]) ** 2).sum() for i in range(3))
                if max(abs(u), abs(v), abs(w)) > 1 or abs(area) < 0.3 * longest2:
                    continue
                if area < 0:
                    c, d, v = d, c, w
                checked += 1
                assert (a, b, c, d) in entries[quads.cell_of(u, v)]
    assert checked > 30


def test_table_of_a_symmetric_layout_is_symmetric():
    xyz = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0), [0.0]), axis=-1).reshape(-1, 3)
    markers = scenes.MarkerSet.make([f"g{i}" for i in range(20)], xyz, normal=np.tile([0, 0, 1.0], (20, 1)))
    table = Layout(markers).table(7)
    cell = np.repeat(np.arange(quads.CELLS**2), np.diff(table.first))
    entries = {(int(c), *q) for c, q in zip(cell, table.quad[table.entry].tolist(), strict=True)}
    # Half a turn of the grid brings marker i to 19 - i.
    assert {(c, *(19 - m for m in q)) for c, *q in entries} == entries


def test_spot_quads_are_all_sound_ones_rarest_first(scene):
    plane = plane_of(scene)
    picture, table = plane.picture(30), plane.layout.table(7)
    got, cells = quads.spot_quads_kernel(picture.p, picture.near, 4, 7, table.first)
    count = np.diff(table.first)[cells]
    assert (np.diff(count) >= 0).all()
    assert count.min() > 0
    expected = set()
    for a in range(30):
        for b, c, d in combinations(picture.near[a, :7].tolist(), 3):
            if {b, c, d} <= set(picture.near[a, :4].tolist()):
                continue
            (u, v, w), area = coordinates(*picture.p[[a, b, c, d]])
            corners = picture.p[[b, c, d]]
            longest2 = max(((corners[i] - corners[i - 1]) ** 2).sum() for i in range(3))
            if max(abs(u), abs(v), abs(w)) > 1 or abs(area) < 2 * quads.FLATTEST * longest2:
                continue
            if area < 0:
                c, d, v = d, c, w
            if table.first[quads.cell_of(u, v) + 1] > table.first[quads.cell_of(u, v)]:
                expected.add((a, b, c, d))
    assert {tuple(q) for q in got.tolist()} == expected
    assert len(got) == len(expected)


def screened(xyz, markers, sight, slack):
    """What the two screens of a link say."""
    shape = np.array(quads.shape_of(xyz, *markers))[:, None]
    return match.fits(shape, 0, sight, slack), match.stands(shape, 0, sight, slack)


def test_screen_passes_what_p3p_confirms_and_little_else(scene):
    """Of right quads nearly all pass; of random links few, and those that P3P confirms nearly all."""
    model, frame = Layout(scene.markers).model, Layout(scene.markers).frame
    rotation, translation = frame.unit(scene.cam_from_model)
    focal, rng = scene.camera.focal_px, np.random.default_rng(1)
    seen = model.xyz @ rotation.T + translation
    p = np.ascontiguousarray(focal * seen[:, :2] / seen[:, 2:] + rng.normal(0, 0.2, (len(seen), 2)))
    right, passed, confirmed, kept, tried, lost, sharp = [], 0, 0, 0, 0, 0, 0
    for a in range(60):
        spots = [a, *model.near[a, :3].tolist()]
        if abs(np.linalg.det(p[spots[2:]] - p[spots[1]])) < 1000:
            continue
        sight = match.sight_of(p, *spots, focal)
        right.append(screened(model.xyz, spots, sight, 3.0 / focal)[0])
        for _ in range(20):
            other = rng.integers(60)
            markers = [other, *rng.permutation(model.near[other, :6])[:3].tolist()]
            rays = np.column_stack([p[spots[1:]], np.full(3, focal)])
            anchors = [pose.apply(model.xyz[markers[0]]) for pose in p3p(rays, model.xyz[markers[1:]]).poses()]
            good = any(np.linalg.norm(focal * x[:2] / x[2] - p[a]) < 3.0 for x in anchors)
            fits, stands = screened(model.xyz, markers, sight, 3.0 / focal)
            lost, sharp = lost + (good and not stands), sharp + (fits and stands)
            tried, confirmed, kept, passed = tried + 1, confirmed + good, kept + (good and fits), passed + fits
    assert np.mean(right) > 0.9
    assert confirmed > 5
    assert kept >= 0.9 * confirmed
    assert passed < 0.25 * tried
    # The second screen has the perspective in full: it loses nothing and passes hardly more than P3P confirms.
    assert lost == 0
    assert sharp < 2 * confirmed


def slow_search(model, picture, gates, table, focal, tried, cells):
    """Twin of `search_kernel`: (match, score) of everything that the quads let grow, in order."""
    outcomes = []
    for (a, b, c, d), cell in zip(tried.tolist(), cells.tolist(), strict=True):
        rays = np.column_stack([picture.p[[b, c, d]], np.full(3, focal)])
        for i, j, k, m in table.quad[table.entry[table.first[cell] : table.first[cell + 1]]].tolist():
            if not screened(model.xyz, (i, j, k, m), match.sight_of(picture.p, a, b, c, d, focal), CHECK / focal)[0]:
                continue
            for pose in p3p(rays, model.xyz[[j, k, m]]).poses():
                anchor = pose.apply(model.xyz[i])
                if np.linalg.norm(focal * anchor[:2] / anchor[2] - picture.p[a]) >= CHECK:
                    continue
                pairs = slow_neighbourhood(
                    model, picture, pose.rotation, pose.translation, focal, (i, j, k), (a, b, c)
                )  # fmt: skip
                if pairs is not None:
                    outcomes.append(slow_growth(model, picture, gates, pose.rotation, pose.translation, focal, pairs))
    return outcomes


def test_search_grows_what_its_slow_twin_grows():
    model, picture, _, focal, scene = kernel_case()
    gates = growth.Gates(TOLERANCE, 0.75, 8.0, 0.5 * focal, 0.5 * focal)
    table = Layout(scene.markers).table(7)
    tried, cells = quads.spot_quads_kernel(picture.p, picture.near, 0, 7, table.first)
    tried, cells = tried[:400], cells[:400]
    best, none = kept.room_for_best(60, 24), np.full((1, 24), -1, np.int32)
    of = match.Links(tried, table.first[cells], table.first[cells + 1], table.entry, table.quad, table.shape, CHECK, 24)
    got, count, work = match.search_kernel(
        model, picture, RULES, gates, of, np.array([focal]), 0, 10**6, np.inf, best, none
    )
    assert got == len(tried)
    assert count == np.diff(table.first)[cells].sum()
    assert count < work
    outcomes = slow_search(model, picture, gates, table, focal, tried, cells)
    # Solutions seen before are not grown again.
    assert 3 < best.serial[-1] <= len(outcomes)
    right = [o for o in outcomes if o is not None]
    for n in np.flatnonzero(best.score > -np.inf):
        assert any((best.match[n] == m).all() and best.score[n] == pytest.approx(s, abs=1e-3) for m, s in right)
    first, most = np.argmax(best.score), max(right, key=lambda o: o[1])
    assert best.score[first] == pytest.approx(most[1], abs=1e-3)
    np.testing.assert_array_equal(best.match[first], most[0])
    seen = most[0] >= 0
    assert (scene.label[most[0][seen]] == np.flatnonzero(seen)).all()


def test_search_finds_the_pose_and_the_planes_mirror_image():
    """Seen from far, a flat wing has two poses; both come out of one search."""
    rng = np.random.default_rng(2)
    flat = scenes.wing(rng)
    flat = scenes.MarkerSet.make(flat.name, flat.xyz * [1, 1, 0], normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    camera = scenes.Camera((1280, 1000), 1280 / (2 * np.tan(np.radians(0.25))))
    pose = Pose.look_at(np.array([0.45, 0.5, 0.0]) + 600 * np.array([0.5, 0.3, 0.8]), [0.45, 0.5, 0.0], [0, 1, 0])
    scene = scenes.image_of(rng, flat, camera, pose, noise_px=0.2)
    search = Search(plane_of(scene), 45.0)
    for _ in search.batches():
        if search.best is not None and search.best.score > 45.0:
            break
    assert search.rivals(search.best, lambda: False)
    first, second = search.top(2)
    assert first.count == second.count == 24
    np.testing.assert_array_equal(first.match, second.match)
    angles = sorted(float(np.degrees(c.cam_from_model.angle_to(pose))) for c in (first, second))
    assert angles[0] < 3
    assert angles[1] > 20


def solved(scene):
    """A search that has found a solution and looked for its rivals."""
    spots = scene.detections
    tolerance = default_tolerance(spots.xy, scene.camera, scene.markers)
    search = Search(Plane(Task(scene.markers, scene.camera, spots.xy, spots.cov, tolerance)), 45.0)
    for _ in search.batches():
        if search.best is not None and search.best.score > 45.0:
            break
    assert search.rivals(search.best, lambda: False)
    return search


def test_half_a_copy_is_found_beside_the_model():
    """A ghost of every second spot, shifted by 30 px, in most of some pictures; and none where there is none."""
    found = 0
    for seed in range(6):
        scene = scenes.scene(seed, "B", hidden=0.25, false=0.5, noise_px=0.2)
        label, xy = scene.label, scene.detections.xy
        seen = np.flatnonzero(label >= 0)[::2]
        ghost = xy[seen] + [24.0, 18.0] + np.random.default_rng(seed).normal(0, 0.2, (len(seen), 2))
        doubled = replace(scene, detections=scenes.Detections.make(np.concatenate([xy, ghost]), sigma_px=0.2))
        shadow = np.full(60, -1)
        shadow[label[seen]] = np.arange(len(xy), len(xy) + len(seen))
        search = solved(doubled)
        first = search.best
        assert search.copies(first, lambda: True) == ([], 1.0)
        copies, part = search.copies(first, lambda: False)
        assert part < 1.0
        assert all(np.isin(c.match[c.match >= 0], first.match, invert=True).all() for c in copies)
        found += max(((c.match == shadow) & (shadow >= 0)).sum() for c in search.top(12)) > 0.8 * len(seen)
        alone = solved(scene)
        before = [(c.score, c.count) for c in alone.top(12)]
        assert alone.copies(alone.best, lambda: False)[1] < 1.0
        assert all(c.score < 45.0 for c in alone.top(12) if (c.score, c.count) not in before)
    assert found >= 4


def test_every_spot_in_turn_is_the_anchor_of_a_quad(scene):
    """Of each anchor the near quads come first, then the far ones, each rarest first; of one turn the rarest first."""
    plane = plane_of(scene)
    picture, table = plane.picture(len(scene.detections)), plane.layout.table(7)
    near, far = (links.quad_links(picture, table, low, high, CHECK) for low, high in ((0, 5), (5, 8)))
    got = links.in_turn(near, far)
    rows = [np.column_stack([of.spots, of.first, of.last]).tolist() for of in (near, far, got)]
    assert sorted(rows[2]) == sorted(rows[0] + rows[1])
    turn, seen = [], {}
    for row in rows[2]:
        seen.setdefault(row[0], []).append(row)
        turn.append(len(seen[row[0]]))
    for anchor, mine in seen.items():
        assert mine == [row for row in rows[0] + rows[1] if row[0] == anchor]
    size = (got.last - got.first).tolist()
    assert list(zip(turn, size, strict=True)) == sorted(zip(turn, size, strict=True))


def test_compact_quads_are_the_rarest_of_each_anchor(scene):
    plane = plane_of(scene)
    picture, table = plane.picture(len(scene.detections)), plane.layout.table(7)
    some = np.arange(0, len(picture.p), 2, dtype=np.int32)
    of = links.compact_links(picture, some, 6, 9, table, CHECK)
    assert len(of.spots) == 9
    assert len(set(of.spots[:, 0].tolist())) == 9
    assert set(of.spots.ravel().tolist()) <= set(some.tolist())
    assert (np.diff(of.last - of.first) >= 0).all()
