"""Loops that bisect cells in place of a new mesh."""

import numpy as np
import pytest
from adaptive_loops import SEED, disc, indicator, to_circle
from meshes import jittered_cube, jittered_square, random_sphere

import adaptsize as ads
from adaptsize import ElementField, SimplexMesh, adapt
from adaptsize.errors import TooManyElementsError

MESHES = {
    "plane": lambda: jittered_square(8, SEED, half_width=1.0),
    "space": lambda: jittered_cube(4, SEED, half_width=1.0),
    "surface": lambda: jittered_cube(4, SEED, half_width=1.0).boundary().mesh,
}


def bisected(mesh, **options):
    return adapt(mesh, indicator(mesh), backend="bisection", **options)


@pytest.fixture(params=list(MESHES))
def mesh(request):
    return MESHES[request.param]()


def test_a_number_of_elements_or_nodes_is_met_by_parts_of_cells(mesh):
    for goal in ({"elements": 4 * mesh.n_cells}, {"nodes": 3 * mesh.n_points}):
        result = bisected(mesh, **goal)
        new = result.mesh
        made = new.n_cells if "elements" in goal else new.n_points
        assert abs(made / next(iter(goal.values())) - 1.0) < 0.06
        assert np.array_equal(new.points[: mesh.n_points], mesh.points)
        assert new.measures.sum() == pytest.approx(mesh.measures.sum(), rel=1e-13)
        assert new.measures.min() > 0.0
        assert new.is_closed == mesh.is_closed
        if not mesh.is_closed:  # conforming: no facet of the boundary is inside
            assert new.boundary().mesh.measures.sum() == pytest.approx(
                mesh.boundary().mesh.measures.sum(), rel=1e-12
            )
        assert result.report.backend == "bisection"
        assert result.report.boundary_distance == 0.0


def test_edges_are_near_their_sizes_and_cells_are_where_they_are_requested(mesh):
    bound = 0.15 + 0.05 * np.linalg.norm(mesh.points - mesh.points[0], axis=1)
    h0 = ads.SizeFunction(mesh, bound)
    result = adapt(mesh, h0=h0, backend="bisection", g=None)
    new, size = result.mesh, h0(result.mesh.points)
    ends = new.edges
    lengths = np.linalg.norm(new.points[ends[:, 0]] - new.points[ends[:, 1]], axis=1)
    ratios = lengths / size[ends].mean(axis=1)
    assert ratios.max() < 1.7
    assert 0.7 < np.median(ratios) < 1.3


def test_fields_are_the_same_functions(mesh):
    rng = np.random.default_rng(SEED)
    given = {
        "linear": mesh.points @ np.arange(1.0, 1.0 + mesh.dim),
        "rough": rng.random((mesh.n_points, 2)),
        "complex": rng.random(mesh.n_points) + 1j,
        "number": rng.integers(0, 5, mesh.n_points),
    }
    by_cell = {"density": rng.random(mesh.n_cells), "region": np.arange(mesh.n_cells)}
    result = bisected(mesh, elements=3 * mesh.n_cells, fields=given, cell_fields=by_cell)
    new, found = result.mesh, result.fields
    assert np.allclose(found["linear"], new.points @ np.arange(1.0, 1.0 + mesh.dim), atol=1e-14)
    middle = new.points[new.cells].mean(axis=1)
    cells, weights, _ = mesh.locator.nearest(middle)
    for name in ("rough", "complex"):
        there = found[name][new.cells].mean(axis=1)
        values = given[name][mesh.cells[cells]]
        assert np.allclose(there, np.einsum("ij,ij...->i...", weights, values), atol=1e-12)
    assert found["number"].dtype == given["number"].dtype
    assert set(found["number"]) <= set(given["number"])
    assert np.array_equal(result.cell_fields["region"], cells)
    assert np.array_equal(result.cell_fields["density"], by_cell["density"][cells])
    text = str(result.report)
    assert "the same function" in text
    assert np.array_equal(new.point_data["rough"], found["rough"])


@pytest.mark.parametrize("name", ["plane", "space"])
def test_a_field_of_finite_elements_stays_the_same_function(name):
    mesh = MESHES[name]()
    field = ElementField(lambda x: x[:, 0] ** 2 - x[:, 1], order=2)
    first = ads.transfer_fields(mesh, mesh, fields={"u": field}).fields["u"]
    result = bisected(mesh, elements=2 * mesh.n_cells, fields={"u": first})
    exact = ads.transfer_fields(result.mesh, result.mesh, fields={"u": field}).fields["u"]
    assert np.allclose(result.fields["u"].values, exact.values, atol=1e-11)


def test_tags_and_names_stay_with_their_cells_and_facets():
    base = MESHES["space"]()
    low = base.points[base.cells].mean(axis=1)[:, 2] < 0.0
    boundary = base.boundary()
    facets = boundary.nodes[boundary.mesh.cells]
    tags = np.where(base.points[facets].mean(axis=1)[:, 2] > 0.99, 7, 8)
    mesh = SimplexMesh(
        base.points, base.cells, cell_tags=low.astype(int), tagged_facets=facets, facet_tags=tags,
        tag_names={(2, 7): "lid"},
    )  # fmt: skip
    result = bisected(mesh, elements=8 * mesh.n_cells)
    new = result.mesh
    assert new.tag_names == mesh.tag_names
    assert result.report.lost_tags == ()
    for tag in (0, 1):
        assert new.measures[new.cell_tags == tag].sum() == pytest.approx(
            mesh.measures[mesh.cell_tags == tag].sum(), rel=1e-12
        )
    lid = new.points[new.tagged_facets[new.facet_tags == 7]]
    assert np.allclose(lid[:, :, 2], 1.0)
    assert len(lid) > np.count_nonzero(tags == 7)


def test_boundary_nodes_are_moved_to_the_true_boundary():
    mesh = disc(6)
    result = adapt(mesh, h0=0.06, backend="bisection", project=to_circle)
    ends = result.mesh.boundary().mesh.points
    assert np.allclose(np.linalg.norm(ends, axis=1), 1.0, atol=1e-12)
    assert result.mesh.measures.sum() == pytest.approx(np.pi, rel=2e-3)
    assert result.mesh.measures.min() > 0.0


def test_facets_of_a_curved_boundary_are_not_divided_for_its_tolerance():
    mesh = random_sphere(300, SEED)
    bound = np.full(mesh.n_points, 0.25)
    result = adapt(mesh, h0=bound, backend="bisection", boundary_tolerance=1e-5)
    assert result.mesh.n_cells < 3 * mesh.n_cells


def test_a_mesh_that_needs_no_finer_cells_is_returned_itself():
    mesh = jittered_square(12, SEED, half_width=1.0)
    result = adapt(mesh, h0=1.0, backend="bisection", fields={"u": mesh.points[:, 0]})
    assert result.mesh is mesh
    assert (result.remeshed, result.converged) == (False, False)
    assert "bisection does not coarsen" in result.reason
    again = bisected(mesh, elements=mesh.n_cells // 2)
    assert again.mesh is mesh


def test_what_bisection_cannot_do_is_refused():
    mesh = jittered_square(6, SEED, half_width=1.0)
    with pytest.raises(ValueError, match=r"backend .*cannot follow a metric"):
        adapt(mesh, h0=ads.Metric.isotropic(np.full(mesh.n_points, 0.1), 2), backend="bisection")
    with pytest.raises(ValueError, match="'bisection'"):
        adapt(mesh, h0=0.1, backend="bisektion")
    with pytest.raises(TooManyElementsError, match="max_elements = 1000;"):
        adapt(mesh, h0=0.001, backend="bisection", max_elements=1000)


def test_a_loop_that_bisects_meets_the_tolerance_with_nested_meshes():
    mesh = jittered_square(4, SEED, half_width=1.0)
    for cycle in range(20):  # noqa: B007 - it is looked at below
        result = adapt(mesh, singular_error(mesh), tolerance=0.15, backend="bisection")
        if not result.remeshed:
            break
        assert np.array_equal(result.mesh.points[: mesh.n_points], mesh.points)
        mesh = result.mesh
    assert cycle <= 8
    assert result.converged
    assert np.linalg.norm(singular_error(mesh)) <= 0.15
    assert mesh.n_cells < 6000  # twice the number of the uniform distribution of the error


def singular_error(mesh):
    """Return the error of linear elements for the power 2/3 of the distance."""
    away = np.linalg.norm(mesh.points[mesh.cells].mean(axis=1), axis=1)
    h = np.sqrt(mesh.measures)
    return h**2 * (away + h) ** (-4.0 / 3.0)


@pytest.mark.parametrize(
    "options",
    [
        {"elements": 5000, "hmin": 0.1},
        {"elements": 5000, "max_refine": 1.5},
        {"nodes": 5000, "hmin": 0.1},
    ],
)
def test_a_number_does_not_override_limits(options):
    mesh = jittered_square(9, SEED, half_width=0.5)
    result = bisected(mesh, **options)
    assert result.mesh.n_cells < 700
    assert not result.report.budget_met


def test_no_error_requests_nothing():
    mesh = jittered_square(9, SEED, half_width=0.5)
    result = adapt(mesh, np.zeros(mesh.n_cells), elements=500, backend="bisection")
    assert result.mesh is mesh


def test_a_loop_with_the_same_error_everywhere_meets_its_tolerance():
    mesh = jittered_square(5, SEED, half_width=0.5)
    for _ in range(20):
        result = adapt(mesh, mesh.measures, tolerance=0.03, backend="bisection")
        if not result.remeshed:
            break
        mesh = result.mesh
    assert result.converged
    assert np.linalg.norm(mesh.measures) <= 0.03


@pytest.mark.parametrize("n", [300, 450, 1500])
def test_a_number_is_met_below_the_largest_one(n):
    mesh = jittered_square(9, SEED, half_width=0.5)
    result = bisected(mesh, elements=n, max_elements=n)
    assert 0.85 * n < result.mesh.n_cells <= n


def test_fields_follow_nodes_that_are_moved_to_the_boundary():
    mesh = disc(1)
    u = mesh.points @ [1.0, 2.0]
    result = adapt(
        mesh, h0=0.12, backend="bisection", project=to_circle, fields={"u": u},
        method="interpolate",
    )  # fmt: skip
    new = result.mesh
    inside = mesh.locator.nearest(new.points)[2] == 0.0
    assert np.allclose(result.fields["u"][inside], new.points[inside] @ [1.0, 2.0], atol=1e-12)
    assert "the same function" not in str(result.report)
