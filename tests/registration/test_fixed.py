"""Labels that the user gives: they decide what is ambiguous, and are refused where the spots contradict them."""

import numpy as np
import pytest
import registration_scenes as scenes

from windmark.registration import NotRegistered, register
from windmark.scene import Detections, MarkerSet


def labels_of(scene, rng, count):
    """True labels of some spots."""
    spots = rng.permutation(np.flatnonzero(scene.label >= 0))[:count]
    return {int(j): str(scene.markers.name[scene.label[j]]) for j in spots}


@pytest.mark.parametrize("count", [1, 2, 3, 6])
@pytest.mark.parametrize("kind", ["A", "B"])
def test_true_labels_are_in_the_solution_and_the_rest_is_found(kind, count):
    scene = scenes.scene(72, kind, hidden=0.25, false=0.5)
    fixed = labels_of(scene, np.random.default_rng(count), count)
    result = register(scene.detections, scene.markers, scene.camera, fixed=fixed, max_time_s=30.0)
    assert result, result.reason
    assert set(fixed) <= set(result.matching.detection.tolist())
    assert scenes.wrong_labels(result.matching.detection, result.matching.marker, scene) == 0
    assert len(result.matching) == (scene.label >= 0).sum()
    assert result.options["fixed"] == fixed


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_wrong_label_is_named_not_dropped(count):
    scene = scenes.scene(73, "B", hidden=0.25, false=0.5)
    fixed = labels_of(scene, np.random.default_rng(count), count)
    spot = next(iter(fixed))
    wrong = next(name for name in scene.markers.name if name not in fixed.values())
    result = register(scene.detections, scene.markers, scene.camera, fixed=fixed | {spot: wrong}, max_time_s=30.0)
    assert isinstance(result, NotRegistered)
    assert result.cause == "labels"
    assert wrong in result.reason
    assert f"takes the spot for {fixed[spot]}" in result.reason
    assert result.best_count >= (scene.label >= 0).sum() - 1


def test_a_label_on_a_false_spot_is_refused():
    scene = scenes.scene(74, "B", hidden=0.25, false=0.5)
    clutter = int(np.flatnonzero(scene.label < 0)[0])
    result = register(scene.detections, scene.markers, scene.camera, fixed=[(clutter, 7)], max_time_s=30.0)
    assert not result
    assert result.cause == "labels"
    assert "px away" in result.reason or "out of sight" in result.reason


def test_one_label_decides_a_symmetric_layout():
    grid = np.stack(np.meshgrid(np.arange(6) * 1.0, np.arange(4) * 1.0, [0.0]), axis=-1).reshape(-1, 3)
    plate = MarkerSet.make([f"g{i}" for i in range(24)], grid, normal=np.tile([0.0, 0.0, 1.0], (24, 1)))
    rng = np.random.default_rng(4)
    camera, pose = scenes.random_view(rng, plate, fov_deg=(40, 50))
    scene = scenes.image_of(rng, plate, camera, pose)
    refused = register(scene.detections, plate, camera)
    assert refused.cause == "ambiguous"
    assert "label of a spot" in refused.reason
    assert "more of the" not in refused.reason  # all are seen already
    for spot, marker in ((0, int(scene.label[0])), (1, 23 - int(scene.label[1]))):  # the truth, and half a turn
        result = register(scene.detections, plate, camera, fixed={spot: marker}, max_time_s=30.0)
        assert result, result.reason
        wrong = scenes.wrong_labels(result.matching.detection, result.matching.marker, scene)
        assert wrong == (0 if marker == scene.label[spot] else 24)


def test_four_labels_let_few_markers_be_enough():
    """Seven pairs among much clutter are not beyond chance; with the labels of four of them they are."""
    scene = scenes.scene(75, "B", noise_px=0.3)
    keep = np.random.default_rng(0).permutation(np.flatnonzero(scene.label >= 0))[:7]
    rng = np.random.default_rng(1)
    xy = np.concatenate([scene.detections.xy[keep], rng.uniform(0, 1, (30, 2)) * scene.camera.size_px])
    spots = Detections.make(xy, sigma_px=0.3)
    assert not register(spots, scene.markers, scene.camera)
    fixed = {k: int(scene.label[keep[k]]) for k in range(4)}
    result = register(spots, scene.markers, scene.camera, fixed=fixed, max_time_s=30.0)
    assert result, result.reason
    found = dict(zip(result.matching.detection.tolist(), result.matching.marker.tolist(), strict=True))
    assert all(found.get(k) == scene.label[keep[k]] for k in range(7))


def one_spot_off(off_px):
    """A picture in which one spot is so far off its marker, and that spot and marker."""
    scene = scenes.scene(78, "B", noise_px=0.2)
    spot = int(np.flatnonzero(scene.label >= 0)[7])
    xy = scene.detections.xy.copy()
    xy[spot] += [off_px, 0.0]
    moved = scenes.Scene(
        Detections.make(xy, sigma_px=0.2), scene.markers, scene.camera, scene.cam_from_model, scene.label
    )
    return moved, spot, int(scene.label[spot])


def test_a_binding_label_is_a_fact():
    """A true label whose spot is 3 px off contradicts the others, unless it is binding; then the residual says so."""
    scene, spot, marker = one_spot_off(3.0)
    given = (scene.detections, scene.markers, scene.camera)
    refused = register(*given, fixed={spot: marker}, max_time_s=30.0)
    assert refused.cause == "labels"
    told = register(*given, fixed={spot: marker}, binding=True, max_time_s=30.0)
    assert told, told.reason
    at = told.matching.detection.tolist().index(spot)
    assert told.matching.marker[at] == marker
    assert told.matching.distance_px[at] > 2
    others = np.delete(told.matching.distance_px, at)
    assert np.median(others) < 0.5


def test_binding_changes_nothing_where_labels_agree():
    scene = scenes.scene(72, "A", hidden=0.25, false=0.5)
    fixed = labels_of(scene, np.random.default_rng(3), 3)
    plain, bound = (
        register(scene.detections, scene.markers, scene.camera, fixed=fixed, binding=b, max_time_s=30.0)
        for b in (False, True)
    )
    np.testing.assert_array_equal(plain.matching.detection, bound.matching.detection)
    np.testing.assert_allclose(plain.cam_from_model.translation, bound.cam_from_model.translation, rtol=1e-6)


def test_excluded_spots_take_no_part():
    scene = scenes.scene(76, "A")
    some = [0, 5]
    result = register(scene.detections, scene.markers, scene.camera, excluded=some)
    assert result
    assert not set(some) & set(result.matching.detection.tolist())
    assert scenes.wrong_labels(result.matching.detection, result.matching.marker, scene) == 0
    mask = np.zeros(len(scene.detections), bool)
    mask[some] = True
    again = register(scene.detections, scene.markers, scene.camera, excluded=mask)
    np.testing.assert_array_equal(again.matching.detection, result.matching.detection)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"fixed": {999: 0}}, "fixed must name spots"),
        ({"fixed": {0: "nobody"}}, "'nobody'"),
        ({"fixed": {0: 99}}, "index below 24"),
        ({"fixed": {0: 3, 1: 3}}, "every marker may be fixed only once"),
        ({"fixed": [(0, 3), (0, 4)]}, "every spot may be fixed only once"),
        ({"fixed": {0: 3}, "excluded": [0]}, "fixed spot 0 is excluded"),
        ({"excluded": [999]}, "excluded must be indices"),
        ({"excluded": [True]}, "mask"),
        ({"excluded": [0.5]}, "indices of spots or a mask"),
    ],
)
def test_wrong_options_are_named(options, words):
    scene = scenes.scene(77, "A")
    with pytest.raises(ValueError, match=words):
        register(scene.detections, scene.markers, scene.camera, **options)
