"""`Metric`: construction, refusals, and operations on single nodes."""

import numpy as np
import pytest
from metric_oracle import excess, largest_inscribed, largest_ratio, random_metric, random_rotations
from numpy.testing import assert_allclose, assert_array_equal

import adaptsize as ads
from adaptsize.metrics import Metric

DECADES = [0.0, 1e-8, 0.1, 1.0, 3.0, 6.0]  # condition numbers of M up to 1e12


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("decades", DECADES)
def test_matrices_and_back(dim, decades):
    metric = random_metric(np.random.default_rng(7), 50, dim, decades)
    again = Metric.from_matrices(metric.matrices)
    condition = metric.aspect_ratio.max() ** 2
    assert_allclose(again.sizes, metric.sizes, rtol=1e-15 * condition + 1e-13)


def test_lengths_are_the_inverse_root_of_the_matrices():
    metric = random_metric(np.random.default_rng(11), 20, 3, 1.0)
    length = metric.lengths
    identity = np.broadcast_to(np.eye(3), length.shape)
    assert_allclose(length @ metric.matrices @ length, identity, atol=1e-12)
    with pytest.raises(ValueError, match=r"sizes must be finite for `lengths`, got sizes\[1, 0\]"):
        _ = Metric.isotropic([1.0, np.inf], 2).lengths


def test_size_along_is_the_length_of_unit_edges():
    rng = np.random.default_rng(13)
    metric, u = random_metric(rng, 30, 3, 2.0), rng.normal(size=(30, 3))
    size = metric.size_along(u)
    edge = size[:, None] * u / np.linalg.norm(u, axis=1)[:, None]
    assert_allclose(np.einsum("ni,nij,nj->n", edge, metric.matrices, edge), 1.0, rtol=1e-9)
    assert_array_equal(Metric.isotropic([np.inf], 2).size_along([3.0, 4.0]), [np.inf])


def test_edge_lengths_integrate_a_geometric_size():
    # h = 0.1 * 4^x between two points at distance 1: the integral of 1 / h.
    metric = Metric.isotropic([0.1, 0.4, 0.1], 2)
    points = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    found = metric.edge_lengths(points, [[0, 1], [0, 2], [1, 1]])
    assert_allclose(found, [7.5 / np.log(4.0), 10.0, 0.0], rtol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_complexity_is_the_volume_in_the_metric(dim):
    points = np.vstack([np.zeros(dim), np.eye(dim)])
    mesh = ads.SimplexMesh(points, [np.arange(dim + 1)])
    sizes = np.linspace(0.1, 0.3, dim)
    metric = Metric(
        np.tile(sizes, (dim + 1, 1)), random_rotations(np.random.default_rng(3), dim + 1, dim)
    )
    assert_allclose(metric.complexity(mesh), mesh.measures[0] / sizes.prod())


def test_clip_limits_sizes_and_then_the_aspect_ratio():
    metric = Metric([[0.001, 5.0]], [np.eye(2)])
    assert_allclose(metric.clip(hmin=0.01, hmax=2.0).sizes, [[0.01, 2.0]])
    assert_allclose(metric.clip(hmin=0.01, max_aspect=10.0).sizes, [[0.01, 0.1]])
    wide = metric.clip(hmin=1e60, max_aspect=1e15)
    assert_allclose(wide.sizes, 1e60)
    with pytest.raises(ValueError, match="hmin must be at most hmax = 1, got 2"):
        metric.clip(2.0, 1.0)


def test_interpolation_is_geometric_and_keeps_nodal_values():
    metric = random_metric(np.random.default_rng(17), 6, 3, 3.0)
    mean = metric.interpolate([[0, 1, 2]], [[0.2, 0.3, 0.5]])
    logs = np.log(metric.density[:3]) @ [0.2, 0.3, 0.5]
    assert_allclose(np.log(mean.density), logs)
    assert largest_ratio(metric.interpolate([[4, 1]], [[1.0, 0.0]]), metric[[4]]) < 1e-9
    free = Metric.isotropic([0.5, np.inf], 2)
    assert_array_equal(free.interpolate([[0, 1]], [[1.0, 0.0]]).sizes, [[0.5, 0.5]])
    assert_array_equal(free.interpolate([[0, 1]], [[0.5, 0.5]]).sizes, [[np.inf, np.inf]])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("decades", DECADES)
def test_the_intersection_of_two_touches_both(dim, decades):
    rng = np.random.default_rng(19)
    a, b = (random_metric(rng, 200, dim, decades) for _ in range(2))
    both = a.intersect(b)
    over = [excess(both, m.sizes, m.directions) for m in (a, b)]
    assert_allclose(np.maximum(*over), 1.0, rtol=1e-9)
    assert largest_ratio(both, b.intersect(a)) < 1e-9


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("decades", [0.1, 1.0, 3.0, 6.0])
def test_several_are_intersected_in_any_order(dim, decades):
    rng = np.random.default_rng(31)
    parts = [random_metric(rng, 300, dim, decades) for _ in range(5)]
    joint, back = parts[0].intersect(*parts[1:]), parts[4].intersect(*parts[3::-1])
    assert largest_ratio(joint, back) < (1e-9 if dim == 2 else 1e-5)
    for part in parts:
        assert excess(joint, part.sizes, part.directions).max() <= 1.0 + 1e-9
    pairwise = parts[0]
    for part in parts[1:]:
        pairwise = pairwise.intersect(part)
    assert (joint.density <= pairwise.density * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_intersection_of_several_has_the_least_density(dim):
    rng = np.random.default_rng(37)
    for _ in range(5):
        parts = [random_metric(rng, 1, dim, 0.7) for _ in range(4)]
        found = np.log(parts[0].intersect(*parts[1:]).density[0])
        best, slack = largest_inscribed(parts)
        assert abs(found - best) < 1e-5 + 10.0 * max(0.0, -slack)


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        ([[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.2], [0.1, 1.0]]], r"symmetric, got matrices\[1\]"),
        ([[[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 0.0]]], r"definite, got matrices\[1\]"),
        ([[[1.0, 0.0], [0.0, -1.0]]], r"positive definite, got matrices\[0\]"),
    ],
)
def test_matrices_that_are_no_metric_are_refused_by_node(matrices, message):
    with pytest.raises(ValueError, match=message):
        Metric.from_matrices(matrices)


def test_metrics_are_read_only_and_stay_so():
    metric = random_metric(np.random.default_rng(43), 4, 2, 1.0)
    for same in (metric, metric[1:]):  # and those of `tests/test_pickling.py`
        with pytest.raises(ValueError, match="read-only"):
            same.sizes[0, 0] = 1.0
    assert len(metric[np.array([True, False, True, False])]) == 2
    assert metric[[3]].sizes.shape == (1, 2)
