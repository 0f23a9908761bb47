"""The number of triangles that Mmg makes of a plane mesh and sizes."""

import numpy as np
import pytest
from meshes import structured_square
from partitions import on_ranks, partition

from adaptsize import adapt
from adaptsize.sizes.budget import count_elements
from adaptsize.sizes.made import triangles_by_mmg

N = 20


def square():
    return structured_square(N, half_width=0.5)


def own_size(mesh):
    """The edge of regular triangles as large as those of the mesh."""
    return np.sqrt(4.0 / np.sqrt(3.0) * mesh.measures[0])


@pytest.mark.parametrize("ratio", [0.97, 1.0, 1.1])
def test_cells_that_nearly_have_their_sizes_are_counted_as_they_are(ratio):
    mesh = square()
    h = np.full(mesh.n_points, ratio * own_size(mesh))
    assert triangles_by_mmg(mesh, h) == pytest.approx(mesh.n_cells)


@pytest.mark.parametrize("ratio", [0.3, 0.6, 1.5, 4.0])
def test_cells_far_from_their_sizes_are_counted_as_new_ones(ratio):
    mesh = square()
    h = np.full(mesh.n_points, ratio * own_size(mesh))
    assert triangles_by_mmg(mesh, h) == pytest.approx(0.89 * count_elements(mesh, h))


def test_the_number_of_new_ones_grows_with_the_gradient():
    mesh = square()
    h = 1.0 + 0.3 * mesh.points[:, 0]
    made = triangles_by_mmg(mesh, h)
    assert made == pytest.approx((0.89 + 1.1 * 0.3) * count_elements(mesh, h))


def test_cells_that_stay_are_counted_whatever_their_sizes():
    mesh = square()
    h = np.full(mesh.n_points, 4.0 * own_size(mesh))
    stays = mesh.points[mesh.cells].mean(axis=1)[:, 0] < 0.0
    new = 0.5 * 0.89 * count_elements(mesh, h)
    assert triangles_by_mmg(mesh, h, stays) == pytest.approx(0.5 * mesh.n_cells + new)


def test_parts_count_together():
    mesh = square()
    h = 0.03 + 0.1 * np.abs(mesh.points[:, 0])
    parts = partition(mesh, "random", 3, np.random.default_rng(91))
    found, _ = on_ranks(mesh, parts, 3, lambda part: triangles_by_mmg(part, h[part.global_ids]))
    assert found == pytest.approx([triangles_by_mmg(mesh, h)] * 3)


@pytest.mark.parametrize("share", [0.8, 0.85, 0.9, 1.2])
def test_one_mesh_has_the_number_where_mmg_keeps_many_cells(share):
    """With the integral of the density alone, it takes two."""
    pytest.importorskip("mmgpy")

    def around(points):
        return 0.01 + 0.2 * np.linalg.norm(points - 0.1, axis=1)

    mesh = structured_square(20, half_width=0.5)
    for _ in range(2):
        mesh = adapt(mesh, h0=around, enough=2.0).mesh
    number = round(share * mesh.n_cells)
    result = adapt(mesh, h0=around, elements=number, enough=2.0)
    assert result.mesh.n_cells == pytest.approx(number, rel=0.05)
    assert result.report.n_meshes == 1
