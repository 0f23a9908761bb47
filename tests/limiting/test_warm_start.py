"""Limiting again from an earlier solution: as a full solution, but for the work."""

import re

import domains
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, random_square
from meshes import slit_square as crack
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, Octree, SimplexMesh, limit_gradient
from adaptsize.limiting import Exact, HamiltonJacobi
from adaptsize.limiting.exact import solve

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
OF_NODES = Exact(face_sources=False)
LIMITS = {"number": G, "zero": 0.0, "of h": lambda h: 0.1 + 0.3 / (1.0 + h)}
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


@pytest.mark.parametrize("nodes_only", [False, True])
@pytest.mark.parametrize("name", BACKGROUNDS)
@settings(max_examples=12)
@given(
    kind=st.sampled_from(CHANGES),
    limit=st.sampled_from(sorted(LIMITS)),
    share=st.sampled_from([0.01, 0.05, 0.5, 1.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_sizes_from_an_earlier_solution_are_those_from_nothing(
    name, nodes_only, kind, limit, share, seed
):
    background, rng = BACKGROUNDS[name], np.random.default_rng(seed)
    h0, g = bounds(background, rng, share), LIMITS[limit]
    options = {"method": Exact(face_sources=not nodes_only)}
    _, info = limit_gradient.with_info(background, h0, g, **options)
    new = changed(h0, kind, rng, first_node(background))
    h = limit_gradient(background, new, g, initial=info, **options)
    full = limit_gradient(background, new, g, **options)
    if limit == "of h":  # tables from other smallest sizes interpolate to 2e-9
        assert_allclose(h, full, rtol=1e-7)
    else:
        assert_array_equal(h, full)


# --- the warm start of the exact method ------------------------------------------------------

MESHES = {
    "square": lambda: random_square(600, 20264),
    "cube": lambda: jittered_cube(8, 20265),
    "slit": lambda: domains.slit_square(700)[0],
    "slit of no width": lambda: crack(10),
    "round holes": lambda: domains.round_holes(900)[0],
    "maze": lambda: domains.maze(900)[0],
    "holes of one triangle": lambda: domains.with_removed_cells(
        random_square(200, 20266), 20266, 20
    )[0],
    "cells given twice": lambda: doubled(domains.l_shape(300)[0]),
}


def doubled(mesh):
    """Return the mesh with every third cell given again."""
    return SimplexMesh(mesh.points, np.concatenate([mesh.cells, mesh.cells[::3]]))


class Bounds:
    """Bounds at a share of the nodes that change step by step."""

    def __init__(self, mesh, share, seed):
        self.rng = np.random.default_rng(seed)
        self.nodes = np.unique(mesh.cells)
        self.scale = 0.1 * np.ptp(mesh.points, axis=0).max()
        self.h0 = np.full(mesh.n_points, np.inf)
        count = max(2, int(share * len(self.nodes)))
        self.put(self.rng.choice(self.nodes, count, replace=False))

    def put(self, nodes):
        self.h0[nodes] = self.scale * self.rng.uniform(0.05, 1.5, np.size(nodes))

    def step(self, kind):
        """Raise, lower, set or take away some bounds, or one after the other at different nodes."""
        self.h0 = self.h0.copy()
        bounded = np.flatnonzero(np.isfinite(self.h0))
        some = self.rng.choice(bounded, max(1, len(bounded) // 20))
        if kind in ("raised", "all"):
            self.h0[some] *= self.rng.uniform(1.0, 5.0)
        if kind in ("lowered", "all"):
            self.h0[self.rng.choice(bounded)] *= self.rng.uniform(0.1, 1.0)
        if kind in ("new", "all"):
            self.put(self.rng.choice(self.nodes, max(1, len(bounded) // 20)))
        if kind in ("removed", "all") and len(bounded) > 2:
            self.h0[self.rng.choice(bounded, max(1, len(bounded) // 20))] = np.inf
        if kind == "least removed" and len(bounded) > 2:
            self.h0[np.argmin(self.h0)] = np.inf  # which may serve all nodes
        if kind == "least raised":
            self.h0[np.argmin(self.h0)] *= 3.0
        if np.isinf(self.h0).all():
            self.put(self.nodes[:1])
        return self.h0


STEPS = ("raised", "lowered", "new", "removed", "all", "least removed", "least raised")


@pytest.mark.parametrize("share", [0.01, 0.3, 1.0])
@pytest.mark.parametrize("name", MESHES)
def test_many_changes_in_a_row_give_what_a_solution_from_nothing_gives(name, share):
    mesh = MESHES[name]()
    bounds = Bounds(mesh, share, 20267)
    options = {"method": OF_NODES}
    h, info = limit_gradient.with_info(mesh, bounds.h0, G, **options)
    places = mesh.points[mesh.cells].mean(axis=1)[::5]
    n_other = 0
    for number in range(5 * len(STEPS)):
        before = h
        h0 = bounds.step(STEPS[number % len(STEPS)])
        kept = h0.copy()
        h, info = limit_gradient.with_info(mesh, h0, G, initial=info, **options)
        full, of_full = limit_gradient.with_info(mesh, h0, G, **options)
        assert_array_equal(h, full)
        assert_array_equal(h0, kept)
        n_other += not np.array_equal(h, before)
        # The info is as good as one from nothing, too.
        assert (info.n_changed, info.n_free) == (of_full.n_changed, of_full.n_free)
        assert (info.iterations, info.n_proved) == (of_full.iterations, of_full.n_proved)
        assert info.cell_gradient_quantiles == of_full.cell_gradient_quantiles
        assert_array_equal(info.sources.evaluate(places), of_full.sources.evaluate(places))
        has = info.sources.nodes[:, 0] >= 0
        assert_array_equal(has, np.isfinite(h))
    assert n_other > 2 * len(STEPS)


def test_sizes_are_taken_from_the_earlier_solution(monkeypatch):
    """In convex domains and in the plane by lines of sight; other problems are solved anew."""
    monkeypatch.setattr(solve, "favours_expansion", lambda *_: False)

    def refuse(*args, **options):
        raise AssertionError("solved from nothing")

    for name, make in MESHES.items():
        mesh = make()
        bounds = Bounds(mesh, 0.02, 20269)
        _, info = limit_gradient.with_info(mesh, bounds.h0, G, method=OF_NODES)
        h0 = bounds.step("all")
        full = limit_gradient(mesh, h0, G, method=OF_NODES)
        with monkeypatch.context() as patch:
            patch.setattr(Exact, "solve", refuse)
            h = limit_gradient(mesh, h0, G, method=OF_NODES, initial=info)
        assert_array_equal(h, full, err_msg=name)


def test_linear_data_and_solids_that_are_not_convex_are_solved_anew():
    # Convex ones are among the backgrounds above.
    for mesh, share in ((domains.slit_square(400)[0], 1.0), (domains.wall_box(800)[0], 0.01)):
        bounds = Bounds(mesh, share, 20272)
        _, info = limit_gradient.with_info(mesh, bounds.h0, G)
        for kind in STEPS:
            h0 = bounds.step(kind)
            h, info = limit_gradient.with_info(mesh, h0, G, initial=info)
            assert_array_equal(h, limit_gradient(mesh, h0, G))


# --- what is kept and what is asked for ---------------------------------------------------------


def test_the_hamilton_jacobi_iteration_starts_from_the_earlier_sizes():
    x = FLAT_GRID.points[:, 0].reshape(FLAT_GRID.shape)
    h0 = 0.3 + np.abs(np.sin(4.0 * x))
    options = {"method": HamiltonJacobi(tol=1e-9, max_iter=10_000)}
    _, info = limit_gradient.with_info(FLAT_GRID, h0, G, **options)
    h0[5, 5] = 0.2
    h, after = limit_gradient.with_info(FLAT_GRID, h0, G, initial=info, **options)
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
        lambda info: limit_gradient(PLANE, np.ones(300), G, method="fast-marching", initial=info),
        "initial must come from the same method: it is of method='exact'",
    ),
    "nodes only": (
        lambda info: limit_gradient(PLANE, np.ones(300), G, method=OF_NODES, initial=info),
        "initial must come from a call with face_sources=False, got True",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_another_problem_is_refused(name):
    call, expected = REFUSED[name]
    _, info = limit_gradient.with_info(PLANE, np.linspace(0.1, 2.0, 300), G)
    with pytest.raises(ValueError, match=re.escape(expected)):
        call(info)


def test_arrays_of_the_caller_may_change_afterwards():
    h0 = bounds(PLANE, np.random.default_rng(20272), 0.5)
    h, info = limit_gradient.with_info(PLANE, h0, G)
    before = info.largest_edge_slope
    h[:] = 1.0
    h0[:50] = 2.0 * h0[:50]  # in place: the earlier bounds must have been kept
    again, after = limit_gradient.with_info(PLANE, h0, G, initial=info)
    assert_array_equal(again, limit_gradient(PLANE, h0, G, initial=info))
    assert_array_equal(again, limit_gradient(PLANE, h0, G))
    assert before == info.largest_edge_slope
    assert info.n_changed == (info.h < info.bound).sum()
    assert after.method == info.method
