"""Exact limiting on Cartesian grids with inactive nodes, against brute force.

The domain is the cubical complex of the active nodes: the nodes, edges, faces and boxes of which
all corners are active.  In space sizes go along the edges only of faces without a whole box.
"""

import warnings
from itertools import combinations

import geodesics
import numpy as np
import pytest
from domains import _box
from exact_on_grids import exact_sizes, fine_grid_sizes
from exact_oracle import straight_sizes
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, limit_gradient
from adaptsize.limiting import Exact
from adaptsize.limiting.exact import boxes

METHOD = "exact"
G = 0.3

#: Closed forms on both sides; sizes are up to 30.
TOLERANCE = 1e-12
PARTS = 4
#: Bends on edges in space at their best places: share of the nodes in small grids that may be
#: above paths that bend at nodes.
SHARE_ABOVE = 0.02


def limit(grid, h0, g=G, **options):
    return limit_gradient(grid, h0, g, method=Exact(**options))


def points_only(grid, nodes, sizes):
    h0 = np.full(grid.shape, np.inf)
    h0[tuple(np.transpose(nodes))] = sizes
    return h0


def random_problem(seed, dim):
    """Return a small grid, mostly with inactive nodes, and bounds at few or many nodes."""
    rng = np.random.default_rng(seed)
    shape = tuple(map(int, rng.integers(2, 7 if dim == 2 else 4, dim)))
    active = rng.random(shape) < rng.choice([0.7, 0.85, 0.95])
    h0 = 1.0 + rng.choice([0.3, 2.0]) * rng.random(shape)
    h0[rng.random(shape) > rng.choice([0.1, 0.4, 1.0])] = np.inf
    first = tuple(rng.integers(shape))
    active[first], h0[first] = True, 1.5
    grid = CartesianGrid(np.zeros(dim), rng.choice([0.5, 1.0, 1.7], dim), shape, active=active)
    return grid, h0


@pytest.mark.parametrize("face_sources", [False, True])
@given(seed=st.integers(0, 2**32 - 1))
def test_sizes_in_the_plane_are_those_of_the_definition(face_sources, seed):
    grid, h0 = random_problem(seed, 2)
    h = limit(grid, h0, face_sources=face_sources)
    exact = exact_sizes(grid.shape, grid.spacing, grid.active, h0, G, segments=face_sources)
    assert_allclose(h, exact, rtol=0.0, atol=TOLERANCE)  # inf where that is


def assert_in_space(seed, face_sources):
    """Compare with bends at nodes and on edges cut in 4; return how many are above the former."""
    grid, h0 = random_problem(seed, 3)
    h = limit(grid, h0, face_sources=face_sources)
    at_nodes = exact_sizes(grid.shape, grid.spacing, grid.active, h0, G, segments=False)
    assert_array_equal(np.isinf(h), np.isinf(at_nodes))
    reached = np.isfinite(h)
    fine = fine_grid_sizes(grid, h0, G, PARTS, segments=face_sources)
    # A bend is up to half a fine spacing s off: g s^2/8 times the curvatures of both ends.
    step = grid.spacing.max() / PARTS
    below = G * step**2 / 8.0 * 2.0 / grid.spacing.min()
    if face_sources:  # and a sample as well, by an eighth of a diagonal
        below += 2.0 * G * np.linalg.norm(grid.spacing) / (2 * PARTS)
    assert (h[reached] >= fine[reached] - below).all()
    if face_sources or not is_pure(grid.active):  # other diagonals; faces on which sizes turn
        return 0, 0
    return np.count_nonzero(h[reached] > at_nodes[reached] + TOLERANCE), np.count_nonzero(reached)


def is_pure(active):
    """Return whether every face of active nodes belongs to a box of active nodes."""
    boxes = np.ones([n - 1 for n in active.shape], bool)
    for corner in np.ndindex(2, 2, 2):
        boxes &= active[
            tuple(slice(c, n - 1 + c) for c, n in zip(corner, active.shape, strict=True))
        ]
    for axis in range(3):
        n = active.shape[axis]
        nodes, beside = np.moveaxis(active, axis, 0), np.moveaxis(boxes, axis, 0)
        faces = nodes[:, :-1, :-1] & nodes[:, 1:, :-1] & nodes[:, :-1, 1:] & nodes[:, 1:, 1:]
        covered = np.zeros_like(faces)
        covered[: n - 1] |= beside
        covered[1:] |= beside
        if (faces & ~covered).any():
            return False
    return True


@pytest.mark.parametrize("face_sources", [False, True])
def test_sizes_in_space_are_never_too_small_and_few_too_large(face_sources):
    counts = np.array([assert_in_space(seed, face_sources) for seed in range(60)])
    n_above, n = counts.T
    assert n_above.max() <= 2
    assert n.sum() > 100 or face_sources
    assert n_above.sum() <= SHARE_ABOVE * n.sum()


MIRRORED = [axes for n in range(4) for axes in combinations(range(3), n)]


def mirrored(grid, h0, axes):
    active = None if grid.active is None else np.flip(grid.active, axes).copy()
    return grid.with_active(active), np.flip(h0, axes).copy()


def test_a_grid_in_space_is_the_least_of_its_meshes():
    rng = np.random.default_rng(2602)
    grid = CartesianGrid(np.zeros(3), [0.5, 1.0, 0.8], (4, 6, 4))  # so all diagonals are mirrored
    h0 = 1.0 + rng.random(grid.shape)
    on_meshes = []
    for axes in MIRRORED:
        h = limit(grid.mesh, mirrored(grid, h0, axes)[1].ravel())
        on_meshes.append(np.flip(h.reshape(grid.shape), axes))
    assert_allclose(limit(grid, h0), np.min(on_meshes, axis=0), rtol=1e-13)
    assert (np.ptp(on_meshes, axis=0) > 1e-3).any()


@pytest.mark.parametrize("face_sources", [False, True])
@pytest.mark.parametrize("masked", [False, True])
def test_sizes_in_space_do_not_change_if_the_grid_is_mirrored(masked, face_sources):
    for seed in range(3):
        rng = np.random.default_rng(2610 + seed)
        shape = tuple(rng.integers(4, 7, 3))
        active = rng.random(shape) > 0.15 if masked else None
        grid = CartesianGrid(np.zeros(3), rng.uniform(0.5, 2.0, 3), shape, active=active)
        h0 = np.where(rng.random(shape) < (0.3, 1.0, 0.1)[seed], rng.uniform(0.1, 3, shape), np.inf)
        h0[np.nonzero(np.ones(shape) if active is None else active)[0][0]] = 0.3
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # parts without bounds
            h = limit(grid, h0, face_sources=face_sources)
            for axes in MIRRORED[1:]:
                other = limit(*mirrored(grid, h0, axes), face_sources=face_sources)
                assert_allclose(np.flip(other, axes), h, rtol=1e-12)


def test_edges_between_bounds_are_sources_whatever_the_other_corners_have():
    tetrahedra = boxes._TETRAHEDRA
    for pattern in range(1, 256):
        has = [v for v in range(8) if pattern >> v & 1]
        pairs = {(v, w) for t in tetrahedra[boxes._KEPT[pattern]] for v in t for w in t}
        assert {(v, w) for v in has for w in has if v ^ w in (0, 1, 2, 4)} <= pairs


def test_data_on_two_faces_have_no_short_cut_between_these():
    grid = CartesianGrid(np.zeros(3), 1.0, (2, 2, 3))
    h0 = np.full(grid.shape, 1.0)
    h0[1, 1] = np.inf  # an angle, seen along its edge
    h = limit(grid, h0)
    assert_allclose(h[1, 1], 1.0 + G)


@pytest.mark.parametrize("shape", [(14,), (8, 9)])
def test_segments_of_boxes_carry_linear_data_without_a_mask(shape):
    rng = np.random.default_rng(2601)
    spacing = rng.uniform(0.5, 1.5, len(shape))
    for active in (None, np.ones(shape, bool)):
        grid = CartesianGrid(np.zeros(len(shape)), spacing, shape, active=active)
        for share in (0.4, 1.0):
            h0 = np.where(rng.random(shape) < share, 1.0 + rng.random(shape), np.inf)
            everywhere = np.ones(shape, bool)
            exact = exact_sizes(shape, spacing, everywhere, h0, G, segments=True)
            assert_allclose(limit(grid, h0), exact, rtol=0.0, atol=TOLERANCE)
            nodes_only = straight_sizes(grid.points, h0.ravel(), G).reshape(shape)
            assert_allclose(limit(grid, h0, face_sources=False), nodes_only, rtol=1e-13)


def with_holes(shape, spacing, holes):
    """Return a grid with rectangular holes (node ranges, boundaries included) and its polygon."""
    active = np.ones(shape, bool)
    dx, dy = spacing
    rings = [_box(0.0, (shape[0] - 1) * dx, 0.0, (shape[1] - 1) * dy)]
    for i0, i1, j0, j1 in holes:
        active[i0 + 1 : i1, j0 + 1 : j1] = False
        rings.append(_box(i0 * dx, i1 * dx, j0 * dy, j1 * dy)[::-1])
    return CartesianGrid([0.0, 0.0], spacing, shape, active=active), tuple(rings)


HOLES = {
    "slit": [(6, 35, 19, 21)],
    "maze": [(4, 8, 2, 30), (10, 14, 6, 38), (18, 22, 2, 26), (24, 28, 10, 38), (30, 38, 18, 22)],
    "lattice": [(i, i + 3, j, j + 3) for i in range(3, 38, 5) for j in range(3, 38, 5)],
}


@pytest.mark.parametrize("n_sources", [1, 3, 200])
@pytest.mark.parametrize("name", HOLES)
def test_sizes_around_rectangles_are_the_geodesic_ones(name, n_sources):
    grid, rings = with_holes((41, 41), (1.0, 0.8), HOLES[name])
    rng = np.random.default_rng(2602)
    nodes = rng.permutation(np.argwhere(grid.active))[:n_sources]
    h0 = points_only(grid, nodes, rng.uniform(1.0, 4.0, n_sources))
    h = limit(grid, h0, face_sources=False)
    assert np.isinf(h[~grid.active]).all()
    points = grid.points[grid.active.ravel()]
    sizes = h0[tuple(nodes.T)]
    exact = geodesics.limited_sizes(rings, points, G, nodes * grid.spacing, sizes)
    assert_allclose(h[grid.active], exact, rtol=0.0, atol=TOLERANCE)
    assert all(
        np.array_equal(limit(grid, h0, face_sources=False, threads=threads), h)
        for threads in (1, 2, 3)
    )


def test_sizes_behind_a_wall_in_space_are_exact():
    # The wall |x| < 1/6, y < 0 of the box (-1, 1)^3: its end has two straight edges.
    grid = CartesianGrid([-1.0, -1.0, -1.0], 1.0 / 6.0, (13, 13, 13))
    x, y, _ = np.meshgrid(*grid.axes, indexing="ij")
    grid = grid.with_active((y >= -1e-12) | (np.abs(x) >= 1.0 / 6.0 - 1e-9))
    w = 1.0 / 6.0
    section = np.array([[-1, -1], [-w, -1], [-w, 0], [w, 0], [w, -1], [1, -1], [1, 1], [-1, 1]])
    nodes = np.array([[2, 2, 4], [9, 8, 10]])
    sizes = np.array([1.0, 1.4])
    h, info = limit_gradient.with_info(grid, points_only(grid, nodes, sizes), G, method=METHOD)
    active = grid.active.ravel()
    starts = grid.points[np.ravel_multi_index(tuple(nodes.T), grid.shape)]
    exact = geodesics.prism_sizes((section,), grid.points[active], G, starts, sizes)
    assert_allclose(h.ravel()[active], exact, rtol=0.0, atol=TOLERANCE)
    straight = (sizes + G * np.linalg.norm(grid.points[active][:, None] - starts, axis=2)).min(
        axis=1
    )
    gap = h.ravel()[active] - straight
    assert (gap > 0.05).mean() > 0.1
    assert 0 < info.n_proved <= np.count_nonzero(gap < 1e-12)
    assert info.largest_gap == pytest.approx(gap.max(), rel=1e-9)
