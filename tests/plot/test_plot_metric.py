"""Pictures of metrics: glyphs of the right shape, at nodes that are apart."""

import numpy as np
import pytest
from shapes import block, two_region_rectangle

from adaptsize import Metric, MetricFunction, SimplexMesh, isotropic_metric
from adaptsize.plot import plot_metric
from adaptsize.plot.ellipsoids import scene_of_metric

pytest.importorskip("pyvista")


@pytest.mark.parametrize(("mesh", "n_corners"), [(two_region_rectangle(8), 41), (block(6), 126)])
def test_glyphs_have_the_proportions_and_directions_of_the_sizes(mesh, n_corners):
    turn = np.linalg.qr(np.random.default_rng(88).standard_normal((mesh.dim, mesh.dim)))[0]
    sizes = np.array([0.1, 0.4, 0.7])[: mesh.dim]
    metric = Metric(np.tile(sizes, (mesh.n_points, 1)), np.tile(turn, (mesh.n_points, 1, 1)))
    scene = scene_of_metric(mesh, metric, 30, "auto")
    corners = scene.points.reshape(-1, n_corners, 3)[..., : mesh.dim]
    middle = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    along = np.abs((corners - middle[:, None]) @ turn).max(axis=1)
    # 14 columns do not meet every axis of an ellipsoid.
    assert along / along[:, -1:] == pytest.approx(
        np.tile(sizes / sizes[-1], (len(along), 1)), rel=0.04
    )
    assert np.allclose(scene.values, 0.1)
    assert 15 <= len(corners) <= 60


def test_glyphs_do_not_overlap():
    mesh = two_region_rectangle(20)
    metric = isotropic_metric(np.full(mesh.n_points, 0.3), 2)
    centres = scene_of_metric(mesh, metric, 100, None).points.reshape(-1, 41, 3)[:, 0]
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) + 10.0 * np.eye(len(centres))
    radius = np.linalg.norm(scene_of_metric(mesh, metric, 100, None).points[1] - centres[0])
    assert apart.min() > 2.0 * radius


def test_a_picture_is_drawn_also_without_a_bound_along_a_direction(tmp_path):
    mesh = two_region_rectangle(6)
    free = Metric(np.tile([0.1, np.inf], (mesh.n_points, 1)), [np.eye(2)] * mesh.n_points)
    image = plot_metric(MetricFunction(mesh, free), path=tmp_path / "metric.png", width=200)
    assert image.shape[1] == 200
    assert image.std() > 5.0
    assert (tmp_path / "metric.png").exists()


def test_bad_arguments_are_refused():
    mesh = two_region_rectangle(2)
    metric = isotropic_metric(np.ones(mesh.n_points), 2)
    with pytest.raises(ValueError, match="metric must be None with a MetricFunction"):
        plot_metric(MetricFunction(mesh, metric), metric)
    with pytest.raises(ValueError, match="metric must have 15 nodes"):
        plot_metric(mesh, metric[:2])
    with pytest.raises(ValueError, match="n_glyphs must be"):
        plot_metric(mesh, metric, n_glyphs=0)


def test_some_glyph_is_drawn_where_no_node_is_near_the_cut():
    mesh = SimplexMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    scene = scene_of_metric(mesh, isotropic_metric(np.full(4, 0.1), 3), 10_000, "y")
    assert len(scene.points) > 0


def test_metrics_with_the_same_limits_have_the_same_colours():
    mesh = two_region_rectangle(4)
    colours = []
    for size in (0.1, 0.2):
        metric = isotropic_metric(np.full(mesh.n_points, size), 2)
        picture = plot_metric(mesh, metric, limits=(0.1, 0.2), width=200)[:, :150]
        colours.append(picture[picture.min(axis=2) < 200].mean(axis=0))
    assert colours[0][0] + 100 < colours[1][0]  # purple, yellow
