"""Fields of finite elements between meshes: exact, conservative, of the order of the element."""

import re

import numpy as np
import pytest
from meshes import jittered_cube, jittered_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import (
    ElementField,
    FieldTransfer,
    SimplexMesh,
    adapt,
    transfer_fields,
)
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.pieces import common_points, rule_of
from adaptsize.distributed import PartitionedMesh

SEED = 52017
ELEMENTS = [(0, False), (1, True), (1, False), (2, True), (2, False)]


def pair(dim, n=None):
    """Two meshes of one square or cube, of any orientation, that share no inner node."""
    n = n or {2: (5, 6), 3: (3, 4)}[dim]
    make = {2: jittered_square, 3: jittered_cube}[dim]
    old, new = (make(k, SEED + k, half_width=1.0) for k in n)
    cells = np.random.default_rng(SEED).permuted(new.cells, axis=1)
    return old, SimplexMesh(new.points, cells)


def polynomial(order, dim):
    """A polynomial of an order with several components."""
    a = np.random.default_rng(SEED + order).normal(size=(dim, 3))
    return lambda x: 1.5 + (x @ a) ** order if order else np.full((len(x), 3), 1.5)


def sample(function, mesh, order, continuous):
    nodes = ElementField.nodes(mesh, order, continuous=continuous)
    values = function(nodes.reshape(-1, mesh.dim))
    return values.reshape(*nodes.shape[:-1], *values.shape[1:])


def integral(mesh, field):
    space = LagrangeSpace(mesh, field.order, field.continuous)
    values = np.asarray(field.values).reshape(space.n, -1)
    return space.integrals @ values


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("degree", [1, 2, 4, 5])
def test_rules_are_exact(dim, degree):
    rule = rule_of(dim, degree)
    assert (rule.weights > 0.0).all()
    assert_allclose(rule.places.sum(axis=1), 1.0)
    # The mean of x^i y^j over a simplex is i! j! d! / (i + j + d)!.
    from math import factorial as f

    for i in range(degree + 1):
        x, y = rule.places[:, 0], rule.places[:, 1]
        expected = f(i) * f(degree - i) * f(dim) / f(degree + dim)
        assert rule.weights @ (x**i * y ** (degree - i)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_pieces_fill_the_intersections_and_their_places_agree(dim):
    old, new = pair(dim)
    transfer = FieldTransfer(old, new)
    total = np.zeros((new.n_cells, old.n_cells))
    for at in common_points(transfer, 2):
        np.add.at(total, (at.cells, at.old_cells), at.weights.sum(axis=1))
        x = at.places @ new.points[new.cells[at.cells]]
        assert_allclose(at.old_places @ old.points[old.cells[at.old_cells]], x, atol=1e-10)
        assert min(at.places.min(), at.old_places.min()) > -1e-9
    assert_allclose(total, transfer.overlap.toarray(), atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("order", "continuous"), ELEMENTS)
def test_functions_of_the_space_are_exact_and_integrals_are_kept(dim, order, continuous):
    old, new = pair(dim)
    exact = polynomial(order, dim)
    field = ElementField(sample(exact, old, order, continuous), order, continuous)
    noise = np.random.default_rng(SEED).normal(size=field.values.shape)
    fields = {"u": field, "n": ElementField(noise + 1j * field.values, order, continuous)}
    made = transfer_fields(old, new, fields=fields).fields
    assert_allclose(made["u"].values, sample(exact, new, order, continuous), atol=1e-11)
    assert (made["u"].order, made["u"].continuous) == (order, continuous)
    for name, given in fields.items():
        before, after = integral(old, given), integral(new, made[name])
        assert_allclose(after, before, atol=1e-12 * np.abs(given.values).max() * 2.0**dim)


@pytest.mark.parametrize(("order", "continuous"), ELEMENTS)
def test_the_order_of_convergence_is_that_of_the_element(order, continuous):
    def wave(x):
        return np.sin(2.0 * x[:, 0] + 0.3) * np.cos(1.5 * x[:, 1])

    error = []
    rule = rule_of(2, 6)
    for n in (8, 16, 32):
        old, new = pair(2, (n, n + n // 4))
        field = ElementField(sample(wave, old, order, continuous), order, continuous)
        made = transfer_fields(old, new, fields={"u": field}).fields["u"]
        space = LagrangeSpace(new, order, continuous)
        places = np.broadcast_to(rule.places, (new.n_cells, *rule.places.shape))
        held = made.values.reshape(space.n, 1)
        values = space.values(held, np.arange(new.n_cells), places)[..., 0]
        x = (places @ new.points[new.cells]).reshape(-1, 2)
        squares = (values - wave(x).reshape(values.shape)) ** 2 @ rule.weights
        error.append(np.sqrt(new.measures @ squares))
    orders = np.log2(np.divide(error[:-1], error[1:]))
    assert (orders > order + 0.8).all(), f"errors {error}, orders {orders}"


def test_functions_are_projected_onto_the_element():
    old, new = pair(2)
    exact = polynomial(2, 2)
    made = transfer_fields(
        old, new, fields={"u": ElementField(exact, order=2), "v": lambda x: 1.0 + x[:, 0]}
    ).fields
    assert_allclose(made["u"].values, sample(exact, new, 2, True), atol=1e-12)
    assert_allclose(made["v"], 1.0 + new.points[:, 0], atol=1e-12)


def of_triangles(order):
    """Rules with 1, 3 and 6 points for triangles: exact for degrees 1, 2 and 4."""
    if order == 0:
        return [[1 / 3, 1 / 3]], [1.0]
    if order == 1:
        return [[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]], [1.0] * 3
    a, b = 0.445948490915965, 0.091576213509771
    corners = [[x, y] for t in (a, b) for x, y in ((t, t), (1 - 2 * t, t), (t, 1 - 2 * t))]
    return corners, [0.223381589678011] * 3 + [0.109951743655322] * 3


@pytest.mark.parametrize("order", [0, 1, 2])
def test_data_at_points_of_quadrature_are_exact_for_polynomials_and_conserved(order):
    old, new = pair(2)
    points, weights = of_triangles(order)
    exact = polynomial(order, 2)

    def at_points(mesh):
        a, b, c = np.moveaxis(mesh.points[mesh.cells], 1, 0)[:, :, None]
        x, y = np.transpose(points)[..., None]
        where = a + x * (b - a) + y * (c - a)
        return exact(where.reshape(-1, 2)).reshape(*where.shape[:2], 3)

    noise = np.random.default_rng(SEED).normal(size=(old.n_cells, len(points), 2, 2))
    fields = {
        "u": ElementField.at_points(at_points(old), points, weights),
        "n": ElementField.at_points(noise, points, weights),
    }
    made = transfer_fields(old, new, fields=fields).fields
    assert_allclose(made["u"].values, at_points(new), atol=1e-11)
    share = np.array(weights) / np.sum(weights)
    before, after = (
        np.einsum("c,q,cqij->ij", mesh.measures, share, field.values)
        for mesh, field in ((old, fields["n"]), (new, made["n"]))
    )
    assert_allclose(after, before, atol=1e-12 * 4.0)


def test_logarithms_keep_matrices_positive():
    old, new = pair(2)
    points, weights = of_triangles(2)
    rng = np.random.default_rng(SEED)

    def matrices(*shape):
        a = rng.normal(size=(*shape, 2, 2))
        return a @ np.swapaxes(a, -1, -2) + 1e-3 * np.eye(2)

    n = ElementField.nodes(old, 2).shape[0]
    same = np.broadcast_to([[2.0, 0.5], [0.5, 1.0]], (n, 2, 2))
    values, data = matrices(n), matrices(old.n_cells, 6)
    fields = {
        "a": ElementField(values, 2, log=True),
        "b": ElementField.at_points(data, points, weights, log=True),
        "same": ElementField(same, 2, log=True),
    }
    made = transfer_fields(old, new, fields=fields).fields
    for name in "ab":
        assert np.linalg.eigvalsh(made[name].values).min() > 0.0
        assert_array_equal(made[name].values, np.swapaxes(made[name].values, -1, -2))
    assert_allclose(made["same"].values, np.broadcast_to(same[0], made["same"].values.shape))
    without = transfer_fields(old, new, fields={"a": ElementField(values, 2)}).fields["a"].values
    assert np.linalg.eigvalsh(without).min() < 0.0


@pytest.mark.parametrize(("order", "continuous"), ELEMENTS)
def test_beyond_the_old_mesh_constants_stay(order, continuous):
    old, new = (jittered_square(k, SEED, half_width=w) for k, w in ((5, 1.0), (6, 1.2)))
    shape = ElementField.nodes(old, order, continuous=continuous).shape[:-1]
    field = ElementField(np.full(shape, 3.0), order, continuous)
    made = transfer_fields(old, new, fields={"u": field}).fields["u"]
    assert_allclose(made.values, 3.0, rtol=1e-11)
    back = transfer_fields(new, old, fields={"u": made}).fields["u"]
    assert_allclose(back.values, 3.0, rtol=1e-11)


def test_adapt_returns_fields_of_the_same_elements_and_reports_them(generator):
    mesh = structured_square(6, half_width=1.0)
    square = sample(lambda x: x[:, 0] ** 2, mesh, 2, True)
    points, weights = of_triangles(1)
    fields = {
        "u": ElementField(square, 2),
        "p": mesh.points[:, 1],
        "f": lambda x: x,
        "q": ElementField.at_points(np.ones((mesh.n_cells, 3)), points, weights),
    }
    result = adapt(mesh, h0=0.2, fields=fields)
    new = result.mesh
    assert set(result.fields) == set(fields)
    assert_allclose(result.fields["u"].values, ElementField.nodes(new, 2)[:, 0] ** 2, atol=1e-12)
    assert_allclose(result.fields["f"], new.points, atol=1e-12)
    assert_allclose(result.fields["q"].values, 1.0)
    assert list(new.point_data) == ["p"]
    text = str(result)
    for line in ("field u: projected (P2)", "field q: projected (points of quadrature)"):
        change = re.search(re.escape(line) + r", integral changed by ([0-9.e+-]+)", text)
        assert float(change[1]) < 1e-12
    kept = adapt(new, h0=0.2, enough=0.0, fields=result.fields)
    assert not kept.remeshed
    assert kept.fields["u"] is result.fields["u"]


def test_what_is_not_taken_is_refused_in_words():
    mesh = structured_square(8, half_width=1.0)
    n = len(ElementField.nodes(mesh, 2))

    def refused(match, value, of=mesh, **options):
        with pytest.raises(ValueError, match=match):
            transfer_fields(of, of, fields={"u": value}, **options)

    taken = "a row for each of the 81 nodes, an ElementField, a function"
    refused(taken + r".* \(289,\); 289 are the nodes of ElementField\(values, order=2\)", [0.0] * n)
    refused(taken + r".*got shape \(5,\)$", np.zeros(5))
    refused(r"must have 289 rows, got shape \(81,\)", ElementField(np.zeros(81), 2))
    refused("order of .* must be", ElementField(np.zeros(81), 3))
    refused("must be finite", ElementField(np.full(81, np.nan)))
    refused(
        "weights of .* must be positive",
        ElementField.at_points([[0.0]] * 128, [[0.3, 0.3]], [-1.0]),
    )
    refused(
        r"must have shape \(128, 1, ...\)",
        ElementField.at_points([[0, 1]] * 128, [[0.3, 0.3]], [1]),
    )
    refused("shape \\(n, 2\\), got", ElementField.at_points([[0.0]] * 128, [[0.3] * 3], [1.0]))
    refused("real matrices for log", ElementField(np.ones(81), log=True))
    refused("must be positive definite", ElementField(np.zeros((81, 2, 2)), log=True))
    refused("must be symmetric", ElementField(np.tile([[1, 0.5], [0, 1]], (81, 1, 1)), log=True))
    field = ElementField(np.zeros(81))
    refused('method must be "project" or None', field, method="bounded")
    part = PartitionedMesh.from_serial(mesh)
    refused("a row per node for meshes in parts", field, of=part)
    surface = SimplexMesh(np.pad(mesh.points, ((0, 0), (0, 1))), mesh.cells)
    refused("a row per node for triangles in space", field, of=surface)
    made = transfer_fields(mesh, mesh, fields={"u": field, "v": mesh.points[:, 0]},
                           method={"u": "project", "v": "interpolate"})  # fmt: skip
    assert list(made.fields) == ["u", "v"]


SKFEM = {
    "P2": (2, lambda s: s.ElementTriP2()),
    "DG1": (1, lambda s: s.ElementTriDG(s.ElementTriP1())),
    "vector P2": (2, lambda s: s.ElementVector(s.ElementTriP2())),
    "P3": (3, lambda s: s.ElementTriP3()),
    "edges": (0, lambda s: s.ElementTriN1()),
    "fluxes": (0, lambda s: s.ElementTriRT1()),
    "P2 in space": (2, lambda s: s.ElementTetP2()),
}


@pytest.mark.parametrize("kind", SKFEM)
def test_functions_of_scikit_fem_are_projected_onto_their_element(kind):
    skfem = pytest.importorskip("skfem")
    order, make = SKFEM[kind]
    element = make(skfem)
    dim = 3 if "space" in kind else 2
    old, new = pair(dim)
    a = np.random.default_rng(SEED).normal(size=dim)

    def exact(x):
        values = 1.0 + np.tensordot(a, x, axes=1) ** order if order else 2.0 + 0.0 * x[0]
        is_vector = kind in ("vector P2", "edges", "fluxes")
        return np.stack([values, -2.0 * values]) if is_vector else values

    basis = skfem.Basis(old.to_skfem(), element)
    x = basis.project(exact)
    noise = np.random.default_rng(SEED).normal(size=basis.N) + 1j * x
    made = transfer_fields(old, new, fields={"u": (basis, x), "n": (basis, noise)}).fields
    there, found = made["u"]
    assert type(there.elem) is type(element)
    assert_allclose(found, there.project(exact), atol=1e-10)

    def integrals(basis, x):
        return (np.asarray(basis.interpolate(x)) * basis.dx).sum(axis=(-1, -2))

    before, after = integrals(basis, noise.imag), integrals(there, made["n"][1].imag)
    assert_allclose(after, before, atol=1e-12 * 2.0**dim * np.abs(x).max())


def test_functions_of_scikit_fem_go_with_adapt_and_others_are_refused(generator):
    skfem = pytest.importorskip("skfem")
    grid = skfem.MeshTri().refined(3).scaled(2.0).translated((-1.0, -1.0))
    basis = skfem.Basis(grid, skfem.ElementTriP2())
    x = basis.project(lambda x: x[0] * x[1])
    mesh = SimplexMesh.from_object(grid)
    there, u = transfer_fields(mesh, mesh, fields={"u": (basis, x)}).fields["u"]
    assert_allclose(u, there.project(lambda x: x[0] * x[1]), atol=1e-12)
    finer = skfem.Basis(grid.refined(), basis.elem)
    finer = finer, finer.zeros()
    with pytest.raises(ValueError, match="must be on all cells of the mesh"):
        transfer_fields(mesh, mesh, fields={"u": finer})
    with pytest.raises(ValueError, match=r"fields\['u'\]\[1\] must have 289 rows"):
        transfer_fields(mesh, mesh, fields={"u": (basis, x[1:])})
    both = skfem.Basis(grid, skfem.ElementTriP2() * skfem.ElementTriP1())
    with pytest.raises(ValueError, match="not of a composite one"):
        transfer_fields(mesh, mesh, fields={"u": (both, both.zeros())})
    result = adapt(grid, h0=0.2, fields={"u": (basis, x)})
    assert result.remeshed
    assert result.fields["u"][0].mesh.t.shape[1] == result.mesh.n_cells
    assert "field u: projected (ElementTriP2), integral changed by" in str(result)
