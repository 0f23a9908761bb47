"""`remesh` with metrics of boundary layers that are much thinner than the cells of the mesh."""

import warnings

import numpy as np
import pytest

from adaptsize import (
    CartesianGrid,
    Metric,
    MetricFunction,
    SimplexMesh,
    metric_from_layers,
    remesh,
    size_conformity,
)
from adaptsize.quality.layers import first_layer
from adaptsize.remeshing import mmg

pytest.importorskip("mmgpy")


def turned_cube(dim, n, angle):
    """Return a square or cube, turned, and the normal of its lower side."""
    mesh = CartesianGrid([0.0] * dim, 1.0 / n, (n + 1,) * dim).mesh
    turn = np.eye(dim)
    turn[-2:, -2:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return SimplexMesh(mesh.points @ turn.T, mesh.cells), turn[:, -1]


def layers(normal, **options):
    def metric(x):
        return metric_from_layers(x @ normal, np.tile(normal, (len(x), 1)), **options)

    return metric


def made(mesh, metric):
    """Return the mesh and the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        new = remesh(mesh, metric, backend="mmg")
    return new, [str(one.message) for one in caught]


def is_told(new, metric, texts):
    """Whether the first layer is right, or the message says that it is not."""
    layer = first_layer(new, metric)
    words = "first layer is within", "requested elements are missing"
    return layer.share >= 0.9 or any(word in text for text in texts for word in words)


@pytest.mark.parametrize(
    ("first", "growth", "along", "angle"),
    [(1e-3, 1.2, 0.2, 0.0), (1e-5, 1.2, 0.2, 0.0), (1e-5, 1.2, 0.2, 0.7), (2e-5, 1.3, 0.1, 0.0)],
)
def test_layers_in_the_plane_are_reached(first, growth, along, angle):
    mesh, normal = turned_cube(2, 12, angle)
    metric = layers(normal, first_height=first, growth=growth, tangential=along)
    new, texts = made(mesh, metric)
    found, layer = size_conformity(new, metric), first_layer(new, metric)
    assert found.share_in_band > 0.85, found
    assert found.too_coarse < 0.05, found
    assert layer.share > 0.6
    assert 0.4 < layer.lowest < layer.highest < 2.0
    assert is_told(new, metric, texts), texts
    assert new.measures.sum() == pytest.approx(1.0, rel=1e-9)


def test_what_mmg_cannot_make_is_told_and_comes_near():
    mesh, normal = turned_cube(2, 12, 0.0)
    metric = layers(normal, first_height=1e-6, tangential=0.2)
    new, texts = made(mesh, metric)
    assert len(texts) == 1
    assert "metric: 8" in texts[0]
    assert "requested elements are missing" in texts[0]
    assert size_conformity(new, metric).worst.point[1] < 1e-4
    # Without steps 70 000 times as high as requested.
    assert first_layer(new, metric).highest < 20.0


def test_nodal_metrics_are_reached_or_told():
    mesh, normal = turned_cube(2, 12, 0.0)
    metric = layers(normal, first_height=1e-4, growth=1.5, tangential=0.3)(mesh.points)
    new, texts = made(mesh, metric)
    function = MetricFunction(mesh, metric)
    assert size_conformity(new, function).too_coarse < 0.1
    assert is_told(new, function, texts)


def test_layers_in_space_are_reached():
    mesh, normal = turned_cube(3, 2, 0.5)
    metric = layers(normal, first_height=1e-4, growth=2.0, tangential=0.5, max_aspect=1e4)
    new, texts = made(mesh, metric)
    found, layer = size_conformity(new, metric), first_layer(new, metric)
    assert found.too_coarse < 0.2, found
    assert layer.share > 0.5, layer
    assert is_told(new, metric, texts)
    assert new.measures.sum() == pytest.approx(1.0, rel=1e-6)


def test_no_run_is_added_where_the_first_mesh_serves_the_metric(monkeypatch):
    mesh, normal = turned_cube(2, 8, 0.3)
    metric = layers(normal, first_height=0.01, tangential=0.2)
    new = made(mesh, metric)[0]
    monkeypatch.setattr(mmg, "in_steps", lambda problem, best, run: best)
    before = made(mesh, metric)[0]
    assert np.array_equal(new.points, before.points)
    assert np.array_equal(new.cells, before.cells)


def test_a_layer_inside_that_lies_between_the_nodes_is_reached():
    mesh, fine = turned_cube(2, 4, 0.0)[0], turned_cube(2, 61, 0.0)[0]

    def layer(x):
        sizes = np.column_stack([np.full(len(x), 0.2), np.full(len(x), 0.2)])
        sizes[:, 1] = np.minimum(2e-3 + 0.3 * np.abs(x[:, 1] - 0.4), 0.2)
        return Metric(sizes, np.tile(np.eye(2), (len(x), 1, 1)))

    for metric in (layer, MetricFunction(fine, layer(fine.points))):
        new, texts = made(mesh, metric)
        missing = size_conformity(new, metric).too_coarse
        assert missing < 0.2 or any("requested elements are missing" in text for text in texts)
