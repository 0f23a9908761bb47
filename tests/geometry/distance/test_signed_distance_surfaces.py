"""Signed distance to triangles in space and segments in the plane, clean and dirty."""

import numpy as np
import pytest
from curved_shapes import part_of, smooth_torus
from distance_shapes import box
from meshes import jittered_cube, jittered_square, random_sphere
from numpy.testing import assert_allclose, assert_array_equal
from shapes import joined, moved
from solids import inside_out

from adaptsize import CartesianGrid, Octree, SimplexMesh, signed_distance

to_box = box(2.0, 2.0, 2.0)
BOX = CartesianGrid([-1, -1, -1], 2.0, (2, 2, 2)).mesh.boundary().mesh
INWARD_AND_OUTWARD = pytest.mark.parametrize("turned", [False, True], ids=["outward", "inward"])


def rotation(seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q


def torus(n=24):
    return smooth_torus(n)[0]


def grid_around(mesh, n, margin=0.3):
    spacing = (np.ptp(mesh.points, axis=0).max() + 2.0 * margin) / n
    return CartesianGrid.around(mesh.points, spacing, margin=margin)


@INWARD_AND_OUTWARD
def test_box_of_few_large_slanting_triangles(turned):
    q = rotation(731)
    surface = SimplexMesh(BOX.points @ q, BOX.cells)
    grid = CartesianGrid([-2.2, -2.1, -2.3], [0.15, 0.17, 0.2], (30, 26, 24))
    phi = signed_distance(grid, inside_out(surface) if turned else surface)
    # On flat faces no two facets compete at a distance: all is exact, also beyond the band.
    assert_allclose(phi, to_box(grid.points @ q.T).reshape(grid.shape), atol=1e-12)


@pytest.mark.parametrize("share", [1.0, 0.5], ids=["around the surface", "inside its box"])
def test_exact_in_the_band_and_never_too_small_beyond(share):
    surface = torus()
    h = float(grid_around(surface, 40).spacing.max())
    grid = CartesianGrid.around(share * surface.points, h, margin=0.3 * share)
    exact = signed_distance(grid, surface, band=np.inf)
    phi = signed_distance(grid, surface)
    near = np.abs(exact) <= 3.0 * h
    assert 0.1 < near.mean() < 0.9
    assert_allclose(phi[near], exact[near], atol=1e-14)
    assert_array_equal(phi < 0.0, exact < 0.0)
    excess = np.abs(phi) - np.abs(exact)
    assert excess.min() > -1e-13
    # The centre of the tube is equally far from facets all around, and there the nearest ones
    # are missed by an edge or two, here of 0.1, at a distance of 0.4.
    assert excess.max() < 0.3 * h
    assert excess.mean() < 0.002 * h


def dirty(kind):
    """The torus with dirt that leaves no hole wider than 1e-6."""
    rng = np.random.default_rng(5081)
    clean = torus()
    n = clean.n_cells
    soup = SimplexMesh(clean.points[clean.cells].reshape(-1, 3), np.arange(3 * n).reshape(n, 3))
    if kind == "repeated nodes":
        return soup
    if kind == "cracks":
        return SimplexMesh(soup.points + rng.uniform(-1e-6, 1e-6, soup.points.shape), soup.cells)
    if kind == "turned facets":
        cells = clean.cells.copy()
        some = rng.random(n) < 0.3
        cells[some] = cells[some][:, ::-1]
        return SimplexMesh(clean.points, cells)
    if kind == "doubled facets":
        return SimplexMesh(clean.points, np.concatenate([clean.cells, clean.cells]))
    if kind == "nodes of no facet":
        far = np.array([[1e30, 0.0, -1e30], [0.0, 3.0, 0.0]])
        return SimplexMesh(np.concatenate([soup.points, far]), soup.cells)
    # Facets without area along edges, their third corner a repeated node.
    ends = clean.edges[::9]
    points = np.concatenate([clean.points, clean.points[ends[:, 1]]])
    flat = np.column_stack([ends, clean.n_points + np.arange(len(ends))])
    return SimplexMesh(points, np.concatenate([clean.cells, flat]))


@pytest.mark.parametrize(
    "kind",
    [
        "repeated nodes",
        "cracks",
        "turned facets",
        "doubled facets",
        "nodes of no facet",
        "facets without area",
    ],
)
def test_dirt_changes_nothing(kind):
    clean = torus()
    grid = grid_around(clean, 24)
    phi, expected = signed_distance(grid, dirty(kind)), signed_distance(grid, clean)
    # Ties between facets are broken otherwise, and cracks stop walks over the surface.
    near = np.abs(expected) <= 3.0 * grid.spacing.max()
    assert_allclose(phi[near], expected[near], atol=2e-6)
    assert_array_equal(phi < 0.0, expected < 0.0)
    assert_allclose(phi, expected, atol=0.15 * grid.spacing.max())


def test_holes_change_signs_near_them_only():
    whole = torus()
    holes = np.array([[1.4, 0.0, 0.0], [-0.6, 0.0, 0.0], [0.0, -1.0, 0.4], [0.0, 1.0, -0.4]])

    def kept(x):
        return (np.linalg.norm(x[:, None] - holes, axis=2) > 0.12).all(axis=1)

    surface = part_of(whole, kept)[0]
    assert whole.n_cells - surface.n_cells > 20
    grid = grid_around(whole, 40)
    expected, phi = signed_distance(grid, whole), signed_distance(grid, surface)
    # 0.12 and one edge is their radius; a node as far away sees them under a small angle.
    far = (np.linalg.norm(grid.points[:, None] - holes, axis=2) > 0.25).all(axis=1)
    far = far.reshape(grid.shape) & (expected != 0.0)
    assert_array_equal(phi[far] < 0.0, expected[far] < 0.0)
    assert (phi[~far] < 0.0).any()
    # The spacing is well below the holes: a fill of connected nodes would run through.
    assert grid.spacing.max() < 0.09


def test_what_is_enclosed_twice_is_inside_and_a_cavity_is_not():
    one, other = random_sphere(300, 11), random_sphere(300, 12)
    aside, hole = moved(other, [0.7, 0.0, 0.0]), moved(other, 0.0, 0.5)
    both, shell = joined(one, aside), joined(one, inside_out(hole))
    grid = CartesianGrid([-1.31, -1.31, -1.31], 0.13, (29, 21, 21))
    to_one = signed_distance(grid, one)
    to_other = signed_distance(grid, aside)
    union = signed_distance(grid, both)
    assert_array_equal(union < 0.0, (to_one < 0.0) | (to_other < 0.0))
    to_hole = signed_distance(grid, hole)
    assert_array_equal(signed_distance(grid, shell) < 0.0, (to_one < 0.0) & (to_hole > 0.0))


def test_other_backgrounds_have_exact_distances():
    q = rotation(64)
    surface = SimplexMesh(0.7 * BOX.points @ q, BOX.cells)

    def exact(x):
        return 0.7 * to_box(x @ q.T / 0.7)

    def near(centres, sizes):
        return np.abs(exact(centres)) < sizes[:, 0]

    tree = Octree.build([-1.5] * 3, [1.5] * 3, near, max_level=4)
    mesh = jittered_cube(9, 5150, half_width=1.5)
    for background in (tree, mesh):
        phi = signed_distance(background, surface)
        assert_allclose(phi, exact(background.points), atol=1e-12)


def test_own_boundary_of_triangles_and_tetrahedra():
    for mesh in (jittered_square(15, 77, half_width=2.0), jittered_cube(7, 78, half_width=2.0)):
        phi = signed_distance(mesh)
        # Inside a cube the nearest side is the nearest in the sense of coordinates.
        assert_allclose(phi, np.abs(mesh.points).max(axis=1) - 2.0, atol=1e-12)
        nodes = mesh.boundary().nodes
        assert (phi[nodes] == 0.0).all()
        assert (np.delete(phi, nodes) < 0.0).all()
