"""The L2 projection of nodal fields: exact integrals, conservation, bounds and order."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import jittered_cube, jittered_square, slit_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from overlap_twin import common_part, measure
from scipy.spatial import Delaunay

from adaptsize import CartesianGrid, FieldTransfer, SimplexMesh, adapt, transfer_fields
from adaptsize._workers import Workers
from adaptsize.adaptation import overlaps
from adaptsize.adaptation.overlaps import intersections_of
from adaptsize.sizes.budget import nodal_measures

SEED = 91127
PROJECTIONS = ("project", "bounded")


def pair(dim, n=None):
    """Two meshes of one square or cube that have no inner node in common."""
    n = n or {2: (9, 11), 3: (5, 6)}[dim]
    make = {2: jittered_square, 3: jittered_cube}[dim]
    return tuple(make(k, SEED + k, half_width=1.0) for k in n)


def mixed(old, new):
    return intersections_of(old, new, Workers(1)).products


def coordinates(corners, x):
    """Barycentric coordinates of points x in a simplex, from a linear system."""
    system = np.vstack([np.ones(len(corners)), corners.T])
    return np.linalg.solve(system, np.vstack([np.ones(len(x)), x.T])).T


def products_of_pair(a, b):
    """Integrals of the products of the coordinates of two simplices over their common part."""
    dim = a.shape[1]
    total = np.zeros((dim + 1, dim + 1))
    for piece in common_part(a, b):
        f, g = coordinates(a, piece), coordinates(b, piece)
        # Linear functions in a simplex: the mean of a product from their values at the corners.
        mean = f.T @ g + np.outer(f.sum(axis=0), g.sum(axis=0))
        total += measure(piece) / ((dim + 1) * (dim + 2)) * mean
    return total


@pytest.mark.parametrize("dim", [2, 3])
def test_mixed_mass_matrix_is_that_of_a_slow_twin(dim):
    rng = np.random.default_rng(SEED)
    count = {2: 20, 3: 9}[dim]
    cells = np.arange(count * (dim + 1)).reshape(count, dim + 1)
    old, new = (SimplexMesh(rng.random((count * (dim + 1), dim)), cells) for _ in range(2))
    expected = np.block(
        [[products_of_pair(new.points[i], old.points[j]) for j in cells] for i in cells]
    )
    assert np.count_nonzero(np.abs(expected) > 1e-9) > 100
    # Qhull's own precision.
    assert_allclose(mixed(old, new).toarray(), expected, atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (1e-9, 0.0), (1e7, 3e7)])
def test_mixed_mass_matrix_is_symmetric_and_sums_to_nodal_measures(dim, scale, shift):
    old, new = (SimplexMesh(scale * m.points + shift, m.cells) for m in pair(dim))
    there, back = mixed(old, new), mixed(new, old)
    size = abs(there).max()
    # Coordinates of size 4 over a tenth of it, in flat cells a hundredth.
    assert_allclose(there.toarray(), back.T.toarray(), atol=1e-12 * size)
    assert_allclose(there.sum(axis=1), nodal_measures(new), rtol=1e-11)
    assert_allclose(there.sum(axis=0), nodal_measures(old), rtol=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", PROJECTIONS)
def test_linear_fields_are_exact_and_integrals_are_kept(dim, method):
    old, new = pair(dim)
    transfer = FieldTransfer(old, new)
    rng = np.random.default_rng(SEED)
    a = rng.normal(size=(dim, 4))
    made = transfer.nodal(old.points @ a + 7.0, method=method)
    assert_allclose(made, new.points @ a + 7.0, atol=1e-12)
    for shape in ((), (2,), (3, 3)):
        field = rng.normal(size=(old.n_points, *shape))
        made = transfer.nodal(field, method=method)
        assert made.shape == (new.n_points, *shape)
        before, after = transfer.integrals(field, made, nodal=True)
        assert_allclose(before, np.tensordot(nodal_measures(old), field, axes=1), rtol=1e-12)
        assert_allclose(after, before, atol=1e-11)
    field = rng.normal(size=(old.n_points, 2)) @ [1.0, 1j]
    made = transfer.nodal(field, method=method)
    assert_allclose(made.real, transfer.nodal(field.real.copy(), method=method), atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_projection_solves_the_normal_equations(dim):
    old, new = pair(dim)
    field = np.random.default_rng(SEED).normal(size=old.n_points)
    made = FieldTransfer(old, new).nodal(field, method="project")
    expected = np.linalg.solve(mixed(new, new).toarray(), mixed(old, new) @ field)
    # 2 (1/3)^n of the Chebyshev iteration, or 2 (0.38)^n, is 1e-13.
    assert_allclose(made, expected, atol=1e-11)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_bounded_values_keep_within_old_ones_and_constants_stay(seed, dim):
    rng = np.random.default_rng(seed)
    old, new = (_random_mesh(dim, rng) for _ in range(2))
    transfer = FieldTransfer(old, new)
    field = np.floor(3.0 * rng.random(old.n_points))
    made = transfer.nodal(field, method="bounded")
    # Exactly, without a tolerance, also where the two hulls differ.
    assert field.min() <= made.min()
    assert made.max() <= field.max()
    for method in PROJECTIONS:
        constant = transfer.nodal(np.full(old.n_points, 0.1), method=method)
        assert_allclose(constant, 0.1, rtol=1e-12)


def _random_mesh(dim, rng):
    points = rng.uniform(-1.0, 1.0, (12, dim))
    return SimplexMesh(points, Delaunay(points).simplices)


def wave(x):
    return np.sin(2.0 * x[:, 0] + 0.3) * np.cos(1.5 * x[:, 1])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", PROJECTIONS)
def test_projections_are_of_second_order(dim, method):
    error = []
    for n in {2: (10, 20, 40), 3: (5, 10)}[dim]:
        old, new = pair(dim, (n, n + n // 4))
        made = FieldTransfer(old, new).nodal(wave(old.points), method=method)
        weights = nodal_measures(new)
        error.append(np.sqrt(weights @ (made - wave(new.points)) ** 2))
    order = np.log(np.divide(error[:-1], error[1:])) / np.log(2.0)
    assert (order > 1.8).all(), f"errors {error}, orders {order}"


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", PROJECTIONS)
def test_rotated_mirrored_scaled_and_renumbered_meshes_give_the_same(dim, method):
    old, new = pair(dim)
    rng = np.random.default_rng(SEED)
    field = (rng.random(old.n_points) > 0.5) * 1.0
    expected = FieldTransfer(old, new).nodal(field, method=method)
    turn = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    turn[:, 0] *= -np.sign(np.linalg.det(turn))  # a reflection
    moved = [SimplexMesh(3.7 * m.points @ turn + 2.0, m.cells) for m in (old, new)]
    assert_allclose(FieldTransfer(*moved).nodal(field, method=method), expected, atol=1e-11)
    numbers = [rng.permutation(m.n_points) for m in (old, new)]
    mixed_up = []
    for mesh, to in zip((old, new), numbers, strict=True):
        cells = rng.permuted(to[mesh.cells], axis=1)[rng.permutation(mesh.n_cells)]
        mixed_up.append(SimplexMesh(mesh.points[np.argsort(to)], cells))
    made = FieldTransfer(*mixed_up).nodal(field[np.argsort(numbers[0])], method=method)
    assert_allclose(made[numbers[1]], expected, atol=1e-11)


def test_sides_of_a_slit_do_not_mix():
    old, new = slit_square(8), slit_square(14)

    def side(mesh):
        up = np.zeros(mesh.n_points)
        middle = mesh.points[mesh.cells].mean(axis=1)
        up[mesh.cells[(middle[:, 1] > 0.0) & (middle[:, 0] > 0.0)]] = 1.0
        return up * (mesh.points[:, 0] > 0.2)

    made = FieldTransfer(old, new).nodal(side(old), method="project")
    on_slit = (np.abs(new.points[:, 1]) < 1e-12) & (new.points[:, 0] > 0.6)
    # Twice 4 nodes; the projection's overshoot decays away from where the jump begins.
    assert_allclose(made[on_slit], side(new)[on_slit], atol=0.05)


def test_methods_may_differ_between_fields():
    old, new = pair(2)
    fields = {"u": np.exp(old.points[:, 0]), "v": old.points[:, 1] ** 2}
    made = transfer_fields(old, new, fields=fields, method={"u": "project", "v": "bounded"})
    transfer = FieldTransfer(old, new)
    assert_array_equal(made.fields["u"], transfer.nodal(fields["u"], method="project"))
    assert_array_equal(made.fields["v"], transfer.nodal(fields["v"], method="bounded"))


def test_adapt_projects_and_reports_the_integrals():
    pytest.importorskip("mmgpy")
    mesh = CartesianGrid((0.0, 0.0), 1.0 / 16.0, (17, 17)).mesh
    field = np.exp(-30.0 * ((mesh.points - 0.4) ** 2).sum(axis=1))
    eta = np.exp(-9.0 * np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1))
    fields = {"u": field, "v": field}
    result = adapt(mesh, eta, elements=700, fields=fields, method={"u": "project"})
    change = {
        name: after / before - 1.0 for name, (before, after) in result.report.integrals.items()
    }
    assert abs(change["u"]) < 1e-10
    assert "field u: projected, integral changed by" in str(result.report)


@pytest.mark.parametrize("method", PROJECTIONS)
def test_where_domains_differ_the_old_part_and_the_continuation_are_integrated(method):
    inner, outer = (jittered_square(9, SEED, half_width=w) for w in (1.0, 1.2))
    field = 2.0 + wave(inner.points)
    grown = FieldTransfer(inner, outer)
    made = grown.nodal(field, method=method)
    # Outside the old polygon, by lumping, the value at the nearest point.
    outside = nodal_measures(outer) - mixed(inner, outer).sum(axis=1)
    extra = outside @ grown.nodal(field, method="interpolate")
    before, after = grown.integrals(field, made, nodal=True)
    assert extra > 0.1
    assert after == pytest.approx(before + extra, rel=1e-11)
    # What sticks out of the new polygon is lost.
    shrunk = FieldTransfer(outer, inner)
    back = shrunk.nodal(made, method=method)
    kept = mixed(outer, inner).sum(axis=0) @ made
    before, after = shrunk.integrals(made, back, nodal=True)
    assert after == pytest.approx(kept, rel=1e-11)
    assert before - after > 0.1
    assert_allclose(grown.nodal(np.ones(inner.n_points), method=method), 1.0, rtol=1e-13)


def test_changes_of_integrals_are_relative_to_the_size_of_the_field(generator):
    mesh = structured_square(8, half_width=1.0)
    odd = mesh.points[:, 0] * (1.0 + 1e-15)
    fields = {"u": odd, "none": np.zeros((mesh.n_points, 2))}
    result = adapt(mesh, h0=0.2, fields=fields, cell_fields={"c": odd[mesh.cells].mean(axis=1)})
    assert abs(result.report.integrals["u"][0]) < 1e-14
    changes = dict(re.findall(r"field (\w+): .* changed by ([0-9.e+-]+)", str(result.report)))
    assert set(changes) == {"u", "c"}
    assert max(map(float, changes.values())) < 1e-12
    # Sums over 16 x 8 squares of |x|.
    assert result.report.magnitudes["u"] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_that_are_the_same_count_as_their_intersections_do(dim, monkeypatch):
    """Also if the hashes of all places are one."""
    old, _ = pair(dim)
    points = old.points.copy()
    inner = (np.abs(points) < 0.5).all(axis=1)
    points[inner] += 0.02 * np.random.default_rng(SEED).random((inner.sum(), dim))
    new = SimplexMesh(points, old.cells[::-1])
    common = overlaps._common_cells(old, new)
    assert 0.1 * old.n_cells < len(common.new) < 0.9 * old.n_cells
    expected = mixed(old, new).toarray()
    monkeypatch.setattr(overlaps, "hashes_of", lambda x: np.zeros(len(x), np.uint64))
    assert_array_equal(mixed(old, new).toarray(), expected)
    monkeypatch.setattr(
        overlaps, "_common_cells", lambda *_: type(common)(*(x[:0] for x in common))
    )
    assert_allclose(mixed(old, new).toarray(), expected, rtol=0.0, atol=1e-14)
