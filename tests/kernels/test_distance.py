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


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-3, 1e-6, 1e-9, 1e-12, 1e-15]))
def test_slivers_agree_with_the_search_over_faces(seed, height):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(int(rng.integers(2, 5)), 3))
    corners[:, 2] *= height
    if rng.random() < 0.5:
        corners[:, 1] *= height  # needles
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    weights = rng.dirichlet(np.ones(len(corners)))
    x = weights @ corners + rng.choice([0.0, height, 1.0]) * rng.normal(size=3)
    # Cells that count as flat are replaced by their faces: off by at most their height,
    # a few times ``height`` here.  Needles count as flat where height^2 is about 1e-13.
    check(corners @ turn, x @ turn, 1e-12 if height > 1e-6 else 1e-12 + 5.0 * height)


@pytest.mark.parametrize("scale", [1e-120, 1e-60, 1e60])
@pytest.mark.parametrize("width", KINDS.values())
def test_very_small_and_large_cells_give_no_nan(width, scale):
    rng = np.random.default_rng(5512)
    corners = rng.normal(size=(width, 3))
    distance, weights = closest(corners * scale, np.array([3.0, 4.0, 5.0]) * scale)
    assert np.isfinite(weights).all()
    assert_allclose(weights.sum(), 1.0, atol=1e-14)
    if scale > 1e-100:  # below, squares of volumes leave the range and corners stand in
        assert_allclose(distance / scale, slow_distance(corners, [3.0, 4.0, 5.0]), rtol=1e-12)
