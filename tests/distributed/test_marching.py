"""Fast marching on parts of a mesh: its rounds, and its info; test_parts_equal_whole has sizes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import jittered_square, random_sphere
from partitions import FIGURES, KINDS, SIZE, bounds, on_ranks, partition

from adaptsize import limit_gradient
from adaptsize.limiting.fast_marching import march_mesh
from adaptsize.limiting.gradient_limit import Slope
from adaptsize.limiting.problem import Problem


def assert_marches_as_one_process(mesh, g_of, kind, rng):
    """Compare sizes and figures, which agree to rounding; g_of(ids, cell_ids) is the limit."""
    h0 = bounds(mesh, "some", rng)
    g = g_of(slice(None), slice(None))
    whole, expected = limit_gradient.with_info(mesh, h0, g, method="fast-marching")

    def work(part):
        own = g_of(part.global_ids, part.cell_ids)
        return limit_gradient.with_info(part, h0[part.global_ids], own, method="fast-marching")

    results, parts = on_ranks(mesh, partition(mesh, kind, SIZE, rng), SIZE, work)
    for (h, info), part in zip(results, parts, strict=True):
        np.testing.assert_allclose(h, whole[part.global_ids], rtol=1e-12)
        for name in FIGURES:
            assert getattr(info, name) == getattr(results[0][1], name), name
    assert (info.n_proved, info.largest_gap, info.n_free) == (None, None, 0)
    assert info.n_changed == pytest.approx(expected.n_changed, abs=3)
    assert abs(info.residual) < 1e-12
    assert info.largest_edge_slope == pytest.approx(expected.largest_edge_slope)
    assert info.cell_gradient_quantiles == pytest.approx(expected.cell_gradient_quantiles)


@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(KINDS))
@settings(deadline=None, max_examples=10)
def test_sizes_and_info_of_drawn_limits(seed, kind):
    rng = np.random.default_rng(seed)
    for mesh in (jittered_square(7, seed), random_sphere(40, seed)):
        g = rng.uniform(0.05, 0.6, mesh.n_points)
        assert_marches_as_one_process(mesh, lambda ids, cells, g=g: g[ids], kind, rng)


def test_windows_keep_the_number_of_rounds_small():
    """A front crosses 4 strips: in each window it advances by eight edges."""
    mesh = jittered_square(40, 876)
    h0 = np.full(mesh.n_points, np.inf)
    h0[0] = 1.0
    rank_of = partition(mesh, "strips", SIZE, np.random.default_rng(877))

    def work(part):
        problem = Problem(part, h0[part.global_ids], Slope(np.array([0.3])))
        part.minimum(np.zeros(part.n_points))  # shared nodes are found on first use
        traffic = part.ranks.traffic
        before = traffic.exchanges, traffic.reductions
        march_mesh(problem)
        rounds = traffic.exchanges - before[0]
        # One for each round, one for the window, and one that finds nothing left to do.
        assert traffic.reductions - before[1] == rounds + 2
        return rounds

    results, _ = on_ranks(mesh, rank_of, SIZE, work)
    assert len(set(results)) == 1
    assert 40 * np.sqrt(2) / 8 / 2 < results[0] < 3 * 40 * np.sqrt(2) / 8
