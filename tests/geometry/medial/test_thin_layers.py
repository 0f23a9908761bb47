"""Thin layers of another region have their thickness; steps of voxels are no layers."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adaptsize import CartesianGrid, SimplexMesh, size_function
from adaptsize.geometry.medial.layers import half_thickness


def box(dim, heights, n=4):
    """Cells of (0, 1)^dim with layers of nodes at given heights along the last axis."""
    shape = (n + 1,) * (dim - 1) + (len(heights),)
    mesh = CartesianGrid([0.0] * dim, 1.0, shape).mesh
    points = mesh.points / n
    points[:, -1] = np.asarray(heights)[mesh.points[:, -1].round().astype(int)]
    return SimplexMesh(points, mesh.cells)


def with_regions(mesh, is_inside):
    """Regions 0 and 1 by the centroids of the cells."""
    return replace(mesh, cell_tags=is_inside(mesh.points[mesh.cells].mean(axis=1)).astype(np.int32))


def radii_of(mesh, angle=40.0):
    return half_thickness(mesh, crease_angle=angle)


HEIGHTS = [0.0, 0.25, 0.5, 0.52, 0.76, 1.0]
SHAPES = {
    "layer": (HEIGHTS, lambda x: np.abs(x[:, -1] - 0.51) < 0.01),
    "coating": ([0.0, 0.02, 0.3, 0.6, 1.0], lambda x: x[:, -1] < 0.02),
    "plate": (
        HEIGHTS,
        lambda x: (np.abs(x[:, -1] - 0.51) < 0.01) & (np.abs(x[:, :-1] - 0.5).max(axis=1) < 0.25),
    ),
}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("shape", SHAPES)
def test_nodes_of_a_layer_have_half_its_thickness(shape, dim):
    heights, is_inside = SHAPES[shape]
    mesh = with_regions(box(dim, heights), is_inside)
    found = radii_of(mesh)
    of_layer = np.unique(mesh.cells[mesh.cell_tags == 1])
    assert_allclose(found[of_layer], 0.01, rtol=0.01)
    assert np.isinf(np.delete(found, of_layer)).all()
    # Regions have no order, and the rest of the domain may have several.
    assert_array_equal(radii_of(replace(mesh, cell_tags=7 - 4 * mesh.cell_tags)), found)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_gap_between_a_curved_interface_and_the_boundary_is_a_layer(dim):
    # A wavy interface, 0.1 to 0.02 below the upper side.
    mesh = box(dim, [0.0, 0.4, 0.9, 1.0], 16)
    points = mesh.points.copy()
    low = np.isclose(points[:, -1], 0.9)
    points[low, -1] = 0.94 - 0.04 * np.cos(2.0 * np.pi * points[low, 0])
    mesh = with_regions(SimplexMesh(points, mesh.cells), lambda x: x[:, -1] > 0.9)
    found = radii_of(mesh)
    at = low & (np.abs(points[:, 0] - 0.5) < 1e-9)
    assert_allclose(found[at], 0.01, rtol=0.05)


VOXELS = {
    "ball": lambda x: np.linalg.norm(x - 0.5, axis=1) < 0.33,
    "diagonal": lambda x: np.abs((x - 0.5).sum(axis=1)) < 0.26,
    "slope": lambda x: x[:, -1] + 0.1 * x[:, 0] < 0.55,
    "noise": lambda x: np.sin(1e4 * (x @ [1.0, 1.7, 2.3][: x.shape[1]])) > 0.0,
    "block": lambda x: np.abs(x - 0.5).max(axis=1) < 0.26,
}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("shape", VOXELS)
def test_steps_of_voxels_are_no_layers(shape, dim):
    n = 12
    mesh = box(dim, np.linspace(0.0, 1.0, n + 1), n)
    mesh = with_regions(mesh, lambda x: VOXELS[shape]((np.floor(n * x) + 0.5) / n))
    assert 0 < mesh.cell_tags.sum() < mesh.n_cells
    assert np.isinf(radii_of(mesh)).all()


def test_without_regions_there_are_no_layers():
    mesh = box(2, HEIGHTS)
    assert np.isinf(radii_of(mesh)).all()
    assert np.isinf(radii_of(replace(mesh, cell_tags=np.ones(mesh.n_cells)))).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_size_function_puts_the_elements_across_a_layer(dim):
    mesh = with_regions(box(dim, HEIGHTS), SHAPES["layer"][1])
    options = {"hmax": 0.3, "elements_across": 4, "max_elements": 1e9}
    size = size_function(mesh, **options)
    at = np.isclose(mesh.points[:, -1], 0.5)
    assert_allclose(size.values[at], 0.02 / 4.0, rtol=0.01)
    plain = size_function(replace(mesh, cell_tags=None), **options)
    assert plain.values[at].min() > 0.1
