"""Sizes of periodic domains are limited across their sides."""

from functools import partial

import numpy as np
import pytest

from adaptsize import CartesianGrid, PointSource, SimplexMesh, size_function
from adaptsize.domain_size.across_sides import limited_across_sides


def square(keep=None):
    """Return triangles of the unit square, or of what is kept of it."""
    grid = CartesianGrid([0.0, 0.0], 0.05, (21, 21)).mesh
    if keep is None:
        return grid
    return SimplexMesh(grid.points, grid.cells[keep(grid.points[grid.cells].mean(axis=1))])


def ratio_across(size, axis):
    """Return the largest ratio of the sizes at opposite places."""
    along = np.linspace(0.0, 1.0, 201)
    sides = [np.insert(along[:, None], axis, end, axis=1) for end in (0.0, 1.0)]
    a, b = (size(points) for points in sides)
    return float(np.maximum(a / b, b / a).max())


@pytest.mark.parametrize("is_convex", [True, False])
def test_small_sizes_at_one_side_act_on_the_other(is_convex):
    # The sizes near a hole beside a side, or at a source, are 0.02 to 0.03 of the other side's.
    mesh = square(None if is_convex else lambda x: np.linalg.norm(x - [0.1, 0.5], axis=1) > 0.045)
    given = {"hmax": 0.2, "g": 0.25, "sources": [PointSource([0.05, 0.3], 0.01)]}
    compute = partial(size_function, mesh)
    assert ratio_across(compute(**given), 0) > 8.0
    size = limited_across_sides(mesh, [[1.0, 0.0]], compute, given)
    # Sources an edge apart and linear sizes between nodes: 1 + g / 2 each.
    assert ratio_across(size, 0) < 1.3
    # The distance from x = 0.95 to the source is 0.1 across the side.
    assert size([[0.95, 0.3]])[0] < 1.2 * (0.01 + 0.25 * 0.1)


def test_sizes_are_limited_across_a_corner():
    mesh = square()
    given = {"hmax": 0.2, "g": 0.25, "sources": [PointSource([0.03, 0.03], 0.01)]}
    motions = [[1.0, 0.0], [0.0, 1.0]]
    size = limited_across_sides(mesh, motions, partial(size_function, mesh), given)
    assert max(ratio_across(size, axis) for axis in (0, 1)) < 1.3
    assert size([[0.97, 0.97]])[0] < 1.2 * (0.01 + 0.25 * 0.06 * np.sqrt(2.0))


def test_sizes_that_match_are_computed_once():
    mesh, calls = square(), []

    def compute(**given):
        calls.append(given)
        return size_function(mesh, **given)

    limited_across_sides(mesh, [[1.0, 0.0]], compute, {"hmax": 0.1})
    assert len(calls) == 1
