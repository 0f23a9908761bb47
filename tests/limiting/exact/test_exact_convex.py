"""Exact limiting of nodal bounds in convex domains: formula (11) of Persson (2006), bit by bit.

The reference is the formula itself, over all pairs of nodes.
"""

import os

import numpy as np
import pytest
from exact_oracle import straight_sizes
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_square
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from adaptsize import CartesianGrid, Octree, SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

METHOD = "exact"
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


# --- random problems ---------------------------------------------------------------------


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


@given(st.sampled_from(KINDS), st.sampled_from(BOUNDS), st.integers(0, 2**32 - 1))
def test_sizes_are_those_of_the_formula(kind, bounds, seed):
    rng = np.random.default_rng(seed)
    background = random_background(kind, rng)
    h0 = random_bounds(bounds, background.points, rng).reshape(background.nodal_shape)
    for g in (0.0, 0.3):
        assert_exact(background, h0, g)


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


# --- special bounds and nodes --------------------------------------------------------------


def test_equal_bounds_and_linear_ones_within_the_limit_stay_bit_by_bit():
    mesh = random_square(500, 2108)
    assert (limit(mesh, np.full(500, 0.7), G) == 0.7).all()
    h0 = 3.0 + 0.5 * G * mesh.points @ [0.6, 0.8]
    assert np.array_equal(limit(mesh, h0, G), h0)


def merged(mesh, seed, count):
    """Move inner nodes onto neighbours where that folds no cell: nodes at one place, flat cells."""
    rng = np.random.default_rng(seed)
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(mesh.n_points), mesh.boundary().nodes)
    sign = np.sign(mesh.signed_measures)
    for i in rng.permutation(inner):
        around = (mesh.cells == i).any(axis=1)
        for j in rng.permutation(np.unique(mesh.cells[around])):
            trial = points.copy()
            trial[i] = points[j]
            measures = SimplexMesh(trial, mesh.cells).signed_measures[around] * sign[around]
            if (
                i != j
                and (measures >= -1e-9).all()
                and (points == points[j]).all(axis=1).sum() == 1
            ):
                points = trial
                count -= 1
                break
        if count == 0:
            break
    assert count == 0
    return SimplexMesh(points, mesh.cells)


@pytest.mark.parametrize("bounds", ["few", "noise", "ties"])
def test_several_nodes_may_be_at_one_place(bounds):
    for seed in range(2111, 2116):
        for mesh in (jittered_square(7, seed), jittered_cube(4, seed)):
            doubled = merged(mesh, seed, 3)
            h0 = random_bounds(bounds, doubled.points, np.random.default_rng(seed))
            assert_exact(doubled, h0, G)


# --- what must not matter ------------------------------------------------------------------


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


def test_cells_do_not_matter_to_the_last_bit():
    mesh = random_square(1000, 2123)
    h0 = random_bounds("field", mesh.points, np.random.default_rng(2124))
    h = limit(mesh, h0, G)
    assert np.array_equal(limit(SimplexMesh(mesh.points, mesh.cells[::-1]), h0, G), h)
    stretched = SimplexMesh(mesh.points, Delaunay(mesh.points * [1.0, 3.0]).simplices)
    assert np.array_equal(limit(stretched, h0, G), h)


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


def test_every_node_of_a_convex_domain_is_proved():
    for mesh in (random_square(500, 2126), jittered_cube(6, 2127)):
        h0 = random_bounds("noise", mesh.points, np.random.default_rng(2128))
        h, info = limit_gradient.with_info(mesh, h0, G, method=Exact(face_sources=False))
        assert np.array_equal(h, limit(mesh, h0, G))
        assert info.n_proved == mesh.n_points
        assert info.largest_gap == 0.0
