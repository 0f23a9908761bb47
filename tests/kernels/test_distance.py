"""Closest points of single simplices against a search over all of their faces."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from adaptsize._kernels.distance import closest_on_cell

KINDS = {"segment": 2, "triangle": 3, "tetrahedron": 4}


def slow_distance(corners, x):
    """Smallest distance to the feet of x that lie inside a face of any dimension.

    By Caratheodory's theorem the closest point is the foot of x on a face with
    independent corners, so least squares on every subset of the corners finds it.
    """
    best = np.inf
    for size in range(1, len(corners) + 1):
        for rows in combinations(range(len(corners)), size):
            face = corners[list(rows)]
            inner = np.zeros(0)
            if size > 1:
                inner = np.linalg.lstsq((face[1:] - face[0]).T, x - face[0], rcond=None)[0]
            weights = np.array([1.0 - inner.sum(), *inner])
            if (weights >= 0.0).all():
                best = min(best, float(np.linalg.norm(x - weights @ face)))
    return best


def closest(corners, x):
    corners = np.asarray(corners, dtype=float)
    cells = np.arange(len(corners), dtype=np.int32)[None]
    distance2, weights = closest_on_cell(corners, cells, 0, tuple(float(t) for t in x))
    return np.sqrt(distance2), np.array(weights[: len(corners)])


def check(corners, x, tolerance):
    """Check distance and weights: both the value and that the weights give it."""
    distance, weights = closest(corners, x)
    assert (weights >= 0.0).all()
    assert_allclose(weights.sum(), 1.0, rtol=0.0, atol=1e-14)
    assert abs(distance - slow_distance(corners, x)) <= tolerance
    assert abs(np.linalg.norm(x - weights @ corners) - distance) <= tolerance


@pytest.mark.parametrize("kind", KINDS)
def test_random_simplices_agree_with_the_search_over_faces(kind):
    rng = np.random.default_rng(90251)
    for _ in range(100):
        check(rng.normal(size=(KINDS[kind], 3)), rng.normal(size=3) * 1.5, 1e-13)


coordinate = st.integers(0, 3).map(float)
place = st.tuples(coordinate, coordinate, coordinate)


@given(st.lists(place, min_size=2, max_size=4), place)
def test_simplices_on_a_coarse_lattice_agree_with_the_search_over_faces(corners, x):
    # Many of them are degenerate: corners that coincide, lie on a line or in a plane.
    check(np.array(corners), np.array(x), 1e-13)
