"""Signed distance to triangles in space and segments in the plane, clean and dirty."""

import numpy as np
import pytest
import solid_shapes as solid
from curved_shapes import part_of, smooth_torus
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_sphere
from numpy.testing import assert_allclose, assert_array_equal
from planar_shapes import polygon as to_polygon
from solids import inside_out, outline
from width_oracle import closest_on_triangles

from adaptsize import CartesianGrid, Octree, SimplexMesh, signed_distance

to_box = solid.box(2.0, 2.0, 2.0)
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


def test_exact_in_the_band_and_never_too_small_beyond():
    surface = torus()
    grid = grid_around(surface, 40)
    h = grid.spacing.max()
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


def test_exact_distances_are_those_of_all_facets():
    surface = random_sphere(60, 914)
    grid = grid_around(surface, 8)
    phi = signed_distance(grid, surface, band=np.inf).ravel()
    # The twin of the width tries all facets, by other arithmetic.
    corners = surface.points[surface.cells]
    exact = [
        np.linalg.norm(closest_on_triangles(corners, x) - x, axis=1).min() for x in grid.points
    ]
    assert_allclose(np.abs(phi), exact, atol=1e-13)


def test_surface_that_reaches_out_of_the_grid_or_lies_outside():
    surface = BOX
    grid = CartesianGrid([-0.5, 0.1, 0.4], 0.1, (15, 8, 9))
    outside = CartesianGrid([3.0, 0.0, 2.5], 0.2, (4, 5, 6))
    for background in (grid, outside):
        exact = to_box(background.points).reshape(background.shape)
        assert_allclose(signed_distance(background, surface, band=1.0), exact, atol=1e-12)


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
    aside = np.add(other.points, [0.7, 0.0, 0.0])
    shifted = np.concatenate([one.points, aside])
    both = SimplexMesh(shifted, np.concatenate([one.cells, other.cells + one.n_points]))
    points = np.concatenate([one.points, 0.5 * other.points])
    inner = inside_out(other).cells + one.n_points
    shell = SimplexMesh(points, np.concatenate([one.cells, inner]))
    grid = CartesianGrid([-1.31, -1.31, -1.31], 0.13, (29, 21, 21))
    to_one = signed_distance(grid, one)
    to_other = signed_distance(grid, SimplexMesh(aside, other.cells))
    union = signed_distance(grid, both)
    assert_array_equal(union < 0.0, (to_one < 0.0) | (to_other < 0.0))
    to_hole = signed_distance(grid, SimplexMesh(0.5 * other.points, other.cells))
    assert_array_equal(signed_distance(grid, shell) < 0.0, (to_one < 0.0) & (to_hole > 0.0))


def test_open_sheet_encloses_nothing():
    plate = jittered_square(12, 808, half_width=1.0)
    sheet = SimplexMesh(np.column_stack([plate.points, np.zeros(plate.n_points)]), plate.cells)
    grid = CartesianGrid([-1.5, -1.5, -0.77], 0.11, (28, 28, 15))
    phi = signed_distance(grid, sheet)
    beyond = np.maximum(np.abs(grid.points[:, :2]) - 1.0, 0.0)
    exact = np.hypot(np.hypot(*beyond.T), grid.points[:, 2]).reshape(grid.shape)
    assert_allclose(phi, exact, atol=1e-12)


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


def test_own_boundary_with_a_hole_as_a_given_boundary():
    square = jittered_square(31, 79, half_width=1.0)
    middle = square.points[square.cells].mean(axis=1)
    ring = SimplexMesh(square.points, square.cells[np.hypot(*middle.T) > 0.4])
    used = np.unique(ring.cells)
    phi, given = signed_distance(ring), signed_distance(ring, ring.boundary().mesh)
    assert_allclose(np.abs(phi[used]), np.abs(given[used]), atol=1e-14)
    off = used[np.abs(phi[used]) > 1e-12]
    assert (given[off] < 0.0).all()


@st.composite
def polygons(draw):
    """Star-shaped polygons with spikes, their segments in any order and direction."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(3, 30))
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    points = rng.uniform(0.2, 1.0, n)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    cells = outline(points).cells.copy()
    turned = rng.random(n) < draw(st.sampled_from([0.0, 0.5, 1.0]))
    cells[turned] = cells[turned][:, ::-1]
    return points, SimplexMesh(points, cells[rng.permutation(n)])


@given(polygons())
@settings(max_examples=25)
def test_polygons_by_brute_force(polygon):
    points, mesh = polygon
    grid = CartesianGrid([-1.213, -1.207], 0.1017, (25, 25))
    phi, exact = signed_distance(grid, mesh, band=2.0).ravel(), to_polygon(points)(grid.points)
    near = np.abs(exact) <= 2.0 * 0.1017
    assert_allclose(np.abs(phi[near]), np.abs(exact[near]), atol=1e-12)
    assert (np.abs(phi) >= np.abs(exact) - 1e-12).all()
    assert (np.abs(phi) <= np.abs(exact) + 0.1017).all()
    clear = np.abs(exact) > 1e-9
    assert_array_equal(phi[clear] < 0.0, exact[clear] < 0.0)
