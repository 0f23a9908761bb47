"""Exact limiting of bounds that count as linear on edges and faces (``face_sources=True``).

References: every edge as a source in closed form (`geodesics`), or samples that cut edges and faces
in 8.  Samples are sources that exist, so that no size is above theirs; how far it may be
below them follows from the curvature of the distance.
"""

from itertools import combinations, product

import domains
import numpy as np
import pytest
from exact_oracle import plane_domain, plane_sizes, refined_triangles
from geodesics import limited_sizes, line_sizes
from meshes import jittered_cube, jittered_square, random_cube, random_square, slit_square
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull, Delaunay

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

METHOD = "exact"
G = 0.3
PARTS = 8

#: Minima on edges in closed form on both sides; sizes are up to 30.
TOLERANCE = 1e-9


def limit(mesh, h0, face_sources=True):
    return limit_gradient(mesh, h0, G, method=Exact(face_sources))


def square_rings(half_width=50.0):
    return (half_width * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float),)


def bounds(kind, mesh, seed):
    """Return smooth bounds with slopes around g everywhere, or rough ones at some nodes."""
    rng = np.random.default_rng(seed)
    extent = np.ptp(mesh.points, axis=0).max()
    if kind == "field":
        waves = rng.normal(size=(mesh.dim, 3)) * 9.0 / extent
        return extent * (0.2 + 0.03 * np.sin(mesh.points @ waves).sum(axis=1))
    h0 = extent * rng.uniform(0.01, 0.05 if kind == "patches" else 0.3, mesh.n_points)
    if kind == "patches":  # balls in which nodes, edges and faces are bounded
        centres = mesh.points[rng.choice(mesh.n_points, 4)]
        away = np.linalg.norm(mesh.points[:, None] - centres, axis=2).min(axis=1)
        h0[away > (0.15 if mesh.dim == 2 else 0.25) * extent] = np.inf
    return h0


def of_edges(mesh, h0, rings, nodes):
    """Return the exact sizes at some nodes: all nodes and edges with finite ends are sources."""
    finite = np.flatnonzero(np.isfinite(h0))
    edges = mesh.edges[np.isfinite(h0[mesh.edges]).all(axis=1)]
    return limited_sizes(
        rings, mesh.points[nodes], G, mesh.points[finite], h0[finite],
        segments=mesh.points[edges], segment_sizes=h0[edges],
    )  # fmt: skip


# --- in the plane --------------------------------------------------------------------------

PLANE = {
    "random square": lambda: (random_square(700, 2501, half_width=50.0), None),
    "jittered square": lambda: (jittered_square(25, 2502), square_rings()),
    "disc": lambda: domains.disc(700, seed=2503),
    "L": lambda: domains.l_shape(700, seed=2504),
    "slit": lambda: domains.slit_square(800, seed=2505),
    "star holes": lambda: domains.star_holes(1200, seed=2506),
    "blocks": lambda: domains.blocks(1200, seed=2507),
}


@pytest.mark.parametrize("kind", ["field", "noise", "patches"])
@pytest.mark.parametrize("name", PLANE)
def test_linear_data_on_edges_of_triangles_are_exact(name, kind):
    mesh, rings = PLANE[name]()
    if rings is None:  # the hull of the points
        rings = (mesh.points[ConvexHull(mesh.points).vertices],)
    h0 = bounds(kind, mesh, 2508)
    h = limit(mesh, h0)
    nodes = np.random.default_rng(2509).choice(mesh.n_points, 300, replace=False)
    assert_allclose(h[nodes], of_edges(mesh, h0, rings, nodes), rtol=0.0, atol=TOLERANCE)
    assert (h < limit(mesh, h0, face_sources=False) - 1e-6).any()


@pytest.mark.parametrize("slope", [0.1, 0.2])
def test_small_holes_hide_parts_of_one_long_edge(slope):
    # Sizes grow from one point of the edge to each node, and the holes lie between some of these.
    outer = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 6.0], [0.0, 6.0]])
    left = np.array([1.0, 3.0, 5.2, 7.0, 8.6])[:, None, None]
    holes = left * [1.0, 0.0] + [[0.0, 0.4], [0.0, 0.6], [0.3, 0.6], [0.3, 0.4]]
    inside = np.random.default_rng(2531).uniform([0.0, 1.2], [10.0, 6.0], (400, 2))
    points = np.concatenate([outer, holes.reshape(-1, 2), inside])
    cells = Delaunay(points).simplices
    middle = points[cells].mean(axis=1)[:, None]
    is_hole = ((middle > holes.min(axis=1)) & (middle < holes.max(axis=1))).all(axis=2).any(axis=1)
    mesh = SimplexMesh(points, cells[~is_hole])
    h0 = np.full(mesh.n_points, np.inf)
    h0[:2] = 1.0, 1.0 + 10.0 * slope
    edge = {"segments": points[None, :2], "segment_sizes": h0[None, :2]}
    exact = limited_sizes((outer, *holes), points, G, **edge)
    assert_allclose(limit(mesh, h0), exact, rtol=1e-12)


@pytest.mark.parametrize("kind", ["field", "noise", "patches"])
@pytest.mark.parametrize("seed", [2510, 2511])
def test_linear_data_beside_slits_of_no_width_and_holes_of_one_triangle(seed, kind):
    for mesh in (
        slit_square(10),
        domains.with_removed_cells(random_square(120, seed, half_width=1.0), seed, 12)[0],
    ):
        h0 = bounds(kind, mesh, seed)
        h = limit(mesh, h0)
        fine, fine_h0 = refined_triangles(mesh, h0, PARTS)
        nodes = np.arange(mesh.n_points)
        upper = plane_sizes(plane_domain(fine), fine_h0, G, nodes)
        assert (h <= upper * (1.0 + 1e-12)).all()
        # From the best place along its edge to a sample, a/16 away or less, and back.
        length = mesh.edge_lengths[np.isfinite(h0[mesh.edges]).all(axis=1)].max()
        assert (h >= upper - 2.0 * G * length / (2 * PARTS) - 1e-12).all()
        assert np.quantile(upper - h, 0.8) <= G * length / 256.0


# --- convex domains in the plane and in space ------------------------------------------------


def between_samples(mesh, h0, nodes):
    """Return lower and upper bounds of the sizes of linear data at nodes of a convex domain.

    Upper: the least over samples.  On an edge in parts of a/8, or a triangle in 64, of longest
    edge a, the best place is at most s = a/16, or a/(8 sqrt 3), from a sample.  Where it is
    inside, the data and the distance r balance, and the distance has a second derivative of at
    most 1/r: the sample is larger by at most g s^2/(2 D), D the distance of x from the line
    or plane, and by 2 g s in any case.  For x in the line or plane the best place is at the rim.
    """
    upper = np.where(np.isfinite(h0[nodes]), h0[nodes], np.inf)
    lower = upper.copy()
    cells = np.sort(mesh.cells, axis=1)
    for k in range(1, mesh.dim + 1):
        local = np.array([c for c in combinations(range(mesh.dim + 1), k)])
        faces = np.unique(cells[:, local].reshape(-1, k), axis=0)
        faces = faces[np.isfinite(h0[faces]).all(axis=1)]
        share = np.array([w for w in product(range(PARTS + 1), repeat=k) if sum(w) == PARTS])
        places = np.einsum("sk,fkd->fsd", share / PARTS, mesh.points[faces])
        sizes = h0[faces] @ share.T / PARTS
        corners = mesh.points[faces]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        step = edges / (PARTS * (1.0, 1.0, 2.0, np.sqrt(3.0))[k])
        for i, x in enumerate(mesh.points[nodes]):
            best = (sizes + G * np.linalg.norm(places - x, axis=2)).min(axis=1)
            away = distances_from_flats(x, corners)
            with np.errstate(divide="ignore", invalid="ignore"):
                excess = np.minimum(G * step**2 / (2.0 * away), 2.0 * G * step)
            excess[away <= 1e-9 * edges] = 0.0
            upper[i] = min(upper[i], best.min(initial=np.inf))
            lower[i] = min(lower[i], (best - excess).min(initial=np.inf))
    return lower, upper


def distances_from_flats(x, corners):
    """Return the distances of x from the points, lines or planes of simplices, float64[f]."""
    off = x - corners[:, 0]
    if corners.shape[1] == 3:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.abs((off * normal).sum(axis=1)) / np.linalg.norm(normal, axis=1)
    if corners.shape[1] == 2:
        along = corners[:, 1] - corners[:, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        off = off - (off * along).sum(axis=1, keepdims=True) * along
    return np.linalg.norm(off, axis=1)


@pytest.mark.parametrize("kind", ["field", "noise", "patches"])
@pytest.mark.parametrize("make", [
    lambda: random_square(300, 2512), lambda: domains.disc(300, seed=2513)[0],
    lambda: jittered_cube(6, 2514), lambda: random_cube(150, 2515),
], ids=["square", "disc", "cube", "random points in a cube"])  # fmt: skip
def test_linear_data_are_between_the_bounds_that_samples_give(make, kind):
    mesh = make()
    h0 = bounds(kind, mesh, 2516)
    nodes = np.random.default_rng(2517).choice(mesh.n_points, 80, replace=False)
    lower, upper = between_samples(mesh, h0, nodes)
    h = limit(mesh, h0)[nodes]
    assert (h <= upper * (1.0 + 1e-12)).all()
    assert (h >= lower * (1.0 - 1e-12)).all()
    of_nodes = limit(mesh, h0, face_sources=False)[nodes]
    assert (of_nodes - h).max() > 2.0 * np.median(upper - lower)


def test_a_face_is_no_source_where_one_of_its_nodes_is_free():
    # Two bounds on one edge of a unit tetrahedron: the edge, and nothing of its faces.
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    h = limit(SimplexMesh(points, [[0, 1, 2, 3]]), [1.0, 1.15, np.inf, np.inf])
    # The foot for (0, 1, 0): the slope of the data is g/2, that of the distance -1/2 at t < 0.
    assert_allclose(h, [1.0, 1.15, 1.0 + G, 1.0 + G], rtol=1e-14)
    h = limit(SimplexMesh(points, [[0, 1, 2, 3]]), [1.5, np.inf, 1.0, 1.0])
    # From (1, 0, 0) to the middle of the edge of nodes 2 and 3: sqrt(1 + 1/2).
    assert_allclose(h, [1.0 + G * np.sqrt(0.5), 1.0 + G * np.sqrt(1.5), 1.0, 1.0], rtol=1e-14)


# --- order -------------------------------------------------------------------------------------


def orders(errors):
    """Return the orders for spacings that are halved each time."""
    return np.log2(np.divide(errors[:-1], errors[1:]))


def test_smooth_data_everywhere_are_of_second_order():
    errors = []
    for n in (800, 3200, 12800):
        mesh, _ = domains.disc(n, seed=2520)
        # The nearest point at another radius is on the same ray: a problem on [0, 50].
        radius = np.linalg.norm(mesh.points, axis=1)
        h0 = domains.disc_field(radius)
        some = np.arange(0, mesh.n_points, mesh.n_points // 400)
        exact = line_sizes(domains.disc_field, (0.0, 50.0), radius[some], 0.2)
        h = limit_gradient(mesh, h0, 0.2, method=METHOD)[some]
        errors.append(np.abs(h - exact).mean())
    assert (orders(errors) > 1.6).all(), f"errors {errors}, orders {orders(errors)}"


def test_smooth_data_in_a_cube_are_of_second_order():
    # Waves along an axis, of slopes up to 0.27, in five phases: where the valleys are among
    # the nodes matters.
    errors = []
    for n_side in (9, 17):
        mesh = jittered_cube(n_side, 2523)
        x = mesh.points[:, 0]
        error = []
        for phase in np.linspace(0.0, 2.8, 5):

            def data(s, phase=phase):
                return 10.0 + 3.0 * np.cos(2.0 * np.pi / 70.0 * s + phase)

            exact = line_sizes(data, (-50.0, 50.0), x, 0.1)
            h = limit_gradient(mesh, data(x), 0.1, method=METHOD)
            error.append(np.abs(h - exact).mean())
        errors.append(np.mean(error))
    assert (orders(errors) > 1.6).all(), f"errors {errors}, orders {orders(errors)}"
