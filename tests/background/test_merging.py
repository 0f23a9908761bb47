"""Points closer than a distance are one, wherever they lie."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from adaptsize.background.merging import (
    _near_pairs,
    corner_distance,
    nodes_there,
    place_numbers,
)
from adaptsize.background.topology import components_of


def chains(points, within):
    """Number places by flooding: the slow twin."""
    near = np.linalg.norm(points[:, None] - points, axis=2) <= within
    number = np.full(len(points), -1)
    for i in range(len(points)):
        if number[i] < 0:
            number[i] = number.max() + 1
            reached = [i]
            while reached:
                k = reached.pop()
                for j in np.flatnonzero(near[k] & (number < 0)):
                    number[j] = number[i]
                    reached.append(j)
    return number


@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e150])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_places_are_the_chains_of_near_points(dim, scale):
    rng = np.random.default_rng(81_001 + dim)
    points = rng.random((120, dim))
    points[60:90] = points[rng.integers(0, 60, 30)]  # some are equal
    for within in (0.0, 0.01, 0.05, 2.0):
        expected = chains(points, within)
        assert_array_equal(place_numbers(scale * points, scale * within), expected)


@pytest.mark.parametrize("spacing", [2.0, 50.0])
@pytest.mark.parametrize("offset", [0.0, 1e7])
@pytest.mark.parametrize("kind", ["cube", "plane", "line"])
def test_near_pairs_are_those_of_a_tree(kind, offset, spacing):
    # Lattices, as CAD parts have, with a fifth of the points repeated nearby.
    rng = np.random.default_rng(81_101)
    n = {"cube": (6, 6, 6), "plane": (15, 15, 1), "line": (200, 1, 1)}[kind]
    points = spacing * np.argwhere(np.ones(n)).astype(float) + offset
    twins = points[::5] + rng.uniform(-0.8, 0.8, (len(points[::5]), 3))
    points = rng.permutation(np.concatenate([points, twins]))
    expected = cKDTree(points).query_pairs(1.0, output_type="ndarray")
    found = _near_pairs(points)
    assert found is not None or spacing == 2.0
    if found is not None:
        assert_array_equal(
            np.unique(np.sort(found, axis=1), axis=0), np.unique(np.sort(expected, axis=1), axis=0)
        )
        assert len(expected) > 10


def test_points_that_are_all_near_are_left_to_a_tree():
    points = np.random.default_rng(81_102).random((200, 3)) * 0.1
    assert _near_pairs(points) is None
    assert place_numbers(points, 1.0).max() == 0


@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_components_are_those_of_a_graph(seed, n_links):
    links = np.random.default_rng(seed).integers(0, 40, (n_links, 2))
    graph = coo_array((np.ones(n_links), links.T), shape=(40, 40))
    assert_array_equal(components_of(links, 40), connected_components(graph, directed=False)[1])


def test_corners_of_triangles_that_are_apart_are_not_joined():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5], [1, 0, 0.5], [0, 1, 0.5]])
    cells = np.array([[0, 1, 2], [3, 4, 5]])
    assert corner_distance(points, cells) == 0.0
    # Most edges are open: the coordinates are noisy if at least a quarter of them meet.
    nearly = points.copy()
    nearly[3:] = points[:3]
    nearly[3:, 2] = 1e-4
    assert 1e-4 <= corner_distance(nearly, cells) <= 2e-4


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["random", "grid", "doubled"])
def test_nodes_that_have_not_moved_are_found_as_by_a_tree(dim, kind):
    rng = np.random.default_rng(5_881)
    points = rng.random((400, dim))
    if kind == "grid":
        axes = [np.linspace(0.0, 1.0, 7)] * dim
        points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, dim)
    elif kind == "doubled":  # some are nearer to each other than the distance
        points = np.concatenate([points, points[:9] + 3e-14])
    moved = points + 2e-14 * rng.normal(size=points.shape)
    places = np.concatenate([moved, rng.random((50, dim)), points[:5] + 3e-13])
    distance, number = cKDTree(points).query(places, distance_upper_bound=1e-13)
    expected = np.where(np.isfinite(distance), number, -1)
    assert (expected[: len(points)] >= 0).sum() > 0.9 * len(points)
    assert_array_equal(nodes_there(points, places, 1e-13), expected)
