"""Quality in a metric: cells that are regular in it, and invariance under linear maps."""

import numpy as np
import pytest
from shapes import block, two_region_rectangle

from adaptsize import Metric, SimplexMesh, size_conformity
from adaptsize.metrics.implied import implied_metric
from adaptsize.quality.elements import metric_qualities

REGULAR = {
    2: [[0, 0], [1, 0], [0.5, np.sqrt(3) / 2]],
    3: [[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(3) / 2, 0], [0.5, np.sqrt(3) / 6, np.sqrt(2 / 3)]],
}


def skewed(dim, condition, seed):
    """A random linear map of the given condition number."""
    rng = np.random.default_rng(seed)
    u, v = (np.linalg.qr(rng.standard_normal((dim, dim)))[0] for _ in range(2))
    return u @ np.diag(np.geomspace(1.0, condition, dim)) @ v


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("condition", [1.0, 30.0, 1e5])
def test_a_cell_is_regular_in_the_metric_that_it_implies(dim, condition):
    points = np.array(REGULAR[dim]) @ skewed(dim, condition, 811).T
    mesh = SimplexMesh(points, [list(range(dim + 1))])
    metric = implied_metric(mesh)
    assert metric.aspect_ratio[0] == pytest.approx(condition, rel=1e-9)
    nodal = Metric(*(np.repeat(a, dim + 1, axis=0) for a in (metric.sizes, metric.directions)))
    assert nodal.edge_lengths(mesh.points, mesh.edges) == pytest.approx(1.0, abs=1e-9)
    assert metric_qualities(mesh, nodal) == pytest.approx(1.0, abs=1e-9)
    conformity = size_conformity(mesh, nodal)
    assert conformity.share_in_band == 1.0
    # One regular cell: as many cells as predicted.
    assert conformity.metric.predicted_elements == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("mesh", [two_region_rectangle(3), block(2)])
def test_quality_does_not_change_if_space_and_metric_are_mapped_together(mesh):
    shape = skewed(mesh.dim, 40.0, 907)
    rng = np.random.default_rng(419)
    directions = np.linalg.qr(rng.standard_normal((mesh.n_points, mesh.dim, mesh.dim)))[0]
    # A constant metric: the mean in a cell of others is not covariant under shears.
    metric = Metric(
        np.tile(rng.uniform(0.1, 1.0, mesh.dim), (mesh.n_points, 1)),
        np.tile(directions[:1], (mesh.n_points, 1, 1)),
    )
    back = np.linalg.inv(shape)
    mapped = Metric.from_matrices(np.einsum("ki,nkl,lj->nij", back, metric.matrices, back))
    there = SimplexMesh(mesh.points @ shape.T, mesh.cells)
    expected = metric_qualities(mesh, metric)
    assert metric_qualities(there, mapped) == pytest.approx(expected, rel=1e-7)
    assert 0.0 < expected.min() < expected.max() < 1.0


def test_a_triangle_in_space_counts_the_metric_of_its_plane():
    turn = np.linalg.qr(np.random.default_rng(52).standard_normal((3, 3)))[0]
    flat = np.pad(np.array(REGULAR[2]) * [1.0, 10.0], ((0, 0), (0, 1)))
    mesh = SimplexMesh(flat @ turn.T, [[0, 1, 2]])
    metric = Metric(np.tile([1.0, 10.0, 0.3], (3, 1)), np.tile(turn, (3, 1, 1)))
    assert metric_qualities(mesh, metric) == pytest.approx(1.0)


def test_a_metric_that_does_not_fit_is_refused():
    mesh = two_region_rectangle(3)
    with pytest.raises(ValueError, match="metric must have 28 nodes in 2-D"):
        size_conformity(mesh, Metric.isotropic([1.0, 1.0], 2))
    with pytest.raises(ValueError, match="must be finite in all directions"):
        size_conformity(mesh, Metric.isotropic(np.full(28, np.inf), 2))
    surface = block(1).boundary().mesh
    with pytest.raises(ValueError, match="triangles in the plane or tetrahedra"):
        implied_metric(surface)
    with pytest.raises(ValueError, match="must not be flat"):
        implied_metric(SimplexMesh([[0, 0], [1, 0], [2, 0]], [[0, 1, 2]]))
