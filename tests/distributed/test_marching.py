"""Fast marching on parts of a mesh: the same sizes as on the whole, in a few rounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, random_sphere, random_square
from partitions import KINDS, on_ranks, partition

from adaptsize import limit_gradient
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.in_parts import marching

SIZE = 4
MESHES = {
    "square": jittered_square(9, 871),
    "slivers": random_square(70, 872),
    "surface": random_sphere(80, 873),
    "cube": jittered_cube(4, 874),
}


def limits(mesh, kind, rng):
    """Return g for the whole mesh, and a function that returns that of a part."""
    if kind == "nodes":
        g = rng.uniform(0.05, 0.6, mesh.n_points)
        return g, lambda part: g[part.global_ids]
    if kind == "cells":
        g = rng.uniform(0.05, 0.6, mesh.n_cells)
        return g, lambda part: g[part.cell_ids]
    if kind == "of size":
        return (of_size := lambda h: 0.1 + 0.2 * h / (10.0 + h)), lambda part: of_size
    return 0.3, lambda part: 0.3


def assert_equal_to_serial(mesh, kind, rank_of, rng):
    g, local = limits(mesh, kind, rng)
    h0 = mesh.diagonal * rng.uniform(0.01, 0.3, mesh.n_points)
    h0[rng.random(mesh.n_points) < 0.7] = np.inf
    h0[0] = 0.01 * mesh.diagonal
    whole = limit_gradient(mesh, h0, g, method="fast-marching")

    def work(part):
        return limit_gradient(part, h0[part.global_ids], local(part), method="fast-marching")

    results, parts = on_ranks(mesh, rank_of, SIZE, work)
    shared = np.full(mesh.n_points, np.nan)
    for h, part in zip(results, parts, strict=True):
        np.testing.assert_allclose(h, whole[part.global_ids], rtol=1e-12)
        before = shared[part.global_ids]
        assert np.array_equal(h[~np.isnan(before)], before[~np.isnan(before)])
        shared[part.global_ids] = h


@pytest.mark.parametrize("kind", ["number", "nodes", "cells", "of size"])
@pytest.mark.parametrize("name", MESHES)
def test_equal_to_serial(name, kind):
    rng = np.random.default_rng(875)
    for parts in KINDS:
        rank_of = partition(MESHES[name], parts, SIZE, rng)
        assert_equal_to_serial(MESHES[name], kind, rank_of, rng)


@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["number", "nodes", "cells"]))
@settings(deadline=None, max_examples=15)
def test_equal_to_serial_for_drawn_problems(seed, kind):
    rng = np.random.default_rng(seed)
    mesh = random_square(int(rng.integers(6, 40)), seed)
    assert_equal_to_serial(mesh, kind, partition(mesh, rng.choice(KINDS), SIZE, rng), rng)


def test_windows_keep_the_number_of_rounds_small():
    """A front crosses 4 strips: in each window it advances by eight edges."""
    mesh = jittered_square(40, 876)
    h0 = np.full(mesh.n_points, np.inf)
    h0[0] = 1.0
    rank_of = partition(mesh, "strips", SIZE, np.random.default_rng(877))

    def work(part):
        given = (part, h0[part.global_ids], Slope(np.array([0.3])), lambda text, share: None)
        part.minimum(np.zeros(part.n_points))  # shared nodes are found on first use
        traffic = part.ranks.traffic
        before = traffic.exchanges, traffic.reductions
        marching.solve_fast_marching(*given)
        rounds = traffic.exchanges - before[0]
        # One for each round, one for the window, and one that finds nothing left to do.
        assert traffic.reductions - before[1] == rounds + 2
        return rounds

    results, _ = on_ranks(mesh, rank_of, SIZE, work)
    assert len(set(results)) == 1
    assert 40 * np.sqrt(2) / 8 / 2 < results[0] < 3 * 40 * np.sqrt(2) / 8


def test_too_many_acceptances_are_left_to_one_process(monkeypatch):
    monkeypatch.setattr(marching, "patience", lambda n: 0)
    rng = np.random.default_rng(878)
    for kind in ("number", "nodes"):
        assert_equal_to_serial(MESHES["square"], kind, None, rng)
