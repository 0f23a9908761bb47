"""Cycles that remesh a plane mesh only around the cells that miss their sizes."""

import numpy as np
import pytest
from meshes import slit_square, structured_square
from numpy.testing import assert_allclose, assert_array_equal
from shapes import facet_areas, two_region_rectangle

from adaptsize import ElementField, FieldTransfer, SimplexMesh, adapt
from adaptsize.adaptation import patch
from adaptsize.errors import BackendError

SEED = 83
SPOT = np.array([0.5, 0.45])


def around(spot, fine=0.01, coarse=0.06):
    """Return sizes that are small at a point."""
    return lambda x: np.minimum(coarse, fine + 0.3 * np.linalg.norm(x - spot, axis=-1))


def next_one(mesh, spot=SPOT, **options):
    return adapt(mesh, h0=around(spot), local=True, enough=2.0, **options)


@pytest.fixture(scope="module")
def regular():
    """Two regions with tagged edges, and the sizes everywhere but at the spot."""
    pytest.importorskip("mmgpy")
    return adapt(two_region_rectangle(6), h0=0.06, enough=2.0).mesh


def far_from(points, spot=SPOT, radius=0.45):
    return np.linalg.norm(points - spot, axis=-1) > radius


def places(points):
    return set(map(tuple, points.tolist()))


def test_cells_and_fields_stay_where_the_sizes_are_kept(regular):
    rng = np.random.default_rng(SEED)
    u, heat = rng.random(regular.n_points), rng.random(regular.n_cells)
    result = next_one(regular, fields={"u": u}, cell_fields={"heat": heat})
    new, far = result.mesh, far_from(regular.points)
    before, after = (np.count_nonzero(~far_from(m.points, radius=0.1)) for m in (regular, new))
    assert after > 2 * before
    assert places(regular.points[far]) <= places(new.points)
    assert not places(regular.points[~far]) <= places(new.points)
    where = {tuple(point): k for k, point in enumerate(new.points.tolist())}
    rows = [where[tuple(point)] for point in regular.points[far].tolist()]
    # The rest of a projection falls fast with the distance from where cells are new.
    assert_allclose(result.fields["u"][rows], u[far], atol=1e-3)
    at = FieldTransfer(regular, result.mesh).cells(np.arange(regular.n_cells), conservative=False)
    is_far = far_from(new.points[new.cells], radius=0.6).all(axis=1)
    assert_array_equal(result.cell_fields["heat"][is_far], heat[at[is_far]])


@pytest.mark.parametrize("method", ["bounded", "project", "interpolate"])
def test_linear_fields_stay_and_integrals_are_kept(regular, method):
    rng = np.random.default_rng(SEED)
    a = np.array([[0.3, 1.0], [-2.0, 0.7]])
    u = rng.random((regular.n_points, 2)) + 1j
    fields = {"linear": regular.points @ a, "u": u, "node": np.arange(regular.n_points)}
    heat = rng.random(regular.n_cells)
    result = next_one(regular, fields=fields, cell_fields={"heat": heat}, method=method)
    new, report = result.mesh, result.report
    assert_allclose(result.fields["linear"], new.points @ a, atol=1e-13)
    assert_allclose(new.measures @ result.cell_fields["heat"], regular.measures @ heat, rtol=1e-13)
    if method != "interpolate":
        before, after = report.integrals["u"]
        assert_allclose(after, before, rtol=1e-13)
    if method != "project":
        assert result.fields["u"].real.min() >= u.real.min()
        assert result.fields["u"].real.max() <= u.real.max()
    assert result.fields["node"].dtype == np.arange(1).dtype
    assert set(result.fields["node"]) <= set(range(regular.n_points))


def test_tags_names_and_interfaces_stay(regular):
    """Also of a mesh with cells of any orientation."""
    cells = np.random.default_rng(SEED).permuted(regular.cells, axis=1)
    named = SimplexMesh(
        regular.points, cells, cell_tags=regular.cell_tags,
        tagged_facets=regular.tagged_facets, facet_tags=regular.facet_tags,
        tag_names={(2, int(regular.cell_tags[0])): "first"},
    )  # fmt: skip
    new = next_one(named).mesh
    assert new.tag_names == named.tag_names
    for tag in np.unique(regular.facet_tags).tolist():
        assert facet_areas(new, tag) == pytest.approx(facet_areas(regular, tag), rel=1e-12)
    for tag in np.unique(regular.cell_tags).tolist():
        old, now = (mesh.measures[mesh.cell_tags == tag].sum() for mesh in (regular, new))
        assert now == pytest.approx(old, rel=1e-12)
    assert new.facet_cell_counts.max() == 2
    assert (new.signed_measures > 0.0).all()


def test_sizes_are_met_and_cells_are_good(regular):
    result = next_one(regular)
    after = result.report.after
    assert after.share_in_band >= 0.95
    assert after.served >= 0.98
    assert after.angle_min >= 25.0


def test_fields_of_elements_are_projected_from_the_whole(regular):
    def product(x):
        return x[..., 0] * x[..., 1]

    given = ElementField(product(ElementField.nodes(regular, 2)), order=2)
    result = next_one(regular, fields={"v": given})
    nodes = ElementField.nodes(result.mesh, 2)
    assert_allclose(result.fields["v"].values, product(nodes), atol=1e-12)


def test_a_turned_mirrored_and_renumbered_mesh_gets_the_same_patch(regular):
    gone = patch.cells_to_remake(regular, around(SPOT)(regular.points))
    assert 0.05 < gone.mean() < 0.4
    turn = np.array([[0.8, 0.6], [0.6, -0.8]])  # and mirrored
    points = 3.0 * (regular.points @ turn)
    order = np.random.default_rng(SEED).permutation(regular.n_points)
    number = np.argsort(order)
    other = SimplexMesh(points[order], number[regular.cells[:, ::-1]])
    h = 3.0 * around(SPOT)(regular.points)[order]
    assert_array_equal(patch.cells_to_remake(other, h), gone)


def boundary_of(mesh):
    return mesh.boundary().mesh.measures.sum()


def test_slits_through_the_patch_stay_open():
    pytest.importorskip("mmgpy")
    mesh = adapt(slit_square(8), h0=0.08, enough=2.0).mesh
    spot = mesh.boundary().mesh.points.mean(axis=0)
    new = adapt(mesh, h0=around(spot, 0.02, 0.08), local=True, enough=2.0).mesh
    assert len(places(mesh.points) & places(new.points)) > 0.5 * mesh.n_points
    assert boundary_of(new) == pytest.approx(boundary_of(mesh), rel=1e-12)


def test_domains_that_touch_at_a_node_are_remeshed_as_a_whole():
    pytest.importorskip("mmgpy")
    one = structured_square(8, half_width=0.5)
    points = np.vstack([one.points, one.points + 1.0])
    corner = [int(np.argmin(np.abs(points - 0.5).sum(axis=1)))]
    cells = np.vstack([one.cells, one.cells + one.n_points])
    twin = np.flatnonzero((points == points[corner]).all(axis=1))
    cells[cells == twin[1]] = twin[0]
    mesh = SimplexMesh(points, cells)
    gone = np.arange(mesh.n_cells) < one.n_cells
    assert patch.patched(mesh, gone, lambda part, cut: part) is None


def test_new_cells_that_do_not_fit_are_refused(regular):
    gone = far_from(regular.points[regular.cells].mean(axis=1), radius=0.2)

    def moved(part, cut):
        points = part.points.copy()
        points[cut[0, 0]] += 1e-3
        return part.moved(points)

    assert patch.patched(regular, ~gone, moved) is None
    same = patch.patched(regular, ~gone, lambda part, cut: part)
    assert same.n_points == regular.n_points
    assert same.measures.sum() == pytest.approx(regular.measures.sum())


def test_a_failure_in_the_patch_leads_to_a_whole_mesh(regular, monkeypatch):
    from adaptsize.adaptation import new_mesh

    made, calls = new_mesh.trial, []

    def failing(mesh, size, required_facets=None, *rest, **options):
        calls.append(required_facets is not None)
        if calls[-1]:
            raise BackendError("it fails")
        return made(mesh, size, required_facets, *rest, **options)

    monkeypatch.setattr(new_mesh, "trial", failing)
    assert next_one(regular).remeshed
    assert calls == [True, False]


def test_a_number_of_elements_is_met_within_15_percent(regular):
    n = 1.15 * regular.n_cells
    c = regular.points[regular.cells].mean(axis=1)
    eta = regular.measures * (1.0 + 3.0 * np.exp(-40.0 * ((c - SPOT) ** 2).sum(axis=1)))
    result = adapt(regular, eta, elements=n, local=True, enough=2.0)
    assert result.report.budget_met


@pytest.mark.parametrize(
    "options", [{"backend": "bisection"}, {"periodic": [[2.0, 0.0]]}], ids=["bisection", "periodic"]
)
def test_what_it_cannot_do_is_refused(options):
    pytest.importorskip("mmgpy")
    with pytest.raises(
        ValueError, match="local needs a mesh in the plane that is not periodic, and Mmg"
    ):
        adapt(structured_square(4, half_width=1.0), h0=0.3, local=True, **options)


def test_tetrahedra_are_refused():
    from shapes import two_region_block

    pytest.importorskip("mmgpy")
    with pytest.raises(ValueError, match="local needs a mesh in the plane"):
        adapt(two_region_block(2), h0=0.3, local=True)
