"""Transfer of fields between meshes: interpolation, and means over exact overlaps."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, slit_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from overlap_twin import common_part, measure

from adaptsize import FieldTransfer, SimplexMesh
from adaptsize._workers import Workers
from adaptsize.adaptation import overlaps

SEED = 50671


def pair(dim, n=(7, 9)):
    """Two meshes of one square or cube that have no inner node in common."""
    if dim == 2:
        old, new = structured_square(n[0], half_width=1.0), jittered_square(n[1], SEED)
        return old, SimplexMesh(new.points / 50.0, new.cells)
    return (jittered_cube(k, SEED + k, half_width=1.0) for k in n)


@pytest.mark.parametrize("dim", [2, 3])
def test_overlaps_are_those_of_a_slow_twin(dim):
    rng = np.random.default_rng(SEED)
    count = {2: 30, 3: 12}[dim]
    # Cells of one mesh need not fit together: all pairs of random simplices.
    cells = np.arange(count * (dim + 1)).reshape(count, dim + 1)
    old, new = (SimplexMesh(rng.random((count * (dim + 1), dim)), cells) for _ in range(2))
    expected = [
        [sum(map(measure, common_part(new.points[a], old.points[b]))) for b in cells] for a in cells
    ]
    assert np.count_nonzero(expected) > count
    # Qhull's own precision.
    assert_allclose(FieldTransfer(old, new).overlap.toarray(), expected, atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("reach", [0.6, 0.0, 9.0], ids=["some", "all", "none"])
def test_cells_that_both_meshes_have_are_not_intersected(dim, reach, monkeypatch):
    """With others, they have the same integrals as by intersection."""
    rng, (old, _) = np.random.default_rng(SEED), pair(dim, (6, 4))
    inside = np.linalg.norm(old.points, axis=1) < reach
    step = np.where(inside[:, None], rng.uniform(-0.05, 0.05, old.points.shape), 0.0)
    order = rng.permutation(old.n_points)  # of the nodes, the corners, and the cells
    cells = np.argsort(order)[rng.permuted(old.cells, axis=1)[rng.permutation(old.n_cells)]]
    new = SimplexMesh((old.points + step)[order], cells)
    found = overlaps.intersections_of(old, new, Workers.of(1))
    n_common = len(overlaps._common_cells(old, new).new)
    assert (n_common == 0) == (reach == 9.0)
    assert (n_common == new.n_cells) == (reach == 0.0)
    nothing = overlaps._common_cells(old, new.moved(new.points + 7.0))
    monkeypatch.setattr(overlaps, "_common_cells", lambda old, new: nothing)
    expected = overlaps.intersections_of(old, new, Workers.of(1))
    for one, other in zip(found, expected, strict=True):
        assert_allclose(one.toarray(), other.toarray(), atol=1e-14)
    assert_allclose(
        overlaps.measures_of_overlaps(old, new, Workers.of(1)).toarray(),
        expected.measures.toarray(), atol=1e-14,
    )  # fmt: skip


def fields_on(n, rng):
    """A scalar, a vector, a tensor and a complex field of n rows."""
    shapes = [(n,), (n, 2), (n, 3, 3)]
    return [*[rng.normal(size=s) for s in shapes], rng.normal(size=n) + 1j * rng.normal(size=n)]


@pytest.mark.parametrize("dim", [2, 3])
def test_overlaps_reach_across_gaps_between_the_old_cells(dim):
    old, new = pair(dim)
    # Each cell has nodes of its own: none has a neighbour.
    loose = SimplexMesh(
        old.points[old.cells.ravel()], np.arange(old.cells.size).reshape(-1, dim + 1)
    )
    assert_allclose(FieldTransfer(loose, new).coverage, 1.0, rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_conservative_transfer_keeps_integrals_of_any_shape(dim):
    old, new = pair(dim)
    transfer = FieldTransfer(old, new)
    for field in fields_on(old.n_cells, np.random.default_rng(SEED)):
        made = transfer.cells(field)
        assert made.shape == (new.n_cells, *field.shape[1:])
        assert made.dtype == field.dtype
        before, after = transfer.integrals(field, made)
        assert before.shape == field.shape[1:]
        assert_allclose(after, before, atol=1e-13 * np.abs(field).max())
        assert_allclose(before, np.tensordot(old.measures, field, axes=1), rtol=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.booleans())
def test_maximum_principle_constants_and_positivity(seed, dim, conservative):
    rng = np.random.default_rng(seed)
    old, new = (_random_mesh(dim, rng) for _ in range(2))
    transfer = FieldTransfer(old, new)
    nodal, by_cell = rng.exponential(size=old.n_points), rng.exponential(size=old.n_cells)
    for field, made in (
        (nodal, transfer.nodal(nodal, method="interpolate")),
        (by_cell, transfer.cells(by_cell, conservative=conservative)),
        (by_cell, transfer.cells(by_cell, keep_integral=True)),
    ):
        # Exactly, without a tolerance, also where the two hulls differ.
        assert field.min() <= made.min()
        assert made.max() <= field.max()
    assert_array_equal(transfer.nodal(np.full(old.n_points, 0.1), method="interpolate"), 0.1)
    assert_array_equal(transfer.cells(np.full(old.n_cells, 0.1), conservative=conservative), 0.1)


def _random_mesh(dim, rng):
    from scipy.spatial import Delaunay

    points = rng.uniform(-1.0, 1.0, (12, dim))
    return SimplexMesh(points, Delaunay(points).simplices)


@pytest.mark.parametrize("dim", [2, 3])
def test_linear_nodal_fields_are_exact(dim):
    old, new = pair(dim)
    a = np.random.default_rng(SEED).normal(size=(dim, 4))
    made = FieldTransfer(old, new).nodal(old.points @ a + 7.0, method="interpolate")
    # Barycentric coordinates of slivers: a few digits less than 1e-16.
    assert_allclose(made, new.points @ a + 7.0, rtol=1e-12)


def wave(x):
    return np.sin(2.0 * x[:, 0] + 0.3) * np.cos(1.5 * x[:, 1])


def test_interpolation_is_of_second_order_and_projection_of_first():
    error = []
    for n in (10, 20, 40):
        old, new = pair(2, (n, n + 4))
        transfer = FieldTransfer(old, new)
        nodal = transfer.nodal(wave(old.points), method="interpolate") - wave(new.points)
        middle, new_middle = (m.points[m.cells].mean(axis=1) for m in (old, new))
        by_cell = transfer.cells(wave(middle)) - wave(new_middle)
        error.append([np.abs(nodal).max(), np.sqrt((new.measures * by_cell**2).sum())])
    order = np.log(np.divide(error[:-1], error[1:])) / np.log(2.0)
    assert (order[:, 0] > 1.8).all(), f"errors {error}, orders {order}"
    assert (order[:, 1] > 0.9).all(), f"errors {error}, orders {order}"


def polygon(n):
    """A regular polygon as a fan of triangles; its corners are on the unit circle."""
    angle = 2.0 * np.pi * np.arange(n) / n
    points = np.concatenate([[[0.0, 0.0]], np.column_stack([np.cos(angle), np.sin(angle)])])
    ring = np.arange(n)
    return SimplexMesh(points, np.column_stack([0 * ring, 1 + ring, 1 + (ring + 1) % n]))


def test_where_domains_differ_means_are_over_the_common_part_and_the_defect_is_reported():
    old, new = polygon(6), polygon(12)
    transfer = FieldTransfer(old, new)
    # Triangles of a twelfth stick out of the hexagon: sin 60 / 2 per two over sin 30.
    assert_allclose(transfer.coverage, np.sin(np.pi / 3) / 2.0 / np.sin(np.pi / 6), rtol=1e-12)
    heat = np.arange(1.0, 7.0)
    made = transfer.cells(heat)
    assert_allclose(made, np.repeat(heat, 2), rtol=1e-14)  # each half a sixth
    before, after = transfer.integrals(heat, made)
    assert after / before == pytest.approx(new.measures.sum() / old.measures.sum(), rel=1e-12)
    repaired = transfer.cells(heat, keep_integral=True)
    assert new.measures @ repaired == pytest.approx(before, rel=1e-13)
    assert repaired.min() >= 1.0
    assert repaired.max() <= 6.0
    # The other way too, where the old domain sticks out.
    back = FieldTransfer(new, old).cells(repaired, keep_integral=True)
    assert old.measures @ back == pytest.approx(before, rel=1e-13)
    # A constant has no room: bounds go before the integral.
    assert_array_equal(transfer.cells(np.ones(6), keep_integral=True), 1.0)


def test_points_outside_get_the_value_of_the_nearest_point():
    old = structured_square(4, half_width=1.0)
    new = SimplexMesh([[2.0, 0.25], [5.0, 5.0], [-1.5, -9.0], [0.1, 0.1]], [[0, 1, 2]])
    transfer = FieldTransfer(old, new)
    made = transfer.nodal(old.points, method="interpolate")
    assert_allclose(made, [[1.0, 0.25], [1.0, 1.0], [-1.0, -1.0], [0.1, 0.1]], atol=1e-15)
    assert_allclose(transfer.distances[1], np.hypot(4.0, 4.0))
    # A cell wholly outside gets the value of the cell nearest to its centroid.
    away = SimplexMesh([[9.0, 9.0], [10.0, 9.0], [9.0, 10.0]], [[0, 1, 2]])
    number = np.arange(old.n_cells, dtype=float)
    corner = old.locator.nearest([[28.0 / 3.0, 28.0 / 3.0]])[0]
    assert FieldTransfer(old, away).cells(number)[0] == number[corner[0]]


def test_integers_and_booleans_are_taken_over_not_averaged():
    old, new = pair(2)
    transfer = FieldTransfer(old, new)
    tag = (old.points[old.cells].mean(axis=1)[:, 0] > 0.0).astype(np.int16) + 3
    made = transfer.cells(tag)
    assert made.dtype == np.int16
    middle = new.points[new.cells].mean(axis=1)
    clear = np.abs(middle[:, 0]) > 0.4
    assert_array_equal(made[clear], np.where(middle[clear, 0] > 0.0, 4, 3))
    flag = transfer.nodal(old.points[:, 0] > 0.5, method="interpolate")
    assert flag.dtype == np.bool_
    assert set(np.unique(transfer.nodal(np.arange(old.n_points), method="interpolate"))) <= set(
        range(old.n_points)
    )


def test_nodes_on_a_slit_get_the_values_of_their_side():
    old, new = slit_square(8), slit_square(14)

    def side(mesh):
        up = np.zeros(mesh.n_points)
        middle = mesh.points[mesh.cells].mean(axis=1)
        up[mesh.cells[(middle[:, 1] > 0.0) & (middle[:, 0] > 0.0)]] = 1.0
        return up

    # Linear on either side, and a jump between them.
    a = np.array([0.3, 1.7])
    jump = lambda mesh: mesh.points @ a + 5.0 * side(mesh) * (mesh.points[:, 0] > 0.2)  # noqa: E731
    made = FieldTransfer(old, new).nodal(jump(old), method="interpolate")
    on_slit = (np.abs(new.points[:, 1]) < 1e-12) & (new.points[:, 0] > 0.45)
    assert on_slit.sum() == 2 * 4
    assert_allclose(made[on_slit], jump(new)[on_slit], rtol=1e-12)


def test_meshes_of_two_kinds_are_refused():
    with pytest.raises(ValueError, match="old and new must be meshes of one kind"):
        FieldTransfer(structured_square(1), jittered_cube(2, SEED))
    with pytest.raises(ValueError, match="new must be a SimplexMesh of triangles or tetrahedra"):
        FieldTransfer(structured_square(1), SimplexMesh([[0.0], [1.0]], [[0, 1]]))


def test_nodes_in_no_cell_and_flat_cells_do_no_harm():
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [7, 7], [0.5, 0.5]]
    cells = [[0, 1, 2], [0, 2, 3], [0, 5, 2]]  # the last one is flat
    old = SimplexMesh(points, cells)
    new = SimplexMesh(points, np.array(cells)[:, ::-1])
    transfer = FieldTransfer(old, new)
    assert_allclose(transfer.nodal(old.points, method="interpolate")[:4], old.points[:4])
    made = transfer.cells([1.0, 3.0, 100.0])
    assert_allclose(made[:2], [1.0, 3.0])
    assert np.isfinite(made).all()


def test_cells_with_a_common_node_meet_in_the_same_volume_however_their_nodes_are_numbered():
    # A side of one cell through a corner of the other: its coordinates are 0 or -6e-17, and copies
    # of it were on both sides of a plane.  The volume is that of the convex hull of the
    # intersection of the half spaces, by Qhull; once it was 2.5 times as large.
    common = [-0.38200646695219664, 0.11106700143599256, 0.13426609201256998]
    new = np.array([
        [-0.30804224782798906, 0.12662794518533496, 0.05966209562825854],
        [-0.355031922787242, 0.06518194188122661, 0.04095808151945994],
        common,
        [-0.40053627611702186, 0.16193299622634075, 0.06818597234660737],
    ])  # fmt: skip
    old = np.array([
        [-0.3387006700866524, 0.03915376219126586, 0.10042234623019851],
        [-0.3811201515451311, 0.16260148381710254, 0.0652864260440587],
        [-0.41065233847273513, 0.04871205019950191, 0.07310834035027035],
        common,
    ])  # fmt: skip
    cell = [[0, 1, 2, 3]]
    for first in permutations(range(4)):
        for second in permutations(range(4)):
            pair = SimplexMesh(old[list(first)], cell), SimplexMesh(new[list(second)], cell)
            found = FieldTransfer(*pair).overlap.sum()
            assert found == pytest.approx(1.7485736365e-05, rel=1e-9)
