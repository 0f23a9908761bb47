"""Sizes between the nodes straight from their sources, and where sizes come from."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, limit_gradient
from backgrounds import coordinates, graded_tree
from domains import point_sources, slit_square
from geodesics import contains, limited_sizes
from meshes import jittered_cube, jittered_square, structured_square

G = 0.3
CONVEX = {
    "triangles": lambda: jittered_square(21, 931),
    "tetrahedra": lambda: jittered_cube(7, 932),
    "grid": lambda: CartesianGrid([-50.0, -50.0], 5.0, (21, 21)),
    "grid in space": lambda: CartesianGrid([-50.0] * 3, 12.5, (9, 9, 9)),
    "quadtree": lambda: graded_tree(2)(11),
    "octree": lambda: graded_tree(3)(5),
}


def limited(background, h0, g=G):
    """Return the size function with its sources, and without."""
    h, info = limit_gradient(background, h0, g, method="exact", full_output=True)
    return SizeFunction(background, h, sources=info.sources), SizeFunction(background, h)


@cache
def two_corners(name):
    """Sizes 1 and 4 at the first and at the last node, which are opposite corners."""
    background = CONVEX[name]()
    x = coordinates(background)
    places = x.reshape(-1, x.shape[-1])
    first, last = places.sum(axis=1).argmin(), places.sum(axis=1).argmax()
    h0 = np.full(x.shape[:-1], np.inf)
    h0.flat[first], h0.flat[last] = 1.0, 4.0
    return background, h0, places[[first, last]]


def distances(points, places):
    return np.linalg.norm(points[:, None] - places, axis=2)


@pytest.mark.parametrize("name", CONVEX)
def test_point_sources_are_exact_between_the_nodes(name):
    background, h0, places = two_corners(name)
    with_sources, interpolating = limited(background, h0)
    points = np.random.default_rng(933).uniform(-50.0, 50.0, (3000, background.dim))
    exact = ([1.0, 4.0] + G * distances(points, places)).min(axis=1)
    assert_allclose(with_sources(points), exact, rtol=1e-13)
    assert np.abs(interpolating(points) - exact).max() > 0.01
    assert_allclose(with_sources(places), [1.0, 4.0], rtol=1e-15)


@pytest.mark.parametrize("name", ["triangles", "grid"])
def test_g_of_h_is_exact_between_the_nodes(name):
    # dh/ds = 0.02 h: h = h0 exp(0.02 s); the table of Phi is read to 2e-9.
    background, h0, places = two_corners(name)
    with_sources, _ = limited(background, h0, lambda h: 0.02 * h)
    points = np.random.default_rng(934).uniform(-50.0, 50.0, (3000, 2))
    exact = ([1.0, 4.0] * np.exp(0.02 * distances(points, places))).min(axis=1)
    assert_allclose(with_sources(points), exact, rtol=1e-8)


def test_points_outside_take_the_value_of_the_closest_point():
    background, h0, _ = two_corners("triangles")
    with_sources, interpolating = limited(background, h0)
    points = np.array([[-60.0, -30.0], [55.0, 70.0], [0.3, 51.0]])
    assert_array_equal(with_sources(points), interpolating(points))


def test_bounds_on_edges_and_inside_count():
    # h0 everywhere, steeper than g: never above the interpolated bound, and at the nodes h.
    mesh = CONVEX["triangles"]()
    h0 = np.random.default_rng(935).uniform(1.0, 6.0, mesh.n_points)
    with_sources, interpolating = limited(mesh, h0)
    bound = SizeFunction(mesh, h0)
    points = np.random.default_rng(936).uniform(-50.0, 50.0, (3000, 2))
    assert (with_sources(points) <= bound(points) * (1.0 + 1e-14)).all()
    # Nodes come back as points of weight 1 to rounding of their place.
    assert_allclose(with_sources(mesh.points), interpolating.values, rtol=1e-12)


def test_nothing_leaks_through_a_slit():
    mesh, rings = slit_square(2000)
    h0, nodes = point_sources(mesh, [(-20, 30)], (1.0,))
    with_sources, interpolating = limited(mesh, h0)
    points = np.random.default_rng(937).uniform(-50.0, 50.0, (3000, 2))
    points = points[contains(rings, points)]
    exact = limited_sizes(rings, points, G, mesh.points[nodes], h0[nodes])
    error, old = with_sources(points) - exact, interpolating(points) - exact
    assert np.abs(error).max() < 1e-12
    assert np.abs(old).max() > 1e-3
    # Through the slit the sizes at its right would be up to 0.3 * 60 smaller.
    right = (points[:, 0] > 0.5) & (points[:, 1] > 0.0)
    through = h0[nodes] + G * distances(points, mesh.points[nodes])[:, 0]
    assert (with_sources(points) - through)[right].min() > 5.0


def test_roots_follow_bends_to_the_node_that_was_asked():
    mesh, _ = slit_square(500)
    h0, nodes = point_sources(mesh, [(-20, 30)], (1.0,))
    _, info = limit_gradient(mesh, h0, G, full_output=True)
    bends = np.unique(info.sources.nodes[:, 0])
    corners = point_sources(mesh, [(-0.5, -20.0), (0.5, -20.0)], (1.0, 1.0))[1]
    assert set(bends) == {*nodes, *corners}
    assert_array_equal(info.sources.roots(), nodes[0])
    assert repr(info.sources) == f"SizeSources(3 sources of {mesh.n_points} nodal sizes)"


def test_roots_of_an_edge_are_its_smaller_end_and_of_nothing_minus_1():
    square = structured_square(4, half_width=1.0)
    n = square.n_points
    apart = SimplexMesh(
        np.concatenate([square.points, square.points + np.array([5.0, 0.0])]),
        np.concatenate([square.cells, square.cells + n]),
    )
    # Linear along the lower side, of a slope below g: sources are inside its edges.
    x, y = apart.points.T
    h0 = np.where((y == -1.0) & (x < 2.0), 1.0 + 0.1 * x, np.inf)
    _, info = limit_gradient(apart, h0, G, full_output=True)
    roots = info.sources.roots()
    assert (roots[n:] == -1).all()
    assert np.isfinite(h0[roots[:n]]).all()
    sources = info.sources
    from_edge = (sources.nodes >= 0).sum(axis=1) == 2
    assert from_edge.sum() > n // 4
    bounds = np.where(sources.nodes >= 0, h0[sources.nodes], np.inf)
    least = np.take_along_axis(sources.nodes, bounds.argmin(axis=1)[:, None], axis=1)
    assert_array_equal(roots[from_edge], least[from_edge, 0])


def test_only_the_exact_method_has_sources():
    background, h0, _ = two_corners("triangles")
    for method in ("fast-marching", "factored"):
        _, info = limit_gradient(background, h0, G, method=method, full_output=True)
        assert info.sources is None


def test_sources_of_another_background_are_refused():
    background, h0, _ = two_corners("triangles")
    size, _ = limited(background, h0)
    other = SimplexMesh(background.points, background.cells)
    with pytest.raises(ValueError, match="sources must be those of the background, SimplexMesh"):
        SizeFunction(other, size.values, sources=size.sources)


def test_changed_sizes_drop_the_sources():
    background, h0, _ = two_corners("triangles")
    size, interpolating = limited(background, h0)
    points = np.random.default_rng(938).uniform(-50.0, 50.0, (50, 2))
    assert size.clip(hmax=20.0).sources is None
    assert_array_equal(size.clip()(points), interpolating(points))
    assert size.minimum(interpolating).sources is None
    assert size.on(structured_square(4)).sources is None


@pytest.mark.parametrize("name", CONVEX)
def test_weights_agree_with_interpolation(name):
    background = two_corners(name)[0]
    values = np.random.default_rng(939).uniform(1.0, 2.0, background.nodal_shape)
    points = np.random.default_rng(940).uniform(-70.0, 70.0, (2000, background.dim))
    points[:100] = coordinates(background).reshape(-1, background.dim)[:100]
    nodes, weights, away = background.locator.weights(points)
    interpolated, distance = background.locator.interpolate(values, points)
    assert (weights >= 0.0).all()
    assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-14)
    assert_allclose((weights * values.ravel()[nodes]).sum(axis=1), interpolated, rtol=1e-13)
    assert_allclose(away, distance, rtol=1e-12, atol=1e-12)
    places = coordinates(background).reshape(-1, background.dim)
    closest = np.einsum("ij,ijk->ik", weights, places[nodes])
    assert_allclose(closest, np.clip(points, -50.0, 50.0), atol=1e-7)


def test_weights_of_inactive_nodes_are_zero():
    active = np.ones((4, 4), bool)
    active[1, 1] = False
    grid = CartesianGrid([0.0, 0.0], 1.0, (4, 4), active=active)
    nodes, weights, _ = grid.locator.weights([[0.5, 0.25], [1.5, 2.5], [1.0, 1.0]])
    assert (weights[nodes == 5] == 0.0).all()
    assert_allclose(weights[:2].sum(axis=1), 1.0, rtol=1e-15)
    assert weights[2].sum() == 0.0
