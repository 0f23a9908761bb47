"""The closed-form updates against brute force, slivers included."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptsize._kernels.local_updates import minimum_on_edge, minimum_on_triangle


def _least(function, n_steps=60):
    """Return the minimum of a convex function on [0, 1] by ternary search."""
    low, high = 0.0, 1.0
    for _ in range(n_steps):
        left, right = low + (high - low) / 3.0, high - (high - low) / 3.0
        if function(left) < function(right):
            high = right
        else:
            low = left
    return min(function(0.0), function(1.0), function(0.5 * (low + high)))


def _least_over_edge(x, corners, sizes, g):
    def value(t):
        y = corners[0] + t * (corners[1] - corners[0])
        return sizes[0] + t * (sizes[1] - sizes[0]) + g * np.linalg.norm(x - y)

    return _least(value)


def _least_over_triangle(x, corners, sizes, g):
    def value(t):  # the minimum over the segment at the share t from corner 0 to the side (1, 2)
        ends = corners[0] + t * (corners[1:] - corners[0])
        return _least_over_edge(x, ends, sizes[0] + t * (sizes[1:] - sizes[0]), g)

    return _least(value, n_steps=40)


@st.composite
def local_problems(draw, k):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dim = draw(st.sampled_from([2, 3])) if k == 2 else 3
    points = rng.normal(size=(k + 1, dim))
    if draw(st.booleans()):  # a sliver: everything close to one line
        points = points[:, :1] * rng.normal(size=dim) + 1e-3 * points
    g = draw(st.sampled_from([0.05, 0.3, 1.0]))
    sizes = rng.uniform(0.5, 0.5 + 2.0 * g, k)
    return points, sizes, g


@given(local_problems(2))
def test_edge_update_is_the_minimum_over_the_edge(problem):
    points, sizes, g = problem
    axes = (0,) * points.shape[1]
    value, t = minimum_on_edge(points, axes, 0, (1, 2), tuple(sizes), g)
    assert value == pytest.approx(_least_over_edge(points[0], points[1:], sizes, g), rel=1e-9)
    foot = (1.0 - t) * points[1] + t * points[2]
    there = (1.0 - t) * sizes[0] + t * sizes[1] + g * np.linalg.norm(points[0] - foot)
    assert value == pytest.approx(there, rel=1e-12)


@given(local_problems(3))
@settings(max_examples=25)
def test_triangle_update_is_the_minimum_over_the_triangle(problem):
    points, sizes, g = problem
    value, l1, l2 = minimum_on_triangle(points, (0, 0, 0), 0, (1, 2, 3), tuple(sizes), g, True)
    assert value == pytest.approx(_least_over_triangle(points[0], points[1:], sizes, g), rel=1e-7)
    weights = np.array([1.0 - l1 - l2, l1, l2])
    there = weights @ sizes + g * np.linalg.norm(points[0] - weights @ points[1:])
    assert value == pytest.approx(there, rel=1e-10)
