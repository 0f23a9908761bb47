"""`limit_gradient(periodic=)`: the same sizes as on the domain surrounded by its images."""

from itertools import product

import numpy as np
import pytest
from meshes import structured_square
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay
from shapes import moved

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, limit_gradient
from adaptsize.limiting import FastMarching

G = 0.3
SQUARE = np.eye(2)


def unit_square(n):
    return moved(structured_square(n, half_width=0.5), 0.5)


def unit_cube(n, seed):
    mesh = CartesianGrid([0, 0, 0], 1.0 / n, (n + 1,) * 3).mesh
    inside = ((mesh.points > 1e-9) & (mesh.points < 1 - 1e-9)).all(axis=1)
    move = np.random.default_rng(seed).uniform(-0.1, 0.1, mesh.points.shape) / n
    return SimplexMesh(mesh.points + np.where(inside[:, None], move, 0.0), mesh.cells)


def tiled(mesh, vectors, reach=1):
    """The mesh and its images as one mesh, the cell first; and the node of the cell for each."""
    shifts = [np.array(s) @ vectors for s in product(range(-reach, reach + 1), repeat=len(vectors))]
    shifts.sort(key=lambda shift: float(np.linalg.norm(shift)))
    points = np.concatenate([mesh.points + shift for shift in shifts])
    cells = np.concatenate([mesh.cells + k * mesh.n_points for k in range(len(shifts))])
    _, first, number = np.unique(points.round(9), axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(first), int)
    rank[np.argsort(first)] = np.arange(len(first))
    new = rank[number.ravel()]
    merged = SimplexMesh(points[np.sort(first)], new[cells])
    return merged, new.reshape(len(shifts), mesh.n_points)


def on_tiles(mesh, vectors, h0, g=G, **options):
    """Slow twin: the sizes in the cell, computed on all tiles; exact to two translations."""
    big, numbers = tiled(mesh, vectors, reach=2 if mesh.dim == 2 else 1)
    bound = np.full(big.n_points, np.inf)
    for of_tile in numbers:
        np.minimum.at(bound, of_tile, h0)
    if np.ndim(g):
        g = np.tile(g, len(numbers))
    return limit_gradient(big, bound, g, **options)[numbers[0]]


def sparse_bounds(n, seed, share=0.03):
    rng = np.random.default_rng(seed)
    h0 = np.where(rng.random(n) < share, rng.uniform(0.01, 0.1, n), np.inf)
    h0[rng.integers(n)] = 0.02
    return h0


def hexagon(n):
    """A regular hexagon of side 1, as 6 n^2 triangles, and two vectors of its lattice."""
    i, j = np.indices((2 * n + 1, 2 * n + 1)).reshape(2, -1) - n
    corners = np.array([[np.cos(a), np.sin(a)] for a in np.arange(3) * np.pi / 3])
    points = (np.column_stack([i, j])[np.abs(i - j) <= n] / n) @ corners[[0, 2]]
    return SimplexMesh(points, Delaunay(points).simplices), corners[:2] + corners[1:]


PLANE = {
    "square": (unit_square(8), SQUARE),
    "one direction": (unit_square(8), SQUARE[:1]),
    "other direction": (unit_square(8), -SQUARE[1:]),
    "hexagon": hexagon(4),
    "sheared": (
        SimplexMesh(unit_square(6).points @ [[1, 0], [0.5, 1]], unit_square(6).cells),
        np.array([[1.0, 0.0], [0.5, 1.0]]),
    ),
}


@pytest.mark.parametrize("case", PLANE)
@pytest.mark.parametrize("method", ["exact", "fast-marching"])
@pytest.mark.parametrize("seed", [8101, 8102])
def test_sizes_are_those_among_all_images(case, method, seed):
    mesh, vectors = PLANE[case]
    h0 = sparse_bounds(mesh.n_points, seed)
    h = limit_gradient(mesh, h0, G, method=method, periodic=vectors)
    assert_allclose(h, on_tiles(mesh, vectors, h0, method=method), rtol=1e-12)
    assert (h < limit_gradient(mesh, h0, G, method=method) - 1e-9).any()


@pytest.mark.parametrize("method", ["exact", "fast-marching"])
@pytest.mark.parametrize("k", [1, 3])
def test_in_space(method, k):
    mesh = unit_cube(3, 8103)
    vectors = np.eye(3)[:k]
    h0 = sparse_bounds(mesh.n_points, 8104)
    h = limit_gradient(mesh, h0, G, method=method, periodic=vectors)
    assert_allclose(h, on_tiles(mesh, vectors, h0, method=method), rtol=1e-12)


def test_a_limit_that_jumps_between_cells_marches_through_the_sides():
    mesh = unit_square(8)
    g = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 0] < 0.5, 0.1, 0.5)
    h0 = sparse_bounds(mesh.n_points, 8105)
    h = limit_gradient(mesh, h0, g, periodic=SQUARE)
    assert_allclose(h, on_tiles(mesh, SQUARE, h0, g), rtol=1e-12)


@pytest.mark.parametrize("method", ["exact", "fast-marching"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_on_a_grid(method, dim):
    grid = CartesianGrid(np.zeros(dim), 0.25, (5,) * dim)
    h0 = sparse_bounds(5**dim, 8106).reshape(grid.shape)
    vectors = np.eye(dim)
    h = limit_gradient(grid, h0, G, method=method, periodic=vectors)
    wide = CartesianGrid(np.full(dim, -1.0), 0.25, (13,) * dim)
    bound = np.full(wide.shape, np.inf)
    for shift in product((0, 4, 8), repeat=dim):
        part = bound[tuple(slice(s, s + 5) for s in shift)]
        np.minimum(part, h0, out=part)
    expected = limit_gradient(wide, bound, G, method=method)[(slice(4, 9),) * dim]
    assert_allclose(h, expected, rtol=1e-12)


def test_a_hole_is_gone_around_through_the_sides():
    full = unit_square(9)
    middle = full.points[full.cells].mean(axis=1)
    kept = ~(np.abs(middle - 0.5) < 0.2).all(axis=1)
    used, cells = np.unique(full.cells[kept], return_inverse=True)
    mesh = SimplexMesh(full.points[used], cells.reshape(-1, 3))
    h0 = sparse_bounds(mesh.n_points, 8107)
    h = limit_gradient(mesh, h0, G, periodic=SQUARE)
    expected = on_tiles(mesh, SQUARE, h0, method="fast-marching")
    assert_allclose(h, expected, rtol=1e-12)
    with pytest.raises(ValueError, match=r"method='exact' needs a convex cell"):
        limit_gradient(mesh, h0, G, periodic=SQUARE, method="exact")


def test_sizes_between_nodes_know_the_images():
    mesh = unit_square(6)
    h0 = sparse_bounds(mesh.n_points, 8108)
    h, info = limit_gradient.with_info(mesh, h0, G, periodic=SQUARE)
    size = SizeFunction(mesh, h, sources=info.sources)
    big, numbers = tiled(mesh, SQUARE, reach=2)
    bound = np.full(big.n_points, np.inf)
    for of_tile in numbers:
        np.minimum.at(bound, of_tile, h0)
    among, of_all = limit_gradient.with_info(big, bound, G)
    x = np.random.default_rng(8109).random((50, 2))
    expected = SizeFunction(big, among, sources=of_all.sources)(x)
    assert_allclose(size(x), expected, rtol=1e-12)
    assert set(info.sources.roots()) <= set(np.flatnonzero(np.isfinite(h0)))


def test_g_of_h_and_point_sources_are_periodic_too():
    grid = CartesianGrid([0, 0], 0.1, (11, 11))
    free = np.full(grid.shape, np.inf)
    at = ([[0.03, 0.5]], [0.05])
    h = limit_gradient(grid, free, G, point_sources=at, periodic=SQUARE)
    dx = np.abs(grid.points[:, 0] - 0.03)
    away = np.hypot(np.minimum(dx, 1 - dx), np.abs(grid.points[:, 1] - 0.5))
    assert_allclose(h.ravel(), 0.05 + G * away, rtol=1e-13)
    of_h = limit_gradient(grid, free, lambda h: 2.0 * h, point_sources=at, periodic=SQUARE)
    assert_allclose(of_h.ravel(), 0.05 * np.exp(2.0 * away), rtol=1e-8)


def sector(n_sectors, rings=8, inner=0.0):
    """A sector of a ring or a disc, moved off the origin, and its rotation [R | t]."""
    angle = 2 * np.pi / n_sectors
    radius = np.linspace(inner, 1.0, rings + 1)
    turn = np.linspace(0.0, angle, rings + 1)
    at = np.stack(np.meshgrid(radius, turn, indexing="ij"), axis=-1).reshape(-1, 2)
    corner = (np.arange(rings)[:, None] * (rings + 1) + np.arange(rings)).ravel()
    cells = np.concatenate([corner[:, None] + [0, rings + 1, rings + 2],
                            corner[:, None] + [0, rings + 2, 1]])  # fmt: skip
    centre = np.array([0.3, -0.2])
    points = centre + at[:, :1] * np.column_stack([np.cos(at[:, 1]), np.sin(at[:, 1])])
    if inner == 0.0:  # one node at the centre
        cells = np.where(cells <= rings, 0, cells - rings)
        cells = cells[[len(set(cell)) == 3 for cell in cells.tolist()]]
        points = points[rings:]
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.array([[c, -s], [s, c]])
    return SimplexMesh(points, cells), np.column_stack([matrix, centre - matrix @ centre])


@pytest.mark.parametrize(("n_sectors", "inner"), [(4, 0.0), (6, 0.5)])
def test_a_sector_gets_the_sizes_of_the_whole_disc_or_ring(n_sectors, inner):
    mesh, rotation = sector(n_sectors, inner=inner)
    h0 = sparse_bounds(mesh.n_points, 9)
    points, moved = [mesh.points], mesh.points
    for _ in range(n_sectors - 1):
        moved = moved @ rotation[:, :2].T + rotation[:, 2]
        points.append(moved)
    every = np.concatenate(points)
    _, first, number = np.unique(every.round(9), axis=0, return_index=True, return_inverse=True)
    cells = np.concatenate([mesh.cells + k * mesh.n_points for k in range(n_sectors)])
    whole = SimplexMesh(every[first], number.ravel()[cells])
    bound = np.full(whole.n_points, np.inf)
    np.minimum.at(bound, number.ravel(), np.tile(h0, n_sectors))
    expected = limit_gradient(whole, bound, G, method="fast-marching")
    found = limit_gradient(mesh, h0, G, periodic=rotation[None])
    assert_allclose(found, expected[number.ravel()[: mesh.n_points]], rtol=1e-10)


def test_a_quarter_of_a_box_in_space_gets_the_sizes_of_the_whole_box():
    quarter, whole = (
        CartesianGrid([0, 0, 0], 0.2, (6, 6, 4)),
        CartesianGrid([-1, -1, 0], 0.2, (11, 11, 4)),
    )
    h0 = sparse_bounds(quarter.n_points, 4).reshape(quarter.shape)
    bound = np.full(whole.shape, np.inf)
    for turns in range(4):  # about the z axis
        part = np.rot90(bound, turns)[5:, 5:]
        np.minimum(part, h0, out=part)
    turn = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    expected = limit_gradient(whole, bound, G, method="fast-marching")[5:, 5:]
    assert_allclose(limit_gradient(quarter, h0, G, periodic=[turn]), expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m * 1.1, r"periodic must be \[R \| t\], R a rotation"),
        (lambda m: [[1, 0, 0], [0, 1, 0]], "must not be the identity"),
        (lambda m: [[-1, 0, 0.6], [0, -1, -0.4]], "maps no node of the background"),
        (lambda m: [[1, 0], [0, 1]], r"rotations \[R \| t\] have shape \(k, 2, 3\)"),
        (lambda m: np.full((2, 3), np.nan), "must be finite"),
    ],
)
def test_motions_that_are_no_rotations_of_the_domain_are_refused(change, message):
    mesh, rotation = sector(8, inner=0.5)
    with pytest.raises(ValueError, match=message):
        limit_gradient(mesh, np.ones(mesh.n_points), G, periodic=[change(rotation)])


@pytest.mark.parametrize(
    ("vectors", "message"),
    [
        (
            [1.0, 0.0],
            r"periodic must hold 1 to 2 translations, of shape \(k, 2\), got shape \(2,\)",
        ),
        (np.ones((3, 2)), r"must hold 1 to 2 translations"),
        ([[np.nan, 1.0]], r"periodic must be finite"),
        ([[1.0, 0.0], [2.0, 0.0]], r"linearly independent"),
        ([[1.5, 0.0]], r"periodic\[0\] = \[1.5, 0.0\] maps no node"),
        ([[0.5, 0.0]], r"overlaps its image"),
        ([[0.9, 0.0]], r"moved by \[0\.9, 0\.0\] lies in the domain, where there is no node"),
    ],
)
def test_translations_that_do_not_fit_are_refused(vectors, message):
    mesh = unit_square(4)
    for background in (mesh, CartesianGrid([0, 0], 0.25, (5, 5))):
        with pytest.raises(ValueError, match=message):
            limit_gradient(background, 1.0, G, periodic=vectors)


def test_other_options_are_refused():
    grid = CartesianGrid([0, 0], 0.25, (5, 5))
    for options in ({"initial": 1.0}, {"method": FastMarching(order=2)}):
        with pytest.raises(ValueError, match="periodic cannot be combined"):
            limit_gradient(grid, 1.0, G, periodic=SQUARE, **options)
    with pytest.raises(ValueError, match="periodic is for method='exact' or 'fast-marching'"):
        limit_gradient(grid, 1.0, G, method="edge-based", periodic=SQUARE)
