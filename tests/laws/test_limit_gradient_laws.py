"""Laws that every limiting scheme keeps on any background.

`backgrounds.CASES` lists the schemes, with the laws that one does not keep and the reason.
"""

from functools import partial

import numpy as np
import pytest
from backgrounds import CASES, active_nodes, domain, placed, problems, rises
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from adaptsize import CartesianGrid, SimplexMesh

LAWS = set()


def law(check=None, *, only=None):
    """Run ``check(case, background, h0, g, data)`` over drawn problems for each case."""
    if check is None:
        return partial(law, only=only)
    name = check.__name__.removeprefix("test_")
    LAWS.add(name)
    keep = [c for c in CASES if name not in c.exempt and only in (None, c.background)]

    @pytest.mark.parametrize("case", keep, ids=str)
    def test(case):
        @settings(max_examples=max(int(case.share * settings.default.max_examples), 5))
        @given(data=st.data())
        def over_problems(data):
            check(case, *data.draw(problems(case)), data)

        over_problems()

    return test


def _rng(data):
    return np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))


def _assert_same(case, h, expected, rounding=0.0):
    """Compare two fields, of which each may err by the rounding of the case, or a larger one."""
    assert_allclose(h, expected, rtol=10.0 * max(case.rounding, rounding))


@law
def test_stays_below_h0_and_within_g_along_every_edge(case, background, h0, g, data):
    h = case.limit(background, h0, g)
    active = active_nodes(background)
    assert (h[active] <= h0[active]).all()
    i, j, rise = rises(background, g)
    h = h.ravel()
    joined = np.isfinite(h[i]) & np.isfinite(h[j])  # inf less inf is none
    excess = h[i][joined] - h[j][joined] - np.broadcast_to(rise, h[i].shape)[joined]
    assert_array_equal(np.isfinite(h[i]), np.isfinite(h[j]))
    assert excess.max(initial=0.0) <= case.rounding


@law
def test_limiting_twice_changes_nothing(case, background, h0, g, data):
    once = case.limit(background, h0, g)
    _assert_same(case, case.limit(background, once, g), once)


@law
def test_lower_bounds_give_lower_sizes(case, background, h0, g, data):
    lower = h0 * _rng(data).uniform(0.2, 1.0, h0.shape)
    h = case.limit(background, h0, g)
    assert (case.limit(background, lower, g) <= h * (1 + case.rounding)).all()


@law
def test_larger_g_gives_larger_sizes(case, background, h0, g, data):
    h = case.limit(background, h0, g)
    assert (case.limit(background, h0, 1.5 * g + 0.01) >= h * (1 - case.rounding)).all()


@law
def test_scales_with_the_unit_of_length(case, background, h0, g, data):
    scale = data.draw(st.sampled_from([1e-6, 0.3, 1e5]))
    h = case.limit(background, h0, g)
    scaled = placed(background, scale, 0.0)
    _assert_same(case, case.limit(scaled, scale * h0, g), scale * h)


@law
def test_place_does_not_matter(case, background, h0, g, data):
    shift = data.draw(st.sampled_from([-8.0, 3.0])) * np.arange(1, domain(background).dim + 1)
    h = case.limit(background, h0, g)
    moved = placed(background, 1.0, shift)
    # Coordinates of 1 become such of up to 24, rounded to 4e-15; the least size is 0.01.
    _assert_same(case, case.limit(moved, h0, g), h, 1e-12)


@law
def test_a_constant_passes_through(case, background, h0, g, data):
    h = case.limit(background, h0, g)
    _assert_same(case, case.limit(background, h0 + 3.0, g), h + 3.0)


@law
def test_equal_bounds_stay(case, background, h0, g, data):
    constant = np.full_like(h0, 0.7)
    expected = np.where(active_nodes(background), constant, np.inf)
    assert_array_equal(case.limit(background, constant, g), expected)


@law
def test_the_least_size_stays(case, background, h0, g, data):
    active = active_nodes(background)
    assert case.limit(background, h0, g).min() == h0[active].min()


@law
def test_constant_g_of_h_is_the_number(case, background, h0, g, data):
    number = data.draw(st.sampled_from([0.1, 0.3, 1.0]))
    h = case.limit(background, h0, number)
    of_size = case.limit(background, h0, lambda sizes: np.full_like(sizes, number))
    # Phi is tabulated: its sums of up to 5e4 terms round to 1e-12.
    _assert_same(case, of_size, h, 1e-12)


@law
def test_is_free_only_in_components_without_a_bound(case, background, h0, g, data):
    h = case.limit(background, h0, g).ravel()
    active = active_nodes(background).ravel()
    i, j, _ = rises(background, g)
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(h.size, h.size))
    component = connected_components(graph, directed=False)[1]
    bounded = np.isin(component, component[active & np.isfinite(h0.ravel())])
    assert_array_equal(np.isfinite(h), bounded & active)


@law
def test_leaves_its_inputs_alone_whatever_their_layout_in_memory(case, background, h0, g, data):
    before = h0.copy(), np.copy(g)
    h = case.limit(background, h0, g)
    assert not np.shares_memory(h, h0)
    assert_array_equal(h0, before[0])
    assert_array_equal(g, before[1])
    # Every second entry of a larger array, or in Fortran's order.
    strewn = [np.repeat(v, 2)[::2] if np.ndim(v) == 1 else np.asfortranarray(v) for v in (h0, g)]
    for values in strewn:
        values.flags.writeable = False
    assert_array_equal(case.limit(background, strewn[0], strewn[1] if np.ndim(g) else g), h)


@law
def test_info_agrees_with_the_field(case, background, h0, g, data):
    h, info = case.with_info(background, h0, g)
    active = active_nodes(background)
    assert info.method == case.method
    assert info.n_changed == (h < h0)[active].sum()
    assert info.n_free == np.isinf(h[active]).sum()
    assert info.converged
    assert info.residual <= case.residual
    if np.max(g) > 0.0 and info.largest_edge_slope != np.inf:
        # Of differences of sizes over edges as short as 0.01.
        assert info.largest_edge_slope <= 1.0 + 1e3 * case.rounding


@law
def test_is_the_largest_solution_of_its_own_equations(case, background, h0, g, data):
    """Lowering the result at one node and limiting again must not be undone elsewhere."""
    h = case.limit(background, h0, g)
    node = _rng(data).choice(np.flatnonzero(np.isfinite(h)))
    lowered = h0.copy()
    lowered.flat[node] = min(0.5 * h.flat[node], h0.flat[node])
    again = case.limit(background, lowered, g)
    assert again.flat[node] <= lowered.flat[node]
    assert (again <= h * (1 + case.rounding)).all()


@law(only="simplices")
def test_numbering_and_orientation_do_not_matter(case, mesh, h0, g, data):
    rng = _rng(data)
    old_of_new = rng.permutation(mesh.n_points)
    new_of_old = np.argsort(old_of_new)
    cell_order = rng.permutation(mesh.n_cells)
    turned = rng.permuted(new_of_old[mesh.cells[cell_order]], axis=1)
    renumbered = SimplexMesh(mesh.points[old_of_new], turned)
    new_order = old_of_new if np.shape(g) == (mesh.n_points,) else cell_order
    g_new = g[new_order] if np.ndim(g) > 0 else g
    h_new = case.limit(renumbered, h0[old_of_new], g_new)
    _assert_same(case, h_new[new_of_old], case.limit(mesh, h0, g))


@law(only="grid")
def test_axes_and_their_directions_may_be_exchanged(case, grid, h0, g, data):
    rng = _rng(data)
    axes = rng.permutation(grid.dim)
    mirrored = tuple(np.flatnonzero(rng.random(grid.dim) < 0.5))

    def turn(values):
        return np.flip(np.transpose(values, axes), mirrored) if np.ndim(values) > 0 else values

    active = None if grid.active is None else turn(grid.active)
    shape = [grid.shape[axis] for axis in axes]
    turned = CartesianGrid(grid.origin[axes], grid.spacing[axes], shape, active=active)
    _assert_same(case, case.limit(turned, turn(h0), turn(g)), turn(case.limit(grid, h0, g)))


@law(only="grid")
def test_what_inactive_nodes_hold_does_not_matter(case, grid, h0, g, data):
    active = active_nodes(grid)
    h = case.limit(grid, h0, g)
    assert np.isinf(h[~active]).all()
    rubbish = data.draw(st.sampled_from([np.nan, -1.0, 0.0, np.inf, 1e-300]))
    h0_other = np.where(active, h0, rubbish)
    g_other = np.where(active, g, rubbish) if np.ndim(g) > 0 else g
    assert_array_equal(case.limit(grid, h0_other, g_other), h)


@law(only="octree")
def test_octrees_are_their_meshes(case, tree, h0, g, data):
    assert_array_equal(case.limit(tree, h0, g), case.limit(tree.mesh, h0, g))


def test_exemptions_name_laws():
    for case in CASES:
        assert set(case.exempt) <= LAWS, case
