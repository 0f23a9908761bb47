"""Sizes between the nodes straight from their sources, and where sizes come from."""

from functools import cache

import domains
import numpy as np
import pytest
from backgrounds import coordinates, graded_tree
from domains import point_sources, slit_square
from exact_oracle import refined_triangles
from geodesics import contains, limited_sizes
from meshes import jittered_cube, jittered_square, random_square, structured_square
from meshes import slit_square as crack
from numpy.testing import assert_allclose, assert_array_equal
from partitions import on_ranks
from shapes import joined, moved

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, limit_gradient
from adaptsize.limiting import Exact

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
    h, info = limit_gradient.with_info(background, h0, g, method="exact")
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


# --- between the nodes, around obstacles and of linear data ----------------------------------

OBSTACLES = {
    "slit": slit_square,
    "maze": domains.maze,
    "star holes": domains.star_holes,
    "round holes": domains.round_holes,
    "spiral": domains.spiral,
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_sizes_between_the_nodes_are_exact_up_to_walls_and_lines_of_shadow(name):
    mesh, rings = OBSTACLES[name](1500, seed=941)
    h0, nodes = point_sources(mesh, [(-45, 45), (45, -44), (-44, -45)], (1.0, 5.0, 3.0))
    with_sources, _ = limited(mesh, h0)
    rng = np.random.default_rng(942)
    points = rng.uniform(-50.0, 50.0, (1500, 2))
    points = points[contains(rings, points)]
    # Beside the corners, and half way along the walls.
    corner = np.concatenate(rings)
    turn = rng.uniform(0.0, 2.0 * np.pi, len(corner))
    beside = corner + 1e-3 * np.column_stack([np.cos(turn), np.sin(turn)])
    middle = 0.5 * np.concatenate([ring + np.roll(ring, 1, axis=0) for ring in rings])
    points = np.concatenate([points, beside[contains(rings, beside)], middle, corner])
    exact = limited_sizes(rings, points, G, mesh.points[nodes], h0[nodes])
    # On a wall the closest point of the mesh is on it to rounding.
    assert_allclose(with_sources(points), exact, rtol=0.0, atol=1e-10)


LINEAR = {
    "square": lambda: random_square(200, 943),
    "slit": lambda: slit_square(250)[0],
    "crack": lambda: crack(8),
    "holes of one triangle": lambda: domains.with_removed_cells(random_square(150, 944), 944, 15)[
        0
    ],
    "blocks": lambda: domains.blocks(500)[0],
}


@pytest.mark.parametrize("kind", ["noise", "field", "some"])
@pytest.mark.parametrize("name", LINEAR)
def test_linear_data_are_limited_between_the_nodes_as_on_a_finer_mesh(name, kind):
    mesh = LINEAR[name]()
    rng = np.random.default_rng(945)
    extent = np.ptp(mesh.points, axis=0).max()
    h0 = extent * rng.uniform(0.01, 0.3, mesh.n_points)
    if kind == "field":
        waves = rng.normal(size=(2, 3)) * 9.0 / extent
        h0 = extent * (0.2 + 0.03 * np.sin(mesh.points @ waves).sum(axis=1))
    if kind == "some":
        away = np.linalg.norm(mesh.points - mesh.points[7], axis=1)
        h0[(away > 0.2 * extent) & (rng.random(mesh.n_points) < 0.97)] = np.inf
    with_sources, interpolating = limited(mesh, h0)
    fine, fine_h0 = refined_triangles(mesh, h0, 4)  # the same data, three more points in each cell
    exact = limit_gradient(fine, fine_h0, G, method="exact")
    inside = mesh.locator.weights(fine.points)[1].min(axis=1) > 1e-6
    assert inside.sum() == 3 * mesh.n_cells
    found = with_sources(fine.points[inside])
    assert_allclose(found, exact[inside], rtol=1e-11)
    assert np.abs(interpolating(fine.points[inside]) - found).max() > 5e-4 * extent


def test_sizes_on_lines_are_exact_between_the_nodes():
    line = SimplexMesh([[0.0], [4.0], [1.0], [2.5]], [[0, 2], [3, 2], [1, 3]])
    with_sources, _ = limited(line, [1.0, 1.5, np.inf, np.inf])
    points = np.linspace(0.0, 4.0, 41)
    exact = np.minimum(1.0 + G * points, 1.5 + G * (4.0 - points))
    assert_allclose(with_sources(points[:, None]), exact, rtol=1e-14)
    _, info = limit_gradient.with_info(line, [1.0, 1.5, np.inf, np.inf], G)
    assert_array_equal(info.sources.nodes[:, 0], [0, 1, 0, 0])
    assert_array_equal(info.sources.roots(), [0, 1, 0, 0])


# --- where sizes come from --------------------------------------------------------------------


def assert_sources_give_the_sizes(background, h0, face_sources=True):
    """Compare sizes with what each source allows; return sizes and sources."""
    h, info = limit_gradient.with_info(background, h0, G, method=Exact(face_sources))
    sources, h, bound = info.sources, h.ravel(), np.ravel(h0)
    points = coordinates(background).reshape(-1, background.dim)
    reached = np.isfinite(h)
    assert_array_equal(sources.nodes[:, 0] >= 0, reached)
    assert_array_equal(sources.roots() >= 0, reached)
    assert np.isfinite(bound[sources.roots()[reached]]).all()
    at_node = reached & (sources.nodes[:, 1] < 0)
    node = sources.nodes[at_node, 0]
    # A source that is a node keeps its bound, or is where the way bends.
    is_bend = h[node] < bound[node] * (1.0 - 1e-12)
    away = np.linalg.norm(points[at_node] - points[node], axis=1)
    assert_allclose(h[at_node], h[node] + G * away, rtol=1e-12)
    if len(sources.bends) == 0:
        assert not is_bend.any()
    else:
        bent = np.isfinite(sources.bends[at_node, 0])
        assert_array_equal(sources.bends[at_node][bent], points[node[bent]])
        assert bent[is_bend].all()
    return h, sources


def blocked_grid(rng):
    """Return a grid with rectangles of inactive nodes, between which boxes are whole."""
    active = np.ones((25, 19), bool)
    for i in (3, 10, 17):
        for j in (3, 11):
            active[i : i + rng.integers(1, 5), j : j + rng.integers(1, 5)] = False
    return CartesianGrid([0.0, 0.0], [1.0, 0.7], active.shape, active=active)


BACKGROUNDS = {
    **CONVEX,
    "slit": lambda: slit_square(500)[0],
    "maze": lambda: domains.maze(900)[0],
    "holes of one triangle": LINEAR["holes of one triangle"],
    "grid with blocks": lambda: blocked_grid(np.random.default_rng(947)),
}


@pytest.mark.parametrize("face_sources", [False, True])
@pytest.mark.parametrize("name", BACKGROUNDS)
def test_sources_give_the_sizes(name, face_sources):
    background, rng = BACKGROUNDS[name](), np.random.default_rng(949)
    extent = float(np.ptp(coordinates(background)))
    active = getattr(background, "active", None)
    for share in (0.02, 0.3, 1.0):
        h0 = extent * rng.uniform(0.01, 0.5, background.nodal_shape)
        h0[rng.random(h0.shape) > share] = np.inf
        h0.flat[0 if active is None else np.flatnonzero(active)[0]] = 0.1 * extent
        if active is not None:
            h0[~active] = np.inf
        assert_sources_give_the_sizes(background, h0, face_sources=face_sources)


def test_roots_follow_bends_to_the_node_that_was_asked():
    mesh, _ = slit_square(500)
    h0, nodes = point_sources(mesh, [(-20, 30)], (1.0,))
    _, info = limit_gradient.with_info(mesh, h0, G)
    bends = np.unique(info.sources.nodes[:, 0])
    corners = point_sources(mesh, [(-0.5, -20.0), (0.5, -20.0)], (1.0, 1.0))[1]
    assert set(bends) == {*nodes, *corners}
    assert_array_equal(info.sources.roots(), nodes[0])
    assert repr(info.sources) == f"SizeSources(3 sources of {mesh.n_points} nodal sizes)"


def test_sources_of_another_background_are_refused():
    background, h0, _ = two_corners("triangles")
    size, _ = limited(background, h0)
    other = SimplexMesh(background.points + 1.0, background.cells)
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


def test_points_outside_take_the_value_of_the_closest_point():
    background, h0, _ = two_corners("triangles")
    with_sources, interpolating = limited(background, h0)
    points = np.array([[-60.0, -30.0], [55.0, 70.0], [0.3, 51.0]])
    assert_array_equal(with_sources(points), interpolating(points))


def grid_with_a_hole():
    x, y = np.meshgrid(np.arange(11) - 5, np.arange(11) - 5)
    return CartesianGrid([-50.0, -50.0], 10.0, (11, 11), active=np.hypot(x, y) > 2.5)


@pytest.mark.parametrize("off", [1e-12, 5e-6])
@pytest.mark.parametrize(
    "make",
    [
        lambda: domains.l_shape(300)[0],
        lambda: domains.holes(16, 5, 24)[0],
        lambda: jittered_square(9, 948),
        lambda: domains.wall_box(300)[0],
        grid_with_a_hole,
    ],
)
def test_points_just_outside_count_as_on_the_boundary(make, off):
    background = make()
    h0 = np.full(background.nodal_shape, np.inf)
    h0.flat[0] = 40.0
    on = np.array([[-50.0, 31.0, 7.0], [-17.0, -50.0, -11.0]])[:, : background.dim]
    outside = np.where(on == -50.0, -50.0 - off, on)
    sizes = [0.5, 0.7]
    h, info = limit_gradient.with_info(background, h0, G, point_sources=(on, sizes), method="exact")
    assert h.min() < 10.0
    moved = limit_gradient(background, h0, G, point_sources=(outside, sizes), method="exact")
    assert_allclose(moved, h, rtol=1e-5)
    assert_allclose(info.sources.evaluate(outside), info.sources.evaluate(on), rtol=1e-5)
    if isinstance(background, SimplexMesh):
        for size in (1, 3):
            found, parts = on_ranks(
                background,
                None,
                size,
                lambda p: limit_gradient(
                    p, h0[p.global_ids], G, point_sources=(outside, sizes), method="exact"
                ),
            )
            for own, part in zip(found, parts, strict=True):
                assert_allclose(own, moved[part.global_ids], rtol=1e-14)


def test_in_solids_that_are_not_convex_nodal_sizes_are_interpolated():
    mesh, _ = domains.wall_box(800)
    h0, _ = point_sources(mesh, [(-20, 30, 10)], (1.0,))
    with_sources, interpolating = limited(mesh, h0)
    points = mesh.points[mesh.cells].mean(axis=1)
    assert_allclose(with_sources(points), interpolating(points), rtol=1e-13)


def test_components_have_sources_of_their_own_between_the_nodes():
    one = random_square(100, 946)
    mesh = joined(one, moved(one, [2.1, 0.0]))
    h0 = np.full(mesh.n_points, np.inf)
    nodes = [3, one.n_points + 5]
    h0[nodes] = 0.1, 0.2
    with_sources, _ = limited(mesh, h0)
    middles = mesh.points[mesh.cells].mean(axis=1)
    of_first, of_second = ([0.1, 0.2] + G * distances(middles, mesh.points[nodes])).T
    is_first = np.arange(mesh.n_cells) < one.n_cells
    assert_allclose(with_sources(middles), np.where(is_first, of_first, of_second), rtol=1e-13)
