"""Limiting again from an earlier solution: as a full solution, but for the work."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import domains
from adaptsize import CartesianGrid, Octree, SimplexMesh, limit_gradient
from meshes import jittered_cube, random_square

G = 0.3

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


@pytest.mark.parametrize("nodes_only", [False, True])
@pytest.mark.parametrize("name", BACKGROUNDS)
@settings(max_examples=12)
@given(
    kind=st.sampled_from(CHANGES),
    limit=st.sampled_from(["number", "zero", "of h"]),
    share=st.sampled_from([0.01, 0.05, 0.5, 1.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_sizes_from_an_earlier_solution_are_those_from_nothing(
    name, nodes_only, kind, limit, share, seed
):
    background, rng = BACKGROUNDS[name], np.random.default_rng(seed)
    h0, g = bounds(background, rng, share), limits(background, limit, rng)
    options = {"face_sources": not nodes_only}
    _, info = limit_gradient(background, h0, g, full_output=True, **options)
    new = changed(h0, kind, rng, first_node(background))
    h = limit_gradient(background, new, g, initial=info, **options)
    full = limit_gradient(background, new, g, **options)
    if limit == "of h":  # tables from other smallest sizes interpolate to 2e-9
        assert_allclose(h, full, rtol=1e-7)
    else:
        assert_array_equal(h, full)


@pytest.mark.parametrize("make", [domains.slit_square, domains.round_holes, domains.maze])
def test_twenty_changes_in_a_row_around_obstacles(make):
    mesh, rng = make(1500)[0], np.random.default_rng(20264)
    h0 = np.full(mesh.n_points, np.inf)
    h0[rng.choice(mesh.n_points, 12, replace=False)] = rng.uniform(1.0, 5.0, 12)
    h, info = limit_gradient(mesh, h0, G, full_output=True, face_sources=False)
    for _ in range(20):
        h0 = h0.copy()
        h0[rng.choice(mesh.n_points, 2)] = rng.uniform(0.5, 5.0, 2)
        h0[rng.choice(np.flatnonzero(np.isfinite(h0)))] *= rng.uniform(0.5, 2.0)
        h0[rng.choice(np.flatnonzero(np.isfinite(h0)))] = np.inf
        h, info = limit_gradient(mesh, h0, G, full_output=True, face_sources=False, initial=info)
        assert_array_equal(h, limit_gradient(mesh, h0, G, face_sources=False))


# --- what is kept and what is asked for ---------------------------------------------------------


def test_arrays_of_the_caller_may_change_afterwards():
    h0 = bounds(PLANE, np.random.default_rng(20272), 0.5)
    h, info = limit_gradient(PLANE, h0, G, full_output=True)
    told = info.largest_edge_slope
    h[:] = 1.0
    h0[:50] = 2.0 * h0[:50]  # in place: the earlier bounds must have been kept
    again, after = limit_gradient(PLANE, h0, G, initial=info, full_output=True)
    assert_array_equal(again, limit_gradient(PLANE, h0, G, initial=info))
    assert_array_equal(again, limit_gradient(PLANE, h0, G))
    assert told == info.largest_edge_slope
    assert info.n_changed == (info.record.h < info.record.bound).sum()
    assert after.method == info.method


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
    assert_allclose(h, full, rtol=1e-11)


@pytest.mark.parametrize(
    ("background", "options"),
    [
        (PLANE, {"method": "hermite"}),
        (PLANE, {"method": "factored"}),
        (PLANE, {"method": "positive-coefficient"}),
        (PLANE, {"method": "fast-marching"}),
        (PLANE, {"method": "edge-based"}),
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
        "initial must come from the same method: it is of method='exact'",
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
