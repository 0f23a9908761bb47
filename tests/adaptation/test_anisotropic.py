"""`adapt` with metrics: fewer elements for the same error, budgets, bounds, tags and refusals."""

from functools import cache

import numpy as np
import pytest
from meshes import structured_square
from shapes import two_region_rectangle

from adaptsize import Metric, SizeFunction, adapt
from adaptsize.metrics import MetricFunction

pytest.importorskip("mmgpy")

MESH = two_region_rectangle(12)


def layer(points):
    """A layer along x = .9 + .1 y."""
    return np.tanh(40.0 * (points[:, 0] - 0.9 - 0.1 * points[:, 1]))


def interpolation_error(mesh, field, n=6):
    """The norm of L2 of the error of linear interpolation, by midpoints of n^2 parts of cells."""
    corners, nodal = mesh.points[mesh.cells], field(mesh.points)[mesh.cells]
    total = 0.0
    for i in range(n):
        for j in range(n - i):
            for a, b in ((i + 1 / 3, j + 1 / 3), (i + 2 / 3, j + 2 / 3)):
                if a + b < n:
                    weights = np.array([n - a - b, a, b]) / n
                    error = nodal @ weights - field(np.einsum("k,nkd->nd", weights, corners))
                    total += float((error**2 * mesh.measures).sum()) / n**2
    return np.sqrt(total)


@cache
def loop(*, anisotropic, n_cycles=3, target=1500, start=MESH):
    mesh = start
    for _ in range(n_cycles):
        fields = {"u": layer(mesh.points)}
        if anisotropic:
            result = adapt(mesh, anisotropic=True, fields=fields, elements=target, hmax=0.3)
        else:
            from adaptsize import size_from_hessian

            h = size_from_hessian(mesh, fields["u"], elements=target, norm=2.0, hmax=0.3)
            result = adapt(mesh, h0=h, elements=target, fields=fields)
        mesh = result.mesh
    return result


def test_anisotropic_cells_have_a_much_smaller_error():
    # Measured 14 times smaller with as many cells.
    meshes = [loop(anisotropic=kind).mesh for kind in (True, False)]
    errors = [interpolation_error(mesh, layer) for mesh in meshes]
    assert errors[0] < errors[1] / 8.0
    cells = [mesh.n_cells for mesh in meshes]
    assert cells == pytest.approx([1500, 1500], rel=0.15)


def test_tags_fields_and_the_report():
    result = loop(anisotropic=True)
    mesh = result.mesh
    for tag in (5, 9):
        assert mesh.measures[mesh.cell_tags == tag].sum() == pytest.approx(1.0)
    assert set(mesh.facet_tags) == {30, 31}
    assert result.fields["u"].shape == (mesh.n_points,)
    assert np.abs(result.fields["u"] - layer(mesh.points)).max() < 0.1
    assert isinstance(result.metric, MetricFunction)
    assert result.size.values == pytest.approx(result.metric.metric.sizes[:, 0])
    assert result.report.after.share_in_band > 0.8
    assert result.report.after.metric.requested_aspect > 10.0


def test_a_metric_is_scaled_to_the_number_of_elements():
    metric = Metric(np.tile([0.05, 0.2], (MESH.n_points, 1)), [np.eye(2)] * MESH.n_points)
    result = adapt(MESH, h0=metric, elements=2500)
    assert result.report.budget_met
    requested = result.metric.metric.sizes
    assert requested[:, 1] / requested[:, 0] == pytest.approx(4.0)


def test_isotropic_bounds_and_limits_hold():
    fields = {"u": layer(MESH.points)}
    bound = SizeFunction(MESH, np.full(MESH.n_points, 0.07))
    result = adapt(MESH, anisotropic="u", fields=fields, tolerance=1e-2, h0=bound, hmin=0.02)
    sizes = result.metric.metric.sizes
    assert sizes.max() <= 0.07 * (1.0 + 1e-9)
    assert sizes.min() >= 0.02 * (1.0 - 1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"anisotropic": True}, "anisotropic needs a field in fields"),
        ({"anisotropic": "w", "elements": 100}, "anisotropic must name fields.*got 'w'"),
        ({"anisotropic": len, "elements": 100}, "anisotropic must be True, False or names"),
        ({"anisotropic": ["u"]}, "fields need tolerance, elements or nodes"),
        ({"h0": Metric.isotropic([1.0], 2)}, "metric must have .* nodes"),
        ({"h0": Metric.isotropic(np.ones(MESH.n_points), 2), "tolerance": 1.0}, "tolerance needs"),
        ({"h0": Metric.isotropic(np.full(MESH.n_points, np.inf), 2)}, "finite size at one node"),
    ],
)
def test_bad_requests_are_refused(options, message):
    fields = {"u": layer(MESH.points), "n": np.arange(MESH.n_points)}
    if options == {"anisotropic": True}:
        fields = {"n": fields["n"]}
    with pytest.raises(ValueError, match=message):
        adapt(MESH, fields=fields, **options)


def test_indicators_and_metrics_do_not_mix():
    with pytest.raises(ValueError, match="indicator must be None with a metric"):
        adapt(MESH, np.ones(MESH.n_cells), anisotropic=True, fields={"u": layer(MESH.points)})


@pytest.mark.parametrize("names", [["u", 3], [3, "u"], [None], 3, [["u"]]])
def test_names_of_fields_are_texts(names):
    mesh = structured_square(3)
    with pytest.raises(ValueError, match="anisotropic must be True, False or names of fields"):
        adapt(mesh, fields={"u": mesh.points[:, 0]}, anisotropic=names, elements=50)
