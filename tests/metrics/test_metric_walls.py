"""`limit_metric` in plane domains that are not convex, against shortest paths in a polygon."""

import numpy as np
import pytest
from domains import l_shape, maze, slit_square, star_holes
from geodesics import distances, polygon
from metric_oracle import largest_ratio, limited_by_all, random_metric
from numpy.testing import assert_allclose

import adaptsize as ads
from adaptsize.metrics import Metric, limit_metric

G = 0.3
DOMAINS = {f.__name__: f for f in (slit_square, star_holes, maze, l_shape)}


def metric_on(mesh, decades=1.0, share=1.0):
    """Return sizes up to 30 in random directions, at some of the nodes."""
    rng = np.random.default_rng(1201)
    metric = random_metric(rng, mesh.n_points, 2, decades).scaled(30.0)
    free = rng.random(mesh.n_points) >= share
    return Metric(np.where(free[:, None], np.inf, metric.sizes), metric.directions)


@pytest.mark.parametrize("share", [1.0, 0.2])
@pytest.mark.parametrize("name", DOMAINS)
def test_equals_the_search_of_all_nodes_along_paths_in_the_domain(name, share):
    mesh, rings = DOMAINS[name](600)
    # Coarser meshes cut the corners off.
    assert mesh.measures.sum() == pytest.approx(polygon(rings).area)
    metric = metric_on(mesh, share=share)
    nodes = np.arange(0, mesh.n_points, 17)

    def distances_to(v):
        return distances(rings, mesh.points[v], mesh.points)

    expected = limited_by_all(mesh.points, metric, G, nodes, distances_to)
    found = limit_metric(mesh, metric, G)
    assert largest_ratio(found[nodes], expected) < 1e-10


def test_the_two_faces_of_a_slit_without_width_have_sizes_of_their_own():
    # Nodes of the slit x = 0, y > 0 are there twice: as 3, 4 to its left, 8, 9 to its right.
    points = [[-1, -1], [0, -1], [-1, 0], [-1, 1], [0, 1], [0, 0]]
    points += [[1, -1], [1, 0], [0, 1], [1, 1]]
    cells = [[0, 1, 5], [0, 5, 2], [2, 5, 4], [2, 4, 3], [1, 6, 5], [6, 7, 5], [5, 7, 9], [5, 9, 8]]
    mesh = ads.SimplexMesh(points, cells)
    sizes = np.full((10, 2), np.inf)
    sizes[4] = 0.1, 1.0
    metric = Metric(sizes, np.tile(np.eye(2), (10, 1, 1)))
    limited = limit_metric(mesh, metric, G)
    assert_allclose(limited.sizes[8], [0.1 + 2.0 * G, 1.0 + 2.0 * G], rtol=1e-12)
    assert_allclose(limited.sizes[9], np.array([0.1, 1.0]) + G * (1.0 + np.sqrt(2.0)), rtol=1e-12)


def test_a_component_without_a_bound_has_none():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = ads.SimplexMesh(
        np.vstack([square, square + np.array([3.0, 0.0])]), np.vstack([cells, cells + 4])
    )
    limited = limit_metric(mesh, Metric.isotropic(np.array([0.1] + [np.inf] * 7), 2), G)
    assert np.isfinite(limited.sizes[:4]).all()
    assert np.isinf(limited.sizes[4:]).all()
