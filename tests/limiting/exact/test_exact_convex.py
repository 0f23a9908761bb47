"""Exact limiting of nodal bounds in convex domains: formula (11) of Persson (2006), bit by bit.

The reference is the formula itself, over all pairs of nodes.
"""

import os

import numpy as np
import pytest
from exact_oracle import straight_sizes
from meshes import jittered_cube, jittered_square, random_square
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from adaptsize import CartesianGrid, Octree, SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

G = 0.3

#: Small problems tried in one test; 10 000 take a minute.
N_PROBLEMS = int(os.environ.get("ADAPTSIZE_PROBLEMS", "1000"))

KINDS = ["segments", "triangles", "tetrahedra", "1-D grid", "2-D grid", "3-D grid"]
BOUNDS = ["few", "noise", "field", "ties", "one"]


def limit(background, h0, g):
    return limit_gradient(background, h0, g, method=Exact(face_sources=False))


def assert_exact(background, h0, g):
    h = limit(background, h0, g)
    exact = straight_sizes(background.points, h0.ravel(), g)
    assert h.shape == h0.shape
    assert_allclose(h.ravel(), exact, rtol=1e-13)
    return h


def random_background(kind, rng):
    scale, shift = 10.0 ** rng.uniform(-3.0, 3.0), rng.choice([0.0, 1.0, -7.0])
    if kind.endswith("grid"):
        dim = int(kind[0])
        shape = rng.integers(2, (40, 9, 5)[dim - 1], dim)
        spacing = scale * 10.0 ** rng.uniform(-1.0, 0.0, dim)
        return CartesianGrid(np.full(dim, scale * shift), spacing, tuple(map(int, shape)))
    dim = ["segments", "triangles", "tetrahedra"].index(kind) + 1
    points = rng.random((int(rng.integers(dim + 2, 50)), dim))
    if dim == 1:
        if rng.random() < 0.3:
            points = np.round(8.0 * points) / 8.0  # several nodes at one place
        order = np.argsort(points[:, 0], kind="stable")
        cells = np.column_stack([order[:-1], order[1:]])
    else:
        cells = Delaunay(points).simplices
        points = points * 10.0 ** rng.uniform(-0.5, 0.5, dim)  # stretched: stays convex
    return SimplexMesh(scale * (points + shift), cells)


def random_bounds(kind, points, rng):
    """Return bounds whose differences are of the order of those of the limited sizes."""
    n, extent = len(points), float(np.ptp(points, axis=0).max())
    h0 = extent * rng.uniform(0.05, 1.0, n)
    if kind == "field":
        waves = rng.normal(size=(points.shape[1], 3)) * 12.0 / extent
        h0 = extent * (0.4 + 0.1 * np.sin((points - points[0]) @ waves).sum(axis=1))
    elif kind == "ties":
        h0 = extent * rng.choice([0.125, 0.25, 0.5], n)
    elif kind in ("few", "one"):
        h0[rng.random(n) < (0.8 if kind == "few" else 1.0)] = np.inf
        h0[rng.integers(n)] = 0.1 * extent
    return h0


def random_problem(seed):
    rng = np.random.default_rng(seed)
    background = random_background(rng.choice(KINDS), rng)
    h0 = random_bounds(rng.choice(BOUNDS), background.points, rng)
    g = rng.choice([0.0, 0.05, 0.3, 1.0, 3.0])
    return background, h0.reshape(background.nodal_shape), g


def test_sizes_of_many_small_problems_are_those_of_the_formula():
    for seed in range(N_PROBLEMS):
        assert_exact(*random_problem(seed))


def quadtree():
    return Octree.build([0, 0], [1, 1], lambda x, a: x[:, 0] < 0.3, max_level=2, root_shape=(9, 8))


@pytest.mark.parametrize("bounds", BOUNDS)
@pytest.mark.parametrize(
    "make",
    [
        lambda: random_square(3000, 2101),
        lambda: jittered_square(55, 2102),
        lambda: jittered_cube(12, 2103),
        lambda: CartesianGrid([0.0, 0.0], [1.0, 0.3], (60, 50)),
        lambda: CartesianGrid([1.0, 0.0, 0.0], [0.3, 0.3, 1.0], (14, 15, 13)),
        quadtree,
    ],
    ids=["random", "jittered", "tetrahedra", "grid", "grid in space", "quadtree"],
)  # fmt: skip
def test_sizes_of_larger_problems_are_those_of_the_formula(make, bounds):
    background = make()
    h0 = random_bounds(bounds, background.points, np.random.default_rng(2104))
    h = assert_exact(background, h0.reshape(background.nodal_shape), G)
    assert 0 < (h.ravel() < h0).sum() < h.size


def renumbered(mesh, seed):
    """Return the mesh with nodes, cells and the nodes of each cell in other orders."""
    rng = np.random.default_rng(seed)
    old_of_new = rng.permutation(mesh.n_points)
    new_of_old = np.argsort(old_of_new)
    cells = rng.permuted(new_of_old[rng.permutation(mesh.cells)], axis=1)
    return SimplexMesh(mesh.points[old_of_new], cells), old_of_new


MESHES = {
    "triangles": lambda: random_square(4000, 2117),
    "tetrahedra": lambda: jittered_cube(13, 2118),
    "small": lambda: random_square(60, 2119),
}


@pytest.mark.parametrize("bounds", BOUNDS)
@pytest.mark.parametrize("name", MESHES)
def test_numbering_does_not_matter_to_the_last_bit(name, bounds):
    mesh = MESHES[name]()
    h0 = random_bounds(bounds, mesh.points, np.random.default_rng(2120))
    h = limit(mesh, h0, G)
    for seed in (2121, 2122):
        other, old_of_new = renumbered(mesh, seed)
        assert np.array_equal(limit(other, h0[old_of_new], G), h[old_of_new])


@pytest.mark.parametrize("face_sources", [False, True])
@pytest.mark.parametrize("name", [*MESHES, "grid"])
def test_the_number_of_threads_does_not_matter_to_the_last_bit(name, face_sources):
    grid = CartesianGrid([0.0, 0.0, 0.0], [1.0, 2.0, 0.5], (15, 16, 17))
    background = grid if name == "grid" else MESHES[name]()
    rng = np.random.default_rng(2125)
    for bounds in ("few", "field", "noise"):
        h0 = random_bounds(bounds, background.points, rng).reshape(background.nodal_shape)
        h = [
            limit_gradient(background, h0, G, method=Exact(face_sources, threads))
            for threads in (1, 2, 3, None)
        ]
        assert all(np.array_equal(h[0], other) for other in h[1:])
