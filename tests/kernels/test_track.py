"""Kernels of source tracking: neighbours, boundary chain, sight."""

import numpy as np
import pytest

from adaptsize import SimplexMesh
from adaptsize._kernels.boundary import sum_facets
from adaptsize.limiting.domain import (
    clearance_of,
    creases_of,
    flat_boundary,
    is_convex,
    pieces_of,
    turns_of,
)
from adaptsize.limiting.source_tracking import _NO_OBSTACLES, _surroundings
from domains import slit_square, star_holes, wall_box
from meshes import jittered_cube, jittered_square, random_square, structured_square


def convex(mesh):
    boundary = flat_boundary(mesh)
    return is_convex(mesh.points, boundary, turns_of(mesh.points, boundary))


def without(mesh, *cells):
    return SimplexMesh(mesh.points, np.delete(mesh.cells, cells, axis=0))


def kuhn_cube(n):
    """n^3 cubes of edge 1, each cut in six tetrahedra around its diagonal."""
    node = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    points = np.stack(np.meshgrid(*[np.arange(n + 1.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    cells = []
    for way in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        corner = np.zeros(3, int)
        path = [node[:-1, :-1, :-1].ravel()]
        for axis in way:
            corner[axis] = 1
            x, y, z = corner
            path.append(node[x : n + x, y : n + y, z : n + z].ravel())
        cells.append(np.column_stack(path))
    return SimplexMesh(points, np.concatenate(cells))


@pytest.mark.parametrize("make", [lambda: random_square(200, 901), lambda: jittered_cube(5, 902)])
def test_neighbours_are_the_other_ends_of_the_edges(make):
    mesh = make()
    near = _surroundings(mesh, False, _NO_OBSTACLES)
    found = {
        (i, int(j))
        for i in range(mesh.n_points)
        for j in near.nbr[near.nbr_ptr[i] : near.nbr_ptr[i + 1]]
    }
    assert near.nbr_ptr[-1] == len(found) == 2 * len(mesh.edges)
    assert found == {(i, j) for a, b in mesh.edges.tolist() for i, j in ((a, b), (b, a))}


@pytest.mark.parametrize("make", [lambda: random_square(300, 903), lambda: kuhn_cube(3)])
def test_chain_is_the_facets_of_one_cell_whatever_the_orientation(make):
    mesh = make()
    rng = np.random.default_rng(904)
    cells = rng.permuted(np.delete(mesh.cells, [3, 40, 41], axis=0), axis=1)
    mesh = SimplexMesh(mesh.points, cells)
    boundary = flat_boundary(mesh)
    expected = mesh.facets[mesh.facet_cell_counts == 1]
    assert sorted(np.sort(boundary.facets, axis=1).tolist()) == expected.tolist()
    assert boundary.is_simple
    sums = np.zeros(mesh.n_points, np.uint64)
    sum_facets(mesh.points, (0,) * mesh.dim, mesh.cells, sums)
    assert set(np.flatnonzero(sums)) == set(expected.ravel().tolist())
    # Outward normals, the domain to the left: Gauss' formula gives its measure.
    corners = mesh.points[boundary.facets]
    measure = np.linalg.det(corners).sum() / (2.0 if mesh.dim == 2 else 6.0)
    assert measure == pytest.approx(mesh.measures.sum(), rel=1e-12)


def test_convex_domains_are_recognised():
    hexagon = np.array([[np.cos(a), np.sin(a)] for a in np.arange(6) * np.pi / 3.0])
    fan = [[6, i, (i + 1) % 6] for i in range(6)]
    for mesh in (
        random_square(300, 905),
        structured_square(5),
        jittered_square(9, 906),
        SimplexMesh(np.vstack([hexagon, [[0.1, 0.2]]]), fan),
        kuhn_cube(3),
    ):
        assert convex(mesh)


def test_what_is_not_convex_is_recognised():
    square, cube = structured_square(4), kuhn_cube(3)
    middle = int(np.argmin(np.abs(cube.points[cube.cells].mean(axis=1) - 1.5).sum(axis=1)))
    apart = square.points + np.array([200.0, 0.0])
    two = SimplexMesh(
        np.vstack([square.points, apart]), np.vstack([square.cells, square.cells + 25])
    )
    # A crack: the middle node is there twice, once for each side.
    crack = square.cells.copy()
    points = np.vstack([square.points, square.points[12:13]])
    upper = square.points[crack].mean(axis=1)[:, 1] > 0.0
    crack[upper] = np.where(crack[upper] == 12, 25, crack[upper])
    fold = SimplexMesh([[0, 0], [1, 0], [0, 1], [0.2, 0.1]], [[0, 1, 2], [0, 3, 1]])
    twice = SimplexMesh(square.points, np.vstack([square.cells, square.cells[:1]]))
    for mesh in (
        without(square, 0),
        without(square, 9),
        two,
        SimplexMesh(points, crack),
        fold,
        twice,
        without(cube, 0),
        without(cube, middle),
    ):
        assert not convex(mesh)


def test_pieces_are_cut_at_reflex_corners_and_creases_are_reflex_edges():
    mesh = structured_square(4)
    x, y = mesh.points[mesh.cells].mean(axis=1).T
    ell = SimplexMesh(mesh.points, mesh.cells[(x < 0.0) | (y < 0.0)])
    boundary = flat_boundary(ell)
    turns = turns_of(ell.points, boundary)
    corner = int(np.argmin(np.abs(ell.points).sum(axis=1)))
    piece = pieces_of(ell.n_points, boundary, turns)
    on_boundary = np.unique(boundary.facets)
    assert piece[corner] == -1
    assert set(piece[on_boundary[on_boundary != corner]]) == {0}
    assert turns.angles.sum() == pytest.approx(2.0 * np.pi)

    cube = kuhn_cube(2)
    x, y, _ = cube.points[cube.cells].mean(axis=1).T
    ell = SimplexMesh(cube.points, cube.cells[(x < 1.0) | (y < 1.0)])
    first, other = creases_of(ell.n_points, turns_of(ell.points, flat_boundary(ell)))
    ends = np.repeat(np.arange(ell.n_points), np.diff(first))
    assert sorted(ell.points[np.column_stack([ends, other])][:, :, :2].ravel()) == [1.0] * 16
    assert len(other) == 4  # two edges, told at both ends


def distance_from_rings(rings, points):
    a = np.concatenate(rings)
    e = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) - a
    w = points[:, None] - a
    t = np.clip((w * e).sum(axis=2) / (e * e).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(w - t[..., None] * e, axis=2).min(axis=1)


@pytest.mark.parametrize("make", [slit_square, star_holes, wall_box])
def test_clearance_is_a_lower_bound_of_the_distance_from_the_boundary(make):
    mesh, rings = make(4000, seed=907)
    facets = flat_boundary(mesh).facets
    exact = distance_from_rings(rings, mesh.points[:, :2])
    if mesh.dim == 3:
        exact = np.minimum(exact, 50.0 - np.abs(mesh.points[:, 2]))
    clearance = clearance_of(mesh.points, facets)
    assert (clearance <= exact + 1e-12).all()
    # The grid has n/4 cells of side s; s (1 + 1) sqrt(d) + 2 rho bounds what is given away.
    side = (1e2**mesh.dim * 4.0 / mesh.n_points) ** (1.0 / mesh.dim)
    given_away = side * (2.0 * np.sqrt(mesh.dim) + (1.0 if mesh.dim == 2 else 2.0 / np.sqrt(3.0)))
    assert (clearance >= np.maximum(exact - given_away, 0.0) - 1e-9).all()
    assert clearance.max() > 0.1 * exact.max()
    # One long facet is cut in parts: the bound holds between its ends as well.
    triangle = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]])
    inside = np.random.default_rng(908).dirichlet([1.0, 1.0, 1.0], 4000) @ triangle
    bound = clearance_of(np.vstack([triangle, inside]), np.array([[0, 1], [1, 2], [2, 0]]))[3:]
    assert (bound <= distance_from_rings([triangle], inside)).all()
    assert bound.max() > 1.0


def test_clearance_of_what_has_no_extent_is_zero():
    assert (clearance_of(np.zeros((3, 2)), np.array([[0, 1], [1, 2], [2, 0]])) == 0.0).all()
    flat = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    assert (clearance_of(flat, np.array([[0, 1], [1, 2], [2, 0]])) == 0.0).all()
