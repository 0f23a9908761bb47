"""Limiting problems with known solutions, for benchmarks/limiting.py.

The domains that are not convex, and what is exact in them, are those of the tests.
"""

import sys
from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _timing import G, model_bound, model_exact, model_grid
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from adaptsize import CartesianGrid, SimplexMesh
from adaptsize.limiting import Exact, FastMarching
from adaptsize.typing import FloatArray

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
import curved_shapes
import domains
import geodesics
import meshes

EVERYWHERE = slice(None)
# References by search are computed at so many nodes at most.
_SAMPLE = 4000
_FEW = 300


class Problem(NamedTuple):
    """What is limited, and what should come out at some of the nodes."""

    background: SimplexMesh | CartesianGrid
    h0: FloatArray
    nodes: Any
    exact: FloatArray
    g: Any = G


class Series(NamedTuple):
    """A problem on meshes of different sizes."""

    make: Callable[[int], Problem]
    """``make(n)`` on about n nodes."""
    sizes: tuple[int, ...]
    methods: dict[str, dict[str, Any]]


def named(*methods):
    """Return the options of methods that need no others."""
    return {name: {"method": name} for name in methods}


BOTH = named("fast-marching", "exact")
ALL = named("fast-marching", "exact", "auto")
NODES = {
    "fast-marching": {"method": "fast-marching"},
    "exact": {"method": Exact(face_sources=False)},
}
PERIODIC = {
    name: {"method": name, "periodic": 100.0 * np.eye(2)} for name in ("fast-marching", "exact")
}
OTHERS = named("edge-based", "positive-coefficient")
ON_GRIDS = {
    **named("edge-based", "fast-marching", "exact"),
    "fast-marching, order 2": {"method": FastMarching(order=2)},
}


def jittered_grid(n_side, dim, share):
    """Return the points of a grid on (-50, 50)^dim, the inner ones moved."""
    rng = np.random.default_rng(20050711)
    axis = np.linspace(-50.0, 50.0, n_side)
    points = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    spacing = axis[1] - axis[0]
    inner = (np.abs(points) < 50.0 - 0.5 * spacing).all(axis=1)
    points[inner] += rng.uniform(-share, share, (int(inner.sum()), dim)) * spacing
    return points


def jittered_triangles(n):
    """Return Delaunay triangles of a grid on (-50, 50)^2 moved by up to 0.3 cells."""
    points = jittered_grid(round(n**0.5), 2, 0.3)
    return SimplexMesh(points, Delaunay(points).simplices)


def random_triangles(n):
    """Return Delaunay triangles of random points in (-50, 50)^2, evenly spaced on its sides.

    With none on the sides cells as long as the square lie along them.
    """
    n_side = round(n**0.5)
    side = np.linspace(-50.0, 50.0, n_side + 1)[:-1]
    low = np.full(n_side, -50.0)
    edge = np.concatenate(
        [np.column_stack(xy) for xy in ((side, low), (-low, side), (-side, -low), (low, -side))]
    )
    inner = np.random.default_rng(20050712).uniform(-50.0, 50.0, (n - len(edge), 2))
    points = np.concatenate([edge, inner])
    return SimplexMesh(points, Delaunay(points).simplices)


def jittered_tetrahedra(n):
    """Return points of a grid on (-50, 50)^3 moved by up to 0.15 cells, each cube cut in six.

    Not Delaunay: for a million points on a grid that takes a quarter of an hour.
    """
    n_side = round(n ** (1.0 / 3.0))
    node = np.arange(n_side**3).reshape(n_side, n_side, n_side)
    cells = []
    for way in permutations(range(3)):  # from one corner to the opposite one, axis by axis
        corner = np.zeros(3, int)
        path = []
        for step in (None, *way):
            if step is not None:
                corner[step] = 1
            block = tuple(slice(c, n_side - 1 + c) for c in corner)
            path.append(node[block].ravel())
        cells.append(np.column_stack(path))
    return SimplexMesh(jittered_grid(n_side, 3, 0.15), np.concatenate(cells))


def from_nodes(mesh, nodes, sizes):
    """Return the problem of sizes at nodes of a convex domain: formula (11) of the paper."""
    h0 = np.full(mesh.n_points, np.inf)
    h0[nodes] = sizes
    exact = h0.copy()
    for node, size in zip(nodes, sizes, strict=True):
        exact = np.minimum(
            exact, size + G * np.linalg.norm(mesh.points - mesh.points[node], axis=1)
        )
    return Problem(mesh, h0, EVERYWHERE, exact)


def two_sources(mesh):
    """Return the problem of section 6.2: 1 near (-10, 0), 5 near (10, 0)."""
    places = np.zeros((2, mesh.dim))
    places[:, 0] = -10.0, 10.0
    nodes = [int(np.argmin(np.linalg.norm(mesh.points - x, axis=1))) for x in places]
    return from_nodes(mesh, nodes, [1.0, 5.0])


def periodic_square(n):
    """Return the two sources near opposite corners of a square that repeats in both directions."""
    mesh = jittered_triangles(n)
    h0 = np.full(mesh.n_points, np.inf)
    exact = h0.copy()
    for place, size in (((-40.0, -45.0), 1.0), ((45.0, 30.0), 5.0)):
        node = int(np.argmin(np.linalg.norm(mesh.points - place, axis=1)))
        h0[node] = size
        for shift in np.stack(np.meshgrid(*[[-100.0, 0.0, 100.0]] * 2), axis=-1).reshape(-1, 2):
            away = np.linalg.norm(mesh.points - mesh.points[node] - shift, axis=1)
            exact = np.minimum(exact, size + G * away)
    return Problem(mesh, h0, EVERYWHERE, exact)


def many_sources(mesh, n_sources):
    """Return the problem of sizes between 1 and 3 at random nodes, no two of them neighbours."""
    rng = np.random.default_rng(20050713)
    order = rng.permutation(mesh.n_points)
    place = np.empty(mesh.n_points, int)
    place[order] = np.arange(mesh.n_points)
    n_tried = min(2 * n_sources, mesh.n_points)
    later = place[mesh.edges].max(axis=1)
    free = np.setdiff1d(np.arange(n_tried), later)[:n_sources]
    nodes = order[free]  # none has a neighbour before it
    return from_nodes(mesh, nodes, rng.uniform(1.0, 3.0, len(nodes)))


def on_grid(n):
    """Return the problem of section 6.2 on a grid of n nodes."""
    grid = model_grid(round(n ** (1.0 / 2.0)) - 1, 2)
    return Problem(
        grid, model_bound(grid), EVERYWHERE, model_exact(grid.points).reshape(grid.shape)
    )


def around_obstacles(name, n):
    """Return one of the domains of the tests with its point sources."""
    case = domains.CASES[name]
    mesh, domain = case.make(n)
    h0, nodes = domains.point_sources(mesh, case.places, case.sizes)
    exact = case.exact(domain, mesh.points, G, mesh.points[nodes], case.sizes)
    return Problem(mesh, h0, EVERYWHERE, exact)


def among_holes(n, n_holes, n_corners):
    """Return two point sources among regular holes."""
    mesh, rings = domains.holes(n, n_holes, n_corners)
    h0, nodes = domains.point_sources(mesh, [(-45.0, 45.0), (40.0, -30.0)], (1.0, 5.0))
    some = np.arange(0, mesh.n_points, max(1, mesh.n_points // _FEW))
    sources = (mesh.points[nodes], (1.0, 5.0))
    exact = geodesics.limited_sizes(rings, mesh.points[some], G, *sources)
    return Problem(mesh, h0, some, exact)


def between_walls(mesh, rings):
    """Return two point sources among obstacles."""
    h0, nodes = domains.point_sources(mesh, [(-45.0, 45.0), (40.0, -30.0)], (1.0, 5.0))
    some = _some(mesh.n_points)
    exact = geodesics.limited_sizes(rings, mesh.points[some], G, mesh.points[nodes], (1.0, 5.0))
    return Problem(mesh, h0, some, exact)


def around_star(n):
    """Return two point sources around a star of 500 corners."""
    star = domains._star((0.0, 0.0), 40.0, 34.0, 250, 0.1)
    square = domains._box(-50.0, 50.0, -50.0, 50.0)
    mesh = domains._triangulated((square, star), n, 20050718)
    h0, nodes = domains.point_sources(mesh, [(-45.0, 45.0), (40.0, -40.0)], (1.0, 5.0))
    some = np.arange(0, mesh.n_points, max(1, mesh.n_points // _FEW))
    sources = (mesh.points[nodes], (1.0, 5.0))
    exact = geodesics.limited_sizes((square, star), mesh.points[some], G, *sources)
    return Problem(mesh, h0, some, exact)


def without_reference(mesh):
    """Return two point sources in the largest component of a mesh, whose sizes are unknown."""
    label = connected_components(_graph(mesh.n_points, mesh.edges))[1]
    cells = mesh.cells[label[mesh.cells[:, 0]] == np.bincount(label[mesh.cells[:, 0]]).argmax()]
    used, number = np.unique(cells, return_inverse=True)
    mesh = SimplexMesh(mesh.points[used], number.reshape(-1, 3))
    h0, _ = domains.point_sources(mesh, [(-45.0, 45.0), (40.0, -30.0)], (1.0, 5.0))
    return Problem(mesh, h0, np.empty(0, np.int64), np.empty(0))


def _graph(n, edges):
    return coo_array((np.ones(len(edges)), edges.T), shape=(n, n))


def punched(n):
    """Return jittered triangles without every fifth one, at random."""
    mesh = jittered_triangles(n)
    kept = np.random.default_rng(20050716).random(mesh.n_cells) >= 0.2
    return without_reference(SimplexMesh(mesh.points, mesh.cells[kept]))


def cut_edges(n):
    """Return jittered triangles that are separated along 30 % of their edges, at random."""
    mesh = jittered_triangles(n)
    cells = mesh.cells.astype(np.int64)
    ends = np.concatenate([cells[:, [k, (k + 1) % 3]] for k in range(3)])
    corner = np.arange(cells.size).reshape(-1, 3)
    at = np.concatenate([corner[:, [k, (k + 1) % 3]] for k in range(3)])
    turned = ends[:, 0] > ends[:, 1]
    ends[turned], at[turned] = ends[turned][:, ::-1], at[turned][:, ::-1]
    order = np.lexsort(ends.T)
    ends, at = ends[order], at[order]
    first = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    first = first[np.random.default_rng(20050717).random(len(first)) >= 0.3]
    # Two triangles share the nodes of an edge that is whole.
    pairs = np.column_stack([at[first].ravel(), at[first + 1].ravel()])
    label = connected_components(_graph(cells.size, pairs))[1]
    points = np.empty((label.max() + 1, 2))
    points[label] = mesh.points[cells.ravel()]
    return without_reference(SimplexMesh(points, label.reshape(-1, 3)))


def coast(n):
    """Return the inside of a closed curve with waves of all lengths and 20 000 corners."""
    rng = np.random.default_rng(20050719)
    angle = np.linspace(0.0, 2.0 * np.pi, 200_001)
    radius = np.full(len(angle), 38.0)
    for k in range(1, 1500):
        radius += 6.0 / k**1.3 * np.cos(k * angle + rng.uniform(0.0, 2.0 * np.pi))
    curve = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], 20_001)[:-1]
    ring = np.column_stack([np.interp(at, along, x) for x in curve.T])
    return without_reference(domains._triangulated((ring,), n, 20050720))


def waves_in_a_cube(n):
    """Return smooth sizes at all nodes of tetrahedra, of slopes up to 0.59; nodes alone count."""
    mesh = jittered_tetrahedra(n)
    h0 = domains.disc_field(np.linalg.norm(mesh.points, axis=1))
    some = np.arange(0, mesh.n_points, max(1, mesh.n_points // _FEW))
    return Problem(mesh, h0, some, _by_brute_force(mesh.points, h0, mesh.points[some]))


def _by_brute_force(points, h0, places):
    """Return formula (11) of the paper at places, from bounds at points."""
    return np.array([(h0 + G * np.linalg.norm(points - x, axis=1)).min() for x in places])


def leaking_slit(n):
    """Return sizes 1 on one face of a slit of width 0.5, and 8 on the other.

    The bottom of the slit, on which linear data rise by 7 within 0.5, adds nothing for g < 14.
    """
    side, tip = 0.25, -20.0
    mesh, rings = domains.slit_square(n, width=2.0 * side, tip=tip, seed=1006)
    x, y = mesh.points.T
    h0 = np.full(mesh.n_points, np.inf)
    h0[(x == -side) & (y >= tip)], h0[(x == side) & (y >= tip)] = 1.0, 8.0
    faces = np.array([[[x, tip], [x, domains.HALF_WIDTH]] for x in (-side, side)])
    sizes = np.array([[1.0, 1.0], [8.0, 8.0]])
    exact = geodesics.limited_sizes(rings, mesh.points, G, segments=faces, segment_sizes=sizes)
    return Problem(mesh, h0, EVERYWHERE, exact)


def disc_boundary(n):
    """Return sizes at the boundary of a disc, which count as linear between its nodes."""
    mesh, (ring,) = domains.disc(n)
    some = _some(mesh.n_points)

    def data(points):
        return 5.0 + 4.0 * np.sin(3.0 * np.arctan2(*points.T[::-1]))

    h0 = np.full(mesh.n_points, np.inf)
    at_edge = _nodes_at(mesh, ring)
    h0[at_edge] = data(mesh.points[at_edge])
    sizes = data(ring)
    exact = geodesics.limited_sizes(
        (ring,),
        mesh.points[some],
        G,
        segments=np.stack([ring, np.roll(ring, -1, axis=0)], axis=1),
        segment_sizes=np.column_stack([sizes, np.roll(sizes, -1)]),
    )
    return Problem(mesh, h0, some, exact)


def disc_everywhere(n):
    """Return smooth sizes at all nodes of a disc, of slopes up to 0.59, compared to the smooth."""
    mesh, _ = domains.disc(n)
    some = _some(mesh.n_points)
    radii = np.linalg.norm(mesh.points, axis=1)
    # The nearest point at another radius is on the same ray.
    exact = geodesics.line_sizes(domains.disc_field, (0.0, domains.HALF_WIDTH), radii[some], G)
    return Problem(mesh, domains.disc_field(radii), some, exact)


def noise(n):
    """Return random sizes at all nodes, compared to formula (11) for the nodes alone."""
    mesh = jittered_triangles(n)
    h0 = np.random.default_rng(20050714).uniform(1.0, 3.0, mesh.n_points)
    some = _some(mesh.n_points)
    return Problem(mesh, h0, some, _by_brute_force(mesh.points, h0, mesh.points[some]))


def smooth_limit(n):
    """Return two sources under g = 1 / (3.58 + .023 (x + y)), .17 to .78: rays are arcs."""
    points = jittered_grid(round(n**0.5), 2, 0.3)
    places, least = np.array([[-10.0, 0.0], [10.0, 0.0]]), np.array([1.0, 5.0])
    nodes = [int(np.argmin(np.linalg.norm(points - x, axis=1))) for x in places]
    points[nodes] = places
    mesh = SimplexMesh(points, Delaunay(points).simplices)
    h0 = np.full(len(points), np.inf)
    h0[nodes] = least
    slope = np.array([0.023, 0.023])
    g = 1.0 / (3.58 + points @ slope)
    # The distance under a slowness with linear inverse, as known from seismic rays.
    away2 = ((points[:, None] - places) ** 2).sum(axis=2)
    rise = np.arccosh(1.0 + 0.5 * slope @ slope * away2 * g[:, None] * g[nodes])
    exact = (least + rise / np.sqrt(slope @ slope)).min(axis=1)
    return Problem(mesh, h0, EVERYWHERE, exact, g)


def on_prism(n, n_sources):
    """Return sizes from some nodes of the sides of a prism, whose nodes lie on a cylinder."""
    n_side = round(n**0.5)
    mesh, flat, around = curved_shapes.prism(n_side, n_side, 20050716)
    rng = np.random.default_rng(20050717)
    nodes = rng.choice(mesh.n_points, n_sources, replace=False)
    h0 = np.full(mesh.n_points, np.inf)
    h0[nodes] = rng.uniform(0.02, 0.1, n_sources)
    exact = np.full(mesh.n_points, np.inf)
    for node in nodes:
        away = curved_shapes.around_prism(flat, around, [node])[:, 0]
        exact = np.minimum(exact, h0[node] + G * away)
    return Problem(mesh, h0, EVERYWHERE, exact)


def sphere(n):
    """Return the size from one node of irregular triangles on a sphere of radius 50."""
    mesh = meshes.random_sphere(n, 20050715, radius=50.0)
    h0 = np.full(mesh.n_points, np.inf)
    h0[0] = 1.0
    unit = mesh.points / 50.0
    chord = np.minimum(np.linalg.norm(unit - unit[0], axis=1), 2.0)
    return Problem(mesh, h0, EVERYWHERE, 1.0 + G * 50.0 * 2.0 * np.arcsin(0.5 * chord))


def _some(n):
    """Return up to _SAMPLE of n nodes, evenly spread over their numbers."""
    return np.arange(0, n, max(1, n // _SAMPLE))


def _nodes_at(mesh, ring):
    """Return the nodes at the corners of a ring: the mesh has its boundary nodes first."""
    nodes = np.arange(len(ring))
    if not np.array_equal(mesh.points[nodes], ring):
        raise RuntimeError("the boundary nodes are not the first ones")
    return nodes


TRIANGLES = (10_000, 40_000, 160_000, 640_000)
HOLED = (11_000, 45_000, 180_000)
SERIES = {
    "two sources, jittered triangles": Series(
        lambda n: two_sources(jittered_triangles(n)), TRIANGLES, {**BOTH, **OTHERS}
    ),
    "two sources, random triangles": Series(
        lambda n: two_sources(random_triangles(n)), TRIANGLES, BOTH
    ),
    "200 sources, random triangles": Series(
        lambda n: many_sources(random_triangles(n), 200), (40_000,), BOTH
    ),
    "2000 sources, random triangles": Series(
        lambda n: many_sources(random_triangles(n), 2000), (40_000, 160_000), BOTH
    ),
    "two sources, tetrahedra": Series(
        lambda n: two_sources(jittered_tetrahedra(n)),
        (10_648, 29_791, 205_379, 1_000_000),
        {**BOTH, **OTHERS},
    ),
    "two sources, grid": Series(on_grid, (101**2, 801**2), ON_GRIDS),
    "two sources, periodic square": Series(periodic_square, (10_000, 40_000, 160_000), PERIODIC),
    "slit": Series(lambda n: around_obstacles("slit", n), HOLED, BOTH),
    "star holes": Series(lambda n: around_obstacles("star holes", n), HOLED, BOTH),
    "maze": Series(lambda n: around_obstacles("maze", n), HOLED, BOTH),
    "round holes": Series(lambda n: around_obstacles("round holes", n), HOLED, BOTH),
    "blocks": Series(lambda n: between_walls(*domains.blocks(n)), HOLED, BOTH),
    "6 holes of 40 corners": Series(lambda n: among_holes(n, 6, 40), (180_000,), BOTH),
    "6 holes of 200 corners": Series(lambda n: among_holes(n, 6, 200), (180_000,), BOTH),
    "100 holes of 24 corners": Series(lambda n: among_holes(n, 100, 24), (180_000,), BOTH),
    "250 holes of 12 corners": Series(lambda n: among_holes(n, 250, 12), HOLED, ALL),
    "spiral of 3 turns": Series(lambda n: between_walls(*domains.spiral(n)), HOLED, ALL),
    "spiral of 9 turns": Series(
        lambda n: between_walls(*domains.spiral(max(n, 11_000), turns=9)), HOLED, ALL
    ),
    "star of 500 corners": Series(around_star, HOLED, ALL),
    "archipelago, 200 islands of 100 corners": Series(
        lambda n: without_reference(domains.holes(n, 200, 100)[0]), (45_000, 180_000), ALL
    ),
    "coast line of 20 000 corners": Series(coast, (80_000,), ALL),
    "every fifth triangle punched out": Series(punched, (5_000, 20_000), ALL),
    "the same, larger": Series(punched, (80_000,), named("fast-marching", "auto")),
    "30 % of the edges cut": Series(cut_edges, (5_000, 10_000), ALL),
    "wall": Series(lambda n: around_obstacles("wall", n), (5_000, 15_000, 45_000), BOTH),
    "window": Series(lambda n: around_obstacles("window", n), (5_000, 15_000, 45_000), BOTH),
    "leaking slit": Series(leaking_slit, (6_800, 26_000), BOTH),
    "disc, data on its boundary": Series(disc_boundary, (9_000, 35_000, 140_000), BOTH),
    "disc, smooth field": Series(disc_everywhere, (10_000, 40_000, 160_000), BOTH),
    "smooth g(x)": Series(
        smooth_limit,
        (10_000, 40_000, 160_000),
        named("fast-marching"),
    ),
    "sphere": Series(
        sphere,
        (2_500, 10_000, 40_000),
        {**named("fast-marching"), "exact": {"method": "great circles"}},
    ),
    "prism, one source": Series(lambda n: on_prism(n, 1), (10_000, 40_000), BOTH),
    "prism, 200 sources": Series(lambda n: on_prism(n, 200), (10_000, 40_000), NODES),
    "noise": Series(noise, (10_000, 40_000, 160_000), BOTH),
    "tetrahedra, smooth field, nodes": Series(waves_in_a_cube, (59_319,), NODES),
}
