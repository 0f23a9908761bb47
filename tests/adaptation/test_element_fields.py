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
from adaptsize.adaptation.element_fields import as_nodal_fields
from adaptsize.adaptation.lagrange import LagrangeSpace
from adaptsize.adaptation.pieces import common_pieces, rule_of
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
    for at in (pieces.points(2) for pieces in common_pieces(transfer)):
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
    hint = re.escape("(289,); as values at nodes of elements: ElementField(values, order=2)")
    refused(f"{taken}.* {hint}$", [0.0] * n)
    hint = re.escape("ElementField(values.reshape((128, 3)), order=1, continuous=False)")
    refused(f"{hint}$", [0.0] * 384)
    hint = re.escape("ElementField(values, order=1, continuous=False)")
    refused(f"{hint}$", np.zeros((128, 3, 2)))
    for good in (np.zeros(384).reshape((128, 3)), np.zeros((128, 3, 2))):
        transfer_fields(mesh, mesh, fields={"u": ElementField(good, order=1, continuous=False)})
    refused(taken + r".*got shape \(5,\)$", np.zeros(5))
    refused(r"must have 289 rows, got shape \(81,\)", ElementField(np.zeros(81), 2))
    with pytest.raises(ValueError, match="order must be at most 2, got 3"):
        ElementField(np.zeros(81), 3)
    with pytest.raises(ValueError, match="log must be False if values is a function"):
        ElementField(lambda x: x, log=True)
    refused("must be finite", ElementField(np.full(81, np.nan)))
    with pytest.raises(ValueError, match="weights must be positive"):
        ElementField.at_points([[0.0]] * 128, [[0.3, 0.3]], [-1.0])
    with pytest.raises(ValueError, match=r"of shape \(n_cells, 1, ...\), got"):
        ElementField.at_points([[0, 1]] * 128, [[0.3, 0.3]], [1])
    with pytest.raises(ValueError, match="log must be True or False"):
        ElementField.at_points([[0.0]] * 128, [[0.3, 0.3]], [1.0], log=3)
    refused("shape \\(n, 2\\), got", ElementField.at_points([[0.0]] * 128, [[0.3] * 3], [1.0]))
    refused("real matrices for log", ElementField(np.ones(81), log=True))
    refused("must be positive definite", ElementField(np.zeros((81, 2, 2)), log=True))
    refused("must be symmetric", ElementField(np.tile([[1, 0.5], [0, 1]], (81, 1, 1)), log=True))
    field = ElementField(np.zeros(81))
    finite = r"fields\['u'\], a field of finite elements, which is always projected"
    refused(f'method must be "project" or None for {finite}', field, method="bounded")
    refused(r"fields\['u'\], a function, which is", lambda x: x, method="bounded")
    refused(finite, field, method=np.array(["project"]))
    part = PartitionedMesh.from_serial(mesh)
    refused("a row per node for meshes in parts", field, of=part)
    surface = SimplexMesh(np.pad(mesh.points, ((0, 0), (0, 1))), mesh.cells)
    refused("a row per node for triangles in space", field, of=surface)
    refused(r"must have 81 rows, got shape \(289,\)$", np.zeros(289), of=surface)
    made = transfer_fields(mesh, mesh, fields={"u": field, "v": mesh.points[:, 0]},
                           method={"u": "project", "v": "interpolate"})  # fmt: skip
    assert list(made.fields) == ["u", "v"]


def test_integer_matrices_have_logarithms():
    mesh = structured_square(3)
    whole = np.tile([[2, 1], [1, 2]], (mesh.n_points, 1, 1))
    made = transfer_fields(mesh, mesh, fields={"u": ElementField(whole, log=True)}).fields["u"]
    assert_allclose(made.values, whole, rtol=1e-12)


@pytest.mark.parametrize("size", [1e160, 1e-170, 1.0])
def test_large_and_small_values_are_projected_like_others(size):
    old, new = pair(2)
    exact = polynomial(1, 2)
    fields = {"u": ElementField(size * exact(old.points)), "v": lambda x: size * exact(x)}
    made = transfer_fields(old, new, fields=fields).fields
    for values in (made["u"].values, made["v"]):
        assert_allclose(values / size, exact(new.points), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_coefficients_follow_from_products_in_any_cells(dim, order):
    # Cells of very different sizes and shapes; the number of steps does not depend on them.
    mesh = pair(dim)[1]
    uneven = SimplexMesh(mesh.points * np.exp(4.0 * mesh.points[:, :1]), mesh.cells)
    assert np.ptp(np.log10(uneven.measures)) > 3.0
    space = LagrangeSpace(uneven, order, True)
    rule = rule_of(dim, 2 * order)
    cells = np.arange(uneven.n_cells, dtype=np.int32)
    places = np.broadcast_to(rule.places, (len(cells), *rule.places.shape))
    wanted = np.random.default_rng(SEED).normal(size=(space.n, 2))
    weights = uneven.measures[:, None, None] * rule.weights[None, :, None]
    load = space.load(cells, places, weights * space.values(wanted, cells, places))
    assert_allclose(space.solve(load), wanted, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
def test_linear_elements_are_projected_as_nodal_fields(dim):
    old, new = pair(dim)
    values = np.random.default_rng(SEED).normal(size=(old.n_points, 2))
    fields = {"nodal": values, "element": ElementField(values)}
    made = transfer_fields(old, new, fields=fields, method={"nodal": "project"}).fields
    assert_array_equal(made["element"].values, made["nodal"])


@pytest.mark.parametrize("order", [1, 2])
def test_nodes_in_no_cell_get_the_nearest_value(order):
    old, new = pair(2)
    loose = SimplexMesh([*new.points, [0.1, 0.2], [5.0, 0.3]], new.cells)
    exact = polynomial(order, 2)
    fields = {
        "u": ElementField(sample(exact, old, order, True), order),
        "v": ElementField(exact, order),
    }
    made = transfer_fields(old, loose, fields=fields).fields
    n = loose.n_points
    for name, beyond in (("u", [1.0, 0.3]), ("v", [5.0, 0.3])):
        values = made[name].values
        assert_allclose(values[: n - 1], exact(loose.points[: n - 1]), atol=1e-11)
        assert_allclose(values[n - 1], exact(np.array([beyond]))[0], rtol=1e-11)


def test_fields_share_the_intersections(monkeypatch):
    from adaptsize.adaptation import pieces

    calls, fill = [], pieces.fill_pieces
    monkeypatch.setattr(pieces, "fill_pieces", lambda *a: calls.append(1) or fill(*a))
    old, new = pair(2)
    fields = {
        f"u{order}{shared}": ElementField(
            sample(polynomial(order, 2), old, order, shared), order, shared
        )
        for order, shared in ELEMENTS
    }
    noise = np.random.default_rng(SEED).normal(size=(len(ElementField.nodes(old, 2)), 2))
    fields["z"] = ElementField(noise + 1j, 2)  # of the spaces of another one
    made = transfer_fields(old, new, fields=fields).fields
    assert len(calls) == 1
    for name, field in fields.items():
        alone = transfer_fields(old, new, fields={name: field}).fields[name]
        assert_allclose(made[name].values, alone.values, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_functions_and_reports_do_not_depend_on_how_many_points_are_processed(monkeypatch, dim):
    old, new = pair(dim)
    beyond = SimplexMesh(1.1 * new.points, new.cells)
    exact = polynomial(2, dim)
    fields = {"f": ElementField(lambda x: exact(x) * 1j, 2), "u": ElementField(exact(old.points))}

    def run():
        made = transfer_fields(old, beyond, fields=fields).fields
        reports = [field.before(old) for field in as_nodal_fields(fields, old).elements.values()]
        return [field.values for field in made.values()], reports

    whole, reports = run()
    monkeypatch.setattr("adaptsize.adaptation.pieces._POINTS", 700)
    parts, others = run()
    for one, other in zip(whole, parts, strict=True):
        assert_allclose(one, other, rtol=1e-11, atol=1e-11)
    for (total, size), (total_, size_) in zip(reports, others, strict=True):
        assert_allclose(total, total_, rtol=1e-12, atol=1e-12)
        assert size == pytest.approx(size_)
    projected = transfer_fields(old, old, fields={"f": fields["f"]}).fields["f"]
    assert_allclose(reports[0][0], integral(old, projected), rtol=1e-11, atol=1e-11)


def test_the_report_evaluates_a_function_once_on_the_old_mesh(generator):
    mesh, called = structured_square(6, half_width=1.0), []

    def function(x):
        called.append(len(x))
        return x[:, 0]

    result = adapt(mesh, h0=0.2, fields={"f": function})
    assert len(called) == 2  # on the new mesh, and for the report on the old one
    assert result.report.magnitudes["f"] == pytest.approx(2.0, rel=0.02)


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


@pytest.mark.parametrize("sizes", [(5, 4), (4, 6)])
@pytest.mark.parametrize("is_vector", [False, True])
def test_elements_of_global_functions_forget_the_old_mesh(sizes, is_vector):
    skfem = pytest.importorskip("skfem")
    old, new = pair(2, sizes)

    def on(mesh):
        element = skfem.ElementTriMorley()
        element = skfem.ElementVector(element) if is_vector else element
        return skfem.Basis(mesh.to_skfem(), element, intorder=4)

    def exact(x):
        value = 1.0 + x[0] ** 2 - 3.0 * x[0] * x[1]
        return np.stack([value, -value]) if is_vector else value

    basis = on(old)
    made = transfer_fields(old, new, fields={"u": (basis, basis.project(exact))}).fields["u"]
    for there in (on(new), made[0]):
        values = np.asarray(there.interpolate(made[1]))
        assert_allclose(values, exact(np.asarray(there.global_coordinates())), atol=1e-10)


def test_bases_on_other_cells_are_refused():
    skfem = pytest.importorskip("skfem")
    mesh, cube = structured_square(3), jittered_cube(3, SEED)
    curved = skfem.MeshTri2.init_circle(1)
    for basis, match in (
        (skfem.Basis(cube.to_skfem(), skfem.ElementTetP1()), "must be on all cells of the mesh"),
        (skfem.Basis(curved, skfem.ElementTriP1()), "on straight cells, .* got one on a MeshTri2"),
    ):
        of = mesh if basis.mesh.dim() == 3 else SimplexMesh.from_object(curved)
        with pytest.raises(ValueError, match=match):
            transfer_fields(of, of, fields={"u": (basis, basis.zeros())})


def test_a_basis_is_not_put_on_nodes_in_no_cell():
    skfem = pytest.importorskip("skfem")
    old, new = pair(2)
    loose = SimplexMesh([*new.points, [5.0, 0.3]], new.cells)
    basis = skfem.Basis(old.to_skfem(), skfem.ElementTriP1())
    with pytest.raises(ValueError, match="a mesh with nodes in no cell"):
        transfer_fields(old, loose, fields={"u": (basis, basis.zeros())})
