"""Tests of the search for near points, against distances of all pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from eskin import near
from eskin.near import find_nearest, iterate_near_pairs, measure_nearest

REACH = 1.0


@st.composite
def clouds(draw):
    """Draw points of a grid, some of them coincident, far away or dense."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = draw(st.integers(1, 60))
    points = rng.integers(-4, 5, (count, 3)) * draw(st.sampled_from([0.0, 0.25, 0.5]))
    points[:, 2] *= draw(st.sampled_from([0.0, 1.0]))
    is_far = rng.random(count) < draw(st.sampled_from([0.0, 0.1]))
    points[is_far] *= draw(st.sampled_from([1e3, 1e9, 1e100]))
    return points


def list_pairs(found):
    pairs = [np.stack([one, other], axis=1) for one, other, _ in found]
    return {tuple(pair) for part in pairs for pair in part.tolist()}


def list_entries(matrix):
    return {tuple(place) for place in np.argwhere(matrix).tolist()}


@given(clouds(), st.sampled_from([1, 7, 1 << 17]))
def test_pairs_within_reach_are_those_of_all_distances(points, block):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(near, "BLOCK", block)
        found = list(iterate_near_pairs(points, REACH))
    is_near = cdist(points, points, "sqeuclidean") <= REACH**2
    np.fill_diagonal(is_near, False)
    assert list_pairs(found) == list_entries(is_near)
    assert sum(len(one) for one, _, _ in found) == is_near.sum()
    for one, other, squared in found:
        assert (squared == ((points[one] - points[other]) ** 2).sum(axis=1)).all()


@given(clouds(), st.integers(1, 12))
def test_nearest_points_are_all_up_to_the_last_of_them(points, count):
    squared = cdist(points, points, "sqeuclidean")
    np.fill_diagonal(squared, -1.0)
    last = np.sort(squared, axis=1)[:, min(count, len(points) - 1)]
    wanted = (squared >= 0) & (squared <= last[:, None])
    one, other, found = find_nearest(points, count)
    assert list_pairs([(one, other, found)]) == list_entries(wanted)
    assert len(one) == wanted.sum()
    if len(points) > 1:
        np.testing.assert_array_equal(measure_nearest(points, count), np.sqrt(last))


@given(clouds())
def test_chosen_points_have_the_pairs_that_they_have_among_all(points):
    chosen = np.arange(0, len(points), 3)
    some = list_pairs(iterate_near_pairs(points, REACH, chosen))
    whole = list_pairs(iterate_near_pairs(points, REACH))
    assert some == {(a, b) for a, b in whole if a % 3 == 0}


def test_no_points_have_no_pairs():
    none = np.empty((0, 3))
    assert not list(iterate_near_pairs(none, REACH))
    assert not len(find_nearest(none, 3)[0])


def test_many_points_in_one_place_take_no_memory_for_their_pairs():
    points = np.zeros((100_000, 3))
    points[0] = 1.0
    distances = measure_nearest(points, 3)
    assert distances[0] == 3**0.5 and not distances[1:].any()
