"""`remesh` with a metric: lengths in all directions, frames, tags, and what is refused."""

from functools import cache

import numpy as np
import pytest
from shapes import block, two_region_block, two_region_rectangle

from adaptsize import Metric, SimplexMesh, remesh, size_conformity
from adaptsize.metrics import MetricFunction
from adaptsize.metrics.implied import implied_metric

pytest.importorskip("mmgpy")


def turned(dim):
    """A rotation without zeros, so that each entry of a matrix matters."""
    rng = np.random.default_rng(20261122)
    directions = np.linalg.qr(rng.standard_normal((dim, dim)))[0]
    return directions * np.sign(np.linalg.det(directions))


def constant(sizes, directions, n):
    return Metric(np.tile(sizes, (n, 1)), np.tile(directions, (n, 1, 1)))


JOBS = {
    "plane": (two_region_rectangle(8), [0.03, 0.15]),
    "tetrahedra": (block(4), [0.06, 0.12, 0.3]),
}


@cache
def made(job):
    mesh, sizes = JOBS[job]
    metric = constant(sizes, turned(mesh.dim), mesh.n_points)
    return remesh(mesh, metric, backend="mmg")


@pytest.mark.parametrize("job", JOBS)
def test_edges_have_the_requested_length_in_every_direction(job):
    mesh, sizes = JOBS[job]
    new = made(job)
    metric = constant(sizes, turned(mesh.dim), new.n_points)
    conformity = size_conformity(new, metric)
    # Measured .97 and .88.  With two entries of the matrices exchanged: below .65.
    assert conformity.share_in_band > 0.8, conformity
    assert conformity.edges.q50 == pytest.approx(1.0, rel=0.12)
    # Lengths of the edges along each direction, not in the metric.
    along = np.abs((new.points[new.edges[:, 1]] - new.points[new.edges[:, 0]]) @ turned(mesh.dim))
    for axis, size in enumerate(sizes):
        mainly = along[:, axis] / size > 0.95 * np.linalg.norm(along / sizes, axis=1)
        assert np.median(along[mainly, axis]) == pytest.approx(size, rel=0.2)
    # Measured .97 and 1.5 cells per cell that the complexity predicts.
    given = constant(sizes, turned(mesh.dim), mesh.n_points)
    assert 0.8 < new.n_cells / given.predicted_elements(mesh) < 1.7


def test_a_surface_is_stretched_along_its_axis():
    sphere_free = block(4).boundary().mesh  # the faces of a cube
    sizes, directions = [0.05, 0.2, 0.2], np.eye(3)
    new = remesh(sphere_free, constant(sizes, directions, sphere_free.n_points), target="triangles")
    along = np.abs(new.points[new.edges[:, 1]] - new.points[new.edges[:, 0]])
    x, y = along[:, 0] > 3.0 * along[:, 1:].sum(axis=1), along[:, 1] > 0.99 * along.sum(axis=1)
    assert np.median(along[x, 0]) == pytest.approx(0.05, rel=0.3)
    assert np.median(along[y, 1]) == pytest.approx(0.2, rel=0.3)
    assert new.is_closed


@pytest.mark.parametrize("mesh", [two_region_rectangle(4), two_region_block(2)])
def test_tags_and_interfaces_are_kept(mesh):
    sizes = [0.2, 0.5, 0.5][: mesh.dim]
    new = remesh(mesh, constant(sizes, np.eye(mesh.dim), mesh.n_points))
    for tag in np.unique(mesh.cell_tags):
        of_old, of_new = mesh.cell_tags == tag, new.cell_tags == tag
        assert new.measures[of_new].sum() == pytest.approx(mesh.measures[of_old].sum(), rel=1e-9)
    assert np.array_equal(np.unique(new.facet_tags), np.unique(mesh.facet_tags))


def layer(points):
    """Sizes across and along a layer at x = .5 that is much thinner than the cells of the mesh."""
    across = 0.002 + 0.2 * np.abs(points[:, 0] - 0.5)
    sizes = np.column_stack([np.minimum(across, 0.2), np.full(len(points), 0.2)])
    return Metric(sizes, np.tile(np.eye(2), (len(points), 1, 1)))


def test_a_function_is_read_anew_until_the_mesh_has_its_sizes():
    mesh = two_region_rectangle(4)
    new = remesh(mesh, layer)
    conformity = size_conformity(new, layer)
    assert conformity.share_in_band > 0.85, conformity
    thin = implied_metric(new).aspect_ratio
    assert 60.0 < thin.max() < 200.0  # 100 requested
    assert conformity.metric.largest_aspect == pytest.approx(thin.max())
    # A metric on another mesh is interpolated.
    other = remesh(mesh, MetricFunction(new, layer(new.points)))
    assert size_conformity(other, layer).share_in_band > 0.8


def test_what_cannot_be_made_is_refused():
    mesh = two_region_rectangle(2)
    metric = constant([0.1, 0.2], np.eye(2), mesh.n_points)
    with pytest.raises(ValueError, match="strict must be False with a Metric"):
        remesh(mesh, metric, strict=True)
    with pytest.raises(ValueError, match=r"metric must have 15 nodes in 2-D"):
        remesh(mesh, metric[:3])
    free = constant([0.1, np.inf], np.eye(2), mesh.n_points)
    with pytest.raises(ValueError, match="must be finite in all directions"):
        remesh(mesh, free)
    with pytest.raises(ValueError, match=r"size\(points\) must be a Metric with 15 nodes"):
        remesh(mesh, lambda x: metric[:1])
    surface = block(1).boundary().mesh
    of_surface = Metric.isotropic(np.full(surface.n_points, 0.2), 3)
    solid = block(1)
    metric = Metric.isotropic(np.full(solid.n_points, 0.2), 3)
    with pytest.raises(ValueError, match="backend 'tetwild' cannot follow a Metric"):
        remesh(solid, metric, backend="tetwild")
    with pytest.raises(ValueError, match="must not be a Metric for a surface to be filled"):
        remesh(surface, of_surface)


def test_scaled_parts_get_the_same_mesh():
    # Mmg sees the same numbers, up to rounding: the frame takes the scale out of the metric.
    scale, (mesh, sizes) = 1e-6, JOBS["plane"]
    small = SimplexMesh(scale * mesh.points + 7.0 * scale, mesh.cells)
    metric = constant(scale * np.array(sizes), turned(2), mesh.n_points)
    new = remesh(small, metric, backend="mmg")
    assert new.n_cells == pytest.approx(made("plane").n_cells, rel=0.1)
