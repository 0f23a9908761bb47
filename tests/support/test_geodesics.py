"""The references for non-convex domains, against closed forms, brute force, and laws."""

from itertools import pairwise
from math import dist

import domains
import numpy as np
import pytest
from geodesics import (
    area,
    contains,
    curve_sizes,
    distances,
    limited_sizes,
    perimeter,
    prism_sizes,
    radial_sizes,
    reflex_corners,
    sees,
    window_sizes,
)
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from adaptsize import SimplexMesh, limit_gradient

G = 0.3
SQUARE = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
BLOCK = np.array([[-5.0, -10.0], [-5.0, 10.0], [5.0, 10.0], [5.0, -10.0]])  # clockwise: a hole


def some_points(rings, n, seed):
    points = np.random.default_rng(seed).uniform(-50.0, 50.0, (3 * n, 2))
    return points[contains(rings, points)][:n]


def length(*places):
    return sum(np.linalg.norm(b - a, axis=-1) for a, b in pairwise(places))


# ---------------------------------------------------------------- what sees what


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((-20, 0), (20, 0), False),  # through the block
        ((-20, 20), (20, 20), True),  # past it
        ((-20, 10), (20, 10), True),  # along its upper side, overlapping all of it
        ((-5, 3), (-5, -50), True),  # from one of its sides along this side
        ((-5, 10), (5, -10), False),  # its diagonal, corner to corner
        ((-5, 3), (5, 3), False),  # from one side to the other inside it
        ((-5, 10), (5, 10), True),  # its upper side itself
        ((-15, 0), (5, 20), True),  # touching the corner (-5, 10) only
        ((-15, -1), (5, 19), False),  # cutting off 0.7 of that corner
        ((-15, 1e-13), (5, 20), True),  # the same touch, to rounding
        ((-5, 0), (-50, 0), True),  # from its side away
        ((-5, 0), (20, 0), False),  # from its side through it
        ((-50, -50), (50, -50), True),  # the square's own side
        ((7, 7), (7, 7), True),
    ],
)
def test_sight(a, b, expected):
    a, b = np.array([a, b], float)[:, None]
    for p, q in ((a, b), (b, a)):
        assert sees((SQUARE, BLOCK), p, q)[0] == expected


def test_sight_agrees_with_many_points_along_the_line():
    for name in ("star holes", "maze", "round holes"):
        _, rings = domains.CASES[name].make(500)
        a, b = some_points(rings, 300, 51), some_points(rings, 300, 52)
        share = np.linspace(0.0, 1.0, 1501)[:, None, None]
        on_line = (a + share * (b - a)).reshape(-1, 2)
        inside = contains(rings, on_line).reshape(1501, -1).all(axis=0)
        visible = sees(rings, a, b)
        assert (inside >= visible).all(), name
        # Steps are up to 0.1 long: a few lines cut less than that off a corner.
        assert (inside != visible).sum() <= 6, name
        assert 30 < visible.sum() < 270, name


def test_points_inside_are_those_with_an_odd_winding():
    _, rings = domains.star_holes(500)
    points = np.random.default_rng(53).uniform(-60.0, 60.0, (2000, 2))
    winding = np.zeros(2000)
    for ring in rings:
        to = ring - points[:, None]
        following = np.roll(to, -1, axis=1)
        cross = to[..., 0] * following[..., 1] - to[..., 1] * following[..., 0]
        winding += np.arctan2(cross, (to * following).sum(axis=2)).sum(axis=1)
    assert (contains(rings, points) == (np.round(winding / (2.0 * np.pi)) == 1)).all()
    assert all(contains(rings, ring).all() for ring in rings)


def test_reflex_corners_are_those_that_paths_bend_at():
    assert_allclose(reflex_corners((SQUARE, BLOCK)), BLOCK)
    assert len(reflex_corners((SQUARE,))) == 0
    _, rings = domains.star_holes(500)
    assert len(reflex_corners(rings)) == 7 + 6 + 9
    assert_allclose(area((SQUARE, BLOCK)), 10_000.0 - 200.0)
    assert_allclose(perimeter((SQUARE, BLOCK)), 400.0 + 60.0)


# ---------------------------------------------------------------- shortest paths


def test_around_a_block_over_the_shorter_side():
    source = np.array([-30.0, 2.0])
    x = np.column_stack([np.linspace(6.0, 50.0, 200), np.linspace(-9.0, 9.0, 200)])  # all hidden
    up, down = BLOCK[[1, 2]], BLOCK[[0, 3]]
    expected = np.minimum(
        length(source, *up, x),
        length(source, *down, x),
    )
    assert_allclose(distances((SQUARE, BLOCK), source, x), expected, rtol=1e-14)


def test_around_a_slit_by_one_tip_or_by_both():
    rings = (domains.slit_polygon(1.0, -20.0),)
    source = np.array([-20.0, 30.0])
    left, right = np.array([-0.5, -20.0]), np.array([0.5, -20.0])
    x = some_points(rings, 500, 54)
    slope = (left - source)[1] / (left - source)[0]  # of the shadow line through the left tip
    is_hidden = (x[:, 0] > -0.5) & (x[:, 1] > left[1] + slope * (x[:, 0] - left[0]))
    is_beyond = (x[:, 0] > 0.5) & (x[:, 1] > -20.0)  # these do not see the left tip
    straight, once = length(source, x), length(source, left, x)
    twice = length(source, left, right, x)
    expected = np.where(is_hidden, np.where(is_beyond, twice, once), straight)
    assert is_beyond.sum() > 100
    assert (is_hidden & ~is_beyond).sum() > 10
    assert_allclose(distances(rings, source, x), expected, rtol=1e-14)


def test_through_a_winding_corridor():
    # Around the ends of the four walls in turn, each 2 thick, and half-way past the T.
    _, rings = domains.maze(500)
    source, end = np.array([-40.0, -10.0]), np.array([32.0, -40.0])
    before = np.array([(-31, -30), (-29, -30), (-11, 30), (-9, 30)], float)
    after = np.array([(9, -30), (11, -30), (29, 30), (31, 30)], float)
    free = length(source, *before, *after, end)
    assert_allclose(distances(rings[:1], source, end[None])[0], free, rtol=1e-14)
    left_of_it, right_of_it = np.array([(-6, 9), (-1, -15)]), np.array([(5, 11), (5, 9)])
    least = min(length(source, *before, *way, *after, end) for way in (left_of_it, right_of_it))
    assert_allclose(distances(rings, source, end[None])[0], least, rtol=1e-14)
    assert least > free + 1.0


def test_around_a_round_hole_paths_follow_it():
    # Opposite points at twice the radius: two tangents and the arc in between; the
    # polygon of n corners is shorter by its share, (pi/n)^2/6 of the arc, and no more.
    radius, n = 10.0, 400
    angle = -2.0 * np.pi * np.arange(n) / n
    hole = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    d = distances((SQUARE, hole), [-20.0, 0.0], np.array([[20.0, 0.0]]))[0]
    arc = radius * (np.pi - 2.0 * np.arccos(0.5))
    smooth = 2.0 * np.sqrt(300.0) + arc
    assert smooth - arc * (np.pi / n) ** 2 < d < smooth


@pytest.mark.parametrize("name", ["slit", "star holes", "maze", "round holes"])
def test_the_distance_is_a_metric_no_shorter_than_the_line(name):
    _, rings = domains.CASES[name].make(500)
    x = some_points(rings, 20, 55)
    d = np.array([distances(rings, source, x) for source in x])
    straight = np.linalg.norm(x[:, None] - x, axis=2)
    assert_allclose(d, d.T, rtol=1e-13)
    assert (np.diagonal(d) == 0.0).all()
    assert (d >= straight * (1.0 - 1e-14)).all()
    assert (d > straight * 1.001).mean() > 0.05  # some paths do bend
    assert (d[:, :, None] + d[None] >= d[:, None] * (1.0 - 1e-13)).all()  # d_ij + d_jk >= d_ik


def test_with_fewer_obstacles_paths_are_no_longer():
    _, rings = domains.round_holes(500)
    x, source = some_points(rings, 200, 56), np.array([-48.0, -45.0])
    longer = distances(rings, source, x)
    for n_rings in range(len(rings) - 1, 0, -1):
        d = distances(rings[:n_rings], source, x)
        assert (d <= longer * (1.0 + 1e-14)).all()
        longer = d
    assert_allclose(longer, np.linalg.norm(x - source, axis=1), rtol=1e-15)  # none is left


def test_shortest_paths_agree_with_a_fine_graph_of_points():
    # The slow twin knows neither corners nor crossings: steps of up to 10 between random
    # points, allowed where 40 points in between lie inside.  Paths get longer by bends only.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    _, rings = domains.star_holes(500)
    x = some_points(rings, 1500, 57)
    i, j = cKDTree(x).query_pairs(10.0, output_type="ndarray").T
    share = np.linspace(0.0, 1.0, 42)[1:-1, None, None]
    between = (x[i] + share * (x[j] - x[i])).reshape(-1, 2)
    free = contains(rings, between).reshape(40, -1).all(axis=0)
    steps = np.linalg.norm(x[i] - x[j], axis=1)[free]
    graph = coo_matrix((steps, (i[free], j[free])), shape=(len(x), len(x)))
    rough = dijkstra(graph, directed=False, indices=0)
    d = distances(rings, x[0], x)
    far = d > 10.0
    # 0.02 is room for corners that a step cuts between two of its 40 points.
    assert (rough > d - 0.02)[far].all()
    # A few points sit at the bottom of a narrow valley, which the graph hardly enters.
    assert np.median(rough[far] / d[far]) < 1.02
    assert np.quantile(rough[far] / d[far], 0.98) < 1.1


# ---------------------------------------------------------------- sizes


def test_sizes_of_several_sources_are_the_least():
    _, rings = domains.maze(500)
    x, sources = some_points(rings, 300, 58), some_points(rings, 5, 59)
    sizes = np.array([1.0, 3.0, 2.0, 8.0, -1.0])
    cones = [u + G * distances(rings, s, x) for s, u in zip(sources, sizes, strict=True)]
    expected = np.min(cones, axis=0)
    assert_allclose(limited_sizes(rings, x, G, sources=sources, sizes=sizes), expected, rtol=1e-13)


@pytest.mark.parametrize("rise", [0.0, 2.0, -2.0, 20.0])
def test_a_segment_is_the_limit_of_its_points(rise):
    # 20 over a length of 40 is steeper than G: then the lower end alone counts.
    _, rings = domains.star_holes(500)
    x = some_points(rings, 200, 60)
    segment, sizes = np.array([[-45.0, -40.0], [-45.0, 0.0]]), np.array([5.0, 5.0 + rise])
    share = np.linspace(0.0, 1.0, 401)[:, None]
    dense = limited_sizes(
        rings,
        x,
        G,
        sources=segment[0] + share * (segment[1] - segment[0]),
        sizes=sizes[0] + share[:, 0] * rise,
    )
    exact = limited_sizes(rings, x, G, segments=segment[None], segment_sizes=sizes[None])
    assert (exact <= dense + 1e-13).all()
    # Points 0.1 apart: at distance D off by up to G 0.05^2/(2D) and, at no distance, G 0.05.
    # D is that of x, or of the corner at which the path to it bends first: those are 8 off.
    off = np.minimum(np.abs(x[:, 0] + 45.0), 8.0 - 1e-9)
    assert (dense - exact <= G * 0.05 / np.maximum(1.0, 2.0 * off / 0.05) + 1e-13).all()


def test_a_leaking_slit_would_be_seen():
    mesh, rings, h0, faces, sizes = domains.leaking_slit(3000)
    exact = limited_sizes(rings, mesh.points, G, segments=faces, segment_sizes=sizes)
    x, y = mesh.points.T
    left, right = (np.isfinite(h0) & (h0 == size) for size in (1.0, 8.0))
    assert left.sum() == right.sum() > 30
    assert (exact[left] == 1.0).all()
    # Along the right face from the left tip: 1 + G (0.5 + s) until that exceeds 8.
    assert_allclose(exact[right], np.minimum(8.0, 1.0 + G * (0.5 + y[right] + 20.0)), rtol=1e-14)
    beside = (x < -0.25) & (y > -20.0)
    assert_allclose(exact[beside], 1.0 + G * (-0.25 - x[beside]), rtol=1e-14)
    # A rule that ignores the slit gives 1 + G (x + 0.25) to the right of it, 6.85 too little.
    assert (exact - (1.0 + G * (x + 0.25)))[(x > 0.0) & (y > 20.0)].max() > 6.8


def test_linear_boundary_data_are_exact_and_converge_to_smooth_ones():
    errors = []
    for n in (500, 2000):
        mesh, rings = domains.disc(n, radius=30.0)
        ring, k = rings[0], len(rings[0])
        u = domains.disc_data(2.0 * np.pi * np.arange(k) / k)
        segments = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        ends = np.column_stack([u, np.roll(u, -1)])
        exact = limited_sizes(rings, mesh.points, G, segments=segments, segment_sizes=ends)
        share = np.linspace(0.0, 1.0, 101)
        places = (segments[:, :1] + share[:, None] * (segments[:, 1:] - segments[:, :1])).reshape(
            -1, 2
        )
        values = (ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])).ravel()
        some = mesh.points[::7]
        away = np.linalg.norm(some[:, None] - places, axis=2)
        brute = (values + G * away).min(axis=1)
        gap = 2.0 * np.pi * 30.0 / k / 100.0
        assert (brute - exact[::7] >= -1e-13).all()
        assert (brute - exact[::7] <= G * gap).all()
        smooth = curve_sizes(circle(30.0), domains.disc_data, (0.0, 2.0 * np.pi), mesh.points, G)
        errors.append(np.abs(exact - smooth).max())
    # Chords of smooth data on a smooth curve: second order (the spacing halves).
    assert errors[0] < 0.05
    assert errors[1] < 0.35 * errors[0], errors


def circle(radius):
    return lambda s: radius * np.column_stack([np.cos(s), np.sin(s)])


def test_a_curve_of_constant_size_gives_the_distance_to_it():
    x = np.random.default_rng(61).uniform(-20.0, 20.0, (300, 2))
    sizes = curve_sizes(circle(30.0), lambda s: np.full(len(s), 2.0), (0.0, 2.0 * np.pi), x, G)
    assert_allclose(sizes, 2.0 + G * (30.0 - np.hypot(*x.T)), rtol=1e-13)


def test_a_function_of_one_variable_is_cut_where_its_slope_is_g():
    # s^2 is steeper than g from s = g/2 on: there the tangent g s - g^2/4 takes over.
    x = np.linspace(-1.0, 1.0, 401)[:, None]
    h = curve_sizes(lambda s: s[:, None], lambda s: s**2, (-1.0, 1.0), x, G)
    size = np.abs(x[:, 0])
    assert_allclose(h, np.where(size < G / 2, size**2, G * size - G**2 / 4), atol=1e-13)


def test_of_many_valleys_the_deepest_is_found():
    # 1 + cos(8 s), valleys at odd multiples of pi/8; at (0, 0) all are equal, beside it one wins.
    x = np.random.default_rng(62).uniform(-10.0, 10.0, (20, 2))
    h = curve_sizes(circle(30.0), lambda s: 1.0 + np.cos(8.0 * s), (0.0, 2.0 * np.pi), x, 0.01)
    s = np.linspace(0.0, 2.0 * np.pi, 100_001)
    places, values = circle(30.0)(s), 1.0 + np.cos(8.0 * s)
    brute = [(values + 0.01 * np.linalg.norm(p - places, axis=1)).min() for p in x]
    assert_allclose(h, brute, atol=4e-8)  # (2 pi/2e5)^2 times a curvature of 64, halved: 3.2e-8


def test_rings_are_limited_by_the_points_of_their_disc():
    mesh, _ = domains.disc(3000)
    x, r = mesh.points, np.linalg.norm(mesh.points, axis=1)
    exact = radial_sizes(domains.disc_field, 50.0, x, G)
    assert 0.5 < (exact < domains.disc_field(r) - 1e-12).mean() < 0.95
    rng = np.random.default_rng(65)
    y = 50.0 * np.sqrt(rng.random(200_000))[:, None] * circle(1.0)(rng.uniform(0, 7, 200_000))
    field = domains.disc_field(np.linalg.norm(y, axis=1))
    for place, size in zip(x[::150], exact[::150], strict=True):
        brute = (field + G * np.linalg.norm(place - y, axis=1)).min()
        # The nearest of 25 random points per unit of area is hardly farther than 0.5.
        assert size <= brute < size + 0.59 * 0.5
    h = limit_gradient(mesh, domains.disc_field(r), G, method="fast-marching")
    assert np.abs(h - exact).max() < 0.25


# ---------------------------------------------------------------- space


def test_over_a_wall_the_bends_are_where_the_sum_of_lengths_is_least():
    rings = (domains.slit_polygon(2.0, 0.0),)
    rng = np.random.default_rng(63)
    a = np.column_stack([rng.uniform(-40, -2, 8), rng.uniform(5, 45, 8), rng.uniform(-40, 40, 8)])
    b = np.column_stack([rng.uniform(2, 40, 8), rng.uniform(5, 45, 8), rng.uniform(-40, 40, 8)])
    for source, x in zip(a, b, strict=True):

        def along(z, source=source, x=x):
            return length(source, np.array([-1.0, 0.0, z[0]]), np.array([1.0, 0.0, z[1]]), x)

        brute = minimize(along, [source[2], x[2]], method="Nelder-Mead", options={"xatol": 1e-8})
        exact = prism_sizes(rings, x[None], 1.0, source[None], [0.0])[0]
        assert exact <= brute.fun * (1.0 + 1e-14)
        assert_allclose(exact, brute.fun, rtol=1e-9)


def test_past_the_wall_lines_are_straight():
    rings = (domains.slit_polygon(2.0, 0.0),)
    x = np.random.default_rng(64).uniform(-50.0, 0.0, (100, 3))  # y < 0
    source = np.array([[30.0, -20.0, 40.0]])
    assert_allclose(
        prism_sizes(rings, x, G, source, [2.0]),
        2.0 + G * np.linalg.norm(x - source, axis=1),
        rtol=1e-14,
    )


WINDOW = (2.0, (-20.0, -8.0), (10.0, 16.0))


def beside_the_wall(n, seed, sign):
    x = np.random.default_rng(seed).uniform(-45.0, 45.0, (n, 3))
    x[:, 0] = sign * (1.0 + np.abs(x[:, 0]))
    return x


def test_through_a_window_the_bends_are_where_the_sum_of_lengths_is_least():
    # The twin minimises over the four coordinates at once, by quadratic programs.
    _, lower, upper = WINDOW
    bounds = [(lower[0], upper[0]), (lower[1], upper[1])] * 2
    bends = set()
    x = beside_the_wall(12, 67, 1.0)
    for a in beside_the_wall(3, 66, -1.0):

        def through(v, b, a=a):
            p, q = (-1.0, v[0], v[1]), (1.0, v[2], v[3])
            return dist(a, p) + dist(p, q) + dist(q, b)

        exact = window_sizes(WINDOW, x, 1.0, a[None], [0.0])
        for b, least in zip(x, exact, strict=True):
            brute = minimize(
                through, np.zeros(4), (b,), "SLSQP", bounds=bounds, options={"ftol": 1e-14}
            )
            assert_allclose(least, brute.fun, rtol=1e-7)
            assert least <= brute.fun * (1.0 + 1e-13)
            bends.add(sum(lo < v < up for v, (lo, up) in zip(brute.x, bounds, strict=True)))
    assert bends >= {0, 2, 4}  # at two corners; over two edges; straight on


def test_lengths_through_a_window_are_a_metric():
    x = np.concatenate([beside_the_wall(5, 68, -1.0), beside_the_wall(5, 69, 1.0)])
    d = np.array([window_sizes(WINDOW, x, 1.0, a[None], [0.0]) for a in x])
    straight = np.linalg.norm(x[:, None] - x, axis=2)
    assert_allclose(d, d.T, rtol=1e-13)
    assert (d >= straight * (1.0 - 1e-14)).all()
    assert (d[:5, :5] == straight[:5, :5]).all()
    assert (d[:5, 5:] > 1.001 * straight[:5, 5:]).mean() > 0.3
    assert (d[:, :, None] + d[None] >= d[:, None] * (1.0 - 1e-13)).all()
    # Over a point within the window no path is shorter, and none is but through some such point.
    inside = np.random.default_rng(70).uniform((-1, -20, -8), (1, 10, 16), (5000, 3))
    to_left, to_right = (
        np.array([window_sizes(WINDOW, inside, 1.0, a[None], [0.0]) for a in some])
        for some in (x[:5], x[5:])
    )
    over = (to_left[:, None] + to_right).min(axis=2)
    assert (over >= d[:5, 5:] * (1.0 - 1e-13)).all()
    assert (over <= d[:5, 5:] + 1.0).all()


def test_a_window_as_high_as_the_wall_is_a_slit():
    # Seen from far within its height only the edges along z count: those of a slab with a gap.
    rings = (domains.slit_polygon(2.0, 0.0),)
    a, b = beside_the_wall(3, 71, -1.0), beside_the_wall(50, 72, 1.0)
    window = (2.0, (-1e6, -1e6), (0.0, 1e6))
    for source in a:
        assert_allclose(
            window_sizes(window, b, G, source[None], [1.0]),
            prism_sizes(rings, b, G, source[None], [1.0]),
            rtol=1e-12,
        )


# ---------------------------------------------------------------- meshes


@pytest.mark.parametrize("n", [700, 3000])
@pytest.mark.parametrize(
    "make",
    [
        domains.slit_square,
        lambda n: domains.slit_square(n, width=0.5),
        domains.star_holes,
        domains.maze,
        domains.round_holes,
        domains.disc,
    ],
)
def test_the_mesh_fills_the_polygon_exactly(make, n):
    mesh, rings = make(n)
    assert 0.85 * n < mesh.n_points < 1.15 * n
    check_boundary(mesh, area(rings), perimeter(rings))
    corners = np.concatenate(rings)
    nearest = np.abs(mesh.points[:, None] - corners).max(axis=2).min(axis=0)
    assert (nearest == 0.0).all()
    assert contains(rings, mesh.points[mesh.cells].mean(axis=1)).all()
    # No cell is bad enough to be a riddle of its own, but many are obtuse.
    assert mesh.measures.min() > 1e-4 * mesh.measures.mean()


def test_the_tetrahedra_fill_the_box_around_the_wall_exactly():
    mesh, rings = domains.wall_box(2000)
    assert 1700 < mesh.n_points < 2500
    check_boundary(mesh, 100.0 * area(rings), 100.0 * perimeter(rings) + 2.0 * area(rings))
    corners = [[x, y, z] for x, y in rings[0] for z in (-50.0, 50.0)]
    assert all((mesh.points == corner).all(axis=1).any() for corner in corners)
    assert contains(rings, mesh.points[mesh.cells].mean(axis=1)[:, :2]).all()


def test_the_tetrahedra_fill_the_box_around_the_window_exactly():
    mesh, (width, lower, upper) = domains.window_box(2000)
    assert (width, lower, upper) == WINDOW
    high, deep = np.subtract(upper, lower)
    wall = 100.0**2 - high * deep
    sides = 6.0 * 100.0**2 - 4.0 * 100.0 * width
    check_boundary(mesh, 100.0**3 - width * wall, sides + 2.0 * wall + 2.0 * width * (high + deep))
    x, y, z = mesh.points[mesh.cells].mean(axis=1).T
    open_here = (y > lower[0]) & (y < upper[0]) & (z > lower[1]) & (z < upper[1])
    assert ((np.abs(x) > 1.0) | open_here).all()
    corners = [[x, y, z] for x in (-1, 1) for y in (-20, 10) for z in (-8, 16)]
    assert all((mesh.points == corner).all(axis=1).any() for corner in corners)


def check_boundary(mesh, measure, boundary_measure):
    # A cell across the boundary would change the one sum, a crack inside the other.
    assert_allclose(mesh.measures.sum(), measure, rtol=1e-12)
    assert_allclose(mesh.boundary().mesh.measures.sum(), boundary_measure, rtol=1e-12)
    assert mesh.facet_cell_counts.max() == 2
    assert len(np.unique(mesh.cells)) == mesh.n_points


def test_meshes_are_the_same_every_time():
    for make in (domains.slit_square, domains.wall_box):
        a, b, c = make(700)[0], make(700)[0], make(700, seed=2001)[0]
        assert (a.points == b.points).all()
        assert (a.cells == b.cells).all()
        assert not np.array_equal(a.points, c.points)


# ---------------------------------------------------------------- the limiter and its reference


@pytest.mark.parametrize("name", domains.CASES)
def test_marching_converges_to_the_reference(name):
    # Two independent ways to the same sizes.  Exact ones near the sources, whose tips would
    # cost a logarithm; the corners that paths bend at still do.  Spacing 2.07 (1.8) times finer.
    case, means = domains.CASES[name], []
    for n in (700, 5000) if name in ("wall", "window") else (700, 3000):
        mesh, domain = case.make(n)
        _, nodes = domains.point_sources(mesh, case.places, case.sizes)
        exact = case.exact(domain, mesh.points, G, mesh.points[nodes], case.sizes)
        away = np.linalg.norm(mesh.points[:, None] - mesh.points[nodes], axis=2).min(axis=1)
        h0 = np.where(away < (10.0 if mesh.dim == 2 else 20.0), exact, np.inf)
        error = limit_gradient(mesh, h0, G, method="fast-marching") - exact
        assert error.min() > -0.1  # linear interpolation where two fronts meet
        means.append(error.mean())
    assert means[0] < 1.0
    assert means[1] < (0.6 if mesh.dim == 2 else 0.65) * means[0], means


def test_point_sources_are_the_nearest_nodes():
    mesh = SimplexMesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])
    h0, nodes = domains.point_sources(mesh, [(0.9, 0.2), (0.1, 0.7)], (2.0, 3.0))
    assert nodes.tolist() == [1, 2]
    assert h0.tolist() == [np.inf, 2.0, 3.0]
