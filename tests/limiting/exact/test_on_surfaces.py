"""Sizes on triangles in space: closed forms, an independent twin, and laws of shortest paths."""

from types import SimpleNamespace

import numpy as np
import pytest
from curved_shapes import around_prism, prism, sliver_cylinder
from domains import holes, slit_square
from meshes import jittered_square, random_sphere, random_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from partitions import on_ranks, partition
from shapes import joined, moved
from surface_oracle import distances, limited

from adaptsize import CartesianGrid, SimplexMesh, SizeFunction, limit_gradient
from adaptsize._kernels import surface_windows
from adaptsize.limiting import Exact, tuning
from adaptsize.limiting.exact import on_surface

G = 0.3
NODES = Exact(face_sources=False)


def only_at(mesh, nodes, sizes):
    h0 = np.full(mesh.n_points, np.inf)
    h0[nodes] = sizes
    return h0


def rotation(seed):
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.diag(r))


def in_space(mesh, seed=2601):
    """Return a plane mesh, turned in space."""
    points = np.column_stack([mesh.points, np.zeros(mesh.n_points)])
    return SimplexMesh(points @ rotation(seed).T, mesh.cells)


def nearest_to(mesh, place):
    return int(np.argmin(np.linalg.norm(mesh.points - place, axis=1)))


def some_bounds(mesh, seed, share=0.2):
    """Return bounds at some nodes, of which many are above what others allow."""
    rng, size = np.random.default_rng(seed), mesh.diagonal
    h0 = np.where(
        rng.random(mesh.n_points) < share, size * rng.uniform(0.01, 0.3, mesh.n_points), np.inf
    )
    h0[rng.integers(mesh.n_points)] = 0.02 * size
    return h0


# --- closed forms -------------------------------------------------------------------------------


def bent(points, slant=1.2, width=7.0):
    """Return points of a sheet, folded like an accordion along lines x = k width."""
    x, y = points.T
    zigzag = np.abs((x + width) % (2.0 * width) - width)
    return np.column_stack([x * np.cos(slant), y, zigzag * np.sin(slant)])


def pierced(mesh, every):
    """Return a plane mesh with small triangular holes in some of its triangles.

    Behind a hole, rays of one root pass through two parts of an edge.
    """
    outer = mesh.cells[::every]
    corners = mesh.points[outer]
    inner = corners.mean(axis=1, keepdims=True) + 0.1 * (corners - corners.mean(axis=1)[:, None])
    own = mesh.n_points + np.arange(outer.size).reshape(-1, 3)
    around = [np.column_stack([outer[:, v - 1], outer[:, v], own[:, v]]) for v in range(3)]
    around += [np.column_stack([outer[:, v - 1], own[:, v], own[:, v - 1]]) for v in range(3)]
    cells = np.concatenate([np.delete(mesh.cells, np.s_[::every], axis=0), *around])
    return SimplexMesh(np.concatenate([mesh.points, inner.reshape(-1, 2)]), cells)


FLAT = {
    "square": lambda: jittered_square(15, 2602, half_width=5.0),
    "slit": lambda: slit_square(500)[0],
    "holes": lambda: holes(9, 5, 12)[0],
    "pierced": lambda: pierced(jittered_square(12, 2602, half_width=5.0), 5),
}


@pytest.mark.parametrize("face_sources", [True, False])
@pytest.mark.parametrize("name", FLAT)
def test_a_flat_surface_has_the_sizes_of_the_plane(name, face_sources):
    # Also bounds that are linear on edges, and points between the nodes.
    flat, scheme = FLAT[name](), Exact(face_sources)
    sheet = in_space(flat)
    inside = flat.points[flat.cells[::40]].mean(axis=1)
    on_edges = flat.points[flat.edges[::50]].mean(axis=1)
    places = np.concatenate([inside, on_edges])
    turned = np.column_stack([places, np.zeros(len(places))]) @ rotation(2601).T
    sizes = flat.diagonal * np.linspace(0.01, 0.05, len(places))
    for share in (0.02, 0.4, 1.0):
        h0 = some_bounds(flat, 2603, share)
        expected = limit_gradient(flat, h0, G, method=scheme)
        assert_allclose(limit_gradient(sheet, h0, G, method=scheme), expected, rtol=1e-11)
        expected = limit_gradient(flat, h0, G, method=scheme, point_sources=(places, sizes))
        h = limit_gradient(sheet, h0, G, method=scheme, point_sources=(turned, sizes))
        assert_allclose(h, expected, rtol=1e-11)


def test_a_prism_unfolds():
    mesh, flat, around = prism(13, 9, 2604)
    nodes, sizes = [4, 60, 100], np.array([0.1, 0.2, 0.15])
    away = around_prism(flat, around, nodes)
    h, info = limit_gradient.with_info(mesh, only_at(mesh, nodes, sizes), G)
    assert info.method == "exact"
    assert info.n_proved == mesh.n_points
    assert_allclose(h, (sizes + G * away).min(axis=1), rtol=1e-13)


def cone(total, n_around, n_along=5):
    """Return a fan around node 0 with a given sum of angles, and radius and angle of its nodes.

    Radial lines lie alternately above and below, so that they fit into one turn.
    """
    step = 2.0 * np.pi / n_around
    # Lines at elevations e and +-e: cos(total / n) = cos^2(e) cos(step) +- sin^2(e).
    sign = 1.0 if total < 2.0 * np.pi else -1.0
    cosine2 = (np.cos(total / n_around) - sign) / (np.cos(step) - sign)
    turn = step * np.arange(n_around)
    up = np.sqrt(1.0 - cosine2) * np.where(np.arange(n_around) % 2 == 0, 1.0, sign)
    lines = np.column_stack([np.sqrt(cosine2) * np.cos(turn), np.sqrt(cosine2) * np.sin(turn), up])
    radii = np.arange(1, n_along + 1) / n_along
    points = np.concatenate([np.zeros((1, 3)), (radii[:, None, None] * lines).reshape(-1, 3)])
    ring = 1 + np.arange(n_along * n_around).reshape(n_along, n_around)
    a, b = ring, np.roll(ring, -1, axis=1)
    inner = np.column_stack([np.zeros(n_around, int), a[0], b[0]])
    quads = np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=-1).reshape(-1, 4)
    cells = np.concatenate([inner, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    radius = np.append(0.0, np.repeat(radii, n_around))
    angle = np.append(0.0, np.tile(total / n_around * np.arange(n_around), n_along))
    return SimplexMesh(points, cells), radius, angle


@pytest.mark.parametrize("share", [0.3, 0.5, 0.9, 1.0, 1.3, 1.9])
def test_around_the_tip_of_a_cone_paths_are_chords_or_bend_in_it(share):
    # The boundary is a polygon, whose corners are convex in the unfolded cone.
    mesh, radius, angle = cone(2.0 * np.pi * share, 12)
    source = 12 * 3 + 2
    turn = np.abs(angle - angle[source])
    turn = np.minimum(turn, 2.0 * np.pi * share - turn)
    r = radius[source]
    chord = np.sqrt(r**2 + radius**2 - 2.0 * r * radius * np.cos(turn))
    away = np.where(turn < np.pi, chord, r + radius)
    h, info = limit_gradient.with_info(mesh, only_at(mesh, source, 0.1), G)
    assert_allclose(h, 0.1 + G * away, rtol=1e-13)
    assert_array_equal(info.sources.roots(), source)
    behind = turn > np.pi + 1e-6
    assert behind.any() == (share > 1.0)
    assert_array_equal(info.sources.nodes[behind, 0], 0)  # the tip
    assert_array_equal(info.sources.bends[behind], 0.0)
    assert np.isnan(info.sources.bends[turn < np.pi - 1e-6]).all()


def box(n, height):
    """Return the surface of a box 1 by 1 by height, n squares along the edges of length 1."""
    spacing = (1.0 / n,) * 3
    return CartesianGrid([0.0] * 3, spacing, (n + 1, n + 1, height * n + 1)).mesh.boundary().mesh


def test_distances_on_a_cube_and_on_a_box_are_those_of_kneser():
    # From a corner of the box 1 x 1 x 2 the opposite one, at sqrt(8), is not farthest: the point
    # (3/4, 3/4, 2) is, at sqrt(130)/4.
    for height, place, away in (
        (1, (1.0, 1.0, 1.0), np.sqrt(5.0)),
        (2, (1.0, 1.0, 2.0), np.sqrt(8.0)),
        (2, (0.75, 0.75, 2.0), np.sqrt(130.0) / 4.0),
    ):
        mesh = box(4, height)
        h = limit_gradient(mesh, only_at(mesh, nearest_to(mesh, np.zeros(3)), 0.1), G)
        assert h[nearest_to(mesh, place)] == pytest.approx(0.1 + G * away, rel=1e-13)
        if height == 2:
            assert h.max() == pytest.approx(0.1 + G * np.sqrt(130.0) / 4.0, rel=1e-13)


def test_on_both_sides_of_a_square_paths_cross_one_edge():
    front = jittered_square(11, 2608, half_width=1.0)
    on_edge = np.flatnonzero((np.abs(front.points) == 1.0).any(axis=1))
    back = structured_square(10, half_width=1.0)
    number = np.arange(back.n_points) + front.n_points
    for node in np.flatnonzero((np.abs(back.points) == 1.0).any(axis=1)):
        away = np.linalg.norm(front.points[on_edge] - back.points[node], axis=1)
        number[node] = on_edge[np.argmin(away)]
    assert len(np.unique(number)) == back.n_points
    points = np.concatenate([front.points, back.points])
    mesh = in_space(SimplexMesh(points, np.concatenate([front.cells, number[back.cells]])))
    assert mesh.facet_cell_counts.max() == 2
    source = nearest_to(front, (0.3, -0.4))
    at = front.points[source]
    mirrored = np.array(
        [[2.0 - at[0], at[1]], [-2.0 - at[0], at[1]], [at[0], 2.0 - at[1]], [at[0], -2.0 - at[1]]]
    )
    h = limit_gradient(mesh, only_at(mesh, source, 0.1), G)
    used = mesh.in_a_cell
    here = np.linalg.norm(points - at, axis=1)
    there = np.linalg.norm(points[:, None] - mirrored, axis=2).min(axis=1)
    is_front = np.arange(len(points)) < front.n_points
    assert_allclose(h[used], (0.1 + G * np.where(is_front, here, there))[used], rtol=1e-13)


@pytest.mark.parametrize("aside", [-0.2, 0.0, 0.3])
def test_behind_a_hole_paths_on_both_sides_leave_its_shadow(aside):
    """They come from one root, through one edge, and are as if nothing were between them."""
    source, left, right, back = (aside, 0.0), (-0.5, 1.0), (0.5, 1.0), (0.0, 1.2)
    points = np.array([source, (10.0, 2.0), (-10.0, 2.0), right, left, back, (0.0, 6.0)])
    cells = [(0, 1, 3), (0, 3, 4), (0, 4, 2), (3, 1, 5), (4, 5, 2), (5, 1, 2), (2, 1, 6)]
    mesh = in_space(SimplexMesh(points, cells))
    h = limit_gradient(mesh, only_at(mesh, [0], 0.1), G, method=NODES)
    for node in (5, 6):  # around the nearer end of the hole
        over = [np.hypot(*(points[0] - x)) + np.hypot(*(points[node] - x)) for x in points[3:5]]
        assert_allclose(h[node], 0.1 + G * min(over), rtol=1e-12)


@pytest.mark.parametrize("n_pages", [3, 5])
def test_sizes_pass_from_each_sheet_of_a_book_into_all_others(n_pages):
    n = 7
    x, z = np.meshgrid(np.arange(n) / 2.0, np.arange(n) / 2.0, indexing="ij")
    flat = np.column_stack([x.ravel(), z.ravel()])
    square = structured_square(n - 1, half_width=1.5)
    square = SimplexMesh(square.points + 1.5, square.cells)
    pages, coordinates = [], []
    for page in range(n_pages):
        turn = 2.0 * np.pi * page / n_pages
        u, v = square.points.T
        pages.append(
            SimplexMesh(np.column_stack([u * np.cos(turn), u * np.sin(turn), v]), square.cells)
        )
        coordinates.append(np.column_stack([np.full(len(u), page), u, v]))
    mesh, place = joined(*pages), np.concatenate(coordinates)
    spine = np.flatnonzero(place[:, 1] == 0.0)
    number = np.arange(mesh.n_points)
    for node in spine:
        number[node] = spine[np.argmax(place[spine, 2] == place[node, 2])]
    mesh = SimplexMesh(mesh.points, number[mesh.cells])
    assert len(flat) == square.n_points
    source = int(np.flatnonzero((place == [1, 1.0, 0.5]).all(axis=1))[0])
    side = np.where(place[:, 0] == 1, -place[:, 1], place[:, 1])
    away = np.hypot(side + 1.0, place[:, 2] - 0.5)
    h = limit_gradient(mesh, only_at(mesh, source, 0.1), G)
    used = mesh.in_a_cell
    assert_allclose(h[used], (0.1 + G * away)[used], rtol=1e-13)


# --- the twin -----------------------------------------------------------------------------------


def moebius(n=9):
    """Return a band with one half twist, three nodes across."""
    u = 2.0 * np.pi * np.arange(n) / n
    across = np.array([-0.4, 0.1, 0.4])[:, None]
    r = 1.0 + across * np.cos(u / 2.0)
    points = np.stack([r * np.cos(u), r * np.sin(u), across * np.sin(u / 2.0)], axis=-1)
    node = np.arange(3 * n).reshape(3, n)
    after = np.column_stack([node[:, 1:], node[::-1, 0]])
    cells = []
    for row in range(2):
        a, b, c, d = node[row], after[row], after[row + 1], node[row + 1]
        cells += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    return SimplexMesh(points.reshape(-1, 3), np.concatenate(cells))


def rough(mesh, seed, share=0.2):
    """Return a surface with its nodes moved, so that many are saddles."""
    moves = np.random.default_rng(seed).uniform(-share, share, mesh.points.shape)
    return SimplexMesh(mesh.points + moves, mesh.cells)


def punched(seed):
    """Return a rough sphere with holes, some of which touch at nodes."""
    mesh = rough(random_sphere(40, seed), seed)
    keep = np.random.default_rng(seed).random(mesh.n_cells) < 0.8
    return SimplexMesh(mesh.points, mesh.cells[keep])


def with_fins(seed):
    """Return a rough sphere with more triangles at some edges, and at some nodes."""
    mesh, rng = rough(random_sphere(30, seed), seed), np.random.default_rng(seed)
    edges = mesh.edges[rng.choice(len(mesh.edges), 5, replace=False)]
    tips = mesh.points[edges].mean(axis=1) * 1.7
    n = mesh.n_points
    fins = np.column_stack([edges, n + np.arange(5)])
    kites = np.column_stack([n + np.arange(5), n + 5 + np.arange(5), n + 10 + np.arange(5)])
    more = [tips * 1.2 + rng.uniform(-0.2, 0.2, (5, 3)) for _ in range(2)]
    return SimplexMesh(
        np.concatenate([mesh.points, tips, *more]), np.concatenate([mesh.cells, fins, kites])
    )


def slivers(seed):
    mesh = rough(random_sphere(24, seed), seed, 0.1)
    return SimplexMesh(mesh.points * [1.0, 0.05, 5.0], mesh.cells)


TWINS = {
    "sphere": lambda seed: random_sphere(30, seed),
    "rough": lambda seed: rough(random_sphere(35, seed), seed, 0.35),
    "sheet": lambda seed: rough(in_space(random_square(35, seed), seed), seed, 0.15),
    "moebius": lambda seed: rough(moebius(), seed, 0.05),
    "punched": punched,
    "fins": with_fins,
    "slivers": slivers,
    "two": lambda seed: joined(
        rough(random_sphere(12, seed), seed), moved(random_sphere(14, seed), [0.5, 0.1, 0.2])
    ),
}  # fmt: skip


@pytest.mark.parametrize("seed", [2611, 2612])
@pytest.mark.parametrize("name", TWINS)
def test_sizes_are_those_of_all_straight_strips(name, seed):
    mesh = TWINS[name](seed)
    away = distances(mesh.points, mesh.cells)
    for share in (0.02, 0.3, 1.0):
        h0 = some_bounds(mesh, seed, share)
        h, info = limit_gradient.with_info(mesh, h0, G, method=NODES)
        allowed = (h0[:, None] + G * away).min(axis=0)
        used = mesh.in_a_cell
        assert_allclose(h[used], allowed[used], rtol=1e-10)
        assert info.n_proved == mesh.n_points
        # The source of each size gives it, and where a path bends, its last root does.
        reached = used & np.isfinite(h)
        at, root = np.flatnonzero(reached), info.sources.roots()[reached]
        assert_allclose(h0[root] + G * away[root, at], h[at], rtol=1e-10)
        last = info.sources.nodes[at, 0]
        assert_allclose(h[last] + G * away[last, at], h[at], rtol=1e-10)


def test_the_twin_agrees_with_closed_forms():
    mesh, radius, _ = cone(2.6 * np.pi, 8, 2)
    away = distances(mesh.points, mesh.cells)
    assert_allclose(away[0], radius, rtol=1e-14)
    assert away[9, 13] == pytest.approx(2.0, rel=1e-14)  # 1.3 pi apart
    cube = box(1, 1)
    across = nearest_to(cube, np.ones(3))
    assert distances(cube.points, cube.cells)[
        nearest_to(cube, np.zeros(3)), across
    ] == pytest.approx(np.sqrt(5.0))


# --- laws ---------------------------------------------------------------------------------------


LAWS = {
    "sphere": lambda: random_sphere(400, 2621),
    "rough": lambda: rough(random_sphere(300, 2622), 2622),
    "moebius": lambda: rough(moebius(21), 2623, 0.03),
    "punched": lambda: punched(2624),
    "fins": lambda: with_fins(2625),
    "slivers": lambda: sliver_cylinder(20, 2626),
}  # fmt: skip


def split(mesh, h0, seed):
    """Return the mesh with a node in each triangle, and linear bounds there."""
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet([1.0] * 3, mesh.n_cells)
    inner = np.einsum("iv,ivd->id", weights, mesh.points[mesh.cells])
    with np.errstate(invalid="ignore"):
        bound = np.nan_to_num((weights * h0[mesh.cells]).sum(axis=1), nan=np.inf, posinf=np.inf)
    middle = mesh.n_points + np.arange(mesh.n_cells)
    parts = [
        np.column_stack([mesh.cells[:, a], mesh.cells[:, b], middle])
        for a, b in ((0, 1), (1, 2), (2, 0))
    ]
    return SimplexMesh(np.concatenate([mesh.points, inner]), np.concatenate(parts)), np.append(
        h0, bound
    )


@pytest.mark.parametrize("share", [0.01, 0.3, 1.0])
@pytest.mark.parametrize("name", LAWS)
def test_splitting_triangles_changes_nothing(name, share, monkeypatch):
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", 10_000)
    mesh = LAWS[name]()
    n, h0 = mesh.n_points, some_bounds(mesh, 2631, share)
    h = limit_gradient(mesh, h0, G, method=NODES)
    once, more = split(mesh, h0, 2632)
    for fine in (once, split(once, more, 2633)[0]):
        bound = np.append(h0, np.full(fine.n_points - n, np.inf))
        assert_allclose(limit_gradient(fine, bound, G, method=NODES)[:n], h, rtol=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_linear_bounds_are_linear_bounds_on_split_triangles(name):
    mesh = LAWS[name]()
    h0 = some_bounds(mesh, 2634, 1.0)
    h = limit_gradient(mesh, h0, G)
    fine, bound = split(mesh, h0, 2635)
    finer, more = split(fine, bound, 2636)
    n = mesh.n_points
    for refined, given in ((fine, bound), (finer, more)):
        own = limit_gradient(refined, given, G)
        assert_allclose(own[:n], h, rtol=1e-12)
        of_nodes = limit_gradient(refined, given, G, method=NODES)
        assert (of_nodes >= own * (1.0 - 1e-12)).all()
    # Bounds at nodes only act less.
    assert (limit_gradient(mesh, h0, G, method=NODES) > h * (1.0 + 1e-4)).any()


@pytest.mark.parametrize("face_sources", [True, False])
@pytest.mark.parametrize("name", LAWS)
def test_numbers_orientation_and_a_power_of_two_change_no_bit(name, face_sources):
    mesh, scheme = LAWS[name](), Exact(face_sources)
    rng = np.random.default_rng(2641)
    h0 = some_bounds(mesh, 2642, 0.5)
    points = mesh.points[mesh.cells[:6]].mean(axis=1), 0.01 * mesh.diagonal * np.arange(1, 7)
    h = limit_gradient(mesh, h0, G, method=scheme, point_sources=points)
    old = rng.permutation(mesh.n_points)
    cells = rng.permuted(np.argsort(old)[mesh.cells[rng.permutation(mesh.n_cells)]], axis=1)
    other = SimplexMesh(mesh.points[old], cells)
    points = points[0][::-1], points[1][::-1]
    again = limit_gradient(other, h0[old], G, method=scheme, point_sources=points)
    assert_array_equal(again, h[old])
    double = SimplexMesh(4.0 * mesh.points, mesh.cells)
    points = 4.0 * points[0], 4.0 * points[1]
    assert_array_equal(
        limit_gradient(double, 4.0 * h0, G, method=scheme, point_sources=points), 4.0 * h
    )


@pytest.mark.parametrize("name", LAWS)
def test_turning_and_moving_change_nothing(name):
    mesh, h0 = LAWS[name](), some_bounds(LAWS[name](), 2643, 0.5)
    turned = SimplexMesh(mesh.points @ rotation(2644).T + [0.3, -0.2, 0.1], mesh.cells)
    for scheme in (Exact(), NODES):
        h = limit_gradient(mesh, h0, G, method=scheme)
        assert_allclose(limit_gradient(turned, h0, G, method=scheme), h, rtol=1e-11)


@pytest.mark.parametrize("name", LAWS)
def test_bounds_at_nodes_act_each_for_itself_and_only_once(name):
    mesh = LAWS[name]()
    rng = np.random.default_rng(2645)
    first, second = some_bounds(mesh, 2646, 0.1), some_bounds(mesh, 2647, 0.1)
    alone = [limit_gradient(mesh, h0, G, method=NODES) for h0 in (first, second)]
    both = limit_gradient(mesh, np.minimum(first, second), G, method=NODES)
    assert_allclose(both, np.minimum(*alone), rtol=1e-13)
    assert_allclose(limit_gradient(mesh, both, G, method=NODES), both, rtol=1e-13)
    for scheme in (Exact(), NODES):
        h = limit_gradient(mesh, first, G, method=scheme)
        lower = limit_gradient(mesh, first * rng.uniform(0.3, 1.0, len(first)), G, method=scheme)
        assert (lower <= h * (1.0 + 1e-13)).all()


# --- points between the nodes -------------------------------------------------------------------


def inserted(mesh, t, place):
    """Return the mesh with a node in triangle t."""
    a, b, c = mesh.cells[t]
    n = mesh.n_points
    cells = np.concatenate([np.delete(mesh.cells, t, axis=0), [[a, b, n], [b, c, n], [c, a, n]]])
    return SimplexMesh(np.vstack([mesh.points, place]), cells)


@pytest.mark.parametrize(
    "weights", [(0.2, 0.3, 0.5), (0.4, 0.6, 0.0), (0.0, 1.0, 0.0), (1e-9, 0.5, 0.5)]
)
@pytest.mark.parametrize("name", LAWS)
def test_a_point_is_a_node_put_into_its_triangle(name, weights):
    mesh, t = LAWS[name](), 17
    place = np.array(weights) @ mesh.points[mesh.cells[t]]
    # In an open edge, or a node, the point is a source of all triangles there.
    h0 = some_bounds(mesh, 2651, 0.05)
    size = 0.5 * h0.min()
    h, info = limit_gradient.with_info(mesh, h0, G, point_sources=([place], [size]), method=NODES)
    if min(weights) > 0.0:
        fine = inserted(mesh, t, place)
        expected = limit_gradient(fine, np.append(h0, size), G, method=NODES)[:-1]
    elif max(weights) == 1.0:
        bound = h0.copy()
        bound[mesh.cells[t, 1]] = size
        expected = limit_gradient(mesh, bound, G, method=NODES)
    else:  # the edge is cut in all of its triangles
        a, b = mesh.cells[t, :2]
        on = (mesh.cells == a).any(axis=1) & (mesh.cells == b).any(axis=1)
        n = mesh.n_points
        halves = [np.where(mesh.cells[on] == old, n, mesh.cells[on]) for old in (a, b)]
        fine = SimplexMesh(
            np.vstack([mesh.points, place]), np.concatenate([mesh.cells[~on], *halves])
        )
        expected = limit_gradient(fine, np.append(h0, size), G, method=NODES)[:-1]
    assert_allclose(h, expected, rtol=1e-8 if min(weights) == 1e-9 else 1e-12)
    assert (info.sources.roots() == mesh.n_points).any()


def test_a_point_off_the_surface_acts_from_the_closest_point():
    mesh = in_space(structured_square(4, half_width=1.0), 2652)
    normal = rotation(2652) @ [0.0, 0.0, 1.0]
    foot = mesh.points[mesh.cells[5]].mean(axis=0)
    h0 = only_at(mesh, 0, 9.0)
    on = limit_gradient(mesh, h0, G, point_sources=([foot], [0.1 + 0.2 * G]))
    off = limit_gradient(mesh, h0, G, point_sources=([foot + 0.2 * normal], [0.1]))
    assert_allclose(off, on, rtol=1e-12)
    assert on.max() < 2.0


# --- degenerate triangles -----------------------------------------------------------------------


def test_triangles_without_area_join_what_they_touch():
    # A square of two triangles; one flat triangle fills a T-junction on its diagonal.
    corners = np.array(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]]
    )
    cells = [[0, 1, 2], [0, 2, 4], [0, 4, 3], [4, 2, 3]]
    mesh = SimplexMesh(corners, cells)
    for source in range(5):
        h = limit_gradient(mesh, only_at(mesh, source, 0.1), G)
        assert_allclose(h, 0.1 + G * np.linalg.norm(corners - corners[source], axis=1), rtol=1e-13)
    # Edges of no length: their nodes are one, also if nothing else joins them.
    points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0], [3, 0, 1], [3, 0, 1], [4, 0, 1]]
    mesh = SimplexMesh(np.array(points, float), [[0, 1, 2], [1, 2, 3], [2, 3, 4], [4, 5, 6]])
    h = limit_gradient(mesh, only_at(mesh, 0, 0.5), 0.5)
    far = 1.5 + 0.5 * np.sqrt(2.0)
    assert_allclose(h, [0.5, 1.0, 1.5, 1.5, far, far, far + 0.5], rtol=1e-14)


def test_a_triangle_collapsed_onto_an_edge_changes_nothing():
    # Nodes 0 and n coincide: two triangles become the edges that they lie on.
    mesh = rough(random_sphere(60, 2661), 2661)
    h0 = some_bounds(mesh, 2662, 0.1)
    n = mesh.n_points
    ring = np.flatnonzero((mesh.cells == 0).any(axis=1))
    # Around node 0 half of the triangles, one after another, move to the new node.
    order, fan = [ring[0]], mesh.cells[ring]
    while len(order) < len(ring):
        last = set(mesh.cells[order[-1]]) - {0}
        order.append(
            next(t for t, c in zip(ring, fan, strict=True) if t not in order and last & set(c))
        )
    moved_cells, half = mesh.cells.copy(), order[: len(order) // 2]
    moved_cells[half] = np.where(mesh.cells[half] == 0, n, mesh.cells[half])
    inner = [set(mesh.cells[t]) - {0} for t in half]
    counts = np.bincount(np.concatenate([list(s) for s in inner]), minlength=n)
    outer = np.flatnonzero(counts == 1)
    cells = np.concatenate([moved_cells, [[0, n, k] for k in outer]])
    both = SimplexMesh(np.vstack([mesh.points, mesh.points[:1]]), cells)
    for scheme in (Exact(), NODES):
        h = limit_gradient(mesh, h0, G, method=scheme)
        doubled = limit_gradient(both, np.append(h0, h0[0]), G, method=scheme)
        assert_allclose(doubled, np.append(h, h[0]), rtol=1e-12)


def test_nodes_that_coincide_without_an_edge_do_not_act_on_each_other():
    one = random_sphere(50, 2663)
    mesh = joined(one, one)
    h = limit_gradient(mesh, np.append(some_bounds(one, 2664), np.full(50, 7.0)), G)
    assert (h[50:] == 7.0).all()


@pytest.mark.parametrize("g", [0.0, 1e-300, 1e-25, 1e-18, 1e-12])
def test_a_tiny_limit_gives_the_least_bound_of_each_component(g):
    one = rough(random_sphere(80, 2665), 2665)
    mesh = joined(one, moved(one, [9.0, 0.0, 0.0]))
    h0 = some_bounds(mesh, 2666, 0.3)
    h0[80:] *= 2.0
    least = np.repeat([h0[:80].min(), h0[80:].min()], 80)
    for scheme in (Exact(), NODES):
        h, info = limit_gradient.with_info(mesh, h0, g, method=scheme)
        assert ((h >= least) & (h <= least + g * mesh.diagonal)).all()
        assert_array_equal(h0[info.sources.roots()], least)
    place, size = mesh.points[mesh.cells[3]].mean(axis=0), 0.1 * least[0]
    h = limit_gradient(mesh, h0, g, point_sources=([place], [size]))
    least = np.where(np.arange(160) < 80, size, least)
    assert ((h >= least) & (h <= least + g * mesh.diagonal)).all()


# --- the number of windows is limited -----------------------------------------------------------


def test_beyond_a_number_of_windows_sizes_are_of_paths_and_the_certificate_holds(monkeypatch):
    mesh = random_sphere(1500, 2671)
    h0 = only_at(mesh, [3, 700], [0.02, 0.05])
    exact, info = limit_gradient.with_info(mesh, h0, G, method=NODES)
    assert info.n_proved == mesh.n_points
    assert info.largest_gap == 0.0
    monkeypatch.setattr(tuning, "LEAST_WINDOWS", 0)
    rise = exact.max() - exact.min()
    for most in (0, 4, 10):
        monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", most)
        h, info = limit_gradient.with_info(mesh, h0, G, method=NODES)
        assert (h >= exact * (1.0 - 1e-13)).all()
        error = (h - exact).max()
        assert 1e-7 * rise < error < 5e-3 * rise
        assert error <= info.largest_gap
        assert 0 < info.n_proved < mesh.n_points
        assert info.largest_edge_slope <= 1.0 + 1e-12
        settled = np.argsort(exact)[: info.n_proved]
        assert_allclose(h[settled], exact[settled], rtol=1e-13)
        roots = info.sources.roots()
        assert set(roots) == {3, 700}


@pytest.mark.parametrize("with_another", [False, True])
def test_narrow_windows_are_dropped_early_where_too_many_are_forecast(with_another, monkeypatch):
    sphere = random_sphere(1500, 2673)
    aside = moved(random_sphere(1000, 2674), (5.0, 0.0, 0.0))  # without bounds
    mesh = joined(sphere, aside) if with_another else sphere
    h0, found, fronts = only_at(mesh, [3], 0.02), [], []
    forecast, propagate = on_surface._forecast, on_surface._propagate

    def spied_forecast(*args):
        found.append(forecast(*args))
        return found[-1]

    def spied_propagate(*args):
        fronts.append(propagate(*args))
        return fronts[-1]

    monkeypatch.setattr(on_surface, "_forecast", spied_forecast)
    monkeypatch.setattr(on_surface, "_propagate", spied_propagate)
    monkeypatch.setattr(tuning, "LEAST_WINDOWS", 0)
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", 10_000)
    monkeypatch.setattr(tuning, "FORECASTS", (8, 20))
    monkeypatch.setattr(tuning, "DROPPING", 0)
    _, info = limit_gradient.with_info(mesh, h0, G)
    total = fronts[-1][0].tally[surface_windows.DONE]
    assert info.n_proved == mesh.n_points
    # The antipode of the source, where paths meet from all sides, costs more than is forecast.
    assert ((0.3 * total < np.array(found)) & (np.array(found) < total)).all()
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", int(0.9 * min(found) / mesh.n_points))
    early = limit_gradient.with_info(mesh, h0, G)[1].n_proved
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", 8)
    assert limit_gradient.with_info(mesh, h0, G)[1].n_proved == early < mesh.n_points
    # Where few are left by the forecast, they are not dropped before the limit.
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", int(0.9 * min(found) / mesh.n_points))
    monkeypatch.setattr(tuning, "DROPPING", max(found) / mesh.n_points)
    assert limit_gradient.with_info(mesh, h0, G)[1].n_proved > early


def test_windows_leave_the_queue_in_the_order_of_their_sizes():
    # This, too, changes no size but the number of windows.
    queue, take = (
        getattr(kernel, "py_func", kernel)
        for kernel in (surface_windows._queue, surface_windows._take)
    )
    rng = np.random.default_rng(2675)
    front = SimpleNamespace(key=np.empty(300), item=np.empty(300, int), tally=np.zeros(4, int))
    inside, sizes = set(), rng.random(900)
    for k, size in enumerate(sizes):
        queue(front, size, k)
        inside.add(k)
        if len(inside) == 300 or rng.random() < 0.4:
            least = min(inside, key=sizes.__getitem__)
            assert take(front) == (sizes[least], least)
            inside.remove(least)
    assert len(inside) > 100
    assert [take(front)[1] for _ in range(len(inside))] == sorted(inside, key=sizes.__getitem__)


@pytest.mark.parametrize("is_wave", [False, True])
def test_the_least_size_in_a_window_is_that_of_its_points(is_wave, monkeypatch):
    # It orders windows, which changes no size but their number.  Kernels are called as Python.
    size_at, least_in = (
        getattr(kernel, "py_func", kernel)
        for kernel in (surface_windows._size_at, surface_windows._least_in)
    )
    monkeypatch.setattr(surface_windows, "_size_at", size_at)
    rng = np.random.default_rng(2663)
    for _ in range(20):
        first, last = np.sort(rng.uniform(0.0, 1.0, 2))
        angle = rng.uniform(0.1, 3.0)
        place = np.cos(angle), np.sin(angle)  # of a root, or of one from which waves come
        found = least_in((first, last), (*place, 0.3), is_wave)
        x = np.linspace(first, last, 2001)
        sizes = 0.3 + (-place[0] * x if is_wave else np.hypot(x - place[0], place[1]))
        assert_allclose(found, sizes.min(), atol=1e-6)
        assert found <= sizes.min() + 1e-15


def test_the_certificate_holds_where_edges_are_roots(monkeypatch):
    mesh = random_sphere(400, 2661)
    h0 = some_bounds(mesh, 2662, 0.3)
    h0[mesh.cells[::9]] = 0.3 * mesh.diagonal * np.linspace(0.1, 1.0, len(mesh.cells[::9]))[:, None]
    exact = limit_gradient(mesh, h0, G)
    monkeypatch.setattr(tuning, "LEAST_WINDOWS", 0)
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", 0)
    for narrow in (0.4, 0.9, 2.0):
        monkeypatch.setattr(tuning, "NARROW", narrow)
        h, info = limit_gradient.with_info(mesh, h0, G)
        assert (h >= exact * (1.0 - 1e-13)).all()
        settled = np.argsort(exact)[: info.n_proved]
        assert_allclose(h[settled], exact[settled], rtol=1e-12)


def test_the_number_of_windows_does_not_depend_on_the_thickness_of_slivers():
    # A plane sheet of long triangles, 1 : 1000: exact, and within the number of windows.
    flat = structured_square(20, half_width=1.0)
    sheet = in_space(SimplexMesh(flat.points * [1.0, 1e-3], flat.cells))
    h, info = limit_gradient.with_info(sheet, only_at(sheet, 7, 0.1), G)
    away = np.linalg.norm(sheet.points - sheet.points[7], axis=1)
    assert_allclose(h, 0.1 + G * away, rtol=1e-12)
    assert info.n_proved == sheet.n_points


# --- the rest of the library --------------------------------------------------------------------


def test_parts_of_a_surface_have_the_sizes_of_the_whole():
    mesh = rough(random_sphere(120, 2681), 2681)
    h0 = some_bounds(mesh, 2682)
    h = limit_gradient(mesh, h0, G)
    for size in (1, 3):
        ranks = partition(mesh, "random", size, np.random.default_rng(2683)) if size > 1 else None
        found, parts = on_ranks(mesh, ranks, size, lambda p: limit_gradient(p, h0[p.global_ids], G))
        for own, part in zip(found, parts, strict=True):
            assert_array_equal(own, h[part.global_ids])


def test_between_the_nodes_of_a_surface_sizes_are_interpolated():
    mesh = random_sphere(200, 2684)
    h, info = limit_gradient.with_info(mesh, some_bounds(mesh, 2685), G)
    middle = mesh.points[mesh.cells].mean(axis=1)
    expected = h[mesh.cells].mean(axis=1)
    assert_allclose(SizeFunction(mesh, h, sources=info.sources)(middle), expected, rtol=1e-12)


def test_limited():
    mesh = random_sphere(20, 2686)
    h0 = some_bounds(mesh, 2687)
    assert_allclose(
        limit_gradient(mesh, h0, G, method=NODES),
        limited(mesh.points, mesh.cells, h0, G),
        rtol=1e-12,
    )


@pytest.mark.parametrize("make", [lambda: prism(40, 40, 2672)[0], lambda: in_space(FLAT["slit"]())])
def test_windows_stay_few_where_a_surface_unfolds(make, monkeypatch):
    # Windows become one behind a node that divided them; without that there are 20 per node.
    monkeypatch.setattr(tuning, "LEAST_WINDOWS", 0)
    monkeypatch.setattr(tuning, "WINDOWS_PER_NODE", 8)
    mesh = make()
    _, info = limit_gradient.with_info(mesh, only_at(mesh, 7, 0.01 * mesh.diagonal), G)
    assert info.n_proved == mesh.n_points
