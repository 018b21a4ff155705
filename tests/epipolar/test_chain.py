"""Links of pairs of pictures joined to tracks."""

import epipolar_twins
import numpy as np
import pytest

from windmark.epipolar import PairLinks, chain
from windmark.epipolar._kernels.merge import JOINED, SHARED_VIEW, merge


def pictures(seed, views=12, markers=40, seen=0.8, found=0.8, wrong=0.06, useless=(), reach=None):
    """Labels of every view's spots, and matchings of which some links are missing and some wrong."""
    rng = np.random.default_rng(seed)
    labels = [rng.permutation(np.flatnonzero(rng.random(markers) < seen)) for _ in range(views)]
    pairs = []
    for a in range(views):
        for b in range(a + 1, views):
            if reach is not None and b - a > reach:
                continue
            common, s, t = np.intersect1d(labels[a], labels[b], return_indices=True)
            kept = rng.random(len(common)) < found
            s, t = s[kept], t[kept]
            bad = rng.random(len(s)) < (0.95 if a in useless or b in useless else wrong)
            t[bad] = rng.permutation(t[bad])
            pairs.append(PairLinks(a, b, s, t))
    return labels, pairs


def wrong_and_right(labels, result):
    label = np.array([labels[v][s] for v, s in zip(result.tracks.view, result.tracks.detection, strict=True)])
    tracks = result.tracks.track
    own = np.array([np.bincount(label[tracks == t]).argmax() for t in range(tracks.max() + 1)])
    good = label == own[tracks]
    return int((~good).sum()), int(good.sum()), len(own), len(np.unique(own))


@pytest.mark.parametrize("seed", range(4))
def test_wrong_links_are_cut(seed):
    """A tenth of the links missing or wrong, two pictures useless: complete tracks, hardly a wrong spot."""
    labels, pairs = pictures(seed, useless=(3, 8))
    result = chain([len(each) for each in labels], pairs, min_views=3)
    wrong, right, tracks, markers = wrong_and_right(labels, result)
    useful = sum(len(each) for v, each in enumerate(labels) if v not in (3, 8))
    assert wrong <= 6  # of the useless pictures, by chance
    assert right >= 0.99 * useful
    assert tracks <= markers + 2
    true = np.array([labels[a][s] == labels[b][t] for a, s, b, t in result.links])
    fine = ~np.isin(result.links[:, 0], (3, 8)) & ~np.isin(result.links[:, 2], (3, 8))
    assert (result.cut[fine & ~true] != JOINED).all()
    assert (result.cut[fine & true] == JOINED).mean() > 0.99


def test_neighbours_only():
    """A path of pictures, each matched with the next two."""
    labels, pairs = pictures(7, seen=1.0, found=0.95, wrong=0.02, reach=2)
    result = chain([len(each) for each in labels], pairs)
    wrong, right, _, _ = wrong_and_right(labels, result)
    assert wrong <= 0.01 * right
    assert right > 0.98 * sum(map(len, labels))


def test_one_wrong_link_between_two_tracks():
    """Markers 0 and 1 in four views, all links but one wrong one in place."""
    pairs = [PairLinks(a, b, np.array([0, 1]), np.array([0, 1])) for a in range(4) for b in range(a + 1, 4)]
    pairs[2] = PairLinks(0, 3, np.array([0, 1]), np.array([1, 0]))
    result = chain([2] * 4, pairs)
    np.testing.assert_array_equal(result.tracks.track, [0] * 4 + [1] * 4)
    np.testing.assert_array_equal(result.tracks.detection, [0] * 4 + [1] * 4)
    wrong = (result.links[:, 0] == 0) & (result.links[:, 2] == 3)
    assert (result.closed[wrong] == 0).all()
    assert (result.broken[wrong] > result.broken[~wrong].max()).all()
    assert (result.cut[wrong] == SHARED_VIEW).all()
    assert (result.cut[~wrong] == JOINED).all()
    assert "2 cut" in result.report()


def test_a_better_link_wins():
    """Two links contradict each other without a third view: the heavier one stays."""
    pairs = [
        PairLinks(0, 1, np.array([0]), np.array([0]), np.array([2.0])),
        PairLinks(1, 2, np.array([0]), np.array([0]), np.array([1.0])),
        PairLinks(0, 2, np.array([0]), np.array([1]), np.array([1.5])),
    ]
    result = chain([1, 1, 2], pairs)
    links = {tuple(link) for link in result.links[result.cut == JOINED].tolist()}
    assert links == {(0, 0, 1, 0), (0, 0, 2, 1)}
    np.testing.assert_array_equal(result.broken, [1, 1, 1])
    np.testing.assert_array_equal(result.cut, [JOINED, SHARED_VIEW, JOINED])


def test_kernel():
    rng = np.random.default_rng(3)
    for seed in range(5):
        labels, pairs = pictures(seed + 20, views=6, markers=12, wrong=0.3)
        sizes = np.array([len(each) for each in labels])
        start = np.cumsum(sizes) - sizes
        first = np.concatenate([start[p.view_a] + p.spot_a for p in pairs])
        second = np.concatenate([start[p.view_b] + p.spot_b for p in pairs])
        view, weight = np.repeat(np.arange(6), sizes), rng.uniform(0.5, 2, len(first))
        partner, trust = np.full((len(view), 6), -1), np.zeros((len(view), 6))
        for s, t in ((first, second), (second, first)):
            partner[s, view[t]], trust[s, view[t]] = t, weight
        order = rng.permutation(len(first))
        track, members, fate = np.empty(len(view), int), np.empty((len(view), 6), int), np.zeros(len(first), int)
        merge(first, second, order, partner, trust, view, track, members, fate)
        sets, expected = epipolar_twins.merge(first, second, order, weight, view)
        assert {frozenset(row[row >= 0].tolist()) for row in members} - {frozenset()} == sets
        np.testing.assert_array_equal(fate, expected)


@pytest.mark.parametrize(
    ("pair", "word"),
    [
        (PairLinks(0, 0, np.array([0]), np.array([0])), "two different views"),
        (PairLinks(0, 3, np.array([0]), np.array([0])), r"views 0 and 3: expected two different views of 0 \.\.\. 2"),
        (PairLinks(3, 0, np.array([0]), np.array([0])), "two different views"),
        (PairLinks(-1, 0, np.array([0]), np.array([0])), "two different views"),
        (PairLinks(0, -1, np.array([0]), np.array([0])), "two different views"),
        (PairLinks(0, 1, np.array([-1]), np.array([0])), "spots of view 0 must be 0 ... 2"),
        (PairLinks(0, 1, np.array([0]), np.array([3])), "spots of view 1 must be 0 ... 2"),
        (PairLinks(0, 1, np.array([0, 1]), np.array([1, 1])), "a spot of view 1 is linked twice"),
        (PairLinks(0, 1, np.array([1]), np.array([0]), np.array([1.0, 1.0])), "same length"),
        (PairLinks(0, 1, np.array([[1]]), np.array([[0]])), "same length"),
        (PairLinks(0, 1, np.array([3]), np.array([0])), "must be 0 ... 2"),
        (PairLinks(0, 1, np.array([1, 1]), np.array([0, 1])), "linked twice"),
        (PairLinks(0, 1, np.array([1]), np.array([0, 1])), "same length"),
        (PairLinks(0, 1, np.array([1]), np.array([0]), np.array([0.0])), "weight"),
        (PairLinks(2, 1, np.array([1]), np.array([0])), "given twice"),
    ],
)  # fmt: skip
def test_bad_links(pair, word):
    with pytest.raises(ValueError, match=word):
        chain([3, 3, 3], [PairLinks(1, 2, np.array([0]), np.array([0])), pair])


def test_first_and_last_view_and_spot_may_be_linked_in_any_order():
    result = chain([3, 3, 3], [PairLinks(2, 0, np.array([0, 2]), np.array([2, 0]))])
    assert result.tracks.view.tolist() == [0, 2, 0, 2]
    links = {tuple(result.tracks.detection[result.tracks.track == t].tolist()) for t in (0, 1)}
    assert links == {(2, 0), (0, 2)}


def test_nothing():
    result = chain([3, 0, 2], [])
    assert len(result.tracks.track) == 0
    with pytest.raises(ValueError, match="min_views"):
        chain([3], [], min_views=1)
