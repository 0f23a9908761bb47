"""Requested elements of metrics that are served, against a slow count of random points."""

import numpy as np
import pytest
from meshes import jittered_cube

from adaptsize import CartesianGrid, Metric, MetricFunction, SimplexMesh, size_conformity
from adaptsize.quality.layers import first_layer


def grid_of_triangles(n):
    return CartesianGrid([0.0, 0.0], 1.0 / n, (n + 1, n + 1)).mesh


def rotation(dim, seed):
    directions = np.linalg.qr(np.random.default_rng(seed).standard_normal((dim, dim)))[0]
    return directions * np.sign(np.linalg.det(directions))


def layers_beside(normal, at, least, along):
    """Return the metric of layers beside a plane, as a function."""
    frame = rotation(len(normal), 3)
    frame[:, 0] = normal
    frame = np.linalg.qr(frame)[0]

    def metric(x):
        across = np.minimum(least + 0.3 * np.abs(x @ normal - at), along)
        sizes = np.full(x.shape, along)
        sizes[:, 0] = across
        return Metric(sizes, np.broadcast_to(frame, (len(x), *frame.shape)))

    return metric


def judged_slowly(mesh, metric, n, seed):
    """Return the shares served and too coarse, of n points in each cell: the definition."""
    rng, d = np.random.default_rng(seed), mesh.cell_dim
    corners = mesh.points[mesh.cells]
    share = rng.dirichlet(np.ones(d + 1), (len(corners), n))
    there = metric(np.einsum("cnv,cvd->cnd", share, corners).reshape(-1, mesh.dim))
    matrices = there.matrices.reshape(len(corners), n, d, d)
    lengths = [
        np.sqrt(np.einsum("ci,cnij,cj->cn", e, matrices, e))
        for i in range(d + 1)
        for e in (corners[:, i] - corners[:, j] for j in range(i))
    ]
    mean = np.mean(lengths, axis=0)
    weight = mesh.measures[:, None] * there.density.reshape(mean.shape)
    near = (mean >= np.sqrt(0.5)) & (mean <= np.sqrt(2.0))
    return [float(weight[which].sum() / weight.sum()) for which in (near, mean > np.sqrt(2.0))]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["function", "on a mesh"])
def test_shares_are_those_of_random_points(dim, kind):
    mesh = grid_of_triangles(9) if dim == 2 else jittered_cube(3, 5)
    mesh = SimplexMesh(mesh.points / np.ptp(mesh.points, axis=0), mesh.cells)
    metric = layers_beside(
        rotation(dim, 8)[:, 0], 0.2, 0.15 if dim == 3 else 0.05, 0.6 if dim == 3 else 0.15
    )
    if kind == "on a mesh":
        fine = grid_of_triangles(12) if dim == 2 else jittered_cube(4, 6)
        fine = SimplexMesh(fine.points / np.ptp(fine.points, axis=0), fine.cells)
        metric = MetricFunction(fine, metric(fine.points))
    found = size_conformity(mesh, metric)
    served, coarse = judged_slowly(mesh, metric, 400, 1)
    assert 0.05 < coarse < 0.95
    # Parts are represented by their centroids.
    assert found.served == pytest.approx(served, abs=0.08)
    assert found.too_coarse == pytest.approx(coarse, abs=0.08)


@pytest.mark.parametrize("kind", ["function", "nodal"])
def test_a_layer_that_was_not_made_is_missed(kind):
    mesh = grid_of_triangles(10)
    metric = layers_beside(np.array([0.0, 1.0]), 0.0, 1e-5, 0.1)
    found = size_conformity(mesh, metric if kind == "function" else metric(mesh.points))
    assert found.share_in_band > 0.7  # the edges know nothing of it
    assert found.too_coarse > 0.75
    assert found.worst.point[1] < 5e-3
    assert found.worst.ratio > 1000.0
    assert "too coarse; worst: edge" in str(found)


def test_a_layer_between_the_nodes_is_missed():
    coarse, fine = grid_of_triangles(5), grid_of_triangles(51)
    metric = layers_beside(np.array([0.0, 1.0]), 0.5, 0.002, 0.2)
    found = size_conformity(coarse, MetricFunction(fine, metric(fine.points)))
    assert found.too_coarse > 0.6
    assert found.worst.point[1] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("factor", "share"), [(1.0, 1.0), (1.4, 1.0), (1.6, 0.0), (0.6, 0.0)])
def test_heights_of_a_structured_layer(dim, factor, share):
    mesh = CartesianGrid([0.0] * dim, 1.0 / 4, (5,) * dim).mesh
    turn, stretch = rotation(dim, 12), np.ones(dim)
    stretch[-1] = 0.004 * factor
    mesh = SimplexMesh((mesh.points * stretch) @ turn.T, mesh.cells)
    sizes = np.full(dim, 0.25)
    sizes[-1] = 0.001

    def metric(x):
        return Metric(np.tile(sizes, (len(x), 1)), np.tile(turn, (len(x), 1, 1)))

    found = first_layer(mesh, metric)
    assert found.share == share
    assert (found.lowest, found.highest) == (pytest.approx(factor), pytest.approx(factor))
    assert found.height == pytest.approx(0.001 * factor)
    assert first_layer(mesh, lambda x: Metric.isotropic(np.full(len(x), 0.25), dim)) is None
