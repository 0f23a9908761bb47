"""Exact limiting of nodal bounds in domains of the plane that are not convex.

The reference is the visibility graph of `exact_oracle`.
"""

import domains
import numpy as np
import pytest
from exact_oracle import plane_domain, plane_sizes, straight_sizes
from meshes import jittered_square, random_square, slit_square, structured_square

from adaptsize import SimplexMesh, limit_gradient
from adaptsize.limiting import Exact

G = 0.3

#: Sizes are up to 60; lines that touch a corner are recognised to 1e-11 of the extent.
TOLERANCE = 1e-9

#: Two sources far apart, three such that their regions meet within the domain, and more.
PLACES = {
    "one": ([(-45, 45)], (1.0,)),
    "two": ([(-45, 45), (45, -45)], (1.0, 5.0)),
    "five": ([(-46, -46), (46, 46), (2, 46), (-46, 3), (46, -30)], (2.0, 1.0, 4.0, 3.0, 6.0)),
}
SHAPES = {
    "slit": domains.slit_square,
    "blocks": domains.blocks,
    "maze": domains.maze,
    "spiral": domains.spiral,
    "L": domains.l_shape,
    "star holes": domains.star_holes,
    "6 holes of 40 corners": lambda n, seed: domains.holes(n, 6, 40, seed=seed),
    "6 holes of 400 corners": lambda n, seed: domains.holes(n, 6, 400, seed=seed),
    "100 holes of 24 corners": lambda n, seed: domains.holes(n, 100, 24, seed=seed),
}


def limit(mesh, h0, g=G, **options):
    return limit_gradient(mesh, h0, g, method=Exact(face_sources=False, **options))


def assert_exact(mesh, h0, g=G, nodes=None):
    """Compare with the visibility graph, at all nodes or some; return how many are off."""
    h = limit(mesh, h0, g)
    nodes = np.arange(mesh.n_points) if nodes is None else nodes
    exact = plane_sizes(plane_domain(mesh), h0, g, nodes)
    assert np.array_equal(np.isinf(h[nodes]), np.isinf(exact))
    finite = np.isfinite(exact)
    error = h[nodes][finite] - exact[finite]
    n_off = np.count_nonzero(np.abs(error) > TOLERANCE)
    assert n_off == 0, f"{n_off} of {len(error)} nodes are off, from {error.min()} to {error.max()}"
    return h


@pytest.mark.parametrize("places", PLACES)
@pytest.mark.parametrize("name", SHAPES)
def test_sizes_from_points_are_exact(name, places):
    mesh, _ = SHAPES[name](4000, seed=2214)
    h0, _ = domains.point_sources(mesh, *PLACES[places])
    h = assert_exact(mesh, h0)
    assert (h > straight_sizes(mesh.points, h0, G) + 0.1).any() or name == "L"


@pytest.mark.parametrize("bounds", ["a third", "noise", "field"])
@pytest.mark.parametrize("name", SHAPES)
def test_bounds_at_many_nodes_are_exact(name, bounds):
    mesh, _ = SHAPES[name](2500, seed=2217)
    rng = np.random.default_rng(2218)
    if bounds == "field":
        h0 = 14.0 + 4.0 * np.sin(mesh.points @ (rng.normal(size=(2, 3)) * 0.2)).sum(axis=1)
    else:
        h0 = random_bounds(mesh, rng, 0.03 if bounds == "a third" else 1.0)
    h = assert_exact(mesh, h0)
    assert (h < h0).any()


def test_every_node_of_the_plane_is_proved():
    mesh, _ = domains.maze(2000, seed=2223)
    h0, _ = domains.point_sources(mesh, *PLACES["two"])
    _, info = limit_gradient.with_info(mesh, h0, G, method=Exact(face_sources=False))
    assert info.n_proved == mesh.n_points
    assert info.largest_gap == 0.0


def random_bounds(mesh, rng, share):
    h0 = np.where(rng.random(mesh.n_points) < share, rng.uniform(1.0, 20.0, mesh.n_points), np.inf)
    h0[rng.choice(np.unique(mesh.cells))] = 1.0
    return h0


def with_holes_of_cells(seed):
    """Return a square of 60 to 200 nodes without 1 to 20 of its triangles, some at one node."""
    rng = np.random.default_rng(seed)
    if seed % 2:
        mesh = jittered_square(int(rng.integers(8, 15)), seed)
    else:
        mesh = random_square(int(rng.integers(60, 200)), seed, half_width=50.0)
    return domains.with_removed_cells(mesh, seed, int(rng.integers(1, 20)), pinched=seed % 3 > 0)


@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
def test_sizes_around_holes_of_one_triangle_are_exact(share):
    n_bent = 0
    for seed in range(3000, 3100):
        mesh, _ = with_holes_of_cells(seed)
        h0 = random_bounds(mesh, np.random.default_rng(seed), share)
        h = assert_exact(mesh, h0)
        n_bent += np.count_nonzero(h > straight_sizes(mesh.points, h0, G) + TOLERANCE)
    assert n_bent > 100


def test_holes_in_slits_and_slits_between_holes():
    # Doubled nodes along y = 0, x > 0, and triangles out of the rest.
    for seed in range(2225, 2235):
        mesh, _ = domains.with_removed_cells(slit_square(8), seed, 8)
        h0 = 0.02 * random_bounds(mesh, np.random.default_rng(seed), 0.1)
        assert_exact(mesh, h0)


def cut_along(mesh, is_cut):
    """Double the nodes at edges so that cells are joined through the other edges only."""
    cells, points = mesh.cells.copy(), mesh.points.tolist()
    edges = {tuple(e) for e in mesh.edges[is_cut].tolist()}
    for node in np.unique(mesh.edges[is_cut]).tolist():
        around = np.flatnonzero((mesh.cells == node).any(axis=1)).tolist()
        fans = []
        while around:
            fan = [around.pop()]
            for cell in fan:
                for other in list(around):
                    shared = set(mesh.cells[cell].tolist()) & set(mesh.cells[other].tolist())
                    if len(shared) == 2 and tuple(sorted(shared)) not in edges:
                        around.remove(other)
                        fan.append(other)
            fans.append(fan)
        for fan in fans[1:]:
            rows = cells[fan]
            rows[mesh.cells[fan] == node] = len(points)
            cells[fan] = rows
            points.append(mesh.points[node].tolist())
    return SimplexMesh(points, cells)


@pytest.mark.parametrize("seed", range(2231, 2237))
def test_sizes_around_bent_slits_of_no_width_are_exact(seed):
    mesh = structured_square(10, half_width=5.0)
    rng = np.random.default_rng(seed)
    is_cut = np.zeros(len(mesh.edges), bool)
    ways = {(0, 1), (1, 0), (1, 1)}
    for _ in range(4):  # random walks along the edges, away from the boundary
        place = rng.integers(-3, 4, 2).astype(float)
        for _ in range(4):
            step = np.array(list(ways)[rng.integers(3)]) * rng.choice([-1, 1])
            ends = [np.argmin(np.abs(mesh.points - p).sum(axis=1)) for p in (place, place + step)]
            if (np.abs(place + step) < 4.0).all():
                is_cut |= (mesh.edges == np.sort(ends)).all(axis=1)
                place = place + step
    cut = cut_along(mesh, is_cut)
    inside = np.setdiff1d(np.arange(cut.n_points), cut.boundary().nodes)
    points = cut.points.copy()
    points[inside] += rng.uniform(-0.1, 0.1, (len(inside), 2))
    cut = SimplexMesh(points, cut.cells)
    for n_sources in (1, 6):
        h0 = np.full(cut.n_points, np.inf)
        h0[rng.choice(cut.n_points, n_sources, replace=False)] = rng.uniform(0.1, 1.0, n_sources)
        assert_exact(cut, h0)


def test_numbering_and_threads_do_not_matter():
    mesh, _ = SHAPES["6 holes of 40 corners"](3000, seed=2219)
    rng = np.random.default_rng(2220)
    h0 = random_bounds(mesh, rng, 0.05)
    h = limit(mesh, h0)
    assert all(np.array_equal(limit(mesh, h0, threads=threads), h) for threads in (1, 2, 3))
    old_of_new = rng.permutation(mesh.n_points)
    cells = np.argsort(old_of_new)[rng.permutation(mesh.cells)]
    other = SimplexMesh(mesh.points[old_of_new], cells)
    assert limit(other, h0[old_of_new]) == pytest.approx(h[old_of_new], rel=1e-13)
