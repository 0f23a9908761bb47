"""What exact limiting keeps on any mesh: folded, overlapping, flat, apart, with doubled nodes.

Which path is the shortest there is a matter of definition.  In any case no size is below that
of straight lines, and none above that of paths along edges.
"""

import numpy as np
import pytest
from exact_oracle import edge_sizes, straight_sizes
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy.spatial import Delaunay

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

#: Meshes tried in one test.
N_MESHES = 150


def assert_between_bounds(mesh, h0, g, face_sources):
    h = limit_gradient(mesh, h0, g, method=Exact(face_sources))
    upper = edge_sizes(mesh, h0, g)
    assert_array_equal(np.isfinite(h), np.isfinite(upper))
    assert (h <= upper * (1.0 + 1e-12)).all()
    assert (h <= h0).all()
    i, j = mesh.edges[np.isfinite(h[mesh.edges]).all(axis=1)].T
    rise = np.abs(h[i] - h[j]) - g * np.linalg.norm(mesh.points[i] - mesh.points[j], axis=1)
    assert (rise <= 1e-12 * h[i]).all()
    if not face_sources:
        assert (h >= straight_sizes(mesh.points, h0, g) * (1.0 - 1e-12)).all()
    return h


@st.composite
def any_mesh(draw):
    """Cells between a few points of a small grid: overlapping, folded, flat, apart, crossing."""
    dim = draw(st.sampled_from([2, 3]))
    coordinate = st.integers(0, 3).map(float)
    points = draw(st.lists(st.tuples(*[coordinate] * dim), min_size=dim + 1, max_size=12))
    node = st.integers(0, len(points) - 1)
    cell = st.lists(node, min_size=dim + 1, max_size=dim + 1, unique=True)
    cells = draw(st.lists(cell, min_size=1, max_size=25))
    size = st.one_of(st.just(np.inf), st.floats(0.01, 3.0))
    h0 = draw(st.lists(size, min_size=len(points), max_size=len(points)))
    h0[draw(node)] = draw(st.floats(0.01, 3.0))
    return SimplexMesh(points, cells), np.array(h0)


@given(any_mesh(), st.sampled_from([0.0, 0.1, 1.0]), st.booleans())
def test_no_size_is_below_that_of_straight_lines_or_above_that_of_edges(case, g, face_sources):
    assert_between_bounds(*case, g, face_sources)


def with_a_moved_node(dim, seed):
    """Return random cells of which a node is moved onto another one, or anywhere."""
    rng = np.random.default_rng(seed)
    points = rng.random((int(rng.integers(7, 30)), dim))
    cells = Delaunay(points).simplices
    i, j = cells[rng.integers(len(cells)), :2]
    points[i] = points[j] if seed % 3 else rng.random(dim)
    n = len(points)
    h0 = rng.uniform(0.01, 2.0, n)
    h0[rng.random(n) > rng.choice([0.1, 0.5, 1.0])] = np.inf
    h0[j] = rng.uniform(0.01, 2.0)
    return SimplexMesh(points, cells), h0, rng


@pytest.mark.parametrize("face_sources", [False, True])
@pytest.mark.parametrize("dim", [2, 3])
def test_sizes_around_folds_are_between_their_bounds(dim, face_sources):
    for seed in range(N_MESHES):
        mesh, h0, rng = with_a_moved_node(dim, seed)
        assert_between_bounds(mesh, h0, rng.choice([0.0, 0.01, 0.3, 1.0]), face_sources)


def test_a_mesh_of_flat_cells_only():
    mesh = SimplexMesh(np.zeros((3, 2)), [[0, 1, 2]])
    assert limit_gradient(mesh, [1.0, np.inf, np.inf], 0.3).tolist() == [1.0, 1.0, 1.0]
