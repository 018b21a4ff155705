"""A model followed through drawn pictures: statuses, what is refused, and what goes from image to image."""

import numpy as np
import pytest

import windmark as wm
from windmark.errors import DataError, UsageError
from windmark.synth import disc_image
from windmark.tasks.expected import prediction_sigma_px
from windmark.tasks.follow import FEWER, FollowOptions, _may_have_slipped, follow

CAMERA = wm.Camera((320, 240), 400.0)
LEVEL = 180.0


def markers():
    rng = np.random.default_rng(12)
    xyz = [rng.uniform(-1, 1, 3) * [130.0, 95.0, 20.0]]
    while len(xyz) < 18:
        more = rng.uniform(-1, 1, 3) * [130.0, 95.0, 20.0]
        if min(np.hypot(*(more - x)[:2]) for x in xyz) > 26:
            xyz.append(more)
    return wm.MarkerSet.make([f"m{k}" for k in range(18)], xyz, normal=np.tile([0.0, 0, 1.0], (18, 1)), radius=6.0)


def pose(step):
    """The model moves by a few pixels from picture to picture."""
    return wm.Pose.look_at([20.0 + 4 * step, -10.0 + 2 * step, 420.0], [4.0 * step, 0.0, 0.0], [0.02 * step, 1.0, 0.0])


def picture(table, step, seed=0):
    image = np.full((240, 320), LEVEL)
    for centre in CAMERA.project(pose(step).apply(table.xyz))[0]:
        low = np.maximum(np.rint(centre).astype(int) - 12, 0)
        patch = disc_image((25, 25), centre - low, [6.0, 6.0], 0.0, level=LEVEL, depth=120.0, blur_px=0.6)
        part = image[low[1] : low[1] + 25, low[0] : low[0] + 25]
        part += patch[: part.shape[0], : part.shape[1]] - LEVEL
    return np.clip(image + np.random.default_rng([seed, step]).normal(0, 2.0, image.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def table():
    return markers()


@pytest.fixture(scope="module")
def frames(table):
    images = [(f"p{k}", picture(table, k)) for k in range(4)]
    images.insert(2, ("dark", np.full((240, 320), 90, np.uint8)))
    kept = {}
    found = list(follow(images, table, CAMERA, options=FollowOptions(radius_px=(6.0,)), handed_on=kept))
    return images, found, kept


def test_the_first_is_searched_for_the_next_are_near_their_prediction_and_an_empty_one_is_lost(table, frames):
    _, found, kept = frames
    assert [f.status for f in found] == ["cold", "tracked", "lost", *[found[3].status, found[4].status]]
    assert found[3].status in ("tracked", "reacquired")
    assert [f.index for f in found] == [0, 1, 2, 3, 4]
    assert [f.instant for f in found] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert not found[0].guided
    assert found[4].guided
    assert np.isfinite(found[4].blur_px)
    assert np.isnan(found[0].blur_px)
    assert {f.polarity for f in found} <= {"dark", ""}
    for f, step in zip(found, (0, 1, None, 2, 3), strict=True):
        if step is None:
            assert f.registered is None
            continue
        error = (f.registered.cam_from_model @ pose(step).inverse()).log()
        sigma = np.sqrt(np.diag(f.registered.cov))
        assert (np.abs(error) < 5 * sigma).all()
        assert len(f.registered.matching) >= 16
    assert kept["index"] == 5
    assert kept["instant"] == 4.0
    assert len({f.picture for f in found if f.registered is not None} - {0}) == 4


def test_what_was_handed_on_goes_on_where_it_stopped(table, frames):
    images, found, _ = frames
    kept = {}
    options = FollowOptions(radius_px=(6.0,))
    first = list(follow(images[:2], table, CAMERA, options=options, handed_on=kept))
    rest = list(follow([images[3]], table, CAMERA, options=options, handed_on=kept, instants=[3.0]))
    assert [f.status for f in first] == ["cold", "tracked"]
    assert (rest[0].index, rest[0].status) == (2, "tracked")
    same = rest[0].registered.cam_from_model @ found[3].registered.cam_from_model.inverse()
    assert np.abs(same.log()).max() < 1e-2
    for instant in (1.0, 0.5, np.nan):
        before = dict(kept, index=2, instant=1.0)
        with pytest.raises(UsageError, match="instants must increase strictly, number 2 is"):
            list(follow([images[3]], table, CAMERA, options=options, handed_on=before, instants=[instant]))
    with pytest.raises(UsageError, match="instants must be given for every image, got 1"):
        list(follow(images[:1] * 2, table, CAMERA, options=FollowOptions(radius_px=(6.0,)), instants=[0.0]))


def test_a_picture_of_another_size_is_lost_with_both_sizes_and_what_is_no_picture_is_refused(table):
    (lost,) = follow([("small", np.zeros((240, 300), np.uint8))], table, CAMERA)
    assert lost.status == "lost"
    assert lost.reason == "small: is 300 x 240 pixels but the camera is 320 x 240"
    with pytest.raises(UsageError, match="expected names with grey images, or `read` for Item"):
        list(follow([type("Item", (), {"name": "x"})()], table, CAMERA))
    with pytest.raises(UsageError, match="or `read` for str"):
        list(follow(["run7.tif"], table, CAMERA))

    def read(item):
        raise DataError(f"{item.name} cannot be read")

    (bad,) = follow([type("Item", (), {"name": "x", "time_s": 7.5})()], table, CAMERA, read=read)
    assert (bad.status, bad.reason, bad.time_s, bad.name) == ("lost", "x cannot be read", 7.5, "x")


def test_a_slip_is_possible_where_a_symmetry_explains_who_is_gone():
    onto = np.array([[1, 2, 3, 4, 5, -1], [5, 4, 3, 2, 1, 0]], np.int32)  # one on along a row, and its mirror image
    seen = np.arange(5)
    assert _may_have_slipped(onto, np.array([5]), seen)  # the last one has nobody to be taken for
    assert not _may_have_slipped(onto[1:], np.array([5]), seen)
    assert not _may_have_slipped(onto, np.array([0]), np.arange(1, 6))  # shifted the first one would be there
    assert not _may_have_slipped(onto, np.zeros(0, int), seen)
    assert not _may_have_slipped(onto[:0], np.array([5]), seen)
    assert not _may_have_slipped(onto, np.array([4, 5]), seen)  # half of them is not most
    row = np.where(np.arange(20) < 12, np.arange(20) + 1, -1)[None].astype(np.int32)
    gone = np.array([19])
    assert _may_have_slipped(row, gone, np.arange(20)) == (FEWER * 20 <= 12)
    assert not _may_have_slipped(np.where(row == 12, -1, row), gone, np.arange(20))


def test_the_prediction_is_as_unsure_as_draws_of_the_pose(table):
    """The worst tenth of the markers, the worse coordinate; 3000 draws know it to 2 %."""
    rng = np.random.default_rng(3)
    root = 1e-3 * rng.normal(size=(6, 6)) * [[1], [1], [1], [300], [300], [300]]
    at = pose(0)
    xy = [CAMERA.project((wm.Pose.exp(root @ rng.normal(size=6)) @ at).apply(table.xyz))[0] for _ in range(3000)]
    worse = np.std(xy, axis=0).max(axis=1)
    got = prediction_sigma_px(CAMERA, at, root @ root.T, table)
    assert got == pytest.approx(np.sqrt(np.quantile(worse**2, 0.9)), rel=0.08)
    away = wm.Pose.look_at([0.0, 0.0, 400.0], [0.0, 0.0, 900.0], [0.0, 1.0, 0.0])
    assert prediction_sigma_px(CAMERA, away, np.eye(6), table) == np.inf
