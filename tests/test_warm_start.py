"""Limiting again from an earlier solution: as a full solution, but for the work."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import domains
from adaptsize import CartesianGrid, LimitingInfo, Octree, SimplexMesh, limit_gradient
from meshes import jittered_cube, jittered_square, random_square, structured_square

G = 0.3
# Sequences end with values that went through up to 20 calls; marching compares to 1e-14 and
# paths of these meshes have some 30 nodes.
ROUNDING = 1e-12

PLANE = random_square(300, 20261)
SPACE = jittered_cube(5, 20262, half_width=1.0)
FLAT_GRID = CartesianGrid([0.0, 0.0], [0.1, 0.13], (17, 15))
BOX_GRID = CartesianGrid([0.0, 0.0, 0.0], 0.1, (6, 7, 8))
HOLED_GRID = CartesianGrid(
    [0.0, 0.0], 0.1, (17, 15), active=np.random.default_rng(20263).random((17, 15)) < 0.8
)
TREE = Octree.build(
    [0.0, 0.0], [2.0, 1.0], lambda c, s: np.abs(c[:, 0] - 0.7) < s[:, 0], max_level=4
)
TWO_PARTS = SimplexMesh(
    np.concatenate([PLANE.points, PLANE.points + 5.0]),
    np.concatenate([PLANE.cells, PLANE.cells + PLANE.n_points]),
)
BACKGROUNDS = {
    "plane": PLANE, "space": SPACE, "grid": FLAT_GRID, "box": BOX_GRID, "holed": HOLED_GRID,
    "octree": TREE, "two parts": TWO_PARTS,
}  # fmt: skip
CHANGES = ("lowered", "raised", "both", "to and from inf", "everything", "nothing")


def bounds(background, rng, share):
    """Return random bounds on a share of the nodes."""
    shape = background.nodal_shape
    h0 = np.where(rng.random(shape) < share, rng.uniform(0.01, 2.0, shape), np.inf)
    h0.flat[first_node(background)] = 0.7
    return h0


def first_node(background):
    active = getattr(background, "active", None)
    return 0 if active is None else int(np.flatnonzero(active)[0])


def changed(h0, kind, rng, keep):
    """Return new bounds; node ``keep`` stays finite."""
    new = h0.copy()
    if kind == "nothing":
        return new
    if kind == "everything":
        return rng.uniform(0.01, 2.0, h0.shape)
    nodes = rng.choice(h0.size, max(1, h0.size // 30), replace=False)
    factor = {"lowered": (0.2, 1.0), "raised": (1.0, 4.0)}.get(kind, (0.3, 3.0))
    new.flat[nodes] *= rng.uniform(*factor, len(nodes))
    if kind == "to and from inf":
        new.flat[nodes] = np.where(
            np.isinf(new.flat[nodes]), rng.uniform(0.01, 2.0, len(nodes)), np.inf
        )
    new.flat[keep] = min(new.flat[keep], 5.0)
    return new


def limits(background, kind, rng):
    """Return a gradient limit of some kind."""
    if kind == "number":
        return G
    if kind == "zero":
        return 0.0
    if kind == "of h":
        return lambda h: 0.1 + 0.3 / (1.0 + h)
    if kind == "cells" and isinstance(background, SimplexMesh):
        return rng.uniform(0.1, 0.5, background.n_cells)
    return rng.uniform(0.1, 0.5, background.nodal_shape)


@pytest.mark.parametrize("method", ["fast-marching", "edge-based"])
@pytest.mark.parametrize("name", BACKGROUNDS)
@settings(max_examples=12)
@given(
    kind=st.sampled_from(CHANGES),
    limit=st.sampled_from(["number", "zero", "nodes", "cells", "of h"]),
    share=st.sampled_from([0.05, 0.5, 1.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_marching_from_an_earlier_solution_is_marching(name, method, kind, limit, share, seed):
    background, rng = BACKGROUNDS[name], np.random.default_rng(seed)
    h0, g = bounds(background, rng, share), limits(background, limit, rng)
    _, info = limit_gradient(background, h0, g, method=method, full_output=True)
    new = changed(h0, kind, rng, first_node(background))
    h = limit_gradient(background, new, g, method=method, initial=info)
    # Tables of g(h) from other smallest sizes interpolate to 2e-9, sums of them to 1e-8.
    tolerance = 1e-7 if limit == "of h" else 1e-13
    assert_allclose(h, limit_gradient(background, new, g, method=method), rtol=tolerance)


@pytest.mark.parametrize("name", BACKGROUNDS)
def test_twenty_changes_in_a_row_add_up_to_nothing(name):
    background, rng = BACKGROUNDS[name], np.random.default_rng(20264)
    h0 = bounds(background, rng, 0.5)
    _, info = limit_gradient(background, h0, G, method="fast-marching", full_output=True)
    for number in range(20):
        h0 = changed(h0, CHANGES[number % 4], rng, first_node(background))
        h, info = limit_gradient(
            background, h0, G, method="fast-marching", initial=info, full_output=True
        )
    assert_allclose(h, limit_gradient(background, h0, G, method="fast-marching"), rtol=ROUNDING)


@pytest.mark.parametrize("method", ["fast-marching", "source-tracking"])
@pytest.mark.parametrize("name", ["plane", "space", "grid", "holed"])
def test_the_same_bounds_give_the_same_array(name, method):
    background = BACKGROUNDS[name]
    h0 = bounds(background, np.random.default_rng(20265), 0.3)
    h, info = limit_gradient(background, h0, G, method=method, full_output=True)
    again, after = limit_gradient(background, h0, G, method=method, initial=info, full_output=True)
    assert_array_equal(again, h)
    assert after.iterations == 0


# --- source tracking ---------------------------------------------------------------------


def moving_points(background, rng, n_sources):
    """Return a step that moves a tenth of some point sources, and gives the bounds."""
    h0 = np.full(background.nodal_shape, np.inf)
    length = background.diagonal

    def place(count):
        nodes = rng.choice(np.flatnonzero(np.isinf(h0)), count, replace=False)
        h0.flat[nodes] = rng.uniform(0.01, 0.05, count) * length

    def step():
        old = np.flatnonzero(np.isfinite(h0))
        gone = rng.choice(old, max(1, len(old) // 10), replace=False)
        h0.flat[gone] = np.inf
        place(len(gone))
        return h0

    place(n_sources)
    return step


TRACKED = {
    "plane": lambda: random_square(1500, 20266),
    "space": lambda: jittered_cube(9, 20267),
    "slit": lambda: domains.slit_square(1500)[0],
    "maze": lambda: domains.maze(1500)[0],
    "grid": lambda: CartesianGrid([0.0, 0.0], [1.0, 1.2], (40, 30)),
    "line": lambda: CartesianGrid([0.0], [1.0], (200,)),
}


@pytest.mark.parametrize("name", TRACKED)
def test_tracking_of_point_sources_is_exact_from_earlier_solutions_too(name):
    background, rng = TRACKED[name](), np.random.default_rng(20268)
    step = moving_points(background, rng, 12)
    _, info = limit_gradient(background, step(), G, full_output=True)
    for _ in range(20):
        h0 = step()
        h, info = limit_gradient(background, h0, G, initial=info, full_output=True)
        full, told = limit_gradient(background, h0, G, full_output=True)
        assert_allclose(h, full, rtol=ROUNDING)
        assert info.residual < 1e-12
        assert info.n_changed == told.n_changed
        # Where two sources give the same to rounding either may be told.
        assert_allclose(h0.flat[info.sources.roots()], h0.flat[told.sources.roots()], rtol=2.0)


def rough(background, rng):
    """Return a step that redraws 3 % of random bounds at all nodes."""
    length = background.diagonal
    h0 = rng.uniform(0.01, 0.1, background.nodal_shape) * length

    def step():
        nodes = rng.choice(h0.size, h0.size // 33, replace=False)
        h0.flat[nodes] = rng.uniform(0.01, 0.1, len(nodes)) * length
        return h0

    return step


@pytest.mark.parametrize("name", ["plane", "slit", "grid"])
def test_tracking_of_rough_data_differs_at_few_nodes(name):
    background, rng = TRACKED[name](), np.random.default_rng(20269)
    step = rough(background, rng)
    _, info = limit_gradient(background, step(), G, full_output=True)
    differing = []
    for _ in range(10):
        h0 = step()
        h, info = limit_gradient(background, h0, G, initial=info, full_output=True)
        full = limit_gradient(background, h0, G)
        assert info.residual < 1e-12
        assert (h <= h0).all()
        differing.append(np.mean(np.abs(h / full - 1.0) > 1e-9))
        # Neither finds every foot in noise; what one overlooks costs some percent.
        assert np.abs(h / full - 1.0).max() < 0.15
    assert np.mean(differing) < 2e-3


def nearest(mesh, place):
    return int(np.argmin(np.linalg.norm(mesh.points - place, axis=1)))


def test_what_bends_around_a_corner_rises_with_its_source():
    mesh, _ = domains.slit_square(1500)
    h0 = np.full(mesh.n_points, np.inf)
    left = nearest(mesh, [-5.0, 0.0])
    for place in ([-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]):
        h0[nearest(mesh, place)] = 3.0
    h0[left] = 1.0
    h, info = limit_gradient(mesh, h0, G, full_output=True)
    roots, nodes = info.sources.roots(), info.sources.nodes[:, 0]
    assert (roots == left).mean() < 0.45  # more would be solved anew
    behind = (roots == left) & (nodes != left)
    assert behind.sum() > 50  # over the tip of the slit
    h0[left] = 4.0
    raised = limit_gradient(mesh, h0, G, initial=info)
    assert (raised[behind] > h[behind]).all()
    assert_allclose(raised, limit_gradient(mesh, h0, G), rtol=ROUNDING)


@pytest.mark.parametrize("factor", [0.7, 1.5])
def test_what_bends_on_an_edge_in_space_follows_its_source(factor):
    mesh = walled_box()
    h0 = np.full(mesh.n_points, np.inf)
    for x, y, z in ((-0.9, -0.9, 0.9), (-0.9, 0.9, 0.9), (0.9, -0.9, -0.9), (0.9, 0.9, -0.9)):
        h0[nearest(mesh, [x, y, z])] = 0.05
    near = nearest(mesh, [-0.3, 0.0, -0.1])
    h0[near] = 0.12
    h, info = limit_gradient(mesh, h0, G, full_output=True)
    of_near = info.sources.roots() == near
    assert of_near.mean() < 0.45  # more would be solved anew
    bent = info.sources.bent
    bends = bent[:, 3] == 0.12
    assert bends.sum() > 20
    h0[near] *= factor
    again = limit_gradient(mesh, h0, G, initial=info)
    assert (np.sign(again[bends] - h[bends]) == np.sign(factor - 1.0)).all()
    full = limit_gradient(mesh, h0, G)
    # Over edges in space sizes are of second order: at one node, where a lower bound makes the
    # full solution larger, the earlier size is kept.
    assert (again <= full * (1.0 + ROUNDING)).all()
    assert np.count_nonzero(again < full * (1.0 - ROUNDING)) <= 1


def walled_box():
    """Return tetrahedra of (-1, 1)^3 without those of a wall up to the middle of the box."""
    mesh = jittered_cube(9, 20270, half_width=1.0)
    middle = mesh.points[mesh.cells].mean(axis=1)
    wall = (np.abs(middle[:, 0]) < 0.15) & (middle[:, 2] < 0.1)
    cells = mesh.cells[~wall]
    used, number = np.unique(cells, return_inverse=True)
    return SimplexMesh(mesh.points[used], number.reshape(cells.shape))


def test_a_bound_that_falls_beside_a_source_is_found_by_all_that_it_serves():
    """The foot on the next edge is better for nodes far away, though not for those around."""
    mesh = random_square(3000, 20271, half_width=50.0)
    x, y = mesh.points.T
    centre = np.array([10.0, -5.0])

    def spot(at):
        away = np.linalg.norm(mesh.points - at, axis=1)
        waves = 2.0 + np.sin(0.4 * x) * np.cos(0.37 * y)
        return waves + 0.8 * np.maximum(away - 10.0, 0.0) * (1.0 + 0.3 * np.sin(0.3 * y))

    _, info = limit_gradient(mesh, spot(centre), G, full_output=True)
    for number in range(6):
        h0 = spot(centre + 0.7 * number)
        h, info = limit_gradient(mesh, h0, G, initial=info, full_output=True)
        full = limit_gradient(mesh, h0, G)
        assert (h <= full * (1.0 + 1e-9)).mean() > 0.999


# --- work -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["fast-marching", "source-tracking"])
@pytest.mark.parametrize("kind", ["mesh", "grid"])
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_work_follows_what_changes(method, kind, factor):
    """Of a hundred sources one gets another bound: a hundredth of the nodes is taken again."""
    if kind == "mesh":
        background = structured_square(100)
        x = background.points
    else:
        background = CartesianGrid([-50.0, -50.0], 1.0, (101, 101))
        x = background.points
    h0 = np.full(len(x), np.inf)
    sources = np.flatnonzero((np.abs(x % 10.0 - 5.0) < 0.1).all(axis=1))
    h0[sources] = 1.0
    h0 = h0.reshape(background.nodal_shape)
    _, info = limit_gradient(background, h0, G, method=method, full_output=True)
    h0.flat[sources[len(sources) // 2]] *= factor
    h, after = limit_gradient(background, h0, G, method=method, initial=info, full_output=True)
    assert_allclose(h, limit_gradient(background, h0, G, method=method), rtol=ROUNDING)
    assert 0 < after.iterations < 0.06 * info.iterations


# --- what is kept and what is asked for ---------------------------------------------------------


def test_arrays_of_the_caller_may_change_afterwards():
    h0 = bounds(PLANE, np.random.default_rng(20272), 0.5)
    h, info = limit_gradient(PLANE, h0, G, full_output=True)
    told = info.largest_edge_slope
    h[:] = 1.0
    h0[:50] = 2.0 * h0[:50]  # in place: the earlier bounds must have been kept
    again, after = limit_gradient(PLANE, h0, G, initial=info, full_output=True)
    assert_array_equal(again, limit_gradient(PLANE, h0, G, initial=info))
    assert_allclose(again, limit_gradient(PLANE, h0, G), rtol=0.05)
    assert (again >= limit_gradient(PLANE, h0, G) * 0.95).all()
    assert told == info.largest_edge_slope
    assert info.n_changed == (info.record.h < info.record.bound).sum()
    assert after.method == info.method


def test_info_of_a_warm_start_tells_what_that_of_a_full_solution_tells():
    h0 = bounds(PLANE, np.random.default_rng(20273), 0.5)
    options = {"method": "fast-marching", "full_output": True}
    _, info = limit_gradient(PLANE, h0, G, **options)
    h0[::17] = 0.4
    h, warm = limit_gradient(PLANE, h0, G, initial=info, **options)
    _, full = limit_gradient(PLANE, h0, G, **options)
    assert isinstance(warm, LimitingInfo)
    assert warm.residual < 1e-13
    assert (warm.n_changed, warm.n_free, warm.converged) == (full.n_changed, 0, True)
    assert warm.largest_edge_slope == pytest.approx(full.largest_edge_slope, rel=1e-12)
    for level, value in full.cell_gradient_quantiles.items():
        assert warm.cell_gradient_quantiles[level] == pytest.approx(value, rel=1e-9)
    assert repr(warm) == (
        f"LimitingInfo(fast-marching: {(h < h0).sum()} of 300 sizes are below h0)"
    )


def test_an_equal_background_will_do():
    h0 = bounds(PLANE, np.random.default_rng(20274), 0.5)
    _, info = limit_gradient(PLANE, h0, G, full_output=True)
    same = SimplexMesh(PLANE.points.copy(), PLANE.cells.copy())
    h0[7] = 0.011
    assert_array_equal(
        limit_gradient(same, h0, G, initial=info), limit_gradient(PLANE, h0, G, initial=info)
    )


def test_a_limit_written_anew_is_the_same_if_its_values_are():
    h0 = bounds(PLANE, np.random.default_rng(20275), 1.0)
    h0[0], h0[1] = 0.005, 3.0  # stay the least and the largest
    _, info = limit_gradient(PLANE, h0, lambda h: 0.1 + 0.1 * h / (1.0 + h), full_output=True)
    h0[5:9] = 0.4
    h = limit_gradient(PLANE, h0, lambda h: 0.1 + 0.1 * h / (1.0 + h), initial=info)
    full = limit_gradient(PLANE, h0, lambda h: 0.1 + 0.1 * h / (1.0 + h))
    assert np.mean(np.abs(h / full - 1.0) > 1e-11) < 0.01


@pytest.mark.parametrize(
    ("background", "options"),
    [
        (PLANE, {"method": "hermite"}),
        (PLANE, {"method": "factored"}),
        (PLANE, {"method": "positive-coefficient"}),
        (PLANE, {"method": "exact"}),
        (FLAT_GRID, {"method": "fast-marching", "order": 2}),
        (FLAT_GRID, {"method": "exact"}),
    ],
)
def test_methods_without_a_warm_start_solve_anew(background, options):
    h0 = bounds(background, np.random.default_rng(20276), 0.5)
    _, info = limit_gradient(background, h0, G, full_output=True, **options)
    h0.flat[3:9] *= 1.7
    assert_array_equal(
        limit_gradient(background, h0, G, initial=info, **options),
        limit_gradient(background, h0, G, **options),
    )


def test_the_hamilton_jacobi_iteration_starts_from_the_earlier_sizes():
    x = FLAT_GRID.points[:, 0].reshape(FLAT_GRID.shape)
    h0 = 0.3 + np.abs(np.sin(4.0 * x))
    options = {"method": "hamilton-jacobi", "tol": 1e-9, "max_iter": 10_000}
    _, info = limit_gradient(FLAT_GRID, h0, G, full_output=True, **options)
    h0[5, 5] = 0.2
    h, after = limit_gradient(FLAT_GRID, h0, G, initial=info, full_output=True, **options)
    assert after.converged
    assert_allclose(h, limit_gradient(FLAT_GRID, h0, G, **options), rtol=1e-6)


REFUSED = {
    "background": (
        lambda info: limit_gradient(SPACE, np.ones(SPACE.n_points), G, initial=info),
        "initial must come from the same background: it is of SimplexMesh(300 points in 2-D",
    ),
    "g": (
        lambda info: limit_gradient(PLANE, np.ones(300), 0.31, initial=info),
        "initial must come from a call with the same g",
    ),
    "g of h": (
        lambda info: limit_gradient(PLANE, np.ones(300), lambda h: 0.3, initial=info),
        "initial must come from a call with the same g",
    ),
    "method": (
        lambda info: limit_gradient(PLANE, np.ones(300), G, method="hermite", initial=info),
        "initial must come from the same method: it is of method='source-tracking'",
    ),
    "nodes only": (
        lambda info: limit_gradient(PLANE, np.ones(300), G, face_sources=False, initial=info),
        "initial must come from a call with face_sources=False, got True",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_another_problem_is_refused(name):
    call, told = REFUSED[name]
    _, info = limit_gradient(PLANE, np.linspace(0.1, 2.0, 300), G, full_output=True)
    with pytest.raises(ValueError, match=re.escape(told)):
        call(info)


def test_a_grid_of_another_mask_is_another_background():
    _, info = limit_gradient(FLAT_GRID, np.ones(FLAT_GRID.shape), G, full_output=True)
    with pytest.raises(ValueError, match="initial must come from the same background"):
        limit_gradient(HOLED_GRID, np.ones(FLAT_GRID.shape), G, initial=info)


def test_the_same_octree_built_again_will_do():
    h0 = bounds(TREE, np.random.default_rng(20277), 0.5)
    _, info = limit_gradient(TREE, h0, G, method="fast-marching", full_output=True)
    same = Octree(TREE.lower, TREE.upper, TREE.root_shape, TREE.levels)
    h0[4] = 0.012
    h = limit_gradient(same, h0, G, method="fast-marching", initial=info)
    assert_allclose(h, limit_gradient(TREE, h0, G, method="fast-marching"), rtol=1e-13)


def test_long_rows_of_obtuse_slivers_are_solved_anew():
    """Nodes depend on each other in circles there; policy iteration takes over."""
    mesh = random_square(2000, 20278)
    mesh = SimplexMesh(mesh.points * [100.0, 1.0], mesh.cells)
    h0 = np.full(mesh.n_points, np.inf)
    h0[:5] = 0.1
    options = {"method": "fast-marching", "full_output": True}
    _, info = limit_gradient(mesh, h0, G, **options)
    h0[0] = 1.0
    h, _ = limit_gradient(mesh, h0, G, initial=info, **options)
    assert_allclose(h, limit_gradient(mesh, h0, G, **options)[0], rtol=1e-11)


def test_a_square_with_jittered_nodes_raised_everywhere_is_solved_anew():
    mesh = jittered_square(20, 20279)
    h0 = np.full(mesh.n_points, 1.0)
    _, info = limit_gradient(mesh, h0, G, full_output=True)
    assert_array_equal(limit_gradient(mesh, 2.0 * h0, G, initial=info), 2.0 * h0)
